"""The vocabulary of trials and hands, beside that of runs."""

from __future__ import annotations

import dataclasses

from rcmqp.runs.measures import Measure
from rcmqp.runs.vocabulary import MEASURES

_TRIALS = (
    Measure("operator", "operator", "operator", "", "Number of the person."),
    Measure("group", "group", "group", "", "Novice or experienced."),
    Measure("period", "period", "period", "s", "Sampling period of the controller."),
    Measure("finished", "finished", "finished", "", "Whether every objective was reached."),
    Measure(
        "completion_s",
        "completion time",
        "completion time",
        "s",
        "When the last objective was reached; missing if not all were.",
        fixed=".1f",
    ),
    Measure("reached_s", "reached", "reached", "s", "When each objective was reached."),
    Measure(
        "looking_s",
        "looking",
        "of which looking",
        "s",
        "Time spent finding out where the objectives reached are: drawn, not moved.",
        fixed=".1f",
    ),
    Measure(
        "obstacle_tip_mm",
        "camera to obstacle",
        "least distance, camera to obstacle",
        "mm",
        "Least distance of the camera, as a point, from the obstacle's surface.",
        fixed=".2f",
    ),
    Measure(
        "obstacle_shaft_mm",
        "shaft to obstacle",
        "least distance, shaft to obstacle",
        "mm",
        "Least distance of the shaft's surface from the obstacle's; negative inside.",
        fixed=".2f",
    ),
    Measure("collided", "collided", "collided", "", "Whether the shaft touched the obstacle."),
    Measure(
        "slow_share",
        "slow",
        "share of time at less than 10 mm/s",
        "",
        "Share of the sampling instants to which the camera came slower than 10 mm/s.",
        fixed=".2f",
    ),
    Measure(
        "rcm_rms_moving_mm",
        "RCM rms, moving",
        "RCM error while the camera moves",
        "mm",
        "RCM error at the sampling instants to which the camera came at 10 mm/s or faster.",
        "rms",
        fixed=".4f",
    ),
    Measure(
        "behind_share",
        "behind",
        "share of time that the loop fell behind the clock",
        "",
        "Share of the time in which a simulated arm stood still because its machine was busy.",
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
            "movements a minute",
            "",
            "How often the hand moves.",
            fixed=".0f",
        ),
        Measure(
            "movement_s",
            "movement",
            "duration of a movement",
            "s",
            "Duration of a movement.",
            "median",
            fixed=".2f",
        ),
        dataclasses.replace(
            TRIALS["slow_share"],
            label="share of time below 10 mm/s",
            meaning="Share of the time at which the hand is slower than 10 mm/s.",
        ),
        Measure(
            "speed_mean_mm_s",
            "speed",
            "speed while moving",
            "mm/s",
            "Mean speed at the other times.",
            "mean",
            fixed=".1f",
        ),
        Measure(
            "speed_max_mm_s",
            "peak",
            "speed",
            "mm/s",
            "Largest speed of the hand.",
            "peak",
            fixed=".0f",
        ),
        *(
            dataclasses.replace(
                measure,
                label=f"{measure.label} of a movement",
                how="median",
                meaning=measure.meaning.replace("the tip's speed", "the hand's speed"),
            )
            for measure in (MEASURES["sparc"], MEASURES["ldlj"])
        ),
        *(
            Measure(
                f"{name}_power_hz",
                f"{share} of power",
                f"{share} of the speed's power is below",
                "Hz",
                f"Frequency below which {share} of the power of the speed about its mean lies.",
                fixed=".2f",
            )
            for name, share in (("half", "half"), ("most", "95 %"))
        ),
        Measure(
            "tremor_share",
            "tremor",
            "share of the speed's power at 8 to 12 Hz",
            "",
            "Share of the power of the speed about its mean that lies at 8 to 12 Hz, tremor.",
            fixed=".1e",
        ),
    )
}
"""Every measure of a hand by name."""
