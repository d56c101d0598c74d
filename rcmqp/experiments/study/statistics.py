"""Means with intervals, and effect sizes with Monte-Carlo errors.

The people of a study are drawn from a model, as many as one likes. So there is no p value here:
with enough draws any difference is "significant", and with few of them none is. What a study can
say is how large an effect is in the model, and how exactly the draws made so far give it. Neither
says anything about real people.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.maths.dualquaternion import Array

CONFIDENCE = 0.95

FEWEST = 5
"""People from which on a mean has an interval."""


@dataclass(frozen=True, slots=True)
class Summary:
    """A sample in a few numbers.

    Attributes:
        count: how many there are.
        mean: their mean.
        deviation: sample standard deviation, with n - 1; NaN for one.
        error: Monte-Carlo error of the mean, deviation / sqrt(n); NaN for one.
        low, high: interval of the mean at 95 % confidence, Student's t; NaN for less than FEWEST,
            where it would be wider than what is measured can be.
        least, largest: of them.
    """

    count: int
    mean: float
    deviation: float
    error: float
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
        return Summary(0, nan, nan, nan, nan, nan, nan, nan)
    mean, least, largest = (float(f(sample)) for f in (np.mean, np.min, np.max))
    if n == 1:
        return Summary(1, mean, nan, nan, nan, nan, least, largest)
    deviation = float(np.std(sample, ddof=1))
    error = deviation / float(np.sqrt(n))
    wide = float(stdtrit(n - 1, 0.5 + CONFIDENCE / 2.0)) if n >= FEWEST else nan
    half = wide * error
    return Summary(n, mean, deviation, error, mean - half, mean + half, least, largest)


@dataclass(frozen=True, slots=True)
class Effect:
    """How two samples of the same people differ.

    Attributes:
        change: of the second from the first, person by person; ``change.error`` is the
            Monte-Carlo error of its mean.
        size: effect size, the mean change over the root mean square of the two samples'
            deviations (Cohen's d_av); NaN for one person, and where nobody differs from anybody.
        size_error: its Monte-Carlo error, by the jackknife; NaN below three people.
    """

    change: Summary
    size: float
    size_error: float


def effect(first: ArrayLike, second: ArrayLike) -> Effect:
    """Compare two samples (n,), the same people in the same order.

    A person with NaN in one of the samples does not count.

    The size is relative to how much people differ, not to how much the change varies between
    them: a change that is tiny but the same for all is a small effect.
    """
    pairs = np.column_stack([np.asarray(first, dtype=float), np.asarray(second, dtype=float)])
    pairs = pairs[~np.isnan(pairs).any(axis=1)]
    n = len(pairs)
    without = np.array([_size(np.delete(pairs, i, axis=0)) for i in range(n if n > 2 else 0)])
    spread = float(np.sum((without - without.mean()) ** 2)) if n > 2 else float("nan")
    error = float(np.sqrt((n - 1) / n * spread)) if n > 2 else float("nan")
    return Effect(summary(pairs[:, 1] - pairs[:, 0]), _size(pairs), error)


def _size(pairs: Array) -> float:
    """Cohen's d_av of pairs (n, 2)."""
    if len(pairs) < 2:
        return float("nan")
    deviation = float(np.sqrt(np.mean(np.var(pairs, axis=0, ddof=1))))
    mean = float(np.mean(pairs[:, 1] - pairs[:, 0]))
    return mean / deviation if deviation > 0.0 else float("nan")
