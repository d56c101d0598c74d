"""Experiment A as one call, and the figures that it draws."""

from __future__ import annotations

import dataclasses
import itertools
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3D
from mpl_toolkits.mplot3d.axes3d import Axes3D

from rcmqp import Run, make_controller, simulate
from rcmqp.cli import main
from rcmqp.errors import OptionError
from rcmqp.experiments.experiment_a import ARMS, BESIDE, comparison_table, reproduce_a
from rcmqp.runs.loading import load_scenario
from rcmqp.runs.metrics import compute_metrics
from rcmqp.show import plots
from rcmqp.show.tables import as_markdown
from rcmqp.world.instrument_file import load_instrument


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    """Two seconds of the helix on both arms."""
    found = []
    for arm in ("lwa3", "meka_a2"):
        scenario = load_scenario("conical_helix", arm, period=0.01, duration=2.0)
        controller = make_controller("dual_quaternion", scenario.insertion(), 0.01)
        found.append(simulate(scenario, controller))
    return found


def test_the_table_beside_the_paper_says_what_the_law_was_given(runs: list[Run]) -> None:
    lines = [line.strip("| ").split(" | ") for line in table_of(runs).splitlines()]
    found = {name: cells for name, *cells in lines[2:]}
    assert found["feed-forward"] == ["no"] * 3
    assert found["joint limits enforced"] == ["none"] * 3
    assert found["K [1/s]"] == ["60"] * 3
    assert found["limits assumed"] == ["not given", "jerk", "acceleration and jerk"]
    assert found["rms until [s]"] == ["not given", "2", "2"]
    lwa3, meka = (compute_metrics(run) for run in runs)
    assert found["joint jerk over its limit, max"] == [
        "not given",
        *(f"{each.jerk_ratio_max:.2f}" for each in (lwa3, meka)),
    ]
    free = dataclasses.replace(runs[0], jerk_limit=np.full(7, np.inf))
    assert "| joint jerk over its limit, max | not given | no limit |" in table_of([free])


def table_of(runs: list[Run]) -> str:
    return comparison_table(runs, list(map(compute_metrics, runs))).markdown()


def test_every_file_is_written_and_every_cycle_is_reported(tmp_path: Path) -> None:
    reported: dict[str, int] = {}
    totals: dict[str, int] = {}

    def progress(title: str, done: int, total: int) -> None:
        reported[title] = reported.get(title, 0) + done
        totals[title] = total

    found = reproduce_a(tmp_path / "new", duration=0.05, progress=progress)
    assert reported == totals
    assert len(reported) == len(found.runs) + len(found.rivals) == 4 + 2 * len(BESIDE)
    assert sorted(found.files) == sorted((tmp_path / "new").iterdir())
    assert all(file.stat().st_size > 0 for file in found.files)
    text = (tmp_path / "new" / "experiment_a.md").read_text()
    assert f"{found.table}\n## Beside hierarchical_qp\n\n{as_markdown(found.beside)}\n" in text
    page = (tmp_path / "new" / "index.html").read_text()
    assert "draws a conical helix inside the patient" in page
    assert page.count("<iframe") == 4
    assert [f'src="helix_{arm}.png"' in page for arm in ARMS] == [True, True]
    assert "left out" not in page
    assert f"rcmqp reproduce --out {tmp_path / 'new'} --duration 0.05" in page
    assert Run.load(tmp_path / "new" / "meka_a2_8ms.h5") == found.runs[1]
    assert Run.load(tmp_path / "new" / "lwa3_1ms_hierarchical_qp.h5") == found.rivals[2]
    assert [row.digest for row in found.beside] == [
        run.digest for run in (*found.runs[2:], *found.rivals)
    ]
    given = [(row.scenario, row.feed_forward, row.limits_enforced) for row in found.beside[::2]]
    assert given == [
        ("conical_helix", "no", "none"),
        ("conical_helix", "yes", "none"),
        ("conical_helix", "yes", "all"),
        ("fast_helix", "no", "speed by scaling"),
        ("fast_helix", "yes", "speed by scaling"),
        ("fast_helix", "yes", "all"),
    ]


def test_without_chromium_the_report_says_that_screenshots_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    found = reproduce_a(tmp_path, arms=["lwa3"], duration=0.05)
    text = (tmp_path / "report.md").read_text()
    assert "Screenshots of the arms are left out: Chromium is not installed" in text
    assert not any(file.name.startswith("helix_") for file in found.files)


def test_an_instrument_of_ones_own_draws_every_helix(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, made, asked = tmp_path / "short.toml", list[Any](), dict[str, Any]()
    file.write_text("length = 0.3\n[mount]\nxyz = [0.0, 0.01, 0.02]\n")

    def keep(runs: list[Run], *_: object, command: str, **__: object) -> list[Path]:
        made.extend([runs, command])
        return []

    def ask(*_: object, **options: object) -> None:
        asked.update(options)
        raise OptionError("enough")

    monkeypatch.setattr("rcmqp.experiments.experiment_a.write_report", keep)
    monkeypatch.setattr("rcmqp.experiments.experiment_a.PERIODS", (8e-3,))
    reproduce_a(tmp_path, arms=["lwa3"], duration=0.02, instrument=file)
    runs, command = made
    assert {run.scenario.instrument for run in runs} == {load_instrument(file)}
    assert command.endswith("--instrument short.toml")
    monkeypatch.setattr("rcmqp.experiments.experiment_a.reproduce_a", ask)
    with pytest.raises(SystemExit):
        main(["reproduce", "--instrument", str(file)])
    assert asked["instrument"] == str(file)


def test_the_table_holds_the_runs_own_numbers(runs: list[Run]) -> None:
    metrics = [compute_metrics(run) for run in runs]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in comparison_table(runs, metrics).markdown().splitlines()
    ]
    assert rows[0] == ["", "the paper", "Schunk LWA3, 10 ms", "Meka A2, right arm, 10 ms"]
    by_label = {row[0]: row[1:] for row in rows[2:]}
    assert by_label["RCM error, max [mm]"] == [
        "< 0.05",
        *(f"{1e3 * run.rcm_error.max():.4f}" for run in runs),
    ]
    speed = [np.linalg.norm(np.diff(run.tip_d, axis=0), axis=1) / 0.01 for run in runs]
    lag = [f"{1e3 * np.sqrt(np.mean(values**2)) / 60.0:.3f}" for values in speed]
    assert by_label["speed / K, rms [mm]"] == ["not given", *lag]
    assert {len(row) for row in rows} == {4}


def lines(figure: Figure, axes: int) -> list[tuple[np.ndarray, np.ndarray]]:
    return [
        (np.asarray(line.get_xdata()), np.asarray(line.get_ydata()))
        for line in figure.axes[axes].get_lines()
    ]


def test_the_error_figure_draws_both_errors_of_every_run_in_mm(runs: list[Run]) -> None:
    figure = plots.error_figure(runs)
    for axes, name in enumerate(("tip_error", "rcm_error")):
        for run, (time, error) in zip(runs, lines(figure, axes), strict=True):
            assert np.array_equal(time, run.time)
            assert np.array_equal(error, 1e3 * getattr(run, name))
    styles = [line.get_linestyle() for line in figure.axes[0].get_lines()]
    assert styles == ["-", "--"]  # the paper's: Schunk solid, Meka dashed


def test_a_logarithmic_figure_shows_every_curve_that_its_legend_names(runs: list[Run]) -> None:
    first = runs[0]
    zero = dataclasses.replace(first, tip_error=0.0 * first.tip_error)
    tiny = dataclasses.replace(first, tip_error=np.full_like(first.tip_error, 1e-15))
    figure = plots.error_figure([first, zero, tiny] + 5 * [first], logarithmic=True)
    low, high = figure.axes[0].get_ylim()
    for _, error in lines(figure, 0):
        assert np.mean((low < error) & (error < high)) > 0.98
    assert len({line.get_color() for line in figure.axes[0].get_lines()}) == 8


def test_ticks_of_a_short_helix_do_not_run_into_each_other(runs: list[Run]) -> None:
    figure = plots.trajectory_figure(runs)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    for axes in figure.axes:
        assert isinstance(axes, Axes3D)
        drawn = []
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            low, high = sorted(axis.get_view_interval())
            drawn += [
                tick.label1.get_window_extent(canvas.get_renderer())
                for tick in axis.get_major_ticks()
                if low <= tick.get_loc() <= high
            ]
        assert len(drawn) >= 8
        for one, other in itertools.combinations(drawn, 2):
            assert not one.overlaps(other)


def test_what_all_runs_share_is_the_title_of_the_error_figure(runs: list[Run]) -> None:
    given = "feed-forward: no, roll controlled: yes, joint limits enforced: none, "
    given += "T = 10 ms, K = 60 1/s".replace(" = ", "\u00a0=\u00a0").replace("0 ", "0\u00a0")
    figure = plots.error_figure([runs[0], dataclasses.replace(runs[0], controller="other")])
    title = figure.axes[0].get_title().replace("\n", " ")
    assert title == f"Schunk LWA3, {given}, limits assumed: jerk"
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["dual_quaternion", "other"]
    both = plots.error_figure(runs)
    assert both.axes[0].get_title().replace("\n", " ") == given
    legend = [text.get_text().replace("\n", " ") for text in both.legends[0].get_texts()]
    assert legend == [
        "Schunk LWA3, dual_quaternion, limits assumed: jerk",
        "Meka A2, right arm, dual_quaternion, limits assumed: acceleration and jerk",
    ]
    assert plots.trajectory_figure(runs).get_suptitle().replace("\n", " ") == given


def test_the_trajectory_figure_starts_below_the_trocar_at_the_starts_depth(
    runs: list[Run],
) -> None:
    figure = plots.trajectory_figure(runs)
    for i, run in enumerate(runs):
        (tip,) = (line for line in figure.axes[2 * i + 1].get_lines() if line.get_label() == "tip")
        assert isinstance(tip, Line3D)
        x, y, z = tip.get_data_3d()
        np.testing.assert_allclose([x[0], y[0], z[0]], [0.0, 0.0, 100.0], atol=1e-6)
        depth = np.linalg.norm(np.column_stack([x, y, z]), axis=1)
        np.testing.assert_allclose(depth, 1e3 * run.depth, atol=1e-3)


def test_a_figure_is_written_as_png_and_pdf(runs: list[Run], tmp_path: Path) -> None:
    files = plots.save_figure(plots.error_figure(runs), tmp_path / "errors")
    assert [file.read_bytes()[:4] for file in files] == [b"\x89PNG", b"%PDF"]
