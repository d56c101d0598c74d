"""The incision given by hand, and found from recorded poses."""

from __future__ import annotations

import csv
import dataclasses
import math
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, shaft_distance

from rcmqp import Insertion, Instrument, Scenario, load_arm, load_scenario, simulate
from rcmqp.cli import main
from rcmqp.controllers import make_controller
from rcmqp.errors import ArmWarning, CalibrationError, OptionError, RcmqpError, TrocarOffShaft
from rcmqp.maths import dualquaternion as dq
from rcmqp.references.paths import Circle
from rcmqp.runs.metrics import compute_metrics
from rcmqp.world.calibration import calibrate_tool, calibrate_trocar, weakness
from rcmqp.world.port import Port

PIVOT, AXIS = (0.45, 0.1, 0.2), (0.1, -0.2, -1.0)


# A port given by hand ----------------------------------------------------------------------


@pytest.mark.parametrize("arm", ["panda", "ur5"])
def test_a_scenario_goes_to_the_port_that_is_given(arm: str) -> None:
    port = Port(PIVOT, AXIS, depth=0.12, cone=math.radians(35.0))
    scenario = load_scenario("circle", arm, port=port)
    insertion = scenario.insertion()
    state = insertion.state(insertion.q_start)
    assert_allclose(state.oMe.translation, PIVOT, rtol=0, atol=1e-9)
    assert_allclose(
        state.oMe.rotation[:, 2], np.array(AXIS) / np.linalg.norm(AXIS), rtol=0, atol=1e-9
    )
    assert_allclose(insertion.tip_depth, 0.12, rtol=0, atol=1e-9)
    assert scenario.trocar.cone_half_angle == math.radians(35.0)
    down = load_scenario("circle", arm, port=Port(PIVOT)).insertion()
    assert_allclose(down.state(down.q_start).oMe.rotation[:, 2], (0, 0, -1), rtol=0, atol=1e-9)


def test_what_is_in_the_patient_goes_along_with_the_shaft() -> None:
    own = load_scenario("obstacle", "panda")
    moved = load_scenario("obstacle", "panda", port=Port(PIVOT, AXIS))
    seen = []
    for scenario in (own, moved):
        x = dq.to_se3(scenario.insertion().x_rcm)
        seen.append(x.actInv(np.array(scenario.obstacles[0].centre)))
    assert_allclose(seen[0], seen[1], rtol=0, atol=1e-9)
    own, moved = (load_scenario("breathing_trocar", "panda", port=p) for p in (None, Port(PIVOT)))
    seen = []
    for scenario in (own, moved):
        R = dq.to_se3(scenario.insertion().x_rcm).rotation
        seen.append(R.T @ np.array(scenario.motion.direction))  # type: ignore[attr-defined]
    assert_allclose(seen[0], seen[1], rtol=0, atol=1e-9)


def test_a_trocar_measured_off_the_shaft_is_taken_in_with_a_tolerance() -> None:
    own = load_scenario("circle", "panda", duration=2.0, period=0.004)
    insertion = own.insertion()
    pivot = np.array(own.trocar.pivot) + insertion.from_start((0.002, -0.0015, 0.0))
    port = Port(tuple(pivot), tolerance=0.003)
    scenario = load_scenario("circle", "panda", duration=2.0, period=0.004, port=port)
    assert scenario.angles_start == own.angles_start
    assert scenario.trocar.axis == own.trocar.axis
    assert_allclose(scenario.insertion().trocar_offset, 0.0025, rtol=0, atol=1e-12)
    run = simulate(scenario, make_controller("hierarchical_qp", scenario.insertion(), 0.004))
    end = dq.to_se3(run.x[-1])
    assert shaft_distance(end, pivot) < 1e-6  # brought back
    with pytest.raises(TrocarOffShaft, match=r"2\.500 mm off .* allowed 2\.000 mm"):
        load_scenario("circle", "panda", port=dataclasses.replace(port, tolerance=0.002))


def test_depth_and_cone_alone_keep_the_shaft_where_it_is() -> None:
    own = load_scenario("circle", "panda")
    scenario = load_scenario("circle", "panda", port=Port(depth=0.15, cone=0.5))
    assert scenario.angles_start == own.angles_start
    assert_allclose(scenario.insertion().tip_depth, 0.15, rtol=0, atol=1e-12)
    assert scenario.trocar.cone_half_angle == 0.5


@pytest.mark.parametrize("name", ["trocar_off_shaft", "obstacle"])
def test_without_pivot_and_depth_the_scenario_keeps_its_incision(name: str) -> None:
    own = load_scenario(name, "panda")
    assert load_scenario(name, "panda", port=Port()) == own
    tilted = dataclasses.replace(own.trocar, cone_half_angle=0.6)
    scenario = load_scenario(name, "panda", port=Port(cone=0.6))
    assert scenario == dataclasses.replace(own, trocar=tilted)
    assert scenario.insertion().trocar_offset == own.insertion().trocar_offset


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"axis": AXIS}, "axis goes with a trocar"),
        ({"tolerance": 0.003}, "tolerance goes with a trocar"),
        ({"pivot": PIVOT, "tolerance": 0.003, "depth": 0.1}, "do not go together"),
        ({"pivot": PIVOT, "tolerance": 3.0}, "tolerance = 3000 mm, it must be"),
    ],
)
def test_what_does_not_go_together_is_refused(given: dict[str, float], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Port(**given)  # type: ignore[arg-type]


def run_cli(*words: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(words)
    return int(end.value.code or 0)


RUN = ("run", "circle", "-a", "panda", "--duration", "0.05", "--json")


def test_the_command_line_takes_the_port(capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        run_cli(*RUN, "--trocar", "0.45,0.1,0.2", "--axis", "0.1,-0.2,-1", "--depth", "0.12") == 0
    )
    for words, said in (
        (("--trocar", "450,100,200"), "are these millimetres"),
        (("--trocar", "0.45,0.1"), "give three numbers"),
        (("--trocar", "0.45,0.1,high"), "give three numbers"),
        (("--depth", "120"), "it is in m"),
        (("--cone", "200"), "give an angle between 0 and 180 degrees"),
        (("--cone", "0.7"), "it is in degrees; are these radians? Then give 40.1"),
        (("--trocar", "4,0,0"), "cannot put the shaft through the trocar"),
    ):
        assert run_cli(*RUN, *words) == 1
        assert said in " ".join(capsys.readouterr().err.split())


def test_the_study_and_the_comparison_take_it_too(tmp_path: Path) -> None:
    port = ("--trocar", "0.45,0.1,0.2", "--depth", "0.12")
    compare = ("compare", "-s", "circle", "-a", "panda", "-c", "damped", "--duration", "0.05")
    assert run_cli(*compare, *port, "-o", str(tmp_path)) == 0
    from rcmqp import Run
    from rcmqp.experiments.study.plan import Law, Trial

    (file,) = tmp_path.glob("*.h5")
    assert Run.load(file).scenario.trocar.pivot == PIVOT
    trial = Trial("camera_task", 0, 0, "panda", Law(), port=Port(PIVOT, depth=0.12))
    assert trial.made().trocar.pivot == PIVOT


# Pivot calibration -------------------------------------------------------------------------


TIP = np.array([0.002, -0.001, 0.35])


def poses(
    rng: np.random.Generator, n: int, *, tilts: float, noise: float, tool: bool, flat: bool = False
) -> list[pin.SE3]:
    """Poses about PIVOT: the tip on it, or the shaft through it 0.1 to 0.3 m from the flange."""
    found, down = [], pin.rpy.rpyToMatrix(math.pi, 0.0, 0.0)
    for _ in range(n):
        tilt = rng.uniform(-tilts, tilts, 2) * ([1, 0] if flat else [1, 1])
        R = (
            pin.exp3(np.array([*tilt, 0.0]))
            @ down
            @ pin.rpy.rpyToMatrix(0, 0, rng.uniform(-2, 2) * (not flat))
        )
        reach = TIP if tool else np.array([0.0, 0.0, rng.uniform(0.1, 0.3)])
        found.append(pin.SE3(R, np.array(PIVOT) - R @ reach + rng.normal(scale=noise, size=3)))
    return found


@pytest.mark.parametrize("tool", [False, True])
def test_a_pivot_is_found_within_a_tenth_of_a_millimetre_and_its_uncertainty_is_right(
    tool: bool,
) -> None:
    """0.3 mm of noise, 60 poses, tilts to 30 degrees; 200 recordings, which scatter as said."""
    rng = np.random.default_rng(7)
    calibrate = calibrate_tool if tool else calibrate_trocar
    found = [calibrate(poses(rng, 60, tilts=0.52, noise=3e-4, tool=tool)) for _ in range(200)]
    errors = np.array([each.pivot - PIVOT for each in found])
    assert np.median(np.linalg.norm(errors, axis=1)) < 1e-4
    said = np.sqrt(np.mean([np.diag(each.covariance) for each in found], axis=0))
    ratio = np.sqrt(np.mean(errors**2, axis=0)) / said
    print(f"rms error {1e3 * np.sqrt(np.mean(errors**2, axis=0))} mm, ratio {ratio}")
    assert ((ratio > 1 / 1.5) & (ratio < 1.5)).all()
    assert all(each.weak is None for each in found)
    rms = np.mean([each.residual_rms for each in found])
    assert rms == pytest.approx(3e-4 * math.sqrt(3 if tool else 2), rel=0.1)
    if tool:
        tips = np.array([each.tip for each in found])
        assert_allclose(tips.mean(axis=0), TIP, rtol=0, atol=5e-5)


@pytest.mark.parametrize("tool", [False, True])
def test_a_motion_that_does_not_show_the_pivot_is_said_to_be_one(tool: bool) -> None:
    rng = np.random.default_rng(7)
    calibrate = calibrate_tool if tool else calibrate_trocar
    still = poses(rng, 1, tilts=0.3, noise=0.0, tool=tool) * 20
    with pytest.raises(CalibrationError, match="does not show where the pivot is along"):
        calibrate(still)
    small = calibrate(poses(rng, 60, tilts=0.03, noise=3e-4, tool=tool))
    assert "hardly shows where the pivot is along" in weakness(small)
    assert small.weak is not None
    assert abs(small.weak[2]) > 0.99
    with pytest.raises(CalibrationError, match="3 poses are too few"):
        calibrate(poses(rng, 3, tilts=0.5, noise=0.0, tool=tool))


def test_a_tilt_about_one_axis_shows_a_trocar_but_no_tool() -> None:
    rng = np.random.default_rng(7)
    calibrate_trocar(poses(rng, 20, tilts=0.5, noise=0.0, tool=False, flat=True))
    with pytest.raises(CalibrationError, match=r"along \((1|-1)\.00, -?0\.00, -?0\.00\)"):
        calibrate_tool(poses(rng, 20, tilts=0.5, noise=0.0, tool=True, flat=True))


def write_csv(file: Path, heads: list[str], rows: list[list[float]]) -> Path:
    with file.open("w", newline="") as text:
        csv.writer(text).writerows([heads, *rows])
    return file


def pose_row(oMf: pin.SE3) -> list[float]:
    x, y, z, qx, qy, qz, qw = pin.SE3ToXYZQUAT(oMf)
    return [x, y, z, qw, qx, qy, qz]


HEADS = ["x", "y", "z", "qw", "qx", "qy", "qz"]


def test_the_command_line_calibrates_from_poses_and_from_joints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(7)
    rows = [pose_row(each) for each in poses(rng, 60, tilts=0.5, noise=1e-4, tool=True)]
    file = write_csv(tmp_path / "tool.csv", HEADS, rows)
    assert run_cli("calibrate", str(file), "--what", "tool") == 0
    shown = capsys.readouterr().out
    assert "0.350" in shown
    assert "mm off its z axis" in shown

    arm = load_arm("panda")
    insertion = Insertion.on_shaft(arm, Instrument())
    scenario = Scenario.of("mine", insertion, Circle(duration=4.0), period=0.01)
    run = simulate(scenario, make_controller("hierarchical_qp", insertion, 0.01))
    assert compute_metrics(run).rcm_max_mm < 0.1
    names = list(arm.joints)[::-1]
    file = write_csv(tmp_path / "run.csv", names, [row[::-1].tolist() for row in run.angles[::10]])
    assert run_cli("calibrate", str(file), "--arm", "panda") == 0
    pivot = ",".join(f"{round(x, 5) + 0.0:.5f}" for x in insertion.trocar.pivot)
    assert f"--trocar={pivot} --tolerance=1" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("heads", "row", "message"),
    [
        (["x", "y", "z"], [0, 0, 0], r"has no column qw, qx, qy, qz, its header has x, y, z"),
        (HEADS, [0, 0, 0, 1, 1, 0, 0], "line 2: the quaternion has the norm 1.4142"),
        (HEADS, [450, 0, 0, 1, 0, 0, 0], "line 2: .* are these millimetres"),
        (HEADS, [0, "far", 0, 1, 0, 0, 0], "line 2: could not convert"),
        (HEADS, [0, "nan", 0, 1, 0, 0, 0], "line 2: not all of"),
    ],
)
def test_a_recording_that_is_none_is_refused_in_words(
    tmp_path: Path, heads: list[str], row: list[float], message: str
) -> None:
    from rcmqp.cli.calibrate import calibrate

    with pytest.raises(RcmqpError, match=message):
        calibrate(write_csv(tmp_path / "a.csv", heads, [row]))
    with pytest.raises(RcmqpError, match=r"no such file; give the path of a CSV"):
        calibrate(tmp_path / "none.csv")


# A port that looks wrong -------------------------------------------------------------------


@pytest.mark.parametrize(("axis", "said"), [((0.0, 0.3, -1.0), 0), ((0.0, 0.0, 1.0), 1)])
def test_an_axis_that_points_upwards_is_questioned(
    axis: tuple[float, float, float], said: int
) -> None:
    before = load_scenario("circle", "panda").insertion()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        Port(pivot=(0.45, 0.0, 0.3), axis=axis).insertion(before)
    assert sum("deg upwards" in str(each.message) for each in caught) == said


def test_a_start_that_touches_itself_is_said_where_the_arm_stays() -> None:
    arm = load_arm("panda")
    angles = [0.0, 0.0, 0.0, -3.0, 0.0, 0.1, 0.0]
    before = Insertion.on_shaft(arm, Instrument(), angles)
    port = Port(pivot=before.trocar.pivot, axis=before.trocar.axis, tolerance=0.001)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ArmWarning)
        port.insertion(before)
    assert any("touching; choose another start" in str(each.message) for each in caught)


def test_a_period_in_milliseconds_is_questioned(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_cli(*RUN, "--period", "8") == 1
    assert "(--period) is in s; 8 ms are 0.008" in capsys.readouterr().err
