"""Recordings from CSV files: ways of the tip, motions of the trocar."""

from __future__ import annotations

from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import Run, compute_metrics, load_scenario
from rcmqp.cli import main
from rcmqp.errors import InvalidCommand, OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.references.paths import TipTrace
from rcmqp.references.view import ViewCommand, view_pose
from rcmqp.runs.moved import along, moved
from rcmqp.world.recorded import Recorded

TIMES = np.linspace(0.0, 2.0, 41)
WAY = 0.01 * np.column_stack([np.sin(1.5 * TIMES) ** 2, 1.0 - np.cos(2.0 * TIMES), 0.3 * TIMES])


def written(folder: Path, head: str, table: np.ndarray, name: str = "way.csv") -> Path:
    file = folder / name
    lines = [",".join(repr(float(x)) for x in row) for row in table]
    file.write_text("\n".join(["# a comment", head, *lines, ""]))
    return file


@pytest.mark.parametrize(
    ("head", "clock", "unit", "first"),
    [
        ("t,x,y,z", 1.0, 1.0, 0.0),
        ("time [s], x [m], y [m], z [m]", 1.0, 1.0, 1.7e9),
        ("T [ms],X [mm],Y [mm],Z [mm]", 1e3, 1e3, -5e4),
        ("t [ns],x [cm],y [cm],z [cm]", 1e9, 1e2, 3e9),
    ],
)
def test_times_of_any_origin_and_units_of_any_kind_are_the_same_way(
    tmp_path: Path, head: str, clock: float, unit: float, first: float
) -> None:
    table = np.column_stack([clock * (TIMES + first), unit * WAY])
    found = Recorded.read(written(tmp_path, head, table))
    assert_allclose(found.times, TIMES, rtol=0, atol=1e-6)
    assert_allclose(found.positions, WAY, rtol=0, atol=1e-12)
    assert not found.world


def test_columns_come_in_any_order_and_others_are_left_out(tmp_path: Path) -> None:
    table = np.column_stack([WAY[:, 2], 7.0 * TIMES, TIMES, WAY[:, 0], WAY[:, 1]])
    found = Recorded.read(written(tmp_path, "world z,force [N],t,world x,world y", table))
    assert found.world
    assert_allclose(found.positions, WAY, rtol=0, atol=1e-15)


def test_the_tip_goes_the_recordings_way_seen_from_the_trocar_or_in_the_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scenario = load_scenario("circle", "panda")
    turn = dq.P(scenario.insertion().x_rcm)
    for world in (False, True):
        way = dq.rotate(turn, WAY) if world else WAY
        head = "t,world x,world y,world z" if world else "t,x,y,z"
        written(tmp_path, head, np.column_stack([TIMES, way]))
        law = ["-c", "hierarchical_qp", "--out", "run.h5"]
        with pytest.raises(SystemExit):
            main(["run", "circle", "-a", "panda", "--path", "way.csv", *law])
        run = Run.load("run.h5")
        assert run.time[-1] == pytest.approx(2.0)
        at = np.searchsorted(run.time, TIMES - 1e-9)
        came = dq.rotate(dq.quaternion_conj(turn), run.tip[at] - run.tip[0])
        assert_allclose(came, WAY - WAY[0], rtol=0, atol=1e-5)
        assert compute_metrics(run).tip_max_mm < 0.01


def test_the_trocar_moves_as_it_was_seen_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path, "t,world x,world y,world z", np.column_stack([TIMES, WAY]))
    with pytest.raises(SystemExit):
        main([*"run circle -a panda --motion way.csv -c hierarchical_qp --out run.h5".split()])
    run = Run.load("run.h5")
    at = np.searchsorted(run.time, TIMES - 1e-9)
    assert_allclose(run.pivot[at] - run.pivot[0], WAY - WAY[0], rtol=0, atol=1e-12)
    assert compute_metrics(run).rcm_max_mm < 0.01


@pytest.mark.parametrize(
    ("head", "change", "said"),
    [
        ("t,x,y", {}, r"has no column z, but t, x, y; its first line must name them"),
        ("t,x,y,z,time", {}, "two columns t"),
        ("t [h],x,y,z", {}, "units h; a time's is one of s, ms, us, ns"),
        ("t,x [mm],y [m],z [mm]", {}, "are the same one of m, cm, mm, um"),
        ("t,world x,y,z", {}, "some of x, y, z in the world's axes"),
        ("t,x,y,z", {(5, 0): 0.0}, r"sample 6 is at 0 s, the one before at 0.2 s"),
        ("t,x,y,z", {(5, 2): np.nan}, "sample 6 has a number that is not finite"),
        ("t,x,y,z", {(5, 2): 120.0}, r"goes 120 m away .* are these millimetres"),
    ],
)
def test_what_a_recording_may_not_have_is_said_with_its_place(
    tmp_path: Path, head: str, change: dict[tuple[int, int], float], said: str
) -> None:
    table = np.column_stack([TIMES, WAY])
    for place, value in change.items():
        table[place] = value
    with pytest.raises(OptionError, match=said):
        Recorded.read(written(tmp_path, head, table))


VIEWS = [
    ViewCommand(0.3 * np.sin(t), 0.2 * np.sin(2.0 * t), 2.1 * t, 0.01 * np.sin(t)) for t in TIMES
]


def poses(depth: float) -> tuple[np.ndarray, np.ndarray]:
    """Tips (n, 3) and quaternions (n, 4), w first, of VIEWS: in the axes of x_d(0)."""
    tool = dq.from_translation([0.0, 0.0, depth])
    found = np.array([dq.mul(view_pose(dq.exp(np.zeros(8)), view).x_d, tool) for view in VIEWS])
    return dq.translation(found), dq.P(found)


@pytest.mark.parametrize("order", ["qw,qx,qy,qz", "qx,qy,qz,qw"])
@pytest.mark.parametrize("world", [False, True])
def test_of_poses_the_roll_counts_with_the_way(tmp_path: Path, order: str, world: bool) -> None:
    scenario = load_scenario("circle")
    insertion = scenario.insertion()
    turn = dq.P(insertion.x_rcm)
    tips, turned = poses(insertion.tip_depth)
    if world:
        tips, turned = dq.rotate(turn, tips) + 0.3, dq.quaternion_mul(turn, turned)
    signs = np.where(np.arange(len(TIMES)) % 3, 1.004, -0.997)  # one rotation, and a little off
    turned = np.roll(turned, 0 if order.startswith("qw") else -1, axis=1) * signs[:, None]
    head = "t,world x,world y,world z," if world else "t,x,y,z,"
    found = Recorded.read(written(tmp_path, head + order, np.column_stack([TIMES, tips, turned])))
    path = along(scenario, found).path
    assert isinstance(path, TipTrace)
    for t, view in zip(TIMES, VIEWS, strict=True):
        made = path.command(float(t), insertion.tip_depth)
        assert_allclose(astuple(made)[:4], astuple(view)[:4], rtol=0, atol=1e-12)
    h, t = 1e-6, 0.77
    ends = [path.command(t + each, insertion.tip_depth).gamma for each in (h, -h)]
    rate = path.command(t, insertion.tip_depth).gamma_dot
    assert rate == pytest.approx((ends[0] - ends[1]) / (2 * h), abs=1e-7)


def test_poses_that_do_not_point_through_the_trocar_are_refused(tmp_path: Path) -> None:
    scenario = load_scenario("circle")
    tips, turned = poses(scenario.insertion().tip_depth)
    wrong = np.roll(turned, 1, axis=1)
    file = written(tmp_path, "t,x,y,z,qw,qx,qy,qz", np.column_stack([TIMES, tips, wrong]))
    with pytest.raises(OptionError, match=r"sample \d+ has its z axis \d+ deg beside the line"):
        along(scenario, Recorded.read(file))


@pytest.mark.parametrize(
    ("names", "factor", "said"),
    [
        ("qw,qx,qy,qz", 1.02, r"the quaternion of sample 1 has the norm 1\.02, it must be 1"),
        ("qw,qx,qy,other", 1.0, "has the columns qw, qx, qy of an orientation; they must be qw"),
        ("q0,q1,q2,q3", 1.0, "has the columns q0, q1, q2, q3 of an orientation"),
    ],
)
def test_quaternions_that_cannot_be_are_refused(
    tmp_path: Path, names: str, factor: float, said: str
) -> None:
    tips, turned = poses(0.1)
    table = np.column_stack([TIMES, tips, factor * turned])
    with pytest.raises(OptionError, match=said):
        Recorded.read(written(tmp_path, f"t,x,y,z,{names}", table))


def test_files_that_are_no_recordings_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "way.csv"
    for text, said in (
        (b"t,x,y,z\n0,0,0,0\n", "has 1 samples below its head"),
        (b"", "has 0 samples"),
        (b"t,x,y,z\n0,0,0,0\n1,a,0,0\n", "sample 2, '1, a, 0, 0', is not 4 numbers"),
        (b"t,x,y,z\n0,0,0,0\n1,0\n", "is not 4 numbers"),
        (b"\xff\xfe\x00", "cannot be read"),
    ):
        file.write_bytes(text)
        with pytest.raises(OptionError, match=said):
            Recorded.read(file)
    with pytest.raises(OptionError, match="no such file; give the path of a CSV"):
        Recorded.read(tmp_path / "nosuch.csv")


def test_a_way_out_of_the_trocar_and_a_motion_in_its_axes_are_refused() -> None:
    scenario = load_scenario("circle")
    here = Recorded((0.0, 1.0), ((0.0, 0.0, 0.0), (0.0, 0.0, -0.2)), world=False)
    path = along(scenario, here).path
    assert isinstance(path, TipTrace)
    with pytest.raises(InvalidCommand, match="must be inside"):
        path.command(1.0, 0.1)
    with pytest.raises(OptionError, match="name its columns world x"):
        moved(scenario, here)
