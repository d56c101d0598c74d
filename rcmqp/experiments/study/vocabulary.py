"""The vocabulary of trials and hands, beside that of runs."""

from __future__ import annotations

import dataclasses

from rcmqp.runs.measures import Measure
from rcmqp.runs.vocabulary import MEASURES

_TRIALS = (
    Measure("operator", "operator", "Number of the person."),
    Measure("group", "group", "Novice or experienced."),
    Measure("period", "period", "Sampling period of the controller.", unit="s"),
    Measure("finished", "finished", "Whether every objective was reached."),
    Measure(
        "completion_s",
        "completion time",
        "When the last objective was reached; missing if not all were.",
        unit="s",
        fixed=".1f",
    ),
    Measure("reached_s", "reached", "When each objective was reached.", unit="s"),
    Measure(
        "looking_s",
        "looking",
        "Time spent finding out where the objectives reached are: drawn, not moved.",
        long="of which looking",
        unit="s",
        fixed=".1f",
    ),
    Measure(
        "obstacle_tip_mm",
        "camera to obstacle",
        "Least distance of the camera, as a point, from the obstacle's surface.",
        long="least distance, camera to obstacle",
        unit="mm",
        fixed=".2f",
    ),
    Measure(
        "obstacle_shaft_mm",
        "shaft to obstacle",
        "Least distance of the shaft's surface from the obstacle's; negative inside.",
        long="least distance, shaft to obstacle",
        unit="mm",
        fixed=".2f",
    ),
    Measure("collided", "collided", "Whether the shaft touched the obstacle."),
    Measure(
        "slow_share",
        "slow",
        "Share of the sampling instants to which the camera came slower than 10 mm/s.",
        long="share of time at less than 10 mm/s",
        fixed=".2f",
    ),
    Measure(
        "rcm_rms_moving_mm",
        "RCM rms, moving",
        "RCM error at the sampling instants to which the camera came at 10 mm/s or faster.",
        long="RCM error while the camera moves",
        unit="mm",
        how="rms",
        fixed=".4f",
    ),
    Measure(
        "behind_share",
        "behind",
        "Share of the time in which a simulated arm stood still because its machine was busy.",
        long="share of time that the loop fell behind the clock",
        fixed=".3f",
    ),
)

TRIALS = MEASURES | {measure.name: measure for measure in _TRIALS}
"""Every measure of a trial by name, those of its run too."""

HANDS = {
    measure.name: measure
    for measure in (
        Measure(
            "movements_per_min",
            "movements",
            "How often the hand moves.",
            long="movements a minute",
            fixed=".0f",
        ),
        Measure(
            "movement_s",
            "movement",
            "Duration of a movement.",
            long="duration of a movement",
            unit="s",
            how="median",
            fixed=".2f",
        ),
        dataclasses.replace(
            TRIALS["slow_share"],
            long="share of time below 10 mm/s",
            meaning="Share of the time at which the hand is slower than 10 mm/s.",
        ),
        Measure(
            "speed_mean_mm_s",
            "speed",
            "Mean speed at the other times.",
            long="speed while moving",
            unit="mm/s",
            how="mean",
            fixed=".1f",
        ),
        Measure(
            "speed_max_mm_s",
            "peak",
            "Largest speed of the hand.",
            long="speed",
            unit="mm/s",
            how="peak",
            fixed=".0f",
        ),
        *(
            dataclasses.replace(
                measure,
                long=f"{measure.label} of a movement",
                how="median",
                meaning=measure.meaning.replace("the tip's speed", "the hand's speed"),
            )
            for measure in (MEASURES["sparc"], MEASURES["ldlj"])
        ),
        *(
            Measure(
                f"{name}_power_hz",
                f"{share} of power",
                f"Frequency below which {share} of the power of the speed about its mean lies.",
                long=f"{share} of the speed's power is below",
                unit="Hz",
                fixed=".2f",
            )
            for name, share in (("half", "half"), ("most", "95 %"))
        ),
        Measure(
            "tremor_share",
            "tremor",
            "Share of the power of the speed about its mean that lies at 8 to 12 Hz, tremor.",
            long="share of the speed's power at 8 to 12 Hz",
            fixed=".1e",
        ),
    )
}
"""Every measure of a hand by name."""
