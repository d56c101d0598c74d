"""CoIKS-Surg's circle: the tool tip draws one of 15 mm radius across the shaft.

The radius is the benchmark's, which gives no time. In 8 s the tip moves at 13 mm/s, which is not
fast for any arm here.
"""

from __future__ import annotations

from rcmqp import Scenario
from rcmqp.references.paths import Circle


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """The circle from the arm's home, the tip 10 cm inside."""
    return Scenario.on_shaft("circle", arm, Circle(), flange=flange)


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
