from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import FrozenInstanceError, dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, derivative, shaft_distance

from rcmqp import load_arm
from rcmqp.controllers import make_controller
from rcmqp.errors import InvalidProblem, OptionError, UnknownName
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.view import Reference
from rcmqp.tasks import TASKS, ObjectiveTask, PostureTask, Residual, Task, make_task
from rcmqp.tasks.objectives import Objective, make_objective
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Instrument

ARMS = ("lwa3", "kinova", "panda", "ur5", "z1")
DERIVED = sorted(set(TASKS) - {"objective"})  # errors whose derivative the Jacobian is
ON_TARGET, NEAR, FAR = 0.0, 1e-8, 1.0


@functools.cache
def insertion(arm: str) -> Insertion:
    rng = np.random.default_rng(11)
    loaded = load_arm(arm)
    return Insertion.on_shaft(loaded, Instrument(), loaded.random_angles(rng))


@dataclass
class Moment:
    """An arm, a desired effector and a trocar, all of them moving."""

    insertion: Insertion
    q: Array
    oMd: pin.SE3
    twist: Array  # (6,) of the desired effector, in its own axes, linear then angular
    pivot: Array
    pivot_dot: Array
    side: float  # which of x_d and -x_d to use

    def state(self, v: Array, t: float) -> ArmState:
        return self.insertion.state(pin.integrate(self.insertion.arm.model, self.q, t * v))

    def reference(self, t: float) -> Reference:
        x_d = self.side * dq.from_se3(self.oMd * pin.exp6(t * self.twist))
        nu, omega = self.twist[:3], self.twist[3:]
        x_d_dot = 0.5 * dq.mul(x_d, np.array([0.0, *omega, 0.0, *nu]))
        return Reference(x_d, x_d_dot, self.pivot + t * self.pivot_dot, self.pivot_dot)


def moment(arm: str, distance: float, seed: int = 7) -> Moment:
    """``distance`` [m] and [rad] from the target, and off the shaft."""
    rng = np.random.default_rng(seed)
    inserted = insertion(arm)
    q = inserted.arm.configuration(inserted.arm.random_angles(rng))
    oMe = inserted.state(q).oMe
    off = pin.exp6(distance * rng.normal(scale=0.7, size=6))
    return Moment(
        insertion=inserted,
        q=q,
        oMd=oMe * off,
        twist=rng.normal(size=6),
        pivot=oMe.act(np.array([0.0, 0.0, 0.05]) + 0.3 * distance * rng.normal(size=3)),
        pivot_dot=rng.normal(size=3),
        side=float(rng.choice([-1.0, 1.0])),
    )


def task_for(name: str, m: Moment, **options: Any) -> Task:
    if name == "posture":  # the target is where the moment's is: at the desired distance
        off = np.linalg.norm(m.oMd.inverse() * m.insertion.state(m.q).oMe - np.eye(4))
        options["posture"] = m.insertion.arm.angles(m.q) - 0.5 * off
    return make_task(name, m.insertion, **options)


# Every task --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(TASKS))
def test_every_task_is_finite_read_only_repeatable_and_remembers_nothing(name: str) -> None:
    for arm in ARMS:
        for distance in (ON_TARGET, NEAR, FAR):
            m, other = moment(arm, distance), moment(arm, FAR, seed=8)
            task = task_for(name, m)
            state, reference = m.state(np.zeros(m.insertion.arm.nv), 0.0), m.reference(0.0)
            found = task.evaluate(state, reference)
            kept = [array.copy() for array in arrays(found)]
            task.evaluate(other.insertion.state(other.q), other.reference(0.0))
            again = task.evaluate(state, reference)
            rows = found.error.size
            assert found.jacobian.shape == (rows, m.insertion.arm.nv)
            for array, copy, rerun in zip(arrays(found), kept, arrays(again), strict=True):
                assert np.isfinite(array).all()
                assert np.array_equal(array, copy)
                assert np.array_equal(array, rerun)
                assert not array.flags.writeable
                for shared in (*arrays(again), state.J_local, state.angles, reference.pivot_dot):
                    assert not np.shares_memory(array, shared)


def arrays(residual: Residual) -> tuple[Array, Array, Array]:
    return residual.error, residual.jacobian, residual.drift


def spun(m: Moment, v: Array, t: float) -> float:
    """Angle that the effector turns about its own z until t [rad]: the twist after the swing."""
    turn = pin.Quaternion(m.state(v, 0.0).oMe.rotation.T @ m.state(v, t).oMe.rotation)
    return 2.0 * float(np.arctan2(turn.z, turn.w))


def unspun(rows: Array, m: Moment, v: Array, t: float) -> Array:
    """Two rows in the effector's axes at t, in axes that went along and did not spin."""
    c, s = np.cos(spun(m, v, t)), np.sin(spun(m, v, t))
    return np.asarray(np.array([[c, -s], [s, c]]) @ rows)


@pytest.mark.parametrize("distance", [ON_TARGET, NEAR, FAR])
@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("name", DERIVED)
def test_jacobian_and_drift_are_the_derivatives_of_the_error(
    name: str, arm: str, distance: float
) -> None:
    for seed in (7, 8):
        m = moment(arm, distance, seed)
        task, nv = task_for(name, m), m.insertion.arm.nv
        found = task.evaluate(m.state(np.zeros(nv), 0.0), m.reference(0.0))

        def along(t: float, v: Array, task: Task = task, m: Moment = m) -> Array:
            error = task.evaluate(m.state(v, t), m.reference(0.0)).error
            return unspun(error, m, v, t) if task.name == "rcm" else error

        def in_time(t: float, task: Task = task, m: Moment = m, nv: int = nv) -> Array:
            return task.evaluate(m.state(np.zeros(nv), 0.0), m.reference(t)).error

        expected = np.column_stack(
            [derivative(functools.partial(along, v=v)) for v in np.eye(nv)] + [derivative(in_time)]
        )
        actual = np.column_stack([found.jacobian, found.drift])
        assert_allclose(actual, expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", DERIVED)
def test_what_a_task_wants_shrinks_its_error_at_its_gain_while_everything_moves(name: str) -> None:
    T, cycles = 1e-4, 100
    for arm in ARMS:
        m = moment(arm, 0.05)
        task = task_for(name, m, gain=80.0)
        q, sizes = m.q, []
        for k in range(cycles + 1):
            state, reference = m.insertion.state(q), m.reference(k * T)
            sizes.append(np.linalg.norm(task.evaluate(state, reference).error))
            level = task.level(state, reference)
            v = np.linalg.lstsq(level.A, level.b, rcond=1e-9)[0]
            q = pin.integrate(m.insertion.arm.model, q, T * v)
        assert sizes[0] > 1e-3
        shrunk = sizes[-1] / sizes[0]
        rank = np.linalg.matrix_rank(level.A, tol=1e-9)
        assert shrunk == pytest.approx((1.0 - 80.0 * T) ** cycles, rel=0.05), (arm, rank)


@pytest.mark.parametrize("name", sorted(set(DERIVED) - {"posture", "orientation"}))
def test_a_task_on_target_asks_for_what_the_reference_does(name: str) -> None:
    """Where the arm moves as the desired effector and the trocar go along, errors stay zero."""
    for arm in ("lwa3", "kinova", "panda"):
        m = moment(arm, ON_TARGET)
        state = m.insertion.state(m.q)
        v = np.linalg.lstsq(state.J_local, m.twist, rcond=None)[0]
        assert_allclose(state.J_local @ v, m.twist, rtol=0, atol=1e-12)
        on_shaft = m.oMd.actInv(m.pivot)  # a point of the shaft, at which the twist has it move
        m.pivot_dot = m.oMd.rotation @ (m.twist[:3] + np.cross(m.twist[3:], on_shaft))
        found = task_for(name, m).evaluate(state, m.reference(0.0))
        assert_allclose(found.error, 0.0, rtol=0, atol=1e-14)
        assert_allclose(found.jacobian @ v + found.drift, 0.0, rtol=0, atol=1e-12)


# Each task against something else ----------------------------------------------------------


@pytest.mark.parametrize("arm", ARMS)
def test_errors_are_what_pinocchio_measures(arm: str) -> None:
    m = moment(arm, FAR)
    state, reference = m.insertion.state(m.q), m.reference(0.0)
    depth = np.array([0.0, 0.0, m.insertion.tip_depth])

    def error(name: str) -> Array:
        return task_for(name, m).evaluate(state, reference).error

    assert_allclose(error("tip"), state.oMe.act(depth) - m.oMd.act(depth), rtol=0, atol=1e-14)
    assert np.linalg.norm(error("rcm")) == pytest.approx(shaft_distance(state.oMe, m.pivot))
    own, other = (m.insertion.depth(x, m.pivot) for x in (state.x, reference.x_d))
    assert_allclose(error("depth"), [own - other], rtol=0, atol=1e-14)
    cross = np.cross(state.oMe.rotation[:, 2], m.oMd.rotation[:, 2])
    assert np.linalg.norm(error("direction")) == pytest.approx(np.linalg.norm(cross))
    posture = m.insertion.arm.configuration(m.insertion.angles_start)
    task = make_task("posture", m.insertion)
    expected = pin.difference(m.insertion.arm.model, posture, m.q)
    assert_allclose(task.evaluate(state, reference).error, expected, rtol=0, atol=1e-12)


OFF = [1e-9, 1e-6, 1e-4, 1e-2]
"""RCM errors [m]."""


@pytest.mark.parametrize("off", OFF)
@pytest.mark.parametrize("arm", ["lwa3", "panda"])
def test_a_spin_of_the_shaft_changes_neither_the_rcms_rows_nor_its_error(
    arm: str, off: float
) -> None:
    """The last joint of these arms turns about the shaft: its column is zero to rounding."""
    m = moment(arm, ON_TARGET)
    away = np.array([0.6, -0.8, 0.0]) * off + np.array([0.0, 0.0, 0.05])
    m.pivot, m.pivot_dot = m.insertion.state(m.q).oMe.act(away), np.zeros(3)
    task, last = make_task("rcm", m.insertion, period=1e-3), np.eye(7)[-1]
    first = task.evaluate(m.state(last, 0.0), m.reference(0.0))
    assert np.linalg.norm(first.error) == pytest.approx(off, rel=1e-6)
    assert np.abs(first.jacobian[:, -1]).max() < 1e-15
    for angle in (1e-3, 0.5, -2.0):
        found = task.evaluate(m.state(last, angle), m.reference(0.0))
        assert spun(m, last, angle) == pytest.approx(angle, abs=1e-14)
        for rows, before in zip(arrays(found), arrays(first), strict=True):
            assert_allclose(unspun(rows, m, last, angle), before, rtol=0, atol=2e-15)
    spinning = replace(m.insertion.state(m.q), v=3.0 * last)
    drift = task.evaluate(spinning, m.reference(0.0)).drift
    assert_allclose(drift, 0.0, rtol=0, atol=1e-16)


@pytest.mark.parametrize("arm", ARMS)
def test_the_distance_from_the_trocar_changes_as_the_rcms_rows_say(arm: str) -> None:
    rng, m = np.random.default_rng(7), moment(arm, 0.05)
    nv = m.insertion.arm.nv
    found = task_for("rcm", m).evaluate(m.state(np.zeros(nv), 0.0), m.reference(0.0))
    for _ in range(5):
        v = rng.normal(size=nv)

        def distance(t: float, v: Array = v) -> float:
            return shaft_distance(m.state(v, t).oMe, m.reference(t).pivot)

        towards = found.error / np.linalg.norm(found.error)
        expected = towards @ (found.jacobian @ v + found.drift)
        assert_allclose(derivative(distance, 1e-4), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("arm", ARMS)
def test_the_rcms_second_order_is_the_rate_at_which_its_first_order_changes(arm: str) -> None:
    rng, m, T = np.random.default_rng(7), moment(arm, 0.05), 1e-3
    nv = m.insertion.arm.nv
    v = rng.normal(size=nv)

    def rate(t: float) -> Array:
        found = task_for("rcm", m).evaluate(m.state(v, t), m.reference(t))
        return unspun(found.jacobian @ v + found.drift, m, v, t)

    state = replace(m.state(v, 0.0), v=v)
    drifts = [
        task_for("rcm", m, period=period).evaluate(state, m.reference(0.0)).drift
        for period in (T, 0.0)
    ]
    assert_allclose(drifts[0] - drifts[1], 0.5 * T * derivative(rate), rtol=0, atol=1e-11)


def test_the_pose_task_alone_is_the_papers_controller() -> None:
    for arm in ("lwa3", "kinova", "panda"):
        m = moment(arm, 0.1)
        controller = make_controller(
            "dual_quaternion", m.insertion, 1e-3, gain=60.0, K_c=0.0, feed_forward=True
        )
        state, reference = m.insertion.state(m.q), m.reference(0.0)
        level = make_task("pose", m.insertion, gain=60.0).level(state, reference)
        v = np.linalg.lstsq(level.A, level.b, rcond=1e-7)[0]
        assert_allclose(v, controller.step(state, reference).v, rtol=0, atol=1e-10)


def test_roll_is_the_turn_about_the_shaft_and_takes_the_short_way() -> None:
    m = moment("panda", ON_TARGET)
    state, task = m.insertion.state(m.q), make_task("roll", m.insertion)
    for turned in np.linspace(-3.1, 3.1, 63):
        tilt = pin.SE3(pin.exp3(np.array([0.4, -0.3, 0.0])), np.ones(3))
        turn = pin.SE3(pin.exp3(np.array([0.0, 0.0, turned])), np.zeros(3))
        m.oMd = state.oMe * (tilt * turn).inverse()  # own = desired, tilted, then turned
        for m.side in (-1.0, 1.0):
            error = task.evaluate(state, m.reference(0.0)).error
            assert_allclose(error, [turned], rtol=0, atol=1e-12)


def test_roll_asks_nothing_where_the_shafts_point_apart() -> None:
    m = moment("lwa3", ON_TARGET)
    state = m.insertion.state(m.q)
    m.oMd = state.oMe * pin.SE3(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    found = make_task("roll", m.insertion).evaluate(state, m.reference(0.0))
    for array in arrays(found):
        assert not array.any()


def test_posture_turns_continuous_joints_the_short_way_only() -> None:
    kinova = insertion("kinova")
    task = make_task("posture", kinova, posture=np.full(6, 3.0))
    assert isinstance(task, PostureTask)
    assert np.array_equal(task.continuous, np.isinf(kinova.arm.upper))
    assert np.count_nonzero(np.asarray(task.continuous)) == 3
    angles = np.full(6, -3.0)
    state = kinova.state(kinova.arm.configuration(angles))
    error = task.evaluate(state, moment("kinova", FAR).reference(0.0)).error
    short, long = 2.0 * np.pi - 6.0, -6.0
    expected = np.where(np.isinf(kinova.arm.upper), short, long)
    assert_allclose(error, expected, rtol=0, atol=1e-12)


def test_the_objective_task_climbs_its_objective_and_rests_where_the_gradient_does() -> None:
    rng = np.random.default_rng(7)
    lwa3 = insertion("lwa3")
    task = make_task("objective", lwa3, K_c=3.0, c_d=0.9)
    assert isinstance(task, ObjectiveTask)
    for _ in range(5):
        q = lwa3.arm.configuration(lwa3.arm.random_angles(rng))

        def value(t: float, v: Array, q: Array = q) -> float:
            return task.objective.evaluate(lwa3.state(pin.integrate(lwa3.arm.model, q, t * v)))[0]

        level = task.level(lwa3.state(q), moment("lwa3", FAR).reference(0.0))
        slope = np.array([derivative(functools.partial(value, v=v), 1e-3) for v in np.eye(7)])
        assert_allclose(level.A, np.eye(7), rtol=0, atol=0)
        assert_allclose(level.b, 3.0 * (0.9 - value(0.0, slope)) * slope, rtol=0, atol=1e-10)
    assert lwa3.arm.srs_offsets is not None
    straight = lwa3.arm.configuration(-lwa3.arm.srs_offsets)  # c = 0 and its gradient too
    level = task.level(lwa3.state(straight), moment("lwa3", FAR).reference(0.0))
    assert_allclose(level.b, 0.0, rtol=0, atol=1e-12)


def test_the_objective_is_the_arms_own_or_the_one_named() -> None:
    def objective(arm: str, **options: Any) -> Objective:
        task = make_task("objective", insertion(arm), **options)
        assert isinstance(task, ObjectiveTask)
        return task.objective

    assert type(objective("lwa3")).__name__ == "SingularityProduct"
    assert type(objective("ur5")).__name__ == "Manipulability"
    assert type(objective("ur5", objective="joint_centring")).__name__ == "JointCentring"
    given = make_objective("manipulability", insertion("lwa3").arm)
    assert objective("lwa3", objective=given) is given


# Levels ------------------------------------------------------------------------------------


def test_added_tasks_share_a_level_by_their_weights() -> None:
    m = moment("panda", FAR)
    state, reference = m.insertion.state(m.q), m.reference(0.0)
    tip = make_task("tip", m.insertion, gain=30.0, weight=4.0)
    roll = make_task("roll", m.insertion, weight=0.25)
    rcm, depth = make_task("rcm", m.insertion), make_task("depth", m.insertion, weight=9.0)
    level = (tip + roll + (rcm + depth)).level(state, reference)
    assert level.name == "tip + roll + rcm + depth"
    alone = [task.level(state, reference) for task in (tip, roll, rcm, depth)]
    assert [len(part.b) for part in alone] == [3, 1, 2, 1]
    v = np.random.default_rng(7).normal(size=7)
    parts = [np.sum((part.A @ v - part.b) ** 2) for part in alone]
    assert np.sum((level.A @ v - level.b) ** 2) == pytest.approx(
        4.0 * parts[0] + 0.25 * parts[1] + parts[2] + 9.0 * parts[3]
    )
    assert [task.name for task in (rcm + (tip + roll)).tasks] == ["rcm", "tip", "roll"]
    residual = tip.evaluate(state, reference)
    assert_allclose(alone[0].b, -30.0 * residual.error - residual.drift, rtol=0, atol=0)
    with pytest.raises(TypeError):
        tip + 1  # type: ignore[operator]
    with pytest.raises(TypeError):
        (tip + roll) + 1  # type: ignore[operator]


@dataclass(frozen=True, eq=False)
class HeightTask(Task):
    """A user's task: hold the effector at a height above the floor."""

    name: ClassVar[str] = "height"

    height: float

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        error = state.oMe.translation[2:] - self.height
        return Residual(error, state.J_world_aligned[2:3], np.zeros(1))


def test_a_user_adds_a_task_in_ten_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TASKS, HeightTask.name, HeightTask)
    m = moment("ur5", FAR)
    task = make_task("height", m.insertion, height=0.4, gain=20.0)
    level = (task + make_task("rcm", m.insertion)).level(m.insertion.state(m.q), m.reference(0.0))
    assert level.A.shape == (3, 6)


# What is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("refused", "message"),
    [
        (lambda i: make_task("rcm", i, gain=0.0), r"gain = 0.0 1/s, it must be positive"),
        (lambda i: make_task("rcm", i, gain=np.nan), r"gain = nan 1/s, it must be positive"),
        (lambda i: make_task("rcm", i, weight=-1.0), r"weight = -1.0, it must be positive"),
        (lambda i: make_task("posture", i, posture=[np.nan]), r"one finite number a joint"),
        (lambda i: PostureTask([1.0], [True, False]), r"shape \(2,\), posture \(1,\)"),
        (lambda i: make_task("objective", i, K_c=0.0), r"K_c = 0.0, it must be positive"),
        (lambda i: make_task("objective", i, c_d=np.nan), r"c_d = nan, it must be finite"),
        (lambda i: make_task("objective", i, objective=3), r"objective = 3; it must be an Obj"),
    ],
)
def test_a_bad_option_is_refused(refused: Callable[[Insertion], Task], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        refused(insertion("lwa3"))


def test_a_residual_copies_what_it_is_given() -> None:
    given = np.zeros(2), np.zeros((2, 6)), np.zeros(2)
    for mine, kept in zip(given, arrays(Residual(*given)), strict=True):
        assert mine.flags.writeable
        assert not np.shares_memory(mine, kept)


def test_names_and_shapes_are_checked() -> None:
    m = moment("ur5", FAR)
    with pytest.raises(UnknownName, match=r"unknown task 'rmc'; did you mean rcm"):
        make_task("rmc", m.insertion)
    with pytest.raises(UnknownName, match=r"unknown option of rcm 'gian'; did you mean gain"):
        make_task("rcm", m.insertion, gian=3.0)
    with pytest.raises(UnknownName, match=r"unknown option of objective 'gain'"):
        make_task("objective", m.insertion, gain=3.0)
    with pytest.raises(InvalidProblem, match=r"error \(2,\), jacobian \(3, 6\) and drift \(2,\)"):
        Residual(np.zeros(2), np.zeros((3, 6)), np.zeros(2))
    seven = make_task("posture", m.insertion, posture=np.zeros(7), continuous=())
    with pytest.raises(OptionError, match=r"a posture of 7 joints for an arm of 6"):
        seven.evaluate(m.insertion.state(m.q), m.reference(0.0))
    with pytest.raises(FrozenInstanceError):
        seven.gain = 3.0  # type: ignore[misc]
    assert replace(seven, gain=3.0).gain == 3.0
