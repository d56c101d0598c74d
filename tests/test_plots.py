"""The figures of any run: a moving trocar, several runs of one controller, missing numbers."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3D
from mpl_toolkits.mplot3d.axes3d import Axes3D

from rcmqp import Run, load_scenario, make_controller, simulate
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.show import plots
from rcmqp.show.labels import COLOURS


@pytest.fixture(scope="module")
def moving() -> Run:
    """A view held while the trocar goes to and fro by 2 cm."""
    scenario = load_scenario("trocar_2cm_05hz", "lwa3", duration=3.0, period=0.01)
    return simulate(
        scenario, make_controller("hierarchical_qp", scenario.insertion(), scenario.period)
    )


def drawn(axes: object) -> list[tuple[str, Array]]:
    """Label and points (n, 3) of each line."""
    assert isinstance(axes, Axes3D)
    lines = [line for line in axes.get_lines() if isinstance(line, Line3D)]
    return [(str(line.get_label()), np.column_stack(line.get_data_3d())) for line in lines]


def test_shafts_of_a_moving_trocar_point_as_the_shaft_does(moving: Run) -> None:
    assert np.ptp(moving.pivot, axis=0).max() > 0.015
    lines = drawn(plots.trajectory_figure([moving]).axes[1])
    shafts = [points for label, points in lines if label.startswith("_")]
    rows = np.linspace(0, len(moving.time) - 1, plots.SHAFTS).astype(int)
    start = dq.quaternion_conj(dq.P(moving.x[0]))
    for k, (trocar, tip) in zip(rows, shafts, strict=True):
        z = dq.rotate(start, dq.rotate(dq.P(moving.x[k]), [0.0, 0.0, 1.0]))
        assert np.array_equal(trocar, np.zeros(3))
        assert_allclose(tip, 1e3 * moving.depth[k] * z, rtol=0, atol=0.05)
    curves = {label: points for label, points in lines if not label.startswith("_")}
    for label, points in (("tip", moving.tip), ("desired tip", moving.tip_d)):
        far = np.linalg.norm(points - moving.pivot, axis=1)
        assert_allclose(np.linalg.norm(curves[label], axis=1), 1e3 * far, rtol=0, atol=1e-6)


def test_a_trajectory_lies_inside_its_axes_and_their_labels_inside_the_figure(moving: Run) -> None:
    away = np.outer(moving.time, [0.015, -0.01, -0.01])  # up to 6 cm off what is desired
    figure = plots.trajectory_figure([dataclasses.replace(moving, tip=moving.tip + away)])
    axes: Any = figure.axes[1]
    low, high = np.sort([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()]).T
    for _, points in drawn(axes):
        assert np.all((low - 1e-9 <= points) & (points <= high + 1e-9))
    for each in (figure, plots.trajectory_figure([moving, moving])):
        canvas: Any = FigureCanvasAgg(each)
        canvas.draw()
        for below in each.axes[1::2]:
            assert isinstance(below, Axes3D)
            labels = [axis.label for axis in (below.xaxis, below.yaxis, below.zaxis)]
            boxes = [label.get_window_extent(canvas.get_renderer()) for label in labels]
            for box in boxes:
                assert each.bbox.x0 <= box.x0
                assert box.x1 <= each.bbox.x1
                assert each.bbox.y0 <= box.y0
                assert box.y1 <= each.bbox.y1
            for one, other in itertools.combinations(boxes, 2):
                assert not one.overlaps(other)


@pytest.mark.parametrize(("count", "mm"), [(1, 88.0), (2, 180.0), (1, 250.0)])
def test_trajectories_are_as_wide_as_asked_for_and_hold_all_letters(
    moving: Run, count: int, mm: float
) -> None:
    figure = plots.trajectory_figure([moving] * count, width=mm / 25.4)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    frame = figure.bbox
    assert frame.width == pytest.approx(figure.dpi * mm / 25.4)
    texts = [figure._suptitle, *(axes.title for axes in figure.axes)]  # type: ignore[attr-defined]
    for axes in figure.axes:
        assert isinstance(axes, Axes3D)
        texts += [axis.label for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    for text in filter(lambda each: each.get_text(), texts):
        box = text.get_window_extent(canvas.get_renderer())
        assert frame.x0 <= box.x0, text
        assert box.x1 <= frame.x1 + 0.5, text
        assert frame.y0 <= box.y0, text
        assert box.y1 <= frame.y1 + 0.5, text
        assert (text.get_fontsize() <= plots.SMALL) is (mm < 250.0)


def test_a_reference_that_is_missing_now_and_then_is_left_out_of_figures(moving: Run) -> None:
    tip_d, error = moving.tip_d.copy(), moving.tip_error.copy()
    tip_d[[0, 100]], error[[0, 100]] = np.nan, np.nan
    broken = dataclasses.replace(moving, tip_d=tip_d, tip_error=error)
    one, other = (plots.trajectory_figure([run]).axes[1] for run in (broken, moving))
    for found, expected in zip(drawn(one), drawn(other), strict=True):
        there = np.isfinite(found[1])
        assert there.sum() >= there.size - 6
        assert_allclose(found[1][there], expected[1][there], rtol=0, atol=1e-9)
    low, _ = plots.error_figure([broken], logarithmic=True).axes[0].get_ylim()
    there = 1e3 * error[np.isfinite(error)]
    assert low == pytest.approx(0.5 * np.quantile(there, 0.01))
    gone = dataclasses.replace(moving, tip_error=np.full_like(error, np.nan))
    plots.error_figure([gone], logarithmic=True)


def test_figures_whose_names_have_dots_keep_them(tmp_path: Path) -> None:
    written = [
        path
        for name in ("arm.v1", "arm.v2")
        for path in plots.save_figure(Figure(), tmp_path / name)
    ]
    assert [path.name for path in written] == [
        "arm.v1.png",
        "arm.v1.pdf",
        "arm.v2.png",
        "arm.v2.pdf",
    ]
    assert set(tmp_path.iterdir()) == set(written)


def test_runs_are_told_apart_by_colour_and_dash_in_both_plots_and_the_legend(moving: Run) -> None:
    count = 2 * len(COLOURS)
    for logarithmic in (False, True):
        labels = [f"run {i}" for i in range(count)]
        figure = plots.error_figure([moving] * count, logarithmic=logarithmic, labels=labels)
        for lines in (*(axes.get_lines() for axes in figure.axes), figure.legends[0].get_lines()):
            looks = [(str(line.get_color()), str(line.get_linestyle())) for line in lines]
            assert len(set(looks)) == count
            assert [colour for colour, _ in looks] == 2 * list(COLOURS)
            assert [dash for _, dash in looks[:4]] == ["-", "--", "-.", ":"]


@pytest.mark.parametrize("figure", [plots.trajectory_figure, plots.error_figure])
def test_no_font_is_of_type_3_and_svg_keeps_its_text(
    moving: Run, tmp_path: Path, figure: Any, caplog: pytest.LogCaptureFixture
) -> None:
    made = figure([moving])
    paths = plots.save_figure(made, tmp_path / "figure", endings=plots.ENDINGS, dpi=50)
    texts = {path.suffix: path.read_bytes() for path in paths}
    assert list(texts) == list(plots.ENDINGS)
    assert b"/Subtype /Type3" not in texts[".pdf"]
    assert b"/FontFile2" in texts[".pdf"]
    assert b"/FontType 42" in texts[".eps"]
    assert b"/FontType 3" not in texts[".eps"]
    assert b"[mm]</text>" in texts[".svg"]
    assert not caplog.records  # EPS has no transparency, and says so where it is asked for
    for ending in (".pdf", ".svg"):  # the same bytes each time
        first, again = (
            plots.save_figure(figure([moving]), tmp_path / name, endings=[ending])[0]
            for name in ("first", "again")
        )
        assert first.read_bytes() == again.read_bytes()


def test_a_column_of_a_journal_holds_all_letters(moving: Run) -> None:
    figure = plots.error_figure([moving, moving], width=88 / 25.4)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    frame = figure.bbox
    assert frame.width == pytest.approx(figure.dpi * 88 / 25.4)
    legend = figure.legends[0].get_window_extent()
    plot, title = figure.axes[0], figure.axes[0].title.get_window_extent()
    for box in (legend, title, plot.yaxis.label.get_window_extent()):
        assert frame.x0 <= box.x0
        assert box.x1 <= frame.x1 + 0.5
        assert frame.y0 <= box.y0
        assert box.y1 <= frame.y1 + 0.5
    assert plot.get_position().height > 0.15
    sizes = {text.get_fontsize() for text in [plot.yaxis.label, *plot.get_yticklabels()]}
    assert sizes == {plots.SMALL}


def test_figures_that_no_journal_takes_are_refused(moving: Run, tmp_path: Path) -> None:
    for figure in (plots.error_figure, plots.trajectory_figure):
        with pytest.raises(OptionError, match=r"width = 0\.0394 in; give 2 to 20"):
            figure([moving], width=1 / 25.4)
    with pytest.raises(UnknownName, match="ending of a figure"):
        plots.save_figure(Figure(), tmp_path / "figure", endings=[".bmp"])
    with pytest.raises(OptionError, match="dpi = 5; give 30 to 2400"):
        plots.save_figure(Figure(), tmp_path / "figure", dpi=5)


@pytest.mark.parametrize("wide", [12, 20, 39])
def test_no_line_of_a_title_ends_inside_a_value(wide: int) -> None:
    lines = plots._wrapped("Schunk LWA3, feed-forward: no, T = 1 ms, K = 60 1/s", wide).split("\n")
    assert "T\u00a0=\u00a01\u00a0ms" in " ".join(lines)
    assert any("K\u00a0=\u00a060\u00a01/s" in line for line in lines)
