"""What users give that is a little off: it is taken as meant, or refused with the remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers import assert_allclose
from test_urdf import urdf

from rcmqp import (
    Insertion,
    Instrument,
    Reference,
    Scenario,
    ViewCommand,
    load_arm,
    make_controller,
    view_pose,
)
from rcmqp.cli import main
from rcmqp.errors import ArmError, InvalidCommand, OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.realtime.checks import as_reading
from rcmqp.references.paths import Circle, HandTrace
from rcmqp.world.motions import Sampled

STILL = ((0.0, 0.0, 0.0),) * 3


@pytest.mark.parametrize("kind", [Sampled, HandTrace])
@pytest.mark.parametrize("start", [1.7e9, 1.7e12, -5.0])
def test_times_of_another_clock_are_refused_with_the_remedy(kind: type, start: float) -> None:
    with pytest.raises(OptionError, match=r"times\[0\] = .* give times - times\[0\]"):
        kind((start, start + 1.0, start + 2.0), STILL)
    assert kind((3.0, 4.0, 5.0), STILL).times[0] == 3.0


@pytest.mark.parametrize("times", [np.array([[0.0], [1.0], [2.0]]), ("now", 1, 2), 3.0])
def test_times_that_are_no_row_of_numbers_are_refused(times: object) -> None:
    with pytest.raises(OptionError, match=r"^times "):
        Sampled(times, STILL)  # type: ignore[arg-type]


@pytest.mark.parametrize("axes", ["zyyyx", "zyxyz"])
def test_five_joints_have_an_objective_of_their_own(tmp_path: Path, axes: str) -> None:
    (tmp_path / "r.urdf").write_text(urdf(axes))
    arm = load_arm(tmp_path / "r.urdf", "l5", home=[0.1, 0.6, 0.8, 0.5, 0.2])
    insertion = Insertion.on_shaft(arm, Instrument())
    view = view_pose(insertion.x_rcm, ViewCommand(alpha=0.01))
    state = insertion.state(insertion.q_start)
    own, named = (
        make_controller("hierarchical_qp", insertion, 0.001, **options)
        for options in ({}, {"objective": "joint_centring"})
    )
    assert np.array_equal(own.step(state, view).v, named.step(state, view).v)
    for objective in ("manipulability", "least_singular_value"):
        with pytest.raises(
            OptionError, match=r"has 5 joints, .* use the objective joint_centring"
        ):
            make_controller("hierarchical_qp", insertion, 0.001, objective=objective)


@pytest.mark.parametrize("digits", [3, 4, 5])
def test_rounded_poses_are_normalized_and_wrong_ones_are_not(digits: int) -> None:
    rng = np.random.default_rng(7)
    insertion = Insertion.on_shaft(load_arm("panda"), Instrument())
    made = make_controller("dual_quaternion", insertion, 0.001)
    state = insertion.state(insertion.q_start)
    pivot = np.array(insertion.trocar.pivot)
    for _ in range(50):
        view = ViewCommand(alpha=rng.uniform(-0.2, 0.2), beta=rng.uniform(-0.2, 0.2))
        exact = view_pose(insertion.x_rcm, view).x_d
        x_d = dq.normalized(np.round(exact, digits))
        assert dq.is_unit(x_d, 1e-12)
        assert_allclose(x_d, exact, rtol=0, atol=3 * 10.0**-digits)
        assert not made.step(state, Reference(x_d, np.zeros(8), pivot, np.zeros(3))).stop
    rough = Reference(np.round(exact, 3), np.zeros(8), pivot, np.zeros(3))
    assert made.step(state, rough).stop.endswith("to 1e-06: give it to normalized()")
    with pytest.raises(InvalidCommand, match="is not a pose"):
        dq.normalized(2.0 * exact)


def test_joint_angles_in_place_of_a_configuration_are_answered_with_the_remedy() -> None:
    insertion = Insertion.on_shaft(load_arm("kinova"), Instrument())
    for call in (
        lambda: insertion.state(insertion.angles_start),
        lambda: as_reading((insertion.angles_start, np.zeros(6)), insertion.arm),
    ):
        with pytest.raises(InvalidCommand, match=r"\(6,\), it must be \(9,\); arm\.configuration"):
            call()
    with pytest.raises(InvalidCommand, match=r"\(5,\), it must be \(9,\)$"):
        insertion.state(np.zeros(5))


def test_readings_may_come_by_joint_name_in_any_order() -> None:
    arm, rng = load_arm("kinova"), np.random.default_rng(7)
    angles, v = arm.random_angles(rng), rng.normal(size=6)
    order = [3, 0, 5, 1, 4, 2]
    named = tuple({arm.joints[i]: float(values[i]) for i in order} for values in (angles, v))
    q_read, v_read = as_reading(named, arm)
    assert np.array_equal(q_read, arm.configuration(angles))
    assert np.array_equal(v_read, v)
    del named[1][arm.joints[3]]
    with pytest.raises(InvalidCommand, match=r"read\(\) answered"):
        as_reading(named, arm)


def test_a_scenario_knows_its_urdf_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "r.urdf").write_text(urdf())
    (tmp_path / "runs").mkdir()
    monkeypatch.chdir(tmp_path)
    scenario = Scenario.on_shaft("rel", "r.urdf", Circle(duration=2.0), flange="l7")
    text = scenario.to_json()
    monkeypatch.chdir(tmp_path / "runs")
    assert Scenario.from_json(text).insertion().arm.joints == scenario.insertion().arm.joints


def test_loopback_says_what_arms_it_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "r.urdf").write_text(urdf())
    with pytest.raises(SystemExit) as end:
        main(["loopback", "-a", str(tmp_path / "r.urdf")])
    assert end.value.code == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "or an arm's file, my_robot.toml" in said
    assert "--flange" not in said


def test_trial_says_how_a_urdf_becomes_an_arms_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command it names is one that works."""
    monkeypatch.chdir(tmp_path)
    Path("r.urdf").write_text(urdf())
    for arm in ("r.urdf", "r.urdf:l7"):
        with pytest.raises(SystemExit) as end:
            main(["trial", "-a", arm, "--no-open"])
        assert end.value.code == 1
    command = " ".join(capsys.readouterr().err.split()).rpartition("to write one: rcmqp ")[2]
    with pytest.raises(SystemExit):
        main(command.split())
    assert load_arm("my_robot.toml").joints == load_arm("r.urdf", flange="l7").joints


def test_a_home_takes_the_place_of_an_arms_own(tmp_path: Path) -> None:
    (tmp_path / "r.toml").write_text('like = "lwa3"\n')
    home = load_arm("lwa3").home + 0.1
    for name in ("lwa3", tmp_path / "r.toml"):
        arm = load_arm(name, home=home)
        assert_allclose(arm.home, home, rtol=0.0, atol=0.0)
        by_name = load_arm(name, home=dict(zip(arm.joints, home.tolist(), strict=True)))
        assert_allclose(by_name.home, home, rtol=0.0, atol=0.0)
    with pytest.raises(ArmError, match="home"):
        load_arm("lwa3", home=[0.0, 100.0, 0.0, 0.0, 0.0, 0.0, 0.0])
