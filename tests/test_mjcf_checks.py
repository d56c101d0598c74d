"""MJCFs that are too large once they are put together, and ones that constraints hold."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from rcmqp import load_arm
from rcmqp.errors import ArmError
from rcmqp.world.mjcf import check_size
from rcmqp.world.urdf_checks import MOST_LINKS


def file_of(folder: Path, world: str, more: str = "") -> Path:
    path = folder / "arm.xml"
    path.write_text(f"<mujoco><worldbody>{world}</worldbody>{more}</mujoco>")
    return path


@pytest.mark.parametrize(
    "world",
    [
        '<replicate count="10000"><body><geom size="1"/></body></replicate>',
        '<replicate count="10000"><geom size="1"/></replicate>',
        '<replicate count="50"><replicate count="50"><site/></replicate></replicate>',
        '<replicate count="900"><include file="parts/more.xml"/></replicate>',
        f'<replicate count="1{400 * "0"}"/>',
        '<body><include file="parts/more.xml"/></body>' + (MOST_LINKS - 2) * "<site/>",
    ],
    ids=["bodies", "geoms", "nested", "include in replicate", "huge", "included"],
)
def test_what_multiplies_beyond_the_limit_is_refused_before_mujoco_reads_it(
    world: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "more.xml").write_text("<mujocoinclude><site/><site/></mujocoinclude>")
    path = file_of(tmp_path, world)
    monkeypatch.setitem(sys.modules, "mujoco", ModuleType("mujoco"))  # with nothing in it
    with pytest.raises(
        ArmError, match=r"bodies, joints, sites .* at most 2000 are read; take out"
    ):
        load_arm(path, "flange")


def test_what_is_not_multiplied_beyond_the_limit_is_read(tmp_path: Path) -> None:
    """Elements outside the bodies, and the shapes of one body, are not counted."""
    world = 3 * MOST_LINKS * '<geom size="1"/>' + '<replicate count="200"><site/></replicate>'
    check_size(file_of(tmp_path, world, "<equality>" + 3000 * "<joint/>" + "</equality>"))
    check_size(file_of(tmp_path, '<include file="arm.xml"/><include file="lost.xml"/>'))


def test_a_file_that_includes_itself_or_has_too_long_a_name_is_left_to_mujoco(
    tmp_path: Path,
) -> None:
    (tmp_path / "parts").mkdir()
    again = '<include file="../parts/more.xml"/>'  # from its own folder
    (tmp_path / "parts" / "more.xml").write_text(f"<mujocoinclude>{again}</mujocoinclude>")
    for name in ("parts/more.xml", "x" * 5000):
        with pytest.raises(ArmError, match="MuJoCo cannot read it: XML Error"):
            load_arm(file_of(tmp_path, f'<include file="{name}"/>'), "flange")


def test_what_mujoco_attaches_is_counted_when_it_is_there(tmp_path: Path) -> None:
    (tmp_path / "part.xml").write_text(
        f"<mujoco><worldbody><body name='part'>{900 * '<site/>'}</body></worldbody></mujoco>"
    )
    attached = "".join(f'<attach model="part" body="part" prefix="p{i}_"/>' for i in range(3))
    assets = '<asset><model name="part" file="part.xml"/></asset>'
    with pytest.raises(ArmError, match=r"has 2704 or more bodies"):
        load_arm(file_of(tmp_path, attached, assets), "flange")


CHAIN = """
<site name="post" pos="0 0 0.2"/>
<body name="ball"><freejoint/><geom size="0.1"/></body>
<body name="upper"><joint name="shoulder" axis="0 1 0" range="-1 1"/><geom size="0.1"/>
  <body name="rod"><joint name="swing" axis="0 1 0" range="-1 1"/><geom size="0.1"/></body>
  <body name="lower" pos="0 0 0.3"><joint name="elbow" axis="0 1 0" range="-1 1"/>
    <geom size="0.1"/><site name="end"/>
    <body name="hand" pos="0 0 0.3"><geom size="0.1"/>
      <body name="finger"><joint name="grip" axis="0 1 0" range="-1 1"/><geom size="0.1"/></body>
    </body>
  </body>
</body>
"""
"""Shoulder and elbow move the hand; rod and finger are beside the way to it."""


@pytest.mark.parametrize(
    ("equality", "joint", "tie"),
    [
        ('<joint name="rods" joint1="elbow" joint2="shoulder"/>', "elbow", "<joint> 'rods'"),
        ('<joint joint1="shoulder"/>', "shoulder", "<joint>"),
        ('<weld name="nail" body1="hand"/>', "shoulder", "<weld> 'nail'"),
        ('<connect body1="rod" body2="lower" anchor="0 0 0"/>', "elbow", "<connect>"),
        ('<connect site1="post" site2="end"/>', "shoulder", "<connect>"),
    ],
)
def test_a_joint_of_the_chain_that_an_equality_ties_is_refused_in_words(
    equality: str, joint: str, tie: str, tmp_path: Path
) -> None:
    path = file_of(tmp_path, CHAIN, f"<equality>{equality}</equality>")
    said = f"joint '{joint}' moves the flange, and is tied by the active {tie} of <equality>"
    with pytest.raises(ArmError, match=f"{re.escape(said)}.*hold it with locked, or take"):
        load_arm(path, "hand")


@pytest.mark.parametrize(
    "equality",
    [
        '<weld body1="hand" active="false"/>',
        '<weld body1="ball" body2="hand"/>',
        '<joint joint1="grip" joint2="elbow"/>',
        '<connect body1="hand" body2="finger" anchor="0 0 0"/>',
    ],
    ids=["not active", "a free body carried", "a finger follows", "within the hand"],
)
def test_an_equality_that_leaves_the_chain_free_is_allowed(equality: str, tmp_path: Path) -> None:
    path = file_of(tmp_path, CHAIN, f"<equality>{equality}</equality>")
    assert load_arm(path, "hand").joints == ("shoulder", "elbow")


def test_a_tied_joint_may_be_locked_and_equalities_switched_off(tmp_path: Path) -> None:
    tie = '<equality><joint joint1="elbow" joint2="shoulder"/></equality>'
    path = file_of(tmp_path, CHAIN, tie)
    assert load_arm(path, "hand", locked={"elbow": 0.01}).joints == ("shoulder",)
    path = file_of(tmp_path, CHAIN, tie + '<option><flag equality="disable"/></option>')
    assert load_arm(path, "hand").nv == 2
