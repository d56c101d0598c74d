"""Starting configurations found for a wished trocar."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import Arm, Insertion, Instrument, Trocar, find_start, load_arm, load_scenario
from rcmqp.errors import NoStartFound
from rcmqp.runs.loading import scenario_module

SCOPE = Instrument()


def trocar_near_home(arm: Arm, rng: np.random.Generator) -> Trocar:
    """A trocar that the arm can reach: that of its home, moved by 3 cm and turned by 5 deg."""
    there = Insertion.on_shaft(arm, SCOPE).trocar
    pivot = np.array(there.pivot) + rng.uniform(-0.03, 0.03, 3)
    axis = np.array(there.axis) + rng.uniform(-0.08, 0.08, 3)
    return Trocar(tuple(pivot), tuple(axis))


def test_a_start_is_on_the_trocar_along_its_axis_and_inside_its_margins(arm: Arm) -> None:
    trocar = trocar_near_home(arm, np.random.default_rng(7))
    angles = find_start(arm, SCOPE, trocar, depth=0.12, margin=0.15, singular_value=0.03)
    insertion = Insertion(arm, SCOPE, trocar, angles, tolerance=1e-9)
    state = insertion.state(insertion.q_start)
    assert_allclose(insertion.tip_depth, 0.12, rtol=0, atol=1e-9)
    assert_allclose(state.oMe.translation, trocar.pivot, rtol=0, atol=1e-9)
    assert_allclose(state.oMe.rotation[:, 2], trocar.axis, rtol=0, atol=1e-9)
    assert arm.limit_margin(angles).min() >= 0.15 - 1e-12
    assert np.linalg.svd(state.J_local, compute_uv=False)[-1] >= 0.03


def test_the_same_seed_finds_the_same_start() -> None:
    arm = load_arm("panda")
    trocar = trocar_near_home(arm, np.random.default_rng(7))
    first, second = (find_start(arm, SCOPE, trocar, attempts=10, seed=1) for _ in range(2))
    assert np.array_equal(first, second)


def test_more_attempts_never_find_a_worse_start() -> None:
    arm = load_arm("lwa3")
    trocar = trocar_near_home(arm, np.random.default_rng(7))

    def score(attempts: int) -> float:
        angles = find_start(arm, SCOPE, trocar, attempts=attempts)
        insertion = Insertion(arm, SCOPE, trocar, angles)
        J = insertion.state(insertion.q_start).J_local
        least = float(np.linalg.svd(J, compute_uv=False)[-1])
        return least * min(float(arm.limit_margin(angles).min()), np.pi / 4)

    assert score(2) <= score(40)


def test_a_trocar_out_of_reach_says_how_far() -> None:
    trocar = Trocar((2.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    with pytest.raises(NoStartFound, match=r"nearest it comes is \d+\.\d mm .* reaches 0\.78 m"):
        find_start(load_arm("lwa3"), SCOPE, trocar, attempts=5)


def test_a_trocar_reached_only_near_a_singularity_says_so() -> None:
    arm = load_arm("lwa3")
    trocar = Insertion.on_shaft(arm, SCOPE).trocar
    with pytest.raises(NoStartFound, match="only near a singularity"):
        find_start(arm, SCOPE, trocar, attempts=3, singular_value=10.0)


def test_a_scenario_takes_a_wished_trocar() -> None:
    scenario = scenario_module("conical_helix").scenario
    trocar = trocar_near_home(load_arm("lwa3"), np.random.default_rng(7))
    assert scenario("lwa3", trocar=trocar).trocar == trocar
    assert load_scenario("conical_helix", "lwa3").trocar != trocar
