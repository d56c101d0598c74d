"""Means with intervals, and paired comparisons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Summary:
    """A sample in a few numbers.

    Attributes:
        count: how many there are.
        mean: their mean.
        deviation: sample standard deviation, with n - 1; NaN for one.
        low, high: interval of the mean at 95 % confidence, Student's t; NaN for one.
        least, largest: of them.
    """

    count: int
    mean: float
    deviation: float
    low: float
    high: float
    least: float
    largest: float


def summary(values: ArrayLike) -> Summary:
    """Sum up a sample (n,); NaN in it does not count."""
    from scipy.special import stdtrit  # SciPy takes long to import

    sample = np.asarray(values, dtype=float)
    sample = sample[~np.isnan(sample)]
    n, nan = len(sample), float("nan")
    if n == 0:
        return Summary(0, nan, nan, nan, nan, nan, nan)
    mean, least, largest = (float(f(sample)) for f in (np.mean, np.min, np.max))
    if n == 1:
        return Summary(1, mean, nan, nan, nan, least, largest)
    deviation = float(np.std(sample, ddof=1))
    half = float(stdtrit(n - 1, 0.5 + CONFIDENCE / 2.0)) * deviation / float(np.sqrt(n))
    return Summary(n, mean, deviation, mean - half, mean + half, least, largest)


@dataclass(frozen=True, slots=True)
class Paired:
    """A comparison of two samples taken on the same people.

    Attributes:
        difference: of the second from the first; its mean, interval, and so on.
        p_t: two-sided p value of the paired t test.
        p_signed_rank: of Wilcoxon's signed-rank test, which does not take the differences for
            normally distributed.
    """

    difference: Summary
    p_t: float
    p_signed_rank: float


def paired(first: ArrayLike, second: ArrayLike) -> Paired:
    """Compare two samples (n,), the same people in the same order.

    Who is NaN in one of them does not count. p values are NaN for fewer than two people, and 1
    where no one differs.
    """
    from scipy import stats  # SciPy takes long to import

    change = np.asarray(second, dtype=float) - np.asarray(first, dtype=float)
    change = change[~np.isnan(change)]
    found, nan = summary(change), float("nan")
    if len(change) < 2:
        return Paired(found, nan, nan)
    if not change.any():
        return Paired(found, 1.0, 1.0)
    if np.ptp(change) <= 1e-12 * np.abs(change).max():  # all by the same: t is infinite
        return Paired(found, 0.0, float(stats.wilcoxon(change).pvalue))
    t = float(stats.ttest_1samp(change, 0.0).pvalue)
    return Paired(found, t, float(stats.wilcoxon(change).pvalue))


def least_rank_p(count: int) -> float:
    """The least two-sided p value of the signed-rank test: ``count`` changes of one sign."""
    return min(1.0, 2.0 ** (1 - count))


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's correction of p values for their number; NaN stays NaN."""
    p = np.asarray(p_values, dtype=float)
    order = [i for i in np.argsort(p) if not np.isnan(p[i])]
    corrected, most = [float("nan")] * len(p), 0.0
    for rank, i in enumerate(order):
        most = max(most, min(1.0, float((len(order) - rank) * p[i])))
        corrected[i] = most
    return corrected
