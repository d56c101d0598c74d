"""An arm's file like a registered arm with other joints, and one in degrees or millimetres."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_arm_file import HOME, arm_file
from test_urdf import urdf, write

from rcmqp import load_arm
from rcmqp.errors import ArmError, ArmWarning, RcmqpError
from rcmqp.experiments.compare import arm_and_flange
from rcmqp.realtime.checks import LoopFault, check_speed
from rcmqp.world.loading import arm_title

RAIL = "[rail]\naxis = [0, 1, 0]\nlower = -0.2\nupper = 0.6\nvelocity = 0.3\n"


def like(folder: Path, text: str, arm: str = "panda") -> Path:
    path = folder / "mine.toml"
    path.write_text(f'like = "{arm}"\n{text}', encoding="utf-8")
    return path


@pytest.mark.parametrize("arm", ["panda", "lwa3", "ur5"])
@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("rail", [False, True])
def test_joints_that_are_left_keep_what_the_registered_arm_has(
    tmp_path: Path, arm: str, held: bool, rail: bool
) -> None:
    own = load_arm(arm)
    text = (f"[locked]\n{own.joints[2]} = {own.home[2]}\n" if held else "") + RAIL * rail
    changed = load_arm(like(tmp_path, text, arm))
    left = [i for i in range(own.nv) if not (held and i == 2)]
    assert changed.joints == ("rail",) * rail + tuple(own.joints[i] for i in left)
    for name in ("home", "lower", "upper", "velocity", "acceleration", "jerk"):
        kept = getattr(changed, name)[int(rail) :]
        assert np.array_equal(kept, getattr(own, name)[left]), name
    if rail:
        assert changed.home[0] == pytest.approx(0.2)


def test_a_home_of_ones_own_has_to_fit_the_joints(tmp_path: Path) -> None:
    with pytest.raises(RcmqpError, match="home has shape"):
        load_arm(like(tmp_path, "home = [0, 0, 0, -2, 0, 1, 0]\n" + RAIL))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[flange]\nrpy = [0, 45, 0]", "degrees"),
        ("[base]\nrpy = [180, 0, 0]", "degrees"),
        ("[flange]\nxyz = [0, 0, 120]", "millimetres"),
        ("[base]\nxyz = [0, 0, 900]", "millimetres"),
        (RAIL.replace("-0.2", "-200").replace("0.6", "600"), "millimetres"),
        ("position = [-170, 170]", "degrees"),
        ("velocity = 98", "degrees"),
    ],
)
def test_what_an_arms_file_has_in_another_unit_is_questioned(
    tmp_path: Path, text: str, said: str
) -> None:
    """And refused: what one wrote oneself and cannot mean is mended there."""
    with pytest.raises(ArmError, match=rf"mine.toml: .* are these {said}\? .*: multiply by"):
        load_arm(like(tmp_path, text))


def test_limits_of_a_urdf_in_another_unit_are_questioned_where_others_are_given(
    tmp_path: Path,
) -> None:
    """They may be another's; only a number that was given is refused."""
    text = re.sub(r'(name="j6".*?upper=")[^"]*', r"\g<1>18.85", urdf())
    far = write(tmp_path, text)
    given: dict[str, Any]
    for given in ({}, {"velocity": {"j1": 1.0}}, {"position": {"j1": (-1.0, 1.0)}}):
        with pytest.warns(ArmWarning, match=r"'j6' turns from .* 18.85 rad .*are these degrees"):
            arm = load_arm(far, "l7", **given)
        assert arm.upper[5] == 18.85
    for limit in ("velocity = { j1 = 1.0 }", "position = { j1 = [-1, 1] }"):
        file = arm_file(tmp_path, f"home = {list(HOME)}", limit)
        far.write_text(text)
        with pytest.warns(ArmWarning, match=r"'j6' turns from .* 18.85 rad"):
            load_arm(file)
    for given in ({"velocity": {"j6": 90.0}}, {"position": {"j6": (-18.85, 18.85)}}):
        with pytest.raises(ArmError, match=r"'j6' turns from .* are these degrees"):
            load_arm(far, "l7", **given)


def test_a_base_that_is_very_far_away_is_refused_by_the_name_of_its_file(tmp_path: Path) -> None:
    with pytest.raises(ArmError, match=r"mine.toml: base.xyz = .* are these millimetres"):
        load_arm(like(tmp_path, "[base]\nxyz = [0, 0, 2000]"))


@pytest.mark.filterwarnings("error::rcmqp.errors.ArmWarning")
def test_a_placement_in_metres_and_radians_is_not_questioned(tmp_path: Path) -> None:
    load_arm(like(tmp_path, "[base]\nxyz = [0, 0, 2.5]\nrpy = [3.1416, 0, 0]\n"))
    load_arm(like(tmp_path, "[flange]\nxyz = [0, 0.1, 0.2]\nrpy = [0, 0.785, 0]\n"))


def test_a_home_in_degrees_is_questioned(tmp_path: Path) -> None:
    degrees = np.degrees(HOME).round(3).tolist()
    with pytest.raises(ArmError, match=r"are these degrees\? Home is in radians"):
        load_arm(arm_file(tmp_path, f"home = {degrees}"))
    endless = write(tmp_path, urdf().replace("revolute", "continuous"))
    with pytest.raises(ArmError, match=r"r.urdf: home has joint 'j2' .* are these degrees"):
        load_arm(endless, "l7", home=degrees)


def test_a_home_in_millimetres_is_questioned(tmp_path: Path) -> None:
    own = load_arm("panda")
    with pytest.raises(ArmError, match=r"are these millimetres\? Home is in metres"):
        load_arm(
            like(
                tmp_path,
                f"home = [150, {', '.join(map(str, own.home))}]\n"
                f"acceleration = 8.0\njerk = 400.0\n{RAIL}",
            )
        )


def test_a_speed_of_a_rail_is_in_metres(tmp_path: Path) -> None:
    arm = load_arm(like(tmp_path, RAIL))
    with pytest.raises(LoopFault, match=r"rail moves at 1 m/s, allowed 0.3 m/s; stop"):
        check_speed(np.eye(8)[0], arm, "moves", "stop")


@pytest.mark.parametrize("ending", [".urdf", ".urdf.gz", ".xacro", ".xml"])
def test_a_flange_goes_behind_any_urdf(ending: str) -> None:
    assert arm_and_flange(f"a/mine{ending}:tool0") == (f"a/mine{ending}", "tool0")


def test_a_file_has_its_own_title(tmp_path: Path) -> None:
    assert arm_title(str(arm_file(tmp_path, 'title = "Mine"'))) == "Mine"
    assert arm_title(str(tmp_path / "gone.toml")) == "gone"


@pytest.mark.parametrize(
    ("position", "said"),
    [
        (
            "90",
            r"panda_joint3 cannot be locked at 90 rad, .*are these degrees\? Multiply by 0.017",
        ),
        ("3.0", r"panda_joint3 cannot be locked at 3 rad, its limits are -2.8973 and 2.8973 rad$"),
        ("nan", r"panda_joint3 cannot be locked at nan; give a number"),
        (f"1{'0' * 400}", r"panda_joint3 cannot be locked at 10+; give a number"),
        ("true", r"panda_joint3 cannot be locked at True; give a number"),
        ('"0.3"', r"panda_joint3 cannot be locked at '0.3'; give a number"),
    ],
)
def test_a_joint_is_locked_inside_its_limits_only(
    tmp_path: Path, position: str, said: str
) -> None:
    with pytest.raises(ArmError, match=rf"mine.toml: {said}"):
        load_arm(like(tmp_path, f"[locked]\npanda_joint3 = {position}"))
    arm = load_arm(like(tmp_path, "[locked]\npanda_joint3 = 0.25"))
    assert arm.source is not None
    assert "locked: panda_joint3 at 0.25" in arm.source.notes


def test_a_joint_without_limits_is_locked_up_to_two_turns_away(tmp_path: Path) -> None:
    endless = load_arm("kinova").joints[0]
    with pytest.raises(ArmError, match=r"cannot be locked at 20 rad, more than two turns from z"):
        load_arm(like(tmp_path, f"[locked]\n{endless} = 20", "kinova"))
    load_arm(like(tmp_path, f"[locked]\n{endless} = 12", "kinova"))
