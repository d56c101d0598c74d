"""The vocabulary: title, unit, meaning and format of every measure of a run.

Tables, pages, the terminal and docs/measures.md take their words from here; those of trials and
hands are in rcmqp.experiments.study.vocabulary.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

from rcmqp.runs.measures import Measure

NOTHING = 1e-6
"""Below it, a measure of AFTER_THE_STOP is shown as 0 [mm], [s], [1]."""


def _error(name: str, head: str, label: str, unit: str, fixed: str, meaning: str) -> list[Measure]:
    """Root of the mean square, maximum and 95th percentile of an error."""
    kinds = (
        ("rms", "rms", "rms", "Root of the mean square until the path ends"),
        ("max", "max", "max", "Largest value of the whole run"),
        ("p95", "95 %", "95th percentile", "95th percentile until the path ends"),
    )
    return [
        Measure(
            f"{name}_{kind}_{unit}",
            f"{head} {short}",
            f"{meaning} {first}.",
            long=label,
            unit=unit,
            how=how,
            fixed=fixed,
        )
        for kind, short, how, first in kinds
    ]


_CASE = (
    Measure("scenario", "scenario", "Name of the scenario."),
    Measure("arm", "arm", "Name of the arm, or path of its URDF."),
    Measure(
        "controller",
        "controller",
        "Name of the controller, with those of its options that no other column tells.",
    ),
    Measure("setting", "setting", "Controller as NAME or NAME:OPTION=VALUE."),
    Measure(
        "feed_forward",
        "feed-forward",
        "Whether the controller knows the velocity of the reference, and of the trocar. Without "
        "it, a controller comes after what moves.",
    ),
    Measure(
        "roll",
        "roll held",
        "Whether the controller turns the instrument about its shaft as it is asked to. One that "
        "does not lets the camera's image turn: its orientation error is of another kind.",
        long="roll controlled",
    ),
    Measure(
        "limits_enforced",
        "joint limits enforced",
        "Which joint limits the controller itself keeps: position, speed, all, or none.",
    ),
    Measure("period_ms", "T", "Sampling period of the controller.", unit="ms"),
    Measure("gain", "K", "Gain of the controller: how fast an error decays.", unit="1/s"),
    Measure(
        "assumed",
        "limits assumed",
        "Which limits of the joints, a wrist's among them, no source gives; a careful value "
        "stands in.",
    ),
    Measure(
        "setup",
        "set up with",
        "What neither scenario nor controller says by its name: another instrument, a recorded "
        "path of the tip or motion of the trocar, another null-space objective.",
    ),
    Measure(
        "errors_until_s",
        "rms until",
        "When the path ended, or reference or trocar last moved if that is later; rms and 95th "
        "percentile are of the time until then, so that rest is not averaged in.",
        unit="s",
    ),
    Measure("duration_s", "duration", "Time of the last sampling instant.", unit="s"),
    Measure("safe_stops", "stops", "Cycles in the safe stop.", long="cycles in the safe stop"),
    Measure(
        "limits_kept",
        "joint limits kept",
        "Whether no joint left its limits of position, speed, acceleration or jerk.",
    ),
    Measure("joint_unit", "unit of joints", "rad, or m if prismatic."),
    Measure("digest", "digest", "SHA-256 of the run without its times."),
    Measure("file", "file", "Name of the run's file."),
    Measure("failure", "failure", "Why there is no run; else empty."),
)

_METRICS = (
    *_error(
        "tip",
        "tip",
        "tip error",
        "mm",
        ".3f",
        "Distance of the tip, which carries the camera, from where it was asked to be at the same "
        "instant.",
    ),
    *_error(
        "effector",
        "effector",
        "effector error",
        "mm",
        ".3f",
        "Distance of the effector, the point of the shaft that lay on the trocar at the start, "
        "from where it was asked to be at the same instant.",
    ),
    *_error(
        "rcm", "RCM", "RCM error", "mm", ".4f", "Distance of the trocar from the shaft's axis."
    ),
    *_error(
        "orientation",
        "orient.",
        "orientation error",
        "mrad",
        ".3f",
        "Angle between the orientation and the one asked for at the same instant.",
    ),
    *_error(
        "contour",
        "contour",
        "contour error",
        "mm",
        ".3f",
        "Distance of the tip from its path, the curve of the desired tip seen from the trocar, "
        "whenever it was asked to be there.",
    )[:2],
    Measure(
        "lag_max_s",
        "lag max",
        "How late the tip is on its path, whether it falls behind the reference or a governor "
        "slows the reference down.",
        long="lag of the tip",
        unit="s",
        how="max",
    ),
    Measure(
        "late_share",
        "late",
        "Share of the cycles of a real-time loop that began half a period late or more. A run "
        "without a real-time loop has none.",
        long="share of cycles late",
        fixed=".3f",
    ),
    Measure(
        "behind_s",
        "behind",
        "Time by the clock less the periods of the cycles that were run. A simulated arm stands "
        "still for as long, and on a real arm as many cycles are missing. A run without a "
        "real-time loop has none.",
        long="loop behind the clock",
        unit="s",
        fixed=".2f",
    ),
    *(
        Measure(
            f"depth_{kind}_mm",
            f"depth {how}",
            "Insertion depth of the tip beyond the trocar.",
            long="depth of the tip",
            unit="mm",
            how=how,
            style=".1f",
            fixed=".1f",
        )
        for kind, how in (("min", "least"), ("max", "max"))
    ),
    Measure(
        "tilt_max_mrad",
        "tilt max",
        "Angle of the shaft from the trocar's axis.",
        long="tilt of the shaft",
        unit="mrad",
        how="max",
    ),
    Measure(
        "speed_ratio_max",
        "speed / limit",
        "Largest joint speed commanded over its limit; above 1, a limit is broken.",
        long="joint speed over its limit",
        how="max",
        fixed=".2f",
    ),
    Measure(
        "acceleration_ratio_max",
        "acc. / limit",
        "Largest change of a commanded joint speed from one cycle to the next, from rest at "
        "first, over the period and the limit; above 1, a limit is broken.",
        long="joint acceleration over its limit",
        how="max",
        fixed=".2f",
        nan="no limit",
    ),
    Measure(
        "jerk_ratio_max",
        "jerk / limit",
        "Largest change of that change, over the period squared and the jerk limit; above 1, a "
        "limit is broken.",
        long="joint jerk over its limit",
        how="max",
        fixed=".2f",
        nan="no limit",
    ),
    Measure(
        "saturated_share",
        "saturated",
        "Share of the cycles in which a joint is commanded at its limit of speed or of "
        "acceleration, or above.",
        long="share of cycles with a joint at its limit",
    ),
    Measure(
        "limit_margin_min_rad",
        "margin to limits",
        "Least distance of a joint from a position limit; negative outside. The margin of a "
        "prismatic joint counts in metres.",
        long="margin to joint limits",
        unit="rad",
        how="least",
        fixed=".2f",
        nan="no limit",
        inf="no limit",
    ),
    Measure(
        "obstacle_distance_min_mm",
        "to obstacle",
        "Least distance of the instrument from an obstacle, from surface to surface; negative "
        "inside one; none if there is no obstacle.",
        long="distance to an obstacle",
        unit="mm",
        how="least",
    ),
    Measure(
        "singular_value_min",
        "singular value, least",
        "Least singular value of the effector's geometric Jacobian, in m and rad: near 0, some "
        "movement asks for very large joint speeds.",
        long="singular value",
        how="least",
        fixed=".3f",
    ),
    Measure(
        "tip_speed_rms_mm_s",
        "tip speed rms",
        "Speed of the desired tip. Without feed-forward, the lag is this over K.",
        long="tip speed asked for",
        unit="mm/s",
        how="rms",
        fixed=".1f",
    ),
    *(
        Measure(
            f"solve_time_{kind}_us",
            head,
            f"Time that the controller took for a cycle, {how}, by the clock of this machine.",
            long="controller step",
            unit="us",
            how=how,
            fixed=".0f",
        )
        for kind, head, how in (("median", "step", "median"), ("p99", "step 99 %", "p99"))
    ),
    Measure(
        "reversals_in_a_row",
        "reversals in a row",
        "Most cycles in a row in which one joint changes its direction, at above 1 % of its speed "
        "limit.",
        long="cycles in a row in which a joint turns round",
    ),
    Measure(
        "reversals",
        "cycles with a reversal",
        "Cycles in which a joint changes its direction, at above 1 % of its speed limit.",
        long="cycles in which a joint turns round",
    ),
    Measure(
        "step_ratio_max",
        "step of v / limit",
        "Largest change of a commanded joint speed from one cycle to the next, from rest at "
        "first, over the joint's speed limit.",
        long="step of a joint's speed over its limit",
        how="max",
    ),
)

_AFTER_THE_STOP = tuple(
    dataclasses.replace(measure, nan="no stop", inf="never", floor=NOTHING)
    for measure in (
        Measure(
            "reference_end_s",
            "reference stops",
            "When the reference stops, seen from the trocar.",
            unit="s",
        ),
        Measure(
            "overshoot_max_mm",
            "overshoot",
            "How far the tip goes past the place where reference and trocar have stopped.",
            long="tip past its end",
            unit="mm",
            how="max",
        ),
        Measure(
            "settling_time_s",
            "below 1 mm after",
            "From when the reference stops, seen from the trocar, until the tip error is below "
            "1 mm for good.",
            long="tip below 1 mm for good, after",
            unit="s",
        ),
        Measure(
            "swing_ratio_end",
            "swing at the end / limit",
            "Largest range of a commanded joint speed over the last second, over the joint's "
            "speed limit, after reference and trocar have stopped.",
            long="swing of a joint over its speed limit, at the end",
        ),
    )
)

AFTER_THE_STOP = tuple(measure.name for measure in _AFTER_THE_STOP)
"""Measures that are NaN if the reference does not stop."""

_SMOOTHNESS = (
    Measure(
        "sparc",
        "SPARC",
        "Spectral arc length of the tip's speed (Balasubramanian et al. 2015): nearer to 0 is "
        "smoother, about -1.4 is the best.",
        fixed=".2f",
    ),
    Measure(
        "ldlj",
        "LDLJ",
        "Log dimensionless jerk of the tip's speed (Hogan and Sternad 2009): larger, nearer to 0, "
        "is smoother. Chatter shows in it that SPARC does not see.",
        fixed=".2f",
    ),
)

MEASURES = {
    measure.name: measure for measure in (*_CASE, *_METRICS, *_AFTER_THE_STOP, *_SMOOTHNESS)
}
"""Every measure of a run by name."""


def meanings(names: Iterable[str]) -> dict[str, str]:
    """Meanings of measures, by their short titles."""
    return {MEASURES[name].column: MEASURES[name].meaning for name in names}
