"""Absurd numbers in states and references, over every controller and back end."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rcmqp import Reference, load_scenario, make_controller

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
from hostile import hostile, settings

SETTINGS = [pytest.param(*each, id=" ".join([each[0], *each[1].values()])) for each in settings()]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(("name", "options"), SETTINGS)
def test_every_answer_to_absurd_numbers_is_finite_and_inside_the_limits(
    name: str, options: dict[str, Any]
) -> None:
    scenario = load_scenario("conical_helix", "lwa3")
    found = hostile(
        make_controller(name, scenario.insertion(), scenario.period, **options), 150, 3
    )
    assert found.steps == 150
    assert found.faults == 0
    assert found.stops > 0


def test_a_controller_that_answers_wrongly_is_counted() -> None:
    scenario = load_scenario("conical_helix", "lwa3")
    made = make_controller("hierarchical_qp", scenario.insertion(), scenario.period)
    answer = made.step

    def doubled(state: Any, reference: Reference) -> Any:
        found = answer(state, reference)
        if not np.isfinite(reference.pivot).all():
            raise ValueError("what is not hushed up is counted")
        object.__setattr__(found, "v", 9.0 * np.ones(7))
        return found

    object.__setattr__(made, "step", doubled)
    found = hostile(made, 200, 3)
    assert found.raised > 0
    assert found.beyond > 100
