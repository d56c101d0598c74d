"""Numbers that sum up a run."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rcmqp import dualquaternion as dq
from rcmqp.contour import Contour
from rcmqp.dualquaternion import Array
from rcmqp.extent import Extent, percentile
from rcmqp.jerk import JerkRatio
from rcmqp.run import Run
from rcmqp.run_file import Recording
from rcmqp.scene import clearance

SATURATED = 1.0 - 1e-6
"""Share of a limit from which on a joint counts as saturated."""

ROUNDING = 1e-9
"""Excess of a limit that is none [1], [rad]."""

SMALL = 1e-4
"""Below it, decimal places say too little of a number."""


@dataclass(frozen=True, slots=True)
class Metrics:
    """Errors, limits and times of a run, over all its sampling instants.

    Names end in their unit. rms is the root of the mean square, p95 the 95th percentile. The tip
    and the effector, which is the point of the shaft that lay on the trocar at the start, are
    compared with where they were asked to be at the same instant, before the step; the RCM error
    is the distance from the trocar to the shaft's axis.

    Attributes:
        contour_rms_mm, contour_max_mm: distance of the tip from its path, the curve of the desired
            tip seen from the trocar, whenever it was asked to be there; see Contour.
        lag_max_s: how late the tip is on its path, whether it falls behind the reference or a
            governor slows the reference down; see Contour.
        depth_min_mm, depth_max_mm: insertion depth of the tip beyond the trocar.
        tilt_max_mrad: largest angle of the shaft from the trocar's axis.
        speed_ratio_max: largest joint speed commanded over its limit; above 1, a limit is broken.
        acceleration_ratio_max: largest change of a commanded joint speed from one cycle to the
            next, from rest at first, over the period and the limit; likewise. NaN on arms without
            acceleration limits.
        jerk_ratio_max: largest change of that change, over the period squared and the jerk limit;
            likewise.
        saturated_share: of the cycles, those in which a joint is commanded at its limit of speed
            or of acceleration, or above.
        limit_margin_min_rad: least distance of a joint from a position limit; negative outside.
        obstacle_distance_min_mm: least distance of the instrument from an obstacle, from surface
            to surface; negative inside one, inf where there is none.
        singular_value_min: least singular value of the effector's geometric Jacobian [m, rad].
        tip_speed_rms_mm_s: of the desired tip; the law's lag is this over K.
    """

    tip_rms_mm: float
    tip_max_mm: float
    tip_p95_mm: float
    contour_rms_mm: float
    contour_max_mm: float
    lag_max_s: float
    effector_rms_mm: float
    effector_max_mm: float
    effector_p95_mm: float
    rcm_rms_mm: float
    rcm_max_mm: float
    rcm_p95_mm: float
    orientation_rms_mrad: float
    orientation_max_mrad: float
    orientation_p95_mrad: float
    depth_min_mm: float
    depth_max_mm: float
    tilt_max_mrad: float
    speed_ratio_max: float
    acceleration_ratio_max: float
    jerk_ratio_max: float
    saturated_share: float
    limit_margin_min_rad: float
    obstacle_distance_min_mm: float
    singular_value_min: float
    tip_speed_rms_mm_s: float
    solve_time_median_us: float
    solve_time_p99_us: float


def compute_metrics(run: Recording) -> Metrics:
    """Sum up a run, or a run's file, a part at a time: the same numbers to the bit."""
    contour = Contour(run)
    found: defaultdict[str, Extent] = defaultdict(Extent)
    before: Run | None = None
    jerk = JerkRatio()
    for part in run.parts():
        found["jerk_ratio"].add(jerk.of(part))
        for name, channel in (_measures(part, before) | contour.measure(part)).items():
            found[name].add(channel)
        before = part
    has_limit = np.isfinite(part.acceleration_limit).any()
    has_jerk_limit = np.isfinite(part.jerk_limit).any()
    values = {
        **_summary(run, "tip", "mm", found),
        "contour_rms_mm": 1e3 * found["contour"].rms,
        "contour_max_mm": 1e3 * found["contour"].high,
        "lag_max_s": found["lag"].high,
        **_summary(run, "effector", "mm", found),
        **_summary(run, "rcm", "mm", found),
        **_summary(run, "orientation", "mrad", found),
        "depth_min_mm": 1e3 * found["depth"].low,
        "depth_max_mm": 1e3 * found["depth"].high,
        "tilt_max_mrad": 1e3 * found["tilt"].high,
        "speed_ratio_max": found["speed_ratio"].high,
        "acceleration_ratio_max": found["acceleration_ratio"].high if has_limit else np.nan,
        "jerk_ratio_max": found["jerk_ratio"].high if has_jerk_limit else np.nan,
        "saturated_share": found["saturated"].mean_square,
        "limit_margin_min_rad": found["margin"].low,
        "obstacle_distance_min_mm": 1e3 * found["obstacle"].low,
        "singular_value_min": found["singular_value"].low,
        "tip_speed_rms_mm_s": 1e3 * found["tip_speed"].rms,
        "solve_time_median_us": 1e6 * percentile(run.column("solve_time"), 50),
        "solve_time_p99_us": 1e6 * percentile(run.column("solve_time"), 99),
    }
    return Metrics(**{name: float(value) for name, value in values.items()})


def _measures(part: Run, before: Run | None) -> dict[str, Array]:
    """What is summed up of a part of a run; the part before it is None at the start, at rest."""
    v = np.zeros_like(part.v[:1]) if before is None else before.v[-1:]
    tip_d = part.tip_d[:0] if before is None else before.tip_d[-1:]
    speed_ratio = np.abs(part.v / part.velocity_limit).max(axis=-1)
    acceleration = np.abs(np.diff(part.v, axis=0, prepend=v)) / part.period
    acceleration_ratio = (acceleration / part.acceleration_limit).max(axis=-1)
    tip_velocity = np.diff(np.concatenate([tip_d, part.tip_d]), axis=0) / part.period
    errors = ("tip", "effector", "rcm", "orientation")
    return {
        **{name: getattr(part, f"{name}_error") for name in errors},
        **{name: getattr(part, name) for name in ("depth", "tilt", "singular_value")},
        "speed_ratio": speed_ratio,
        "acceleration_ratio": acceleration_ratio,
        "saturated": np.maximum(speed_ratio, acceleration_ratio) >= SATURATED,
        "margin": np.minimum(part.angles - part.lower, part.upper - part.angles),
        "obstacle": obstacle_distance(part),
        "tip_speed": np.linalg.norm(tip_velocity, axis=-1),
    }


def readable(value: float, style: str) -> str:
    """A number for people: one too small for decimal places has three significant digits."""
    return format(value, ".3g" if 0.0 < abs(value) < SMALL else style)


def against_limit(ratio: float, style: str = ".3g", *, assumed: bool = False) -> str:
    """A ratio to a limit, for people: "no limit" where there is none and the ratio is NaN.

    A limit that nobody has given is said to be assumed.
    """
    mark = " (assumed)" if assumed else ""
    return "no limit" if np.isnan(ratio) else readable(ratio, style) + mark


def obstacle_distance(run: Run) -> Array:
    """Distance (n,) of the instrument from the nearest obstacle [m], see scene.clearance()."""
    shaft = dq.rotate(dq.P(run.x), np.array([0.0, 0.0, 1.0]))
    return clearance(run.scenario.obstacles, run.scenario.instrument, run.tip, shaft)


def _summary(
    run: Recording, name: str, unit: str, found: Mapping[str, Extent]
) -> dict[str, float]:
    """rms, largest and 95th percentile of an error, in a thousandth of its unit."""
    return {
        f"{name}_rms_{unit}": 1e3 * found[name].rms,
        f"{name}_max_{unit}": 1e3 * found[name].high,
        f"{name}_p95_{unit}": 1e3 * percentile(run.column(f"{name}_error"), 95),
    }
