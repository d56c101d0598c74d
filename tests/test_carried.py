"""Runs travel: the arm is in the file, and nothing of the machine is."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from helpers import assert_allclose
from test_urdf import urdf

from rcmqp import Run, compute_metrics, load_arm, load_scenario, make_controller, simulate
from rcmqp.cli import main
from rcmqp.errors import ArmError, ArmWarning, RunFileError
from rcmqp.runs.scenario import Scenario
from rcmqp.show.viewer.shapes import arm_parts
from rcmqp.world.carried import CarriedArm

CORNERS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
HOME = [0.1, -0.6, 0.2, 1.1, -0.1, 0.9, 0.3]

ARM_FILE = f"""
urdf = "alices_robot.urdf"
title = "Alice's robot"
home = {HOME}
acceleration = [1, 2, 3, 4, 5, 6, inf]
velocity = 1.5
position = {{ j2 = [-1.5, 1.0] }}
[flange]
frame = "l7"
xyz = [0.0, 0.0, 0.01]
rpy = [0.0, 0.1, 0.0]
[base]
xyz = [0.0, 0.0, 1.5]
rpy = [0.1, 0.0, 0.0]
"""


@pytest.fixture
def away(tmp_path: Path) -> Path:
    """A folder with an arm's file and its URDF, of somebody's own."""
    folder = tmp_path / "home_of_alice" / "robots"
    folder.mkdir(parents=True)
    (folder / "alices_robot.urdf").write_text(urdf())
    (folder / "my_robot.toml").write_text(ARM_FILE)
    return folder


def made(arm: Path, flange: str | None = None, **changes: Any) -> Run:
    scenario = load_scenario("circle", str(arm), flange=flange, duration=0.05, **changes)
    law = make_controller("hierarchical_qp", scenario.insertion(), scenario.period)
    return simulate(scenario, law)


def travelled(run: Run, away: Path) -> Run:
    """The run's file, opened where nothing else is left."""
    here = away.parents[1] / "run.h5"
    run.save(here)
    shutil.rmtree(away.parent)
    return Run.load(here)


def test_a_run_has_its_whole_arm_with_it(away: Path) -> None:
    before = load_arm(away / "my_robot.toml")
    run = made(away / "my_robot.toml", limits=None)
    found = travelled(run, away)
    assert found == run
    after = found.insertion().arm
    assert (after.name, after.title) == ("my_robot.toml", "Alice's robot")
    assert after.sha256 == run.urdf_sha256
    for name in ("lower", "upper", "velocity", "acceleration", "jerk", "home"):
        assert np.array_equal(getattr(after, name), getattr(before, name)), name
    assert after.assumed == before.assumed
    assert after.joints == before.joints
    q = before.configuration(HOME)
    assert found.scenario.load_arm().state(q).oMe == before.state(q).oMe


def test_a_run_that_travelled_is_made_again_to_the_bit_and_with_another_law(away: Path) -> None:
    run = made(away / "alices_robot.urdf", "l7", acceleration=3.0)
    found = travelled(run, away)
    insertion = found.scenario.insertion()
    again = simulate(found.scenario, make_controller("hierarchical_qp", insertion, found.period))
    assert again.digest == found.digest == run.digest
    other = simulate(found.scenario, make_controller("damped", insertion, found.period))
    assert compute_metrics(other).rcm_max_mm < 0.1
    assert (insertion.arm.acceleration == 3.0).all()


def test_every_command_takes_a_run_that_travelled_and_no_output_says_where_it_was_made(
    away: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    call = ["run", "circle", "-a", str(away / "alices_robot.urdf"), "--flange", "l7"]
    call += ["--duration", "0.05", "--out", str(here / "run.h5")]
    with pytest.raises(SystemExit):
        main(call)
    said = capsys.readouterr().out.replace(str(here), "")
    shutil.rmtree(away.parent)
    monkeypatch.chdir(here)
    for command in (
        ["show", "run.h5", "--figures", "figures"],
        ["view", "run.h5", "--html", "run.html", "--no-open"],
        ["report", "run.h5", "--out", "report"],
        ["run", "run.h5", "-c", "damped", "--out", "again.h5"],
    ):
        with pytest.raises(SystemExit) as ended:
            main(command)
        assert not ended.value.code, command
    outputs = [path.read_bytes() for path in here.rglob("*") if path.is_file()]
    assert len(outputs) > 10
    told = "".join(capsys.readouterr())
    for text in (said.encode(), told.encode(), *outputs):
        assert b"home_of_alice" not in text


def test_the_arms_own_file_is_used_where_it_is_the_same(away: Path) -> None:
    run = made(away / "alices_robot.urdf", "l7")
    assert not run.insertion().arm.source.carried  # type: ignore[union-attr]
    run.save(away / "run.h5")
    found = Run.load(away / "run.h5")
    assert found.insertion().arm.urdf == away / "alices_robot.urdf"
    (away / "alices_robot.urdf").write_text(urdf().replace('velocity="2"', 'velocity="3"'))
    source = found.insertion().arm.source
    assert source is not None
    assert source.carried
    assert found.insertion().arm.sha256 == run.urdf_sha256


def test_another_file_of_the_arm_can_be_drawn_and_another_arm_cannot(away: Path) -> None:
    run = made(away / "alices_robot.urdf", "l7")
    copy = away / "copy.urdf"
    copy.write_text(urdf().replace("<robot", "<!-- with meshes --><robot"))
    assert run.drawn_with(str(copy), "l7").insertion().arm.urdf == copy
    with pytest.raises(ArmError, match="has the joints shoulder_pan_joint"):
        run.drawn_with("ur5")
    copy.write_text(urdf("zyzyzyx"))
    with pytest.raises(ArmError, match="elsewhere than in the run"):
        run.drawn_with(str(copy), "l7")


def test_meshes_keep_no_folder_of_a_machine_and_are_not_fetched(
    away: Path, tmp_path: Path
) -> None:
    secret = tmp_path / "secret.stl"
    secret.write_text("solid nobody is to read\nendsolid\n")
    shape = "<visual><geometry><mesh filename='{}'/></geometry></visual></link>"
    text = urdf().replace("<link name='l1'/>", f"<link name='l1'>{shape.format(secret)}")
    text = text.replace('<link name="l1"/>', f'<link name="l1">{shape.format(secret)}')
    assert str(secret) in text
    (away / "alices_robot.urdf").write_text(text)
    carried = CarriedArm.of(load_arm(away / "alices_robot.urdf", "l7", home=HOME))
    assert carried is not None
    assert str(tmp_path) not in carried.to_json()
    assert "secret.stl" in carried.urdf
    stranger = dataclasses.replace(carried, urdf=text, beside=None)
    with pytest.warns(match="without its 1 meshes"):
        assert arm_parts(stranger.load("l7", {}))  # cylinders


def stl(size: float) -> str:
    """A corner of a box."""
    corners = [f"vertex {size * x} {size * y} {size * z}" for x, y, z in CORNERS]
    facets = ["\n".join(corners[i] for i in face) for face in FACES]
    text = "".join(f"facet normal 0 0 1\nouter loop\n{f}\nendloop\nendfacet\n" for f in facets)
    return f"solid s\n{text}endsolid\n"


@pytest.mark.parametrize("where", ["cover.stl", "package://alices_robot/cover.stl", "absolute"])
def test_a_mesh_of_another_content_is_said_and_the_same_one_is_not(
    away: Path, tmp_path: Path, where: str
) -> None:
    cover = away / "cover.stl"
    cover.write_text(stl(0.1))
    name = str(cover) if where == "absolute" else where
    shape = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
    text = urdf().replace('<link name="l3"/>', f'<link name="l3">{shape}</link>')
    (away / "alices_robot.urdf").write_text(text)
    packages = away if not where.startswith("package") else away / "alices_robot"
    if packages != away:
        packages.mkdir()
        shutil.move(cover, packages)
        cover = packages / "cover.stl"
    made(away / "alices_robot.urdf", "l7").save(away / "run.h5")
    run = Run.load(away / "run.h5")
    assert len(arm_parts(run.insertion().arm)) == 1
    cover.write_text(stl(0.2))
    for arm in (
        run.insertion().arm,
        run.drawn_with(str(away / "alices_robot.urdf"), "l7").insertion().arm,
    ):
        with pytest.warns(ArmWarning, match=r"does not look as it did .*cover\.stl of that name"):
            assert len(arm_parts(arm)) == 1
    cover.unlink()
    with pytest.warns(ArmWarning, match=r"is drawn without .*cover\.stl"):
        arm_parts(run.insertion().arm)


def test_a_run_drawn_with_another_file_can_be_kept(away: Path, tmp_path: Path) -> None:
    run = made(away / "alices_robot.urdf", "l7")
    copy = away / "copy.urdf"
    copy.write_text(urdf().replace("<robot", "<!-- with meshes --><robot"))
    run.drawn_with(str(copy), "l7").save(tmp_path / "copy.h5")
    assert Run.load(tmp_path / "copy.h5").scenario.arm == "copy.urdf"


def test_a_carried_arm_goes_to_the_processes_of_real_time(away: Path, tmp_path: Path) -> None:
    scenario = travelled(made(away / "alices_robot.urdf", "l7"), away).scenario
    again = Scenario.from_json(scenario.to_json(carry=True))
    assert again.insertion().arm.sha256 == scenario.insertion().arm.sha256
    own = Scenario.of("own", scenario.insertion(), scenario.path)
    assert own.arm == "alices_robot.urdf"
    assert Scenario.from_json(own.to_json(carry=True)).insertion().arm.nv == 7


def test_only_links_joints_and_materials_are_carried(away: Path) -> None:
    more = """<material name="m"><texture filename="/home/alice/t.png"/></material>
    <gazebo><plugin filename="/home/alice/libp.so">/home/alice/x</plugin></gazebo></robot>"""
    (away / "alices_robot.urdf").write_text(urdf().replace("</robot>", more))
    carried = CarriedArm.of(load_arm(away / "alices_robot.urdf", "l7", home=HOME))
    assert carried is not None
    assert "/home/alice" not in carried.to_json()
    assert carried.load("l7", {}).nv == 7


def test_no_program_beside_a_run_is_run(away: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    carried = CarriedArm.of(load_arm(away / "alices_robot.urdf", "l7", home=HOME))
    assert carried is not None

    def never(*_: object, **__: object) -> None:
        pytest.fail("a file beside the run was read")

    monkeypatch.setattr("rcmqp.world.carried.load_arm", never)
    (away / "arm.xacro").write_text("<robot/>")
    (away / "arm.toml").write_text('urdf = "arm.xacro"')
    for name in ("arm.xacro", "arm.toml"):
        arm = dataclasses.replace(carried, name=name, beside=away).load("l7", {})
        assert arm.source is not None
        assert arm.source.carried


def test_an_arm_that_only_has_a_registered_name_does_not_have_its_title() -> None:
    carried = CarriedArm.of(load_arm("panda"))
    assert carried is not None
    assert carried.load(None, {}).title == "Franka Emika Panda"
    other = dataclasses.replace(carried, urdf=carried.urdf.replace("2.175", "9"), sha256="0" * 64)
    assert other.load(None, {}).title == "Franka Emika Panda, as the run's file has it"


# What is damaged ---------------------------------------------------------------------------


def _urdf(data: dict[str, Any]) -> None:
    data["urdf"] = data["urdf"].replace("revolute", "floating")


def _name(data: dict[str, Any]) -> None:
    data["name"] = "../alices_robot.urdf"


def _kind(data: dict[str, Any]) -> None:
    data["recipe"]["locked"] = []


def _more(data: dict[str, Any]) -> None:
    data["recipe"]["about"]["source"] = "a stranger's"


def _turned(data: dict[str, Any]) -> None:
    data["recipe"]["about"]["flange_offset"] = [[1.0, 2.0], [3.0, 4.0]]


def _titled(data: dict[str, Any]) -> None:
    data["recipe"]["about"]["title"] = {}


def _home(data: dict[str, Any]) -> None:
    data["recipe"]["home"] = [float("nan")]


def _meshes(data: dict[str, Any]) -> None:
    data["meshes"] = {"cover.stl": 7}


def _lost(data: dict[str, Any]) -> None:
    del data["urdf"]


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_urdf, "do not fit its sum"),
        (_name, "must be an arm's or a file's"),
        (_kind, "locked is missing, or is no dict"),
        (_more, "'source' is none of"),
        (_meshes, "meshes must be sums by name"),
        (_lost, "urdf is missing, or is no str"),
        (_turned, "flange_offset must be a placement"),
        (_titled, "title = {}, it must be a text"),
        (_home, "home must be finite numbers"),
    ],
)
def test_a_damaged_arm_is_said_of_the_file(
    away: Path, damage: Callable[[dict[str, Any]], None], said: str
) -> None:
    file = away / "run.h5"
    made(away / "alices_robot.urdf", "l7").save(file)
    with h5py.File(file, "r+") as stored:
        data = json.loads(stored["arm"][()])
        damage(data)
        del stored["arm"]
        stored.create_dataset("arm", data=json.dumps(data))
    with pytest.raises(RunFileError, match=f"run.h5.*arm.*{said}"):
        Run.load(file)


def test_an_arm_that_cannot_be_made_of_what_is_carried_is_an_error_in_words(away: Path) -> None:
    carried = CarriedArm.of(load_arm(away / "my_robot.toml"))
    assert carried is not None
    about = {**carried.recipe["about"], "flange_offset": "here"}
    for recipe, urdf_text in (
        ({**carried.recipe, "about": about}, carried.urdf),
        (carried.recipe, carried.urdf.replace("revolute", "floating")),
        ({**carried.recipe, "own": {"velocity": "fast"}}, carried.urdf),
    ):
        wrong = dataclasses.replace(carried, recipe=recipe, urdf=urdf_text, beside=None)
        with pytest.raises(Exception, match=r"my_robot\.toml|velocity") as found:
            wrong.load(None, {})
        assert isinstance(found.value, ArmError | ValueError)


def test_a_file_of_before_has_the_same_digest_and_needs_its_arm_here(tmp_path: Path) -> None:
    scenario = load_scenario("circle", "ur5", duration=0.05)
    run = simulate(scenario, make_controller("damped", scenario.insertion(), scenario.period))
    run.save(tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5", "r+") as stored:
        del stored["arm"]
    found = Run.load(tmp_path / "run.h5")
    assert found.arm is None
    assert found.digest == run.digest
    assert_allclose(found.insertion().arm.home, load_arm("ur5").home)
