"""The helix on an arm without a redundant joint: six joints, on a UR5 if no arm is named.

A pose takes all six joints, so nothing is left for a secondary objective. A controller that leaves
the roll about the shaft free has one joint more to use. One and a half turns of experiment A's
helix, at its speed of 20 mm/s, in 10 s.
"""

from __future__ import annotations

from rcmqp import Scenario
from rcmqp.references.paths import ConicalHelix


def scenario(arm: str = "ur5", *, flange: str | None = None) -> Scenario:
    """The helix from the arm's home, 10 to 12 cm inside."""
    path = ConicalHelix(turns=1.5, duration=10.0)
    return Scenario.on_shaft("six_joints", arm, path, flange=flange)


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
