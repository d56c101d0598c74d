"""Experiment A of the paper: the tool tip draws a conical helix, 10 to 14 cm inside."""

from __future__ import annotations

from rcmqp import Instrument, Scenario, Trocar, find_start, load_arm
from rcmqp.references.paths import ConicalHelix
from rcmqp.world.insertion import Insertion

DEPTH = 0.10
"""How far the tip is inside at the start [m]."""


def scenario(
    arm: str = "lwa3", *, flange: str | None = None, trocar: Trocar | None = None
) -> Scenario:
    """The helix through a trocar, or, without one, from the arm's home, through one put there."""
    instrument, loaded = Instrument(), load_arm(arm, flange)
    if trocar is None:
        insertion = Insertion.on_shaft(loaded, instrument, depth=DEPTH)
    else:
        start = find_start(loaded, instrument, trocar, depth=DEPTH)
        insertion = Insertion(loaded, instrument, trocar, start)
    return Scenario.of("conical_helix", insertion, ConicalHelix())


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
