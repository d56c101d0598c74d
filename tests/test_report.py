"""The report: its folder, its tables, the way back to its runs, and its page in Chromium."""

from __future__ import annotations

import csv
import dataclasses
import errno
import html
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from markdown_it import MarkdownIt

from rcmqp import Run, load_arm, load_scenario, make_controller, simulate
from rcmqp.cli import main
from rcmqp.errors import RunFileError, ViewError
from rcmqp.runs.metrics import compute_metrics
from rcmqp.show import plots
from rcmqp.show.report import Screenshot, Section, as_html, groups_of, pictures, write_report
from rcmqp.show.viewer.browser import PATIENCE, browser

DISPLAYS = "what => [...document.querySelectorAll(what)].map(x => getComputedStyle(x).display)"
CUT = "[...document.querySelectorAll('table')].filter(x => x.scrollWidth > x.clientWidth).length"
FILES = ("paper.h5", "qp.h5", "slow.h5", "other.h5")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    """Three that go together, with an option and a period of their own, and one on another arm.

    That arm is a URDF with a dot in its name.
    """
    urdf, own = load_arm("ur5").urdf, tmp_path_factory.mktemp("arm") / "ur5.v2.urdf"
    assert urdf is not None
    own.write_text(urdf.read_text())
    cases: tuple[tuple[str, str, float, dict[str, Any]], ...] = (
        ("lwa3", "dual_quaternion", 0.01, {"feed_forward": True, "gain": 12.5}),
        ("lwa3", "hierarchical_qp", 0.01, {}),
        ("lwa3", "dual_quaternion", 0.02, {"objective": ""}),
        (str(own), "dual_quaternion", 0.01, {}),
    )
    found = []
    for arm, name, period, options in cases:
        flange = "tool0" if arm == str(own) else None
        scenario = load_scenario(
            "conical_helix", arm, flange=flange, period=period, duration=0.3, seed=5
        )
        controller = make_controller(name, scenario.insertion(), period, **options)
        found.append(simulate(scenario, controller))
    return found


@pytest.fixture(scope="module")
def folder(runs: list[Run], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("report") / "study"
    written = write_report(runs, out, files=FILES)
    assert sorted(written) == sorted(out.iterdir())
    return out


def test_tables_are_there_as_page_markdown_and_csv(folder: Path, runs: list[Run]) -> None:
    rows = list(csv.DictReader((folder / "report.csv").read_text().splitlines()))
    assert [row["digest"] for row in rows] == [run.digest for run in runs]
    assert [row["file"] for row in rows] == list(FILES)
    assert len({row["controller"] for row in rows[:3]}) == 3
    for row, run in zip(rows, runs, strict=True):
        assert float(row["tip_rms_mm"]) == compute_metrics(run).tip_rms_mm
        shown = f"{compute_metrics(run).tip_rms_mm:.3g}"
        assert f"| {shown} |" in (folder / "report.md").read_text()
        assert f">{shown}</td>" in (folder / "index.html").read_text()


def test_figures_tell_runs_of_one_controller_apart(runs: list[Run]) -> None:
    faster = dataclasses.replace(runs[0], options={**runs[0].options, "gain": 30.0})
    slow = dataclasses.replace(runs[0], options={**runs[0].options, "feed_forward": False})
    (group,) = groups_of([runs[0], faster, slow], FILES[:3])
    trajectories, errors = (picture.figure for picture in pictures(group))
    titles = [axes.get_title() for axes in trajectories.axes if axes.get_title()]
    assert [title.splitlines()[0] for title in titles] == 2 * ["Schunk LWA3"]
    assert [title.partition("\n")[2].replace("\n", " ") for title in titles] == group.labels[:2]
    legend = [text.get_text().replace("\n", " ") for text in errors.legends[0].get_texts()]
    assert legend == group.labels
    assert len(set(legend)) == 3
    for text in [*titles, *legend]:
        assert "dual_quaternion" in text


def test_errors_of_several_runs_are_on_a_logarithmic_scale(runs: list[Run]) -> None:
    for drawn, scale in ((runs[:1], "linear"), (runs[:2], "log")):
        (group,) = groups_of(drawn, FILES[: len(drawn)])
        _, errors = (picture.figure for picture in pictures(group))
        assert [axes.get_yscale() for axes in errors.axes] == [scale] * 2


def test_a_screenshot_is_of_the_runs_end_and_its_caption_is_text(
    runs: list[Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def draw(runs: list[Run], path: Path, *, time: float) -> None:
        asked.append((runs, path, time))

    monkeypatch.setattr("rcmqp.show.report.snapshot", draw)
    shot = Screenshot("lwa3", "the LWA3 *at the end*", runs[0])
    shot.write(tmp_path)
    assert asked == [([runs[0]], tmp_path / "lwa3.png", 0.3)]
    page = as_html("title", [Section("one", pictures=[shot])])
    assert '<img src="lwa3.png" alt="the LWA3 *at the end*" />' in page
    assert "<p>the LWA3 *at the end*</p>" in page


def test_every_file_that_the_page_names_is_there_and_no_other_address(folder: Path) -> None:
    text = (folder / "index.html").read_text()
    named = set(re.findall(r'(?:src|href)="([^"]*)"', text)) - {"data:,"}
    assert all((folder / name).stat().st_size > 0 for name in named)
    assert {name.rpartition(".")[2] for name in named} == {"png", "pdf", "html", "csv", "tex"}
    assert text.count("<iframe") == 2


def test_each_command_makes_its_run_again_to_the_bit(
    folder: Path, runs: list[Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = (folder / "report.md").read_text().splitlines()
    commands = [shlex.split(line) for line in lines if line.startswith("rcmqp run ")]
    assert [command[-1] for command in commands] == list(FILES)
    monkeypatch.chdir(folder)
    for command, run in zip(commands, runs, strict=True):
        with pytest.raises(SystemExit):
            main([*command[1:-1], str(tmp_path / command[-1])])
        assert Run.load(tmp_path / command[-1]).digest == run.digest


def test_names_are_text_wherever_they_stand(runs: list[Run], tmp_path: Path) -> None:
    name = "![i](http://evil.example/x.png) [click](http://evil.example) *b* _c_ d_e | <http://evil.example>`"
    law, option = r"</td><img src=x> $\frac$ ![i](y.png)", "`\n![i](z.png)"
    fence = {"objective": "\n```\n![i](w.png)"}
    scenario = dataclasses.replace(runs[0].scenario, name=name)
    named = [
        dataclasses.replace(
            runs[0],
            scenario=scenario,
            controller=controller,
            options=options,
            versions={"![i](v.png)": "1"},
        )
        for controller, options in (
            (law, {option: [1]}),
            (law, {option: [2]}),
            ("dual_quaternion", {option: [3]}),
            ("dual_quaternion", fence),
        )
    ]
    write_report(named, tmp_path, files=FILES)
    page = (tmp_path / "index.html").read_text()
    linked = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert {re.sub(r"^(view|trajectories|errors)_.*_lwa3", "", each) for each in linked} == {
        *("data:,", ".html", ".png", ".pdf", "report.csv", "report.tex")
    }
    assert not re.search("<(em|i|b)>", page)
    shown = html.unescape(re.sub("<[^>]*>", "", page))
    title = f"{name} on Schunk LWA3"
    assert shown.count(title) == 2  # the section's title, and the list of versions
    assert shown.count(name) == 2 + 2 + 3  # the page's own title, twice; three tables' titles
    assert f"{title}: 0.3 s, sampled every 10 ms; seed 5; ![i](v.png) 1" in shown
    for label in (f"{law}, {option} = [1]", f"{law}, {option} = [2]"):
        assert shown.count(" ".join(label.split())) == 4  # below the trajectories; three tables
    assert f"# slow.h5: made in Python, its {option!r} were given there" in shown
    assert f"objective={fence['objective']}' --out other.h5" in shown
    written = MarkdownIt().render((tmp_path / "report.md").read_text())
    assert html.unescape(written).startswith(f"<h1>{name}: 4 runs</h1>")


def test_a_run_that_no_command_makes_is_said_to_be_one(runs: list[Run], tmp_path: Path) -> None:
    strange = dataclasses.replace(runs[0], controller="mine")
    write_report([strange], tmp_path, files=["a.h5"])
    assert "# a.h5: its controller 'mine' is not one" in (tmp_path / "report.md").read_text()


def test_runs_of_one_and_of_two_rows_have_a_report(runs: list[Run], tmp_path: Path) -> None:
    """Such as a recording that was interrupted at once."""
    short = [
        runs[0].with_rows({name: rows[:n] for name, rows in runs[0].rows().items()}, {}, {})
        for n in (1, 2)
    ]
    write_report(short, tmp_path, files=FILES[:2])
    rows = list(csv.DictReader((tmp_path / "report.csv").read_text().splitlines()))
    assert [(row["sparc"], row["ldlj"]) for row in rows] == [("nan", "nan")] * 2
    assert [row["tip_rms_mm"] for row in rows] == [
        str(compute_metrics(run).tip_rms_mm) for run in short
    ]
    errors = plots.error_figure(short, logarithmic=True)
    for axes, name in zip(errors.axes, ("tip_error", "rcm_error"), strict=True):
        low, high = axes.get_ylim()
        for line, run in zip(axes.get_lines(), short, strict=True):
            there = np.maximum(1e3 * getattr(run, name), plots.FLOOR_MM)
            assert np.array_equal(line.get_ydata(), there)
            assert (line.get_marker() == "") == (run is short[1])
            assert (low <= there).all()
            assert (there <= high).all()


def test_what_goes_wrong_leaves_the_folder_as_it_was(
    runs: list[Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ViewError, match="at least one"):
        write_report([], tmp_path, files=[])
    stranger = dataclasses.replace(runs[3], urdf_sha256="0")
    with pytest.raises(ViewError, match="make the run again"):
        write_report([runs[0], stranger], tmp_path, files=FILES[:2])
    (tmp_path / "index.html").mkdir()
    with pytest.raises(RunFileError, match="is a folder"):
        write_report(runs[:1], tmp_path, files=FILES[:1])
    assert [path.name for path in tmp_path.iterdir()] == ["index.html"]


def test_a_full_disk_is_said_of_the_file_in_the_reports_own_folder(
    runs: list[Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, *_: object, **__: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(RunFileError) as raised:
        write_report(runs[:1], tmp_path, files=FILES[:1])
    page = tmp_path / "view_conical_helix_lwa3.html"
    assert str(raised.value) == f"{page}: could not be written: No space left on device"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("content", "out", "message"),
    [
        (b"\x89HDF\r\n\x1a\nrest", "new", "damaged"),
        (None, "taken", "is a file; give the name of a folder"),
    ],
)
def test_the_command_refuses_what_it_cannot_read_or_write(
    runs: list[Run],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    content: bytes | None,
    out: str,
    message: str,
) -> None:
    file = tmp_path / "run.h5"
    runs[0].save(file)
    if content is not None:
        file.write_bytes(content)
    (tmp_path / "taken").touch()
    with pytest.raises(SystemExit) as stop:
        main(["report", str(file), "--out", str(tmp_path / out)])
    assert stop.value.code == 1
    assert message in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_the_page_opens_offline_plays_its_runs_and_prints_without_viewers(folder: Path) -> None:
    requests: list[str] = []
    said: list[str] = []
    with browser() as chromium:
        page = chromium.new_page(viewport={"width": 700, "height": 400}, offline=True)
        page.on("request", lambda request: requests.append(request.url))
        page.on("console", lambda message: said.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: said.append(f"error: {error}"))
        page.goto((folder / "index.html").as_uri())
        frame = page.query_selector("iframe")
        assert frame is not None
        frame.scroll_into_view_if_needed()
        viewer = frame.content_frame()
        assert viewer is not None
        viewer.wait_for_selector("html[data-ready]", state="attached", timeout=1e3 * PATIENCE)
        assert viewer.locator("#viewer canvas").count() == 1
        assert viewer.locator("#legend tbody tr").count() == 3
        wide = []
        for width in (1280, 390):
            page.set_viewport_size({"width": width, "height": 844})
            wide.append(page.evaluate("document.documentElement.scrollWidth"))
        broken = page.evaluate("[...document.images].filter(x => !x.naturalWidth).length")
        page.emulate_media(media="print")
        page.set_viewport_size({"width": 1000, "height": 700})
        frames = page.evaluate(DISPLAYS, "iframe")
        links = page.evaluate(DISPLAYS, "p:has(a[href^='view_'])")
        cut = page.evaluate(CUT)
        page.evaluate("document.documentElement.dataset.theme = 'dark'")
        ground = page.evaluate("getComputedStyle(document.documentElement).backgroundColor")
    assert set(frames) == set(links) == {"none"}
    assert cut == 0
    assert ground == "rgb(255, 255, 255)"
    assert broken == 0
    assert wide == [1280, 390]
    assert all(url.startswith(folder.as_uri()) for url in requests)
    assert [line for line in said if line.startswith(("error", "warning"))] == []
