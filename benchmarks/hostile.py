"""What controllers answer to absurd numbers, and in what time.

Steps of every controller, and of every back end of hierarchical_qp, from random states and
references of which some numbers are replaced by absurd ones: not finite, huge, tiny, out of reach.
Counts exceptions, answers that are not finite, and answers beyond the joints' speed limits of
controllers that keep these; prints the longest step in microseconds of processor time.

    python benchmarks/hostile.py --steps 100000
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

from rcmqp import Controller, Insertion, Reference, load_scenario, make_controller
from rcmqp.controllers import CONTROLLERS
from rcmqp.qp.hierarchy import hierarchy_backends
from rcmqp.show.table import Table
from rcmqp.world.arm import ArmState

ABSURD = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200, -1e200, 1e50, -1e12, 1e6, 1e-200, 0.0)
"""What takes the place of a number."""

FIELDS = ("q", "v", "a", "x_d", "x_d_dot", "pivot", "pivot_dot")
"""In what."""

LIMITED = ("hierarchical_qp", "weighted_qp")
"""Controllers that keep the joints' speed limits."""

ARMS = ("lwa3", "panda", "ur5", "meka_a2")


@dataclass
class Found:
    """What one controller answered.

    Attributes:
        steps: how many.
        raised: exceptions.
        not_finite: answers with a number that is not finite.
        beyond: answers above a joint's speed limit, of controllers that keep it.
        stops: safe stops.
        longest: step [us of processor time].
    """

    steps: int = 0
    raised: int = 0
    not_finite: int = 0
    beyond: int = 0
    stops: int = 0
    longest: float = 0.0

    @property
    def faults(self) -> int:
        """Answers that ought not to be."""
        return self.raised + self.not_finite + self.beyond


def settings() -> list[tuple[str, dict[str, str]]]:
    """Every controller, and every back end of the hierarchy."""
    backends = [("hierarchical_qp", {"backend": name}) for name in hierarchy_backends()]
    others: list[tuple[str, dict[str, str]]] = [
        (name, {}) for name in CONTROLLERS if name != "hierarchical_qp"
    ]
    return [*backends, *others]


def asked(
    insertion: Insertion, references: list[Reference], rng: np.random.Generator
) -> tuple[ArmState, Reference]:
    """A state and a reference with one to three absurd numbers, or none."""
    arm, reference = insertion.arm, references[int(rng.integers(len(references)))]
    given = {
        "q": arm.configuration(arm.random_angles(rng)),
        "v": rng.uniform(-0.8, 0.8) * arm.velocity,
        "a": rng.uniform(-0.2, 0.2, arm.nv) * np.minimum(arm.acceleration, arm.velocity),
        **{name: np.array(getattr(reference, name)) for name in FIELDS[3:]},
    }
    for _ in range(int(rng.integers(4))):
        array = given[FIELDS[int(rng.integers(len(FIELDS)))]]
        array[int(rng.integers(array.size))] = ABSURD[int(rng.integers(len(ABSURD)))]
    state = insertion.state(given["q"], given["v"], given["a"])
    return state, Reference(*(given[name] for name in FIELDS[3:]))


def hostile(controller: Controller, steps: int, seed: int) -> Found:
    """Ask a controller so many times."""
    insertion, rng, found = controller.insertion, np.random.default_rng(seed), Found()
    references = list(load_scenario("conical_helix", insertion.arm.name).references(insertion))
    most = insertion.arm.velocity * (1.0 + 1e-12)
    for state, reference in (asked(insertion, references, rng) for _ in range(steps)):
        found.steps += 1
        begin = time.process_time_ns()
        try:
            answer = controller.step(state, reference)
        except Exception:  # noqa: BLE001  (it is what is counted)
            found.raised += 1
            continue
        found.longest = max(found.longest, 1e-3 * (time.process_time_ns() - begin))
        found.stops += bool(answer.stop)
        found.not_finite += not np.isfinite(answer.v).all()
        found.beyond += controller.name in LIMITED and bool((np.abs(answer.v) > most).any())
    return found


def main() -> None:
    """Ask all, and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=1000, help="of each controller on each arm")
    given = parser.parse_args()
    rows = []
    for name, options in settings():
        for arm in ARMS:
            scenario = load_scenario("conical_helix", arm)
            made = make_controller(name, scenario.insertion(), scenario.period, **options)
            found = hostile(made, given.steps, seed=ARMS.index(arm))
            shown = " ".join([name, *options.values()])
            counts = (found.steps, found.raised, found.not_finite, found.beyond, found.stops)
            rows.append([shown, arm, *counts, f"{found.longest:.0f}"])
    heads = ["controller", "arm", "steps", "raised", "not finite", "beyond", "stops"]
    print(Table([*heads, "longest [us]"], rows, words=2).markdown(), end="")


if __name__ == "__main__":
    main()
