"""CoIKS-Surg's helix: the tool tip draws four turns of 15 mm radius and 10 mm pitch.

Radius, turns and pitch are the benchmark's (create3DHelixPath), which gives no time. In 20 s the
tip moves at 20 mm/s, as in experiment A, which is not fast for any arm here.
"""

from __future__ import annotations

from rcmqp import Scenario
from rcmqp.references.paths import ConicalHelix


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """The helix, a cone without taper, from the arm's home, 10 to 14 cm inside."""
    path = ConicalHelix(radius_start=0.015, radius_end=0.015, pitch=0.01, turns=4.0)
    return Scenario.on_shaft("helix", arm, path, flange=flange)


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
