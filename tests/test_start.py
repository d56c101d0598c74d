"""Starting configurations found for a wished trocar."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest
from helpers import assert_allclose
from public_arms import PUBLIC_ARMS, write_public_arm
from test_urdf import urdf, write

from rcmqp import (
    Arm,
    Insertion,
    Instrument,
    Trocar,
    compute_metrics,
    find_start,
    load_arm,
    load_scenario,
    make_controller,
    simulate,
)
from rcmqp.errors import NoStartFound
from rcmqp.runs.loading import scenario_module
from rcmqp.world.ease import ease_at
from rcmqp.world.geometry import Collisions
from rcmqp.world.start import search_start

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
        return ease_at(Insertion(arm, SCOPE, trocar, angles)).score

    assert score(2) <= score(40)


@pytest.mark.parametrize("stroke", [0.5, 0.19, 0.1, 0.03])
def test_margins_are_in_each_joints_own_unit(tmp_path: Path, stroke: float) -> None:
    lift = (
        '<link name="base"/><joint name="lift" type="prismatic"><parent link="base"/>'
        f'<child link="l0"/><axis xyz="0 0 1"/><limit lower="0" upper="{stroke}" velocity="0.05" '
        'effort="100"/></joint><link name="l0"/>'
    )
    (tmp_path / "r.urdf").write_text(urdf().replace('<link name="l0"/>', lift))
    home = [stroke / 2, 0.1, -0.6, 0.2, 1.1, -0.1, 0.9, 0.3]
    arm = load_arm(tmp_path / "r.urdf", "l7", home=home)
    trocar = Insertion.on_shaft(arm, SCOPE).trocar
    angles = find_start(arm, SCOPE, trocar, attempts=4)
    margins = arm.limit_margin(angles)
    assert margins[0] >= 0.01
    assert margins[1:].min() >= 0.1
    with pytest.raises(NoStartFound, match=r"lift moves only from 0 to .* m, and is to stay 0\.3"):
        find_start(arm, SCOPE, trocar, attempts=4, stroke_margin=0.3)


def test_a_trocar_out_of_reach_says_how_far() -> None:
    trocar = Trocar((2.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    with pytest.raises(NoStartFound, match=r"nearest it comes is \d+\.\d mm .* reaches 0\.78 m"):
        find_start(load_arm("lwa3"), SCOPE, trocar, attempts=5)


def test_a_trocar_reached_only_near_a_singularity_says_so() -> None:
    arm = load_arm("lwa3")
    trocar = Insertion.on_shaft(arm, SCOPE).trocar
    with pytest.raises(NoStartFound, match="only near a singularity"):
        find_start(arm, SCOPE, trocar, attempts=3, singular_value=10.0)


def test_a_start_with_the_scope_through_the_arm_is_refused_by_name() -> None:
    arm = load_arm("ur5")
    rng, collisions = np.random.default_rng(7), Collisions(arm, SCOPE)
    poses = (arm.random_angles(rng) for _ in range(1000))
    folded = next(q for q in poses if collisions.first(q).endswith("link and the shaft"))
    trocar = Insertion.on_shaft(arm, SCOPE, folded).trocar
    assert ease_at(Insertion(arm, SCOPE, trocar, folded)).touching
    assert Collisions(arm, SCOPE).first(arm.home) == ""
    start = search_start(arm, SCOPE, trocar)
    assert Collisions(arm, SCOPE).first(start.angles) == ""


def test_a_start_says_what_it_is_like() -> None:
    arm = load_arm("panda")
    text = str(search_start(arm, SCOPE, Insertion.on_shaft(arm, SCOPE).trocar, attempts=20))
    for words in ("shaft 0 deg from straight down", "panda_joint", "rad from its limits", "of 21"):
        assert words in text


@pytest.mark.parametrize("arm", [*PUBLIC_ARMS])
def test_the_start_of_an_arm_without_a_home_is_one_that_a_surgeon_would_use(
    tmp_path: Path, arm: str
) -> None:
    path = write_public_arm(tmp_path, arm)
    before = time.process_time()
    loaded = load_arm(path, "flange")
    home = loaded.home
    took = time.process_time() - before
    insertion = Insertion.on_shaft(loaded, SCOPE)
    ease, pivot = ease_at(insertion), np.array(insertion.trocar.pivot)
    print(f"{arm}: {took:.1f} s, {ease}")
    assert took < 5.0
    assert np.array_equal(load_arm(path, "flange").home, home)
    assert ease.tilt < np.radians(45.0)
    assert not ease.touching
    assert not ease.low
    assert pivot[0] > 0.0  # in front of the base
    assert loaded.limit_margin(home).min() > 0.1
    scenario = load_scenario("conical_helix", str(path), flange="flange", period=0.004)
    made = make_controller("hierarchical_qp", scenario.insertion(), scenario.period)
    run = simulate(scenario, made)
    assert not run.head.stops
    metrics = compute_metrics(run)
    assert metrics.limit_margin_min_rad > -1e-9
    assert metrics.tip_max_mm < 1.0
    assert metrics.rcm_max_mm < 0.01


def test_a_scenario_takes_a_wished_trocar() -> None:
    scenario = scenario_module("conical_helix").scenario
    trocar = trocar_near_home(load_arm("lwa3"), np.random.default_rng(7))
    assert scenario("lwa3", trocar=trocar).trocar == trocar
    assert load_scenario("conical_helix", "lwa3").trocar != trocar


def fan(count: int) -> list[tuple[tuple[float, float, float], ...]]:
    """Triangles of a cone whose point has ``count`` neighbours; two of them make it flat."""
    turns = 2.0 * math.pi * np.arange(count) / count
    rim = [(0.05 * math.cos(t), 0.05 * math.sin(t), 0.0) for t in turns]
    return [((0.0, 0.0, 0.1), rim[i], rim[(i + 1) % count]) for i in range(count)]


@pytest.mark.parametrize("count", [2, 12, 300])
def test_a_mesh_of_any_shape_stands_in_the_way(tmp_path: Path, count: int) -> None:
    """Coal takes no hull of a flat mesh, nor of one whose point has more than 255 neighbours."""
    corners = ""
    for each in fan(count):
        points = "".join(f"vertex {x} {y} {z}\n" for x, y, z in each)
        corners += f"facet normal 0 0 0\nouter loop\n{points}endloop\nendfacet\n"
    (tmp_path / "fan.stl").write_text(f"solid fan\n{corners}endsolid fan\n")
    shape = '<collision><origin xyz="0 0 0.2"/><geometry><mesh filename="fan.stl"/></geometry>'
    text = urdf().replace('<link name="l0"/>', f'<link name="l0">{shape}</collision></link>')
    arm = load_arm(write(tmp_path, text), "l7", home=[0.0, 0.6, 0.0, 1.2, 0.0, 1.2, 0.0])
    collisions = Collisions(arm, SCOPE)
    assert collisions.first(arm.home) == ""
    low = np.array([0.0, 1.0, 0.0, 2.4, 0.0, 1.2, 0.0])  # the shaft comes back to the base
    touching = [
        collisions.first(low + np.array([0.0, a, 0.0, 0.0, 0.0, b, 0.0]))
        for a in np.linspace(-1.0, 1.0, 9)
        for b in np.linspace(-2.0, 1.0, 13)
    ]
    assert "l0 and the shaft" in touching
