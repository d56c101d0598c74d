"""What the arm is asked for, a cycle at a time: the same each time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from rcmqp import ViewCommand
from rcmqp.references.paths import Circle, ConicalHelix, Path, ViewMoves

PERIOD = 1e-3
"""A cycle of Franka's interface [s]."""

TIP_DEPTH = 0.1
"""How deep the tip is at the start [m]."""

LOW, HIGH = (-0.6, -0.6, -3.0, -0.05), (0.6, 0.6, 3.0, 0.08)
"""Wild views: alpha, beta, gamma [rad] and t_z [m]."""


@dataclass(frozen=True, slots=True)
class Demand:
    """What happens in a cycle.

    Attributes:
        view: the view asked for; None where the reference is lost, and NaN.
        stop: begin a safe stop, and go on when it is over.
        dropped: this cycle's command does not arrive.
    """

    view: ViewCommand | None
    stop: bool = False
    dropped: bool = False


def view_steps() -> list[Demand]:
    """The view jumps by 0.15 rad, and back."""
    there, back = ViewCommand(alpha=0.15, beta=-0.15), ViewCommand()
    return [Demand(view) for view in (back, there, back) for _ in range(700)]


def smooth_turn() -> list[Demand]:
    """The view goes to 0.1 rad and back like a cosine: nothing that any arm would refuse."""
    turn, w = 0.05, 2.0 * math.pi / 2.0
    return [
        Demand(
            ViewCommand(alpha=turn * (1.0 - math.cos(w * t)), alpha_dot=turn * w * math.sin(w * t))
        )
        for t in np.arange(2000) * PERIOD
    ]


def fast_helix() -> list[Demand]:
    """Experiment A's helix in a tenth of its time: joints run into their limits."""
    return _along(ConicalHelix(duration=2.0, ramp=0.1), 2500)


def reversals() -> list[Demand]:
    """The view jumps to and fro before it is reached."""
    to_and_fro = (ViewCommand(0.3, 0.2), ViewCommand(-0.3, -0.2))
    return [Demand(to_and_fro[(k // 120) % 2]) for k in range(2000)]


def reference_lost() -> list[Demand]:
    """A circle of which every now and then a fifth of a second is missing."""
    demands = _along(Circle(turns=2.0, duration=2.0), 2000)
    return [Demand(None) if k % 500 >= 300 else demand for k, demand in enumerate(demands)]


def packets_lost() -> list[Demand]:
    """View steps, of whose commands 1 % do not arrive."""
    return _dropped(view_steps(), np.random.default_rng(7))


def safe_stops() -> list[Demand]:
    """Safe stops in the middle of jumps."""
    return [dataclasses.replace(d, stop=k % 400 == 170) for k, d in enumerate(reversals())]


def wild_views() -> list[Demand]:
    """Moves and jumps to views drawn at random."""
    return _wild(np.random.default_rng(11), 3000)


def everything(seed: int, cycles: int, stops: int) -> list[Demand]:
    """Wild views, jumps, lost references, 1 % of the commands lost, and safe stops.

    Args:
        seed: of what is drawn at random.
        cycles: how many.
        stops: how many safe stops, evenly spread.
    """
    rng = np.random.default_rng(seed)
    demands = _dropped(_wild(rng, cycles), rng)
    for begin in rng.integers(0, cycles, cycles // 1000).tolist():
        lost = demands[begin : begin + 100]
        demands[begin : begin + 100] = [dataclasses.replace(each, view=None) for each in lost]
    for k in np.linspace(0, cycles, stops, endpoint=False, dtype=int).tolist():
        demands[k] = dataclasses.replace(demands[k], stop=True)
    return demands


DEMANDS: dict[str, Callable[[], list[Demand]]] = {
    made.__name__: made
    for made in (
        view_steps,
        fast_helix,
        reversals,
        reference_lost,
        packets_lost,
        safe_stops,
        wild_views,
    )
}


def _along(path: Path, cycles: int) -> list[Demand]:
    return [Demand(path.command(PERIOD * k, TIP_DEPTH)) for k in range(cycles)]


def _wild(rng: np.random.Generator, cycles: int) -> list[Demand]:
    """A view each 0.4 s: a move to it, or, one time in two, a jump."""
    count = cycles // 400 + 1
    views = tuple(tuple(view) for view in rng.uniform(LOW, HIGH, (count, 4)).tolist())
    moves = ViewMoves(views=views, move=0.4, dwell=0.0)
    jumps = rng.random(count) < 0.5
    demands = _along(moves, cycles)
    return [
        Demand(ViewCommand(*views[k // 400])) if jumps[k // 400] else demand
        for k, demand in enumerate(demands)
    ]


def _dropped(demands: Iterable[Demand], rng: np.random.Generator) -> list[Demand]:
    """One command in a hundred is lost."""
    return [dataclasses.replace(each, dropped=bool(rng.random() < 0.01)) for each in demands]
