"""An instrument whose tool is turned by joints of its own: shaft and tool are two frames."""

from __future__ import annotations

import dataclasses
import functools
import math
from pathlib import Path

import numpy as np
import oracles.tasks
import pinocchio as pin
import pytest
from helpers import assert_allclose, derivative
from opened import Opened
from wristed import (
    ARMS,
    JOINTS,
    NEEDLE_DRIVER,
    PITCH_TO_YAW,
    YAW_TO_TIP,
    inserted,
    somewhere,
    tool_by_hand,
)

from rcmqp import (
    Instrument,
    Run,
    Scenario,
    ViewCommand,
    load_arm,
    make_controller,
    simulate,
    view_pose,
)
from rcmqp.controllers import CONTROLLERS
from rcmqp.controllers.hierarchical_qp import default_limits
from rcmqp.controllers.task_priority import manipulability
from rcmqp.errors import InsertionError, OptionError, UnknownName
from rcmqp.limits import JointLimits
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.governor import tip_distance
from rcmqp.references.hand import ImageHand
from rcmqp.references.view import Reference
from rcmqp.runs.loading import load_scenario
from rcmqp.runs.metrics import obstacle_distance
from rcmqp.tasks import OrientationTask, RcmTask, Task, TipTask
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Mount, Wrist, WristJoint
from rcmqp.world.instrument_file import INSTRUMENTS, load_instrument
from rcmqp.world.obstacles import Sphere
from rcmqp.world.port import Port


@pytest.fixture(scope="module", params=ARMS)
def helix(request: pytest.FixtureRequest) -> Run:
    scenario = load_scenario("helix", request.param, instrument=NEEDLE_DRIVER, duration=8.0)
    controller = make_controller("hierarchical_qp", scenario.insertion(), scenario.period)
    return simulate(scenario, controller)


def test_a_wristed_tool_draws_the_helix_and_keeps_its_orientation(helix: Run) -> None:
    """On the trocar to 1e-6 mm, and as the forward kinematics of the arm alone have it."""
    insertion = helix.insertion()
    assert 1e3 * helix.rcm_error.max() < 0.001
    assert 1e3 * math.sqrt(float(np.mean(helix.tip_error**2))) < 0.002
    assert 1e3 * helix.orientation_error.max() < 0.1
    assert np.ptp(helix.tilt) > math.radians(5.0)
    assert np.ptp(helix.angles[:, -JOINTS:], axis=0).min() > 0.05
    start = tool_by_hand(insertion, helix.q[0])
    for k in range(0, len(helix.q), 800):
        tool = tool_by_hand(insertion, helix.q[k])
        off = np.linalg.norm(pin.log3(tool.rotation @ start.rotation.T))
        assert_allclose(helix.tip[k], tool.translation, rtol=0, atol=1e-12)
        assert_allclose(helix.orientation_error[k], off, rtol=0, atol=1e-9)
        asked = dq.translation(helix.x_d[k]) + insertion.tip_depth * dq.rotate(
            dq.P(helix.x_d[k]), [0.0, 0.0, 1.0]
        )
        assert np.linalg.norm(asked - tool.translation) < 5e-6


def test_the_wrist_keeps_the_limits_of_its_joints(helix: Run) -> None:
    arm, T = helix.insertion().arm, helix.scenario.period
    speeds = np.vstack([np.zeros(arm.nv), helix.v])
    accelerations = np.diff(speeds, axis=0) / T
    assert (np.abs(helix.v) <= arm.velocity * (1.0 + 1e-9)).all()
    assert (np.abs(accelerations) <= arm.acceleration * (1.0 + 1e-6)).all()
    jerks = np.diff(np.vstack([np.zeros(arm.nv), accelerations]), axis=0) / T
    assert (np.abs(jerks) <= arm.jerk * (1.0 + 1e-6)).all()
    assert (arm.limit_margin(helix.angles) >= -1e-9).all()


@pytest.mark.parametrize("name", ARMS)
def test_jacobians_of_shaft_and_tool_are_derivatives(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    arm = insertion.arm
    for _ in range(3):
        q, v = arm.configuration(somewhere(insertion, rng)), rng.normal(size=arm.nv)
        state, depth = insertion.state(q, v), float(rng.uniform(-0.2, 0.1))
        tool = state.tool
        assert_allclose(
            tool.oMt.homogeneous, tool_by_hand(insertion, q).homogeneous, rtol=0, atol=1e-12
        )

        def moved(t: float, step: Array, q: Array = q) -> Array:
            return np.asarray(pin.integrate(arm.model, q, t * step))

        def twist(t: float, step: Array, at: pin.SE3 = tool.oMt) -> Array:
            there = insertion.state(moved(t, step)).tool.oMt
            return np.asarray(pin.log6(at.actInv(there)).vector)

        def point(t: float, step: Array, depth: float = depth) -> Array:
            return insertion.state(moved(t, step)).shaft.point(depth)

        steps = np.eye(arm.nv)
        expected = np.column_stack([derivative(functools.partial(twist, step=s)) for s in steps])
        assert_allclose(tool.J_local, expected, rtol=0, atol=1e-9)
        expected = np.column_stack([derivative(functools.partial(point, step=s)) for s in steps])
        assert_allclose(state.shaft.jacobian(depth), expected, rtol=0, atol=1e-9)
        assert_allclose(state.shaft.velocity(depth), expected @ v, rtol=0, atol=1e-9)
        assert not state.J_local[:, -JOINTS:].any()  # the shaft is on the arm's last joint


@pytest.mark.parametrize("name", ARMS)
def test_rows_of_a_wristed_tool_are_derivatives_of_their_errors(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    arm = insertion.arm
    q = arm.configuration(somewhere(insertion, rng))
    reference = Reference(
        insertion.x_rcm, np.zeros(8), np.array(insertion.trocar.pivot), np.zeros(3)
    )
    tasks: list[Task] = [TipTask(), OrientationTask.made_for(insertion)]
    for task in tasks:
        found = task.evaluate(insertion.state(q), reference)
        assert np.linalg.norm(found.error) > 1e-2

        def along(t: float, step: Array, task: Task = task) -> Array:
            state = insertion.state(pin.integrate(arm.model, q, t * step))
            return task.evaluate(state, reference).error

        columns = [derivative(functools.partial(along, step=step)) for step in np.eye(arm.nv)]
        assert_allclose(found.jacobian, np.column_stack(columns), rtol=0, atol=1e-9)
        expected = oracles.tasks.residual(task, insertion.state(q), reference)
        assert_allclose(found.jacobian, expected.jacobian, rtol=0, atol=1e-12)
        assert_allclose(found.error, expected.error, rtol=0, atol=1e-12)
    rcm = RcmTask().evaluate(insertion.state(q), reference)
    assert not rcm.jacobian[:, -JOINTS:].any()


def test_the_tool_of_a_straight_scope_is_its_tip() -> None:
    rng, insertion = np.random.default_rng(7), inserted("panda", Instrument())
    arm = insertion.arm
    q = arm.configuration(somewhere(insertion, rng))
    tool = insertion.state(q).tool
    assert_allclose(tool.oMt.translation, insertion.tip(insertion.state(q).x), rtol=0, atol=1e-12)

    def twist(t: float, step: Array) -> Array:
        there = insertion.state(q + t * step).tool.oMt
        return np.asarray(pin.log6(tool.oMt.actInv(there)).vector)

    columns = [derivative(functools.partial(twist, step=step)) for step in np.eye(arm.nv)]
    assert_allclose(tool.J_local, np.column_stack(columns), rtol=0, atol=1e-9)


def test_a_wrist_of_two_joints_on_a_mount_at_an_angle_holds_what_it_can() -> None:
    """Eight rows for eight joints, and still neither trocar nor tip is let go."""
    pitch = WristJoint("pitch", (0.0, 1.0, 0.0), (-1.2, 1.2), 2.0)
    yaw = WristJoint("yaw", (1.0, 0.0, 0.0), (-1.2, 1.2), 2.0, along=0.01)
    mount = Mount((0.0, 0.04, 0.03), (0.0, math.radians(30.0), 0.0))
    bent = Instrument(mount=mount, wrist=Wrist((pitch, yaw), 0.012))
    scenario = load_scenario("helix", "ur10", instrument=bent, duration=3.0)
    insertion = scenario.insertion()
    run = simulate(scenario, make_controller("hierarchical_qp", insertion, scenario.period))
    assert run.rcm_error.max() < 1e-6
    assert run.tip_error.max() < 1e-5


def test_limits_of_the_arm_set_by_hand_hold_and_are_kept_with_a_wrist() -> None:
    arm = load_arm("panda", velocity=1.0, jerk=500.0)
    insertion = Insertion.on_shaft(arm, NEEDLE_DRIVER)
    assert_allclose(insertion.arm.velocity, [1.0] * 7 + [3.0] * 3, rtol=0, atol=0)
    assert_allclose(insertion.arm.jerk[:7], 500.0, rtol=0, atol=0)
    assert insertion.arm.is_assumed("jerk").tolist() == [False] * 7 + [True] * 3
    path = load_scenario("helix").path
    scenario = Scenario.of("own", insertion, path, duration=0.01)
    assert Scenario.from_json(scenario.to_json()) == scenario
    assert_allclose(scenario.insertion().arm.jerk, insertion.arm.jerk, rtol=0, atol=0)
    simulate(scenario, make_controller("hierarchical_qp", insertion, scenario.period))
    box = JointLimits(insertion.arm, 1e-3)
    assert box.block.joints == 10


def test_a_port_of_ones_own_takes_a_wristed_instrument() -> None:
    before = load_scenario("helix", "panda", instrument=NEEDLE_DRIVER)
    port = Port(pivot=(0.45, 0.05, 0.2), depth=0.1)
    scenario = load_scenario("helix", "panda", instrument=NEEDLE_DRIVER, port=port, duration=0.5)
    insertion = scenario.insertion()
    assert len(scenario.angles_start) == len(before.angles_start) == 10
    run = simulate(scenario, make_controller("hierarchical_qp", insertion, scenario.period))
    assert_allclose(run.pivot[0], [0.45, 0.05, 0.2], rtol=0, atol=0)
    assert run.rcm_error.max() < 1e-6


def test_a_path_waits_for_the_tool_and_not_for_the_shaft() -> None:
    rng, insertion = np.random.default_rng(7), inserted("ur10")
    q = insertion.arm.configuration(somewhere(insertion, rng))
    pivot = np.array(insertion.trocar.pivot)
    reference = Reference(insertion.x_rcm, np.zeros(8), pivot, np.zeros(3))
    asked = dq.to_se3(insertion.x_rcm).act(np.array([0.0, 0.0, insertion.tip_depth]))
    far = np.linalg.norm(tool_by_hand(insertion, q).translation - asked)
    found = tip_distance(insertion.state(q), reference, insertion)
    assert_allclose(found, far, rtol=0, atol=1e-12)


def test_obstacles_are_as_far_as_shaft_and_tool_are(helix: Run) -> None:
    k = 1500
    insertion = helix.insertion()
    tool = tool_by_hand(insertion, helix.q[k]).translation
    shaft = dq.to_se3(helix.x[k])
    end = shaft.act(np.array([0.0, 0.0, insertion.tip_depth - PITCH_TO_YAW - YAW_TO_TIP]))
    beside, radius = shaft.rotation @ np.array([0.03, 0.0, 0.0]), NEEDLE_DRIVER.radius
    for point, away in ((tool + beside, 0.03), (end - 0.1 * shaft.rotation[:, 2] + beside, 0.03)):
        scenario = dataclasses.replace(helix.scenario, obstacles=(Sphere(tuple(point), 0.01),))
        found = obstacle_distance(dataclasses.replace(helix, scenario=scenario))[k]
        assert_allclose(found, away - 0.01 - radius, rtol=0, atol=3e-4)


# What does not go with a wrist -------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(set(CONTROLLERS) - {"hierarchical_qp"}))
def test_other_laws_refuse_a_wrist(name: str) -> None:
    with pytest.raises(OptionError, match=f"{name} is for .* fixed to the shaft; use hierarch"):
        make_controller(name, inserted("panda"), 1e-3)


def test_manipulability_refuses_a_wrist() -> None:
    insertion = inserted("panda", NEEDLE_DRIVER)
    state = insertion.state(insertion.q_start)
    with pytest.raises(OptionError, match=r"fixed to the shaft; this instrument has a wrist"):
        manipulability(state, view_pose(insertion.x_rcm, ViewCommand()))


def test_hands_and_camera_tasks_refuse_a_wrist() -> None:
    with pytest.raises(OptionError, match="this instrument has a wrist"):
        ImageHand(inserted("panda"))
    scenario = load_scenario("camera_task", "panda", instrument=NEEDLE_DRIVER)
    with pytest.raises(OptionError, match="a camera task is for a camera that is fixed"):
        next(scenario.references(scenario.insertion()))


def test_a_start_with_a_bent_wrist_is_refused() -> None:
    arm = load_arm("panda")
    straight = inserted("panda")
    Insertion(arm, NEEDLE_DRIVER, straight.trocar, [*arm.home, 0.5, 0.0, 0.0])  # only rolled
    with pytest.raises(InsertionError, match=r"the tool starts 1\.9 mm from where a straight"):
        Insertion(arm, NEEDLE_DRIVER, straight.trocar, [*arm.home, 0.0, 0.1, 0.0])


def test_names_of_joints_must_differ_and_an_arm_has_one_wrist() -> None:
    clash = Wrist((WristJoint("panda_joint3", (0.0, 1.0, 0.0), (-1.0, 1.0), 1.0),))
    with pytest.raises(OptionError, match="panda_joint3"):
        inserted("panda", Instrument(wrist=clash))
    twice = inserted("panda")
    with pytest.raises(OptionError, match=r"panda has .* wrist already; give .* insertion\.bare"):
        Insertion(twice.arm, NEEDLE_DRIVER, twice.trocar, twice.angles_start)


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_every_instrument_of_rcmqp_loads_and_says_its_sources(name: str) -> None:
    instrument = load_instrument(name)
    assert Instrument(**dataclasses.asdict(instrument)) == instrument
    file = Path(__file__).parents[1] / "rcmqp" / "world" / "instruments" / f"{name}.toml"
    assert "[sources]" in file.read_text()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[wrist]\njoints = []", r"needs a table \[\[wrist.joints\]\]"),
        ("[[wrist.joints]]\nname = 'a'", "axis"),
        ("[[wrist.joints]]\nname = 'a'\nangle = 2", r"key in .*\[\[wrist.joints\]\] 'angle'"),
        (
            "[[wrist.joints]]\nname='a'\naxis=[0,1,0]\nposition=[-80,80]\nvelocity=1",
            "position = .*in rad",
        ),
    ],
)
def test_a_wrist_that_is_wrong_is_refused_in_words(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "wrist.toml"
    file.write_text(text)
    with pytest.raises((OptionError, UnknownName), match=said):
        load_instrument(file)


# The page ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    scenario = load_scenario("helix", "lwa3", instrument=NEEDLE_DRIVER, duration=2.0, period=0.008)
    made = make_controller("hierarchical_qp", scenario.insertion(), scenario.period)
    return [simulate(scenario, made)]


def test_the_page_has_the_camera_at_the_tool(opened: Opened, runs: list[Run]) -> None:
    run = runs[0]
    for k in (0, len(run.q) - 1):
        opened.seek(float(run.time[k]))
        found, flange = (
            np.array(opened.js(f"rcmqp.pose(0, '{link}')")).reshape(4, 4).T
            for link in ("camera", "flange")
        )
        arm = load_arm("lwa3").with_effector(pin.SE3.Identity())
        expected = arm.state(run.q[k][: arm.nq]).oMe
        assert_allclose(flange, expected.homogeneous, rtol=0, atol=1e-5)
        tool = tool_by_hand(run.insertion(), run.q[k])
        assert_allclose(found[:3, 3], tool.translation, rtol=0, atol=1e-5)
        assert_allclose(-found[:3, 2], tool.rotation[:, 2], rtol=0, atol=1e-5)


def test_a_wrist_may_be_left_out_of_a_scenarios_start_and_the_run_has_it(tmp_path: Path) -> None:
    full = load_scenario("circle", "panda", instrument=NEEDLE_DRIVER, duration=0.02)
    bare = dataclasses.replace(full, angles_start=full.angles_start[:-JOINTS])
    law = make_controller("hierarchical_qp", bare.insertion(), bare.period)
    run = simulate(bare, law)
    assert run.scenario.angles_start == full.angles_start
    run.save(tmp_path / "run.h5")
    assert Run.load(tmp_path / "run.h5").digest == run.digest
    assert run.drawn_with("panda").insertion().arm.joints == run.joints


def test_the_view_at_the_start_is_within_reach_however_deep_the_tool_is() -> None:
    arm = load_arm("panda")
    short = dataclasses.replace(NEEDLE_DRIVER, length=0.1)
    deep = short.tip - short.mount_offset - 1e-3
    assert deep > short.length
    insertion = Insertion.on_shaft(arm, short, depth=deep)
    insertion.check_reach(0.0, 0.0)
    with pytest.raises(InsertionError, match="instrument is only"):
        insertion.check_reach(0.0, 0.01)


def test_a_wrist_does_not_make_the_shafts_limits_gentler() -> None:
    arm = load_arm("panda")
    rates = [
        [limit.rates for limit in default_limits(Insertion.on_shaft(arm, tool), 1e-3)[2:4]]  # type: ignore[attr-defined]
        for tool in (Instrument(), NEEDLE_DRIVER)
    ]
    assert rates[0] == rates[1]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("tool = 0.01", r"needs a table \[\[wrist.joints\]\]"),
        ("joints = 3", r"needs a table \[\[wrist.joints\]\]"),
        ('[[wrist.joints]]\nname = "a"', "joint 1 of .* has no axis; it needs name, axis"),
        ("[[wrist.joints]]\nname = 5\naxis = [0, 0, 1]\nposition = [-1, 1]\nvelocity = 1", "name"),
    ],
)
def test_what_a_wrists_file_lacks_is_said_in_words(tmp_path: Path, lines: str, said: str) -> None:
    (tmp_path / "w.toml").write_text(f"[wrist]\n{lines}\n")
    with pytest.raises(OptionError, match=said):
        load_instrument(tmp_path / "w.toml")
