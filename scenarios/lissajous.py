"""CoIKS-Surg's Lissajous figure: the tool tip draws an eight that also goes in and out.

The benchmark leaves the sizes to its user. Here they are 4 cm by 3 cm by 1 cm, within the
10 x 10 x 5 cm that Marinho, Bernardes and Bo (2016) give as the workspace of a task, drawn once
in 10 s.
"""

from __future__ import annotations

from rcmqp import Scenario
from rcmqp.references.paths import Lissajous


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """The figure from the arm's home, 9 to 10 cm inside."""
    return Scenario.on_shaft("lissajous", arm, Lissajous(), flange=flange)


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
