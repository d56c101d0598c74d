"""Experiment A of the paper: the tool tip draws a conical helix, 10 to 14 cm inside."""

from __future__ import annotations

from rcmqp import Instrument, Scenario, load_arm
from rcmqp.insertion import Insertion
from rcmqp.paths import ConicalHelix


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """The helix, from the arm's home, with the trocar where the shaft is there."""
    instrument, path = Instrument(), ConicalHelix()
    insertion = Insertion.on_shaft(load_arm(arm, flange), instrument, depth=0.10)
    return Scenario(
        name="conical_helix",
        arm=arm,
        flange=flange,
        angles_start=tuple(insertion.angles_start),
        instrument=instrument,
        trocar=insertion.trocar,
        path=path,
        duration=path.duration,
    )


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
