from __future__ import annotations

import base64
import dataclasses
import gzip
import importlib.util
import json
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import (
    Run,
    arm_names,
    compute_metrics,
    load_arm,
    load_scenario,
    make_controller,
    simulate,
)
from rcmqp.cli import main
from rcmqp.errors import OptionError, ToolMissing, UnknownName, ViewError
from rcmqp.maths.dualquaternion import Array
from rcmqp.show.labels import run_labels, versions_text
from rcmqp.show.tables import metrics_table
from rcmqp.show.viewer import browser, capture, page
from rcmqp.show.viewer.scene import surroundings
from rcmqp.show.viewer.shapes import arm_parts
from rcmqp.show.viewer.timeline import BINS, envelope, frames, slip, stopped
from rcmqp.world.insertion import rcm_error
from rcmqp.world.obstacles import Sphere


def helix(duration: float = 0.4, period: float = 0.004, arm: str = "lwa3", **options: Any) -> Run:
    scenario = load_scenario("conical_helix", arm, duration=duration, period=period)
    controller = make_controller("dual_quaternion", scenario.insertion(), period, **options)
    return simulate(scenario, controller)


@pytest.fixture(scope="module")
def run() -> Run:
    return helix()


def test_the_table_says_what_was_given_and_which_limits_are_assumed_or_not_there(
    run: Run,
) -> None:
    free = dataclasses.replace(run, jerk_limit=np.full(7, np.inf), assumed=())
    lines = re.findall("<tr><td>(.*?)</td>(.*?)</tr>", metrics_table([run, free], "ab").html())
    rows = {name: re.findall("<td>(.*?)</td>", cells) for name, cells in lines}
    ratio = compute_metrics(run).jerk_ratio_max
    jerk = rows["joint jerk over its limit, max"]
    assert jerk == [f"{ratio:.3g}", "no limit"]
    assert rows["limits assumed"] == ["jerk", "none"]
    assert rows["feed-forward"] == ["no", "no"]
    assert rows["joint limits enforced"] == ["none", "none"]
    assert rows["T [ms]"] == ["4", "4"]
    assert rows["K [1/s]"] == ["60", "60"]
    names = list(rows)
    at = names.index("joint speed over its limit, max")
    assert [name.split()[1] for name in names[at : at + 3]] == ["speed", "acceleration", "jerk"]


def test_a_peak_of_one_sample_stays_in_the_curve() -> None:
    time: Array = np.arange(60_001) / 1e3
    values = np.sin(time)
    for k in (12_345, 59_999):
        values[k] = 9.0
    values[40_000] = -9.0
    kept_time, kept = envelope(time, values)
    assert kept.size <= 2 * BINS + 2
    assert set(time[[0, 12_345, 40_000, 59_999, 60_000]]) <= set(kept_time)
    assert_allclose(kept, values[np.searchsorted(time, kept_time)])


def test_frames_are_recorded_instants_sixty_a_second_or_more(run: Run) -> None:
    found = frames(run)
    steps = np.diff(found["time"])
    assert steps.max() <= 1.0 / 60.0
    assert steps.max() > 0.5 / 60.0
    rows = np.searchsorted(run.time, found["time"])
    assert rows[-1] == run.time.size - 1
    for name in ("tip", "pivot", "depth"):
        assert np.array_equal(found[name], getattr(run, name)[rows])


def test_angles_of_continuous_joints_do_not_jump() -> None:
    run = helix(arm="kinova")
    turning = dataclasses.replace(
        run, angles=np.mod(run.angles + np.linspace(0.0, 9.0, run.time.size)[:, None], 2 * np.pi)
    )
    continuous = ~np.isfinite(run.upper)
    assert continuous.sum() == 3
    assert np.abs(np.diff(frames(turning)["angles"][:, continuous], axis=0)).max() < 1.0


def test_slip_is_the_rcm_error_across_the_shaft(run: Run) -> None:
    off = dataclasses.replace(run, pivot=run.pivot + np.array([0.003, -0.002, 0.001]))
    found = slip(off.x, off.pivot)
    assert_allclose(np.linalg.norm(found, axis=1), rcm_error(off.x, off.pivot), atol=1e-12)
    nearest = off.pivot + found
    assert_allclose(rcm_error(off.x, nearest), 0.0, atol=1e-12)


@pytest.mark.parametrize("name", arm_names())
def test_every_arm_has_shapes_on_every_moving_link(name: str) -> None:
    arm = load_arm(name)
    parts = arm_parts(arm)
    assert {part.joint for part in parts} >= set(range(arm.nv))  # the last may be a bare flange
    for part in parts:
        R = part.placement[:3, :3]
        assert_allclose(R.T @ R, np.linalg.norm(R[:, 0]) ** 2 * np.eye(3), atol=1e-9)


def test_a_gripper_makes_way_for_the_instrument() -> None:
    arm = load_arm("panda")
    on_last = [part for part in arm_parts(arm) if part.joint == arm.nv]
    assert on_last  # link 7, in its own axes; hand and fingers, which hang lower, are left out
    assert all(np.array_equal(part.placement, np.eye(4)) for part in on_last)


def test_an_arm_without_shapes_is_rods_from_base_to_flange(tmp_path: Path) -> None:
    file = tmp_path / "bare.urdf"
    lwa3 = load_arm("lwa3").urdf
    assert lwa3 is not None
    text = lwa3.read_text()
    head, *links = text.split("<visual>")
    file.write_text(head + "".join(link.split("</visual>", 1)[1] for link in links))
    arm = load_arm(file, "flange", home=load_arm("lwa3").home)
    parts = arm_parts(arm)
    frame = arm.model.frames[arm.model.getFrameId("flange")]
    ends = [*(arm.model.jointPlacements[i + 1] for i in range(arm.nv)), frame.placement]
    middles = {i: end.translation / 2 for i, end in enumerate(ends) if end.translation.any()}
    assert {0, arm.nv} <= set(middles)
    rods = [part for part in parts if part.joint in middles and part.placement[:3, 3].any()]
    assert [part.joint for part in rods] == list(middles)
    for part in rods:
        assert_allclose(part.placement[:3, 3], middles[part.joint], atol=1e-12)
    assert len(parts) == arm.nv + len(rods)


def test_runs_are_told_apart_by_what_differs(run: Run) -> None:
    assert run_labels([run]) == ["dual_quaternion"]
    assert run_labels([run, helix(gain=30.0)])[1] == "dual_quaternion, K = 30 1/s"
    assert run_labels([run, helix(c_d=0.5)])[1] == "dual_quaternion, c_d = 0.5"
    assert run_labels([run, helix(feed_forward=True)]) == [
        "dual_quaternion, feed-forward: no",
        "dual_quaternion, feed-forward: yes",
    ]
    scaled = run_labels([run, helix(velocity_limit="scale")])[1]
    assert scaled == "dual_quaternion, joint limits enforced: speed by scaling"
    assert run_labels([run, helix(period=0.008)])[1] == "dual_quaternion, T = 8 ms"
    other = dataclasses.replace(helix(period=0.008), controller="damped")
    assert run_labels([run, other])[1] == "damped, T = 8 ms"
    seeded = dataclasses.replace(run, scenario=dataclasses.replace(run.scenario, seed=7))
    assert run_labels([run, seeded]) == ["dual_quaternion, seed = 0", "dual_quaternion, seed = 7"]
    assert len(set(run_labels([run, run, run]))) == 3


def test_lengths_periods_and_seeds_are_those_of_the_runs(run: Run) -> None:
    other = helix(period=0.008)
    rows = {name: values[:21] for name, values in other.rows().items()}
    scenario = dataclasses.replace(other.scenario, seed=7)
    short = dataclasses.replace(other, scenario=scenario).with_rows(rows, {}, {})
    assert versions_text([run, run]).startswith(
        "0.4 s, sampled every 4 ms; seed 0; example-robot-data "
    )
    assert versions_text([run, short, run]).startswith(
        "0.4 s and 0.16 s, sampled every 4 ms and 8 ms; seeds 0 and 7; example-robot-data "
    )


@pytest.mark.parametrize(
    ("field", "value"),
    [("duration", 0.8), ("obstacles", (Sphere((0.5, 0.0, 0.0), 0.01),)), ("name", "other")],
)
def test_a_run_of_another_scenario_is_refused_by_field(
    run: Run, field: str, value: object
) -> None:
    scenario = dataclasses.replace(run.scenario, **{field: value})  # type: ignore[arg-type]
    with pytest.raises(ViewError, match=rf"{field} is .* there and .* pages of their own"):
        page([run, dataclasses.replace(run, scenario=scenario)])


def test_no_run_is_refused() -> None:
    with pytest.raises(ViewError, match="at least one"):
        page([])


def test_an_arm_that_is_not_here_is_named(run: Run) -> None:
    for arm, why in (("/nowhere/arm.urdf", "no such file"), ("lwa9", "did you mean lwa3")):
        scenario = dataclasses.replace(run.scenario, arm=arm, carried_arm=None)
        with pytest.raises(ViewError, match=rf"'{arm}' is not the one .*{why}"):
            page([dataclasses.replace(run, scenario=scenario)])
    with pytest.raises(ViewError, match="has changed since the run was made"):
        page([dataclasses.replace(run, urdf_sha256="0")])


def test_a_damaged_file_ends_the_command_with_its_name(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "run.h5"
    run.save(file)
    with h5py.File(file, "r") as stored:
        position = stored["x"].id.get_chunk_info(0).byte_offset
    data = bytearray(file.read_bytes())
    data[position] ^= 0xFF
    file.write_bytes(data)
    with pytest.raises(SystemExit, match="1"):
        main(["view", str(file), "--html", str(tmp_path / "run.html"), "--no-open"])
    said = capsys.readouterr().err
    assert str(file) in said
    assert "damaged" in said
    assert not (tmp_path / "run.html").exists()


def test_view_writes_the_page_and_opens_it(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[str] = []

    def show(url: str) -> bool:
        seen.append(url)
        return True

    monkeypatch.setattr("webbrowser.open", show)
    run.save(tmp_path / "run.h5")
    with pytest.raises(SystemExit, match="0"):
        main(["view", str(tmp_path / "run.h5"), "--html", str(tmp_path / "run.html")])
    assert seen == [(tmp_path / "run.html").as_uri()]
    assert "MB" in capsys.readouterr().out
    text = (tmp_path / "run.html").read_text()
    assert "conical_helix on Schunk LWA3" in text
    assert "http" not in text.split("<script", 1)[0]  # nothing is fetched from anywhere


def test_a_temporary_page_that_cannot_be_made_leaves_no_folder(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run.save(tmp_path / "run.h5")
    dataclasses.replace(run, urdf_sha256="0").save(tmp_path / "other.h5")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    with pytest.raises(SystemExit, match="1"):
        main(["view", str(tmp_path / "run.h5"), str(tmp_path / "other.h5"), "--no-open"])
    assert list((tmp_path / "temporary").iterdir()) == []


def test_a_reference_that_is_missing_now_and_then_does_not_change_the_scene(run: Run) -> None:
    tip_d = run.tip_d.copy()
    tip_d[[0, 50]] = np.nan
    broken = dataclasses.replace(run, tip_d=tip_d)
    assert page([broken])
    insertion = run.insertion()
    assert surroundings(broken, insertion) == surroundings(run, insertion)


def test_the_ground_lies_below_the_deepest_tip_of_all_runs(run: Run) -> None:
    axis = np.array(run.scenario.trocar.axis)
    deeper = dataclasses.replace(run, tip=run.tip + 0.05 * axis)
    data = re.search(r'id="data-gz">([^<]+)<', page([run, deeper]))
    assert data is not None
    packed = gzip.decompress(base64.b64decode(data[1]))
    header, _ = json.JSONDecoder().raw_decode(packed[4:].decode("latin-1"))
    expected = np.linalg.norm(deeper.tip - run.pivot, axis=1).max()
    assert header["scene"]["deepest"] == pytest.approx(expected)


def test_a_page_is_light_unless_dark_is_asked_for(run: Run) -> None:
    for dark, theme in ((False, "light"), (True, "dark")):
        assert f'<html lang="en" data-theme="{theme}">' in page([run], dark=dark)


def test_safe_stops_too_near_to_be_told_apart_are_one(run: Run) -> None:
    assert stopped(run).shape == (0, 2)
    time, T = run.time, run.period
    short = dataclasses.replace(run, stops={"no view": [3, 9], "too fast": [4]})
    assert_allclose(stopped(short), [[time[3], time[4] + T], [time[9], time[9] + T]])
    long = dataclasses.replace(short, time=np.append(time[:-1], 1e4))
    assert_allclose(stopped(long), [[time[3], time[9] + T]])


def test_a_page_is_the_same_text_twice(run: Run) -> None:
    assert page([run]) == page([run])


def test_missing_tools_are_found_at_once_with_what_to_install(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("built a page before it looked for the tools")

    monkeypatch.setattr(browser, "write_page", never)
    which = shutil.which
    monkeypatch.setattr(shutil, "which", lambda name: None if name == "ffmpeg" else which(name))
    with pytest.raises(ToolMissing, match=r"ffmpeg .*apt-get install ffmpeg"):
        capture.video([run], tmp_path / "x.mp4")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(ToolMissing, match=r"Chromium .*apt-get install chromium"):
        capture.snapshot([run], tmp_path / "x.png")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ToolMissing, match=r"playwright .*pip install 'rcmqp\[browser\]'"):
        capture.snapshot([run], tmp_path / "x.png")


def test_wrong_pictures_are_refused_before_the_browser_starts(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(capture, "opened", None)
    png = tmp_path / "x.png"
    with pytest.raises(UnknownName, match="camera 'scope'"):
        capture.snapshot([run], png, camera="scope")
    with pytest.raises(OptionError, match=r"ends in \.png"):
        capture.snapshot([run], tmp_path / "x.jpg")
    with pytest.raises(OptionError, match=r"from 0 to 0\.4 s"):
        capture.snapshot([run], png, time=9.0)
    for size in ((10, 480), (480, 10), (9000, 640), (640, 9000)):
        with pytest.raises(OptionError, match="64 to 7680"):
            capture.snapshot([run], png, size=size)
    with pytest.raises(OptionError, match="even"):
        capture.video([run], tmp_path / "x.mp4", size=(641, 480))
    with pytest.raises(OptionError, match="speed"):
        capture.video([run], tmp_path / "x.mp4", speed=0.0)


def test_a_peak_beside_a_missing_number_is_kept() -> None:
    values = np.ones(10_000)
    values[5000], values[5001] = 9.0, np.nan
    _, kept = envelope(np.arange(10_000.0), values)
    assert np.nanmax(kept) == 9.0
