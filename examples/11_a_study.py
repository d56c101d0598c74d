"""A study: two simulated operators steer the camera to four views, past an obstacle.

The operators are models: they see what the camera shows, late and inexactly, and move a haptic
device. Each trial is a file of its own, so a study that is stopped can continue later.
"""

from __future__ import annotations

import sys
import tempfile

from rcmqp.experiments.study.figures import trajectory_figure
from rcmqp.experiments.study.perform import perform
from rcmqp.experiments.study.plan import Law, Study


def main(picture: str = "11_a_study.png", period: float = 0.004) -> None:
    """Perform two trials, print who did what, and draw the way of the second one's camera."""
    study = Study(operators=2, seed=4, laws=(Law("hierarchical_qp", period),))
    with tempfile.TemporaryDirectory() as folder:
        done = perform(study, folder)
        record = done.record(1)
    for outcome in done.outcomes:
        print(
            f"operator {outcome.operator} ({outcome.group}): {outcome.completion_s:.0f} s, "
            f"tip error {outcome.tip_rms_mm:.2f} mm rms, "
            f"{outcome.obstacle_shaft_mm:.1f} mm from the obstacle"
        )
    scenario = study.trials()[1].made()
    trajectory_figure(scenario, record).savefig(picture, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:2])
