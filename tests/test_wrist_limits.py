"""Limits of a wristed instrument count the shaft and each piece of the wrist where they are."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, derivative
from limit_parts import T, reference
from wristed import ARMS, NEEDLE_DRIVER, chain_by_hand, inserted, somewhere

from rcmqp import Instrument, Scenario, load_arm, make_controller, simulate
from rcmqp.errors import OptionError
from rcmqp.limits import Limit, make_limit
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.loading import load_scenario
from rcmqp.runs.metrics import obstacle_distance
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Wrist, WristJoint
from rcmqp.world.obstacles import Sphere

GAIN, RADIUS = 40.0, 0.02


def off(centre: Array, ends: list[Array]) -> float:
    """Distance from a point to a segment."""
    way = ends[1] - ends[0]
    share = np.clip((centre - ends[0]) @ way / (way @ way), 0.0, 1.0)
    return float(np.linalg.norm(centre - ends[0] - share * way))


def rooms(name: str, part: str, insertion: Insertion, q: Array, centre: Array) -> list[float]:
    """What each row of a limit keeps positive, by the hand-made kinematics."""
    chain = chain_by_hand(insertion, q)
    points = [np.asarray(place.translation) for place in chain]
    if name == "trocar_depth":
        depths = [(p - insertion.trocar.pivot) @ chain[0].rotation[:, 2] for p in points]
        low, high = insertion.trocar.depth_range
        return [high - depths[3], depths[3] - low, high - depths[1], high - depths[2]]
    outer, inner = RADIUS + NEEDLE_DRIVER.radius, RADIUS - NEEDLE_DRIVER.radius
    segments = [off(centre, points[i : i + 2]) for i in range(3)]
    if name == "entry_sphere":
        return [inner - segments[0]]
    ends = [float(np.linalg.norm(centre - point)) for point in points]
    if name == "keep_in":
        order = [ends[3], ends[1], ends[2], ends[0]]
        return [inner - end for end in order[: 4 if part == "shaft" else 1]]
    return [end - outer for end in (segments if part == "shaft" else ends[-1:])]


def made(name: str, part: str, insertion: Insertion, centre: Array) -> Limit:
    options: dict[str, Any] = {"gain": GAIN}
    if name != "trocar_depth":
        options |= {"centre": tuple(centre), "radius": RADIUS}
    return make_limit(name, insertion, T, **options, **({"part": part} if part else {}))


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("trocar_depth", ""),
        ("keep_out", "shaft"),
        ("keep_out", "tip"),
        ("keep_in", "shaft"),
        ("keep_in", "tip"),
        ("entry_sphere", ""),
    ],
)
def test_a_row_is_the_derivative_of_what_is_there(name: str, part: str, arm: str) -> None:
    """For spheres beside the shaft, each piece and beyond the tip."""
    rng, insertion = np.random.default_rng(7), inserted(arm)
    model = insertion.arm.model
    for beside in (-0.05, -0.015, -0.005, 0.01):  # from the tool's point, along the tool
        q = insertion.arm.configuration(somewhere(insertion, rng))
        aside = pin.SE3(np.eye(3), np.array([0.006, -0.012, beside]))
        centre = np.asarray((chain_by_hand(insertion, q)[-1] * aside).translation)
        limit = made(name, part, insertion, centre)
        found = limit.evaluate(insertion.state(q), reference(np.array(insertion.trocar.pivot)))
        expected = rooms(name, part, insertion, q, centre)
        assert len(found.names) == len(expected)
        assert_allclose(found.d, GAIN * np.array(expected), rtol=0, atol=1e-10)

        def room(t: float, step: Array, q: Array = q, centre: Array = centre) -> Array:
            moved = pin.integrate(model, q, t * step)
            return np.array(rooms(name, part, insertion, moved, centre))

        columns = [
            derivative(functools.partial(room, step=step), 1e-5) for step in np.eye(model.nv)
        ]
        assert_allclose(found.C, -np.column_stack(columns), rtol=0, atol=1e-8)


def test_rows_of_a_wrist_are_named_by_its_joints() -> None:
    insertion, centre = inserted("panda"), np.zeros(3)
    assert made("keep_out", "shaft", insertion, centre).row_names == (  # type: ignore[attr-defined]
        "sphere, shaft out",
        "sphere, wrist_pitch out",
        "sphere, wrist_yaw out",
    )
    assert made("keep_in", "shaft", insertion, centre).row_names == (  # type: ignore[attr-defined]
        "sphere, tip in",
        "sphere, wrist_pitch in",
        "sphere, wrist_yaw in",
        "sphere, mount in",
    )


def obstructed() -> Scenario:
    """A helix that draws the tool through a sphere the shaft never comes near."""
    scenario = load_scenario("helix", "panda", instrument=NEEDLE_DRIVER, duration=2.0)
    free = simulate(
        scenario, make_controller("hierarchical_qp", scenario.insertion(), scenario.period)
    )
    k = int(0.6 * len(free.q))
    tool = chain_by_hand(free.insertion(), free.q[k])[-1]
    centre = tool.act(np.array([0.0, 0.0, 0.004]))
    return dataclasses.replace(scenario, obstacles=(Sphere(tuple(centre), 0.003),))


def test_an_obstacle_in_the_way_of_the_tool_is_not_touched() -> None:
    scenario = obstructed()
    insertion = scenario.insertion()
    run = simulate(scenario, make_controller("hierarchical_qp", insertion, scenario.period))
    centre, found = np.array(scenario.obstacles[0].centre), obstacle_distance(run)
    least = math.inf
    for k in range(0, len(run.q), 10):
        points = [np.asarray(place.translation) for place in chain_by_hand(insertion, run.q[k])]
        away = min(off(centre, points[i : i + 2]) for i in range(3))
        away -= 0.003 + NEEDLE_DRIVER.radius
        assert_allclose(found[k], away, rtol=0, atol=1e-12)
        least = min(least, away)
        depth = (points[-1] - run.pivot[k]) @ dq.to_se3(run.x[k]).rotation[:, 2]
        assert_allclose(run.depth[k], depth, rtol=0, atol=1e-12)
    assert -1e-6 < least < 1e-4
    assert run.rcm_error.max() < 1e-6


def test_a_wrist_has_six_joints_at_most() -> None:
    joints = [WristJoint(f"j{k}", (0.0, 1.0, 0.0), (-1.0, 1.0), 1.0) for k in range(7)]
    with pytest.raises(OptionError, match="1 to 6 joints"):
        Wrist(tuple(joints))


def test_a_wrist_bent_back_on_itself_does_not_take_its_joints_too_deep() -> None:
    """The tool's point is in the range all the way; a joint before it, deeper, decides."""
    wrist = NEEDLE_DRIVER.wrist
    assert wrist is not None
    joints = tuple(dataclasses.replace(joint, position=(-2.5, 2.5)) for joint in wrist.joints)
    instrument = dataclasses.replace(
        NEEDLE_DRIVER, wrist=dataclasses.replace(wrist, joints=joints)
    )
    insertion = inserted("panda", instrument)
    angles = insertion.angles_start.copy()
    angles[-2] = 2.4  # pitch: the tool points back along the shaft
    wide = insertion.trocar
    q = insertion.arm.configuration(angles)
    points = [place.translation for place in chain_by_hand(insertion, q)]
    shaft = insertion.arm.state(q).oMe.rotation[:, 2]
    depths = [float((point - np.array(wide.pivot)) @ shaft) for point in points]
    assert depths[3] < depths[2] < depths[1]
    trocar = dataclasses.replace(wide, depth_range=(0.0, depths[1] - 0.001))
    limit = make_limit("trocar_depth", insertion, T)
    limit = dataclasses.replace(limit, trocar=trocar, gain=GAIN)  # type: ignore[call-arg]
    found = limit.evaluate(insertion.state(q), reference(np.array(trocar.pivot)))
    rooms_now = dict(zip(found.names, found.d / GAIN, strict=True))
    assert rooms_now["trocar depth, deepest"] > 0.0
    assert rooms_now["trocar depth, wrist_pitch deepest"] == pytest.approx(-0.001, abs=1e-12)


@pytest.mark.parametrize("name", ["trocar_depth", "keep_out", "keep_in"])
def test_a_limit_for_a_wrist_is_refused_on_an_arm_without_one(name: str) -> None:
    insertion, centre = inserted("panda"), np.zeros(3)
    limit = made(name, "" if name == "trocar_depth" else "shaft", insertion, centre)
    alone = Insertion.on_shaft(load_arm("panda"), Instrument())
    with pytest.raises(ValueError, match="the block is for a wrist, the arm has none"):
        limit.evaluate(alone.state(alone.q_start), reference(np.array(alone.trocar.pivot)))
    with pytest.raises(
        OptionError, match=r"wrist has 3 joints, here it is one without a wrist; make"
    ):
        make_controller("hierarchical_qp", alone, T, limits=[limit])


@pytest.mark.parametrize("name", ["trocar_depth", "keep_out", "keep_in"])
def test_a_limit_for_a_straight_instrument_is_refused_on_an_arm_with_a_wrist(name: str) -> None:
    """It would guard a straight tip only."""
    insertion, centre = inserted("panda"), np.zeros(3)
    alone = Insertion.on_shaft(load_arm("panda"), Instrument())
    limit = made(name, "" if name == "trocar_depth" else "shaft", alone, centre)
    with pytest.raises(OptionError, match=r"one whose wrist has 3 joints; make it for this"):
        make_controller("hierarchical_qp", insertion, T, limits=[limit])
