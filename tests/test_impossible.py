"""What cannot be done is answered by name, refused, or ends in the safe stop."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from helpers import inserted
from stopping import T, every_controller, home, view

from rcmqp import Arm, Insertion, Run, compute_metrics, load_scenario, make_controller, simulate
from rcmqp.cli.results import warnings
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.dualquaternion import Array
from rcmqp.plants import PLANTS, KinematicDrive
from rcmqp.qp import SolverNotInstalled, solver_names
from rcmqp.references.paths import ConicalHelix
from rcmqp.world.insertion import rcm_error, tilt
from rcmqp.world.instrument import vector3
from rcmqp.world.obstacles import Sphere

SPEED_LIMITED = ("hierarchical_qp", "weighted_qp")
BACKENDS = {"hierarchical_qp": "backend", "weighted_qp": "backend", "vfi_qp": "solver"}


# A whole run -------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, slots=True)
class LooseWire:
    """Ideal joints; between 0.1 and 0.12 s the second one is not read."""

    def start(self, arm: Arm, q: Array, period: float, seed: int) -> KinematicDrive:
        return LooseWireDrive(arm, q, period)


class LooseWireDrive(KinematicDrive):
    cycle = -1

    def measure(self) -> tuple[Array, Array]:
        self.cycle += 1
        q = self.q.copy()
        if 100 <= self.cycle < 120:
            q[1] = math.nan
        return q, self.v


@pytest.fixture
def loose(monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setitem(PLANTS, "loose_wire", LooseWire)
    scenario = load_scenario(
        "conical_helix",
        "panda",
        path=ConicalHelix(duration=3.0),
        duration=0.3,
        plant=LooseWire(),
    )
    return simulate(scenario, make_controller("hierarchical_qp", scenario.insertion(), 1e-3))


def test_a_joint_that_is_not_read_for_a_while_stops_the_run_safely_and_is_recorded(
    loose: Run, tmp_path: Path
) -> None:
    lost = np.arange(len(loose.time)) // 20 == 5
    assert loose.stops == {"the joint reading q is not finite": list(range(100, 120))}
    assert np.array_equal(loose.diagnostics["safe_stop"] == 1.0, lost)
    change = np.abs(np.diff(loose.v, axis=0)) / 1e-3
    assert (change <= loose.acceleration_limit * (1.0 + 1e-9)).all()
    assert not loose.v[119].any()
    assert np.isnan(loose.q_measured[lost, 1]).all()
    assert np.isfinite(loose.tip_error).all()
    assert loose.tip_error[119] > 1e-5
    assert loose.tip_error[-1] < 2e-6  # it caught up
    assert loose.rcm_error.max() < 1e-5
    (warning,) = warnings(loose, compute_metrics(loose))
    assert "in 20 of 301 cycles, first at 0.100 s: the joint reading q is not finite" in warning
    loose.save(tmp_path / "loose.h5")
    again = Run.load(tmp_path / "loose.h5")
    assert again == loose
    assert again.stops == loose.stops
    assert (
        again.about_diagnostics["safe_stop"][1] == "1 where the joints brake instead of following"
    )
    assert dataclasses.replace(loose, stops={"else": [1]}).digest != loose.digest


# What cannot be done -----------------------------------------------------------------------


@every_controller
@pytest.mark.parametrize("part", [slice(0, 4), slice(4, 8)], ids=["primal", "dual"])
def test_a_reference_that_is_no_pose_is_answered_by_braking(name: str, part: slice) -> None:
    """P is no unit quaternion, or D is not orthogonal to it."""
    insertion, reference = inserted(), view(inserted())
    x_d = reference.x_d.copy()
    x_d[part] += 1e-3 * x_d[:4]
    answer = make_controller(name, insertion, T).step(
        insertion.state(insertion.q_start), dataclasses.replace(reference, x_d=x_d)
    )
    assert answer.stop == (
        "x_d of the reference is not a unit dual quaternion to 1e-06: give it to normalized()"
    )


@every_controller
@pytest.mark.parametrize("arm_name", ["panda", "ur5"])
def test_a_trocar_that_jumps_10_cm_is_followed_and_followed_back(name: str, arm_name: str) -> None:
    free = None if arm_name == "lwa3" else math.inf
    scenario = load_scenario("conical_helix", arm_name, acceleration=free, jerk=math.inf)
    insertion = scenario.insertion()
    arm, controller = insertion.arm, make_controller(name, insertion, T)
    off = np.array(insertion.from_start((0.1, 0.0, 0.0)))
    q, v, a, error = insertion.q_start, np.zeros(arm.nv), np.zeros(arm.nv), []
    for k in range(360):
        reference = home(insertion, off if 10 <= k < 180 else None)
        state = insertion.state(q, v, a)
        error.append(float(rcm_error(state.x, reference.pivot)))
        before, v = v, controller.step(state, reference).v
        a = (v - before) / T
        assert np.isfinite(v).all()
        if name in SPEED_LIMITED:
            assert (np.abs(v) <= arm.velocity).all()
            assert (np.abs(v - before) <= T * arm.acceleration * (1.0 + 1e-9)).all()
            assert (arm.limit_margin(state.angles) >= 0.0).all()
        q = arm.integrate(q, v, T)
    assert error[0] < 1e-9
    assert max(error[10], error[180]) > 0.05
    assert max(error[179], error[-1]) < 5e-5


@every_controller
def test_a_target_out_of_reach_is_gone_after_with_finite_speed(name: str) -> None:
    insertion = inserted("panda")
    arm, controller = insertion.arm, make_controller(name, insertion, T)
    far = home(insertion, np.array([0.0, 0.0, 5.0])).x_d
    reference = dataclasses.replace(home(insertion), x_d=far)
    q, v = insertion.q_start, np.zeros(arm.nv)
    for _ in range(60):
        v = controller.step(insertion.state(q, v), reference).v
        assert np.isfinite(v).all()
        assert name not in SPEED_LIMITED or (np.abs(v) <= arm.velocity).all()
        q = arm.integrate(q, v, T)
    assert not np.array_equal(q, insertion.q_start)
    if name in SPEED_LIMITED:
        arm.check_limits(arm.angles(q))


@every_controller
def test_a_target_outside_the_cone_is_answered_and_the_cone_kept_by_who_knows_it(
    name: str,
) -> None:
    scenario = load_scenario("cone_and_depth", "panda", period=T, duration=3.2)
    insertion = scenario.insertion()
    run = simulate(scenario, make_controller(name, insertion, T))
    widest = tilt(run.x, np.array(scenario.trocar.axis)).max()
    if name in SPEED_LIMITED:
        assert widest < scenario.trocar.cone_half_angle + 1e-3
    else:
        assert widest > scenario.trocar.cone_half_angle + 0.05


@every_controller
@pytest.mark.parametrize("arm_name", ["lwa3", "ur5"])
def test_a_singular_arm_is_answered_with_finite_speed(name: str, arm_name: str) -> None:
    insertion = inserted(arm_name)
    arm, controller = insertion.arm, make_controller(name, insertion, T)
    state = insertion.state(arm.configuration(np.zeros(arm.nv)))
    assert np.linalg.svd(state.J_local, compute_uv=False)[-1] < 1e-9
    v = controller.step(state, home(insertion)).v
    assert np.isfinite(v).all()
    if name in SPEED_LIMITED:
        assert (np.abs(v) <= arm.velocity).all()


@pytest.mark.parametrize("name", list(BACKENDS))
def test_obstacles_that_cannot_both_be_left_are_named_or_stopped_at(name: str) -> None:
    """Two balls grip the shaft from both sides: out of one is deeper into the other."""
    free = inserted("panda")
    oMe = free.state(free.q_start).oMe
    balls = [
        Sphere(vector3("centre", oMe.act(np.array([x, 0, 0.05]))), 0.03) for x in (-0.02, 0.02)
    ]
    insertion = Insertion(
        free.arm, free.instrument, free.trocar, free.angles_start, obstacles=balls
    )
    controller = make_controller(name, insertion, T)
    v = np.full(7, 0.1)
    state = insertion.state(insertion.q_start, v)
    answer = controller.step(state, home(insertion))
    assert np.isfinite(answer.v).all()
    assert (np.abs(answer.v - v) <= T * insertion.arm.acceleration * (1 + 1e-9)).all()
    if name == "hierarchical_qp":
        assert answer.diagnostics["violation"] > 0.05
        report = controller.report(state, answer)
        assert "obstacle 1, shaft out: exceeded by" in report
        assert "obstacle 2, shaft out: exceeded by" in report
    else:
        assert answer.diagnostics["safe_stop"] == 1.0
        assert controller.report(state, answer).startswith(f"safe stop: {answer.stop}")


# What is refused at the door ---------------------------------------------------------------


@pytest.mark.parametrize("name", SPEED_LIMITED)
def test_an_arm_whose_limits_contradict_themselves_is_refused_by_its_joint(name: str) -> None:
    insertion = load_scenario("conical_helix", "panda").insertion()
    turned = insertion.arm.lower.copy()
    turned[3] = insertion.arm.upper[3] + 0.1
    insertion.arm.lower = turned
    with pytest.raises(OptionError, match=r"panda_joint4 has position limits \[.*mend the limits"):
        make_controller(name, insertion, T)


def test_a_scenario_whose_depths_contradict_themselves_is_refused() -> None:
    trocar = load_scenario("conical_helix", "panda").trocar
    with pytest.raises(OptionError, match="depth_range"):
        dataclasses.replace(trocar, depth_range=(0.12, 0.08))


@pytest.mark.parametrize("name", list(BACKENDS))
def test_a_backend_that_is_unknown_or_missing_is_answered_with_what_there_is(name: str) -> None:
    option = BACKENDS[name]
    with pytest.raises(UnknownName, match=r"'proxpq'; did you mean proxqp\?") as unknown:
        make_controller(name, inserted(), T, **{option: "proxpq"})
    assert set(unknown.value.known) >= set(solver_names()) >= {"proxqp", "daqp"}
    with pytest.raises(SolverNotInstalled, match="pip install coptpy"):
        make_controller(name, inserted(), T, **{option: "copt"})
