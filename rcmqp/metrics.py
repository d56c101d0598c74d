"""Numbers that sum up a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcmqp import dualquaternion as dq
from rcmqp.dualquaternion import Array
from rcmqp.run import Run
from rcmqp.scene import clearance

SATURATED = 1.0 - 1e-6
"""Share of a limit from which on a joint counts as saturated."""


@dataclass(frozen=True, slots=True)
class Metrics:
    """Errors, limits and times of a run, over all its sampling instants.

    Names end in their unit. rms is the root of the mean square, p95 the 95th percentile. The tip
    and the effector, which is the point of the shaft that lay on the trocar at the start, are
    compared with where they were asked to be at the same instant, before the step; the RCM error
    is the distance from the trocar to the shaft's axis.

    Attributes:
        depth_min_mm, depth_max_mm: insertion depth of the tip beyond the trocar.
        tilt_max_mrad: largest angle of the shaft from the trocar's axis.
        speed_ratio_max: largest joint speed commanded over its limit; above 1, a limit is broken.
        acceleration_ratio_max: largest change of a commanded joint speed from one cycle to the
            next, from rest at first, over the period and the limit; likewise. 0 on arms without
            acceleration limits.
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
    saturated_share: float
    limit_margin_min_rad: float
    obstacle_distance_min_mm: float
    singular_value_min: float
    tip_speed_rms_mm_s: float
    solve_time_median_us: float
    solve_time_p99_us: float


def compute_metrics(run: Run) -> Metrics:
    """Sum up a run."""
    tip, effector, rcm = 1e3 * run.tip_error, 1e3 * run.effector_error, 1e3 * run.rcm_error
    margin = np.minimum(run.angles - run.lower, run.upper - run.angles)
    speed_ratio = np.abs(run.v / run.velocity_limit).max(axis=-1)
    acceleration = np.abs(np.diff(run.v, axis=0, prepend=0.0)) / run.period
    acceleration_ratio = (acceleration / run.acceleration_limit).max(axis=-1)
    tip_velocity = np.diff(run.tip_d, axis=0) / run.period
    values = {
        **_summary("tip", "mm", tip),
        **_summary("effector", "mm", effector),
        **_summary("rcm", "mm", rcm),
        **_summary("orientation", "mrad", 1e3 * run.orientation_error),
        "depth_min_mm": 1e3 * run.depth.min(),
        "depth_max_mm": 1e3 * run.depth.max(),
        "tilt_max_mrad": 1e3 * run.tilt.max(),
        "speed_ratio_max": speed_ratio.max(),
        "acceleration_ratio_max": acceleration_ratio.max(),
        "saturated_share": np.mean(np.maximum(speed_ratio, acceleration_ratio) >= SATURATED),
        "limit_margin_min_rad": margin.min(),
        "obstacle_distance_min_mm": 1e3 * obstacle_distance(run).min(),
        "singular_value_min": run.singular_value.min(),
        "tip_speed_rms_mm_s": 1e3 * _rms(np.linalg.norm(tip_velocity, axis=-1)),
        "solve_time_median_us": 1e6 * np.median(run.solve_time),
        "solve_time_p99_us": 1e6 * np.percentile(run.solve_time, 99),
    }
    return Metrics(**{name: float(value) for name, value in values.items()})


def obstacle_distance(run: Run) -> Array:
    """Distance (n,) of the instrument from the nearest obstacle [m], see scene.clearance()."""
    shaft = dq.rotate(dq.P(run.x), np.array([0.0, 0.0, 1.0]))
    return clearance(run.scenario.obstacles, run.scenario.instrument, run.tip, shaft)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _summary(name: str, unit: str, values: Array) -> dict[str, float]:
    return {
        f"{name}_rms_{unit}": _rms(values),
        f"{name}_max_{unit}": values.max(),
        f"{name}_p95_{unit}": np.percentile(values, 95),
    }
