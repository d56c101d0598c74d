"""Figures of runs, to stand beside the paper's."""

from __future__ import annotations

import math
import os
import re
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D

from rcmqp.errors import OptionError, UnknownName
from rcmqp.files import whole_file
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.run import Run
from rcmqp.show.labels import colour, dash, run_labels, run_marks
from rcmqp.world.loading import arm_title

FLOOR_MM = 1e-13
"""Where a logarithmic axis ends at the latest [mm]; what is less, as zero is, is drawn there."""
WIDE = 44
"""Letters of a line of what tells a run apart, at most."""
WIDTH, NARROW, SMALL = 8.0, 6.0, 8
"""Of a figure of errors: width [in]; below which letters are small; their size then [pt]."""
TRAJECTORY = 4.8
"""Width of a trajectory in its figure, where none is asked for [in]."""
ENDINGS = (".png", ".pdf", ".svg", ".eps")
"""Of files that a figure can be written to."""
FONTS: Any = {
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "rcmqp",
}
"""TrueType, which journals take, and text that stays text."""
SHAFTS = 7
"""How many times the shaft is drawn along a trajectory."""


def trajectory_figure(
    runs: Sequence[Run], labels: Sequence[str] = (), *, width: float | None = None
) -> Figure:
    """Tip trajectories in space, one column a run, as the paper's Fig. 2.

    Above, the arm at the start with its instrument, in the world [m]. Below, the trajectory in
    the axes of the effector at the start, with the trocar at the origin, wherever it moves to
    [mm]; the shaft is drawn at a few instants, from the trocar to the tip.

    Args:
        runs: at least one.
        labels: what tells the runs apart, see run_marks().
        width: of the figure [in]; TRAJECTORY for each run without it.

    Raises:
        OptionError: the width is below 2 or above 20 inches.
    """
    scale = 1.0 if width is None else _checked_width(width) / (TRAJECTORY * len(runs))
    with matplotlib.rc_context({"font.size": SMALL} if scale < 1.0 else {}):
        return _trajectory_figure(runs, labels, scale)


def _trajectory_figure(runs: Sequence[Run], labels: Sequence[str], scale: float) -> Figure:
    labels = labels or [", ".join(marks) for marks in run_marks(runs)[1]]
    wide = int(WIDE * min(1.0, scale * 10.0 / _letters(10)))
    height = 1.75 * TRAJECTORY * scale
    figure = Figure(figsize=(TRAJECTORY * scale * len(runs), height), layout="constrained")
    figure.suptitle(_shared_text(runs, wide * min(2, len(runs))), fontsize=_letters(9))
    for i, run in enumerate(runs):
        above, below = (
            figure.add_subplot(2, len(runs), row * len(runs) + i + 1, projection="3d")
            for row in (0, 1)
        )
        arm = _literal(arm_title(run.scenario.arm))
        title = f"{arm}\n{_wrapped(labels[i], wide)}"
        above.set_title(title, fontsize=_letters(10), y=0.98)
        _draw_arm(above, run, colour(i))
        _draw_trajectory(below, run, colour(i))
    return figure


def error_figure(
    runs: Sequence[Run],
    *,
    logarithmic: bool = False,
    labels: Sequence[str] = (),
    width: float = WIDTH,
) -> Figure:
    """Tip error and RCM error over time, all runs in one plot each, as the paper's Fig. 3.

    What all runs share of arm, period and what they were given is the title; the legend says
    the rest.

    Args:
        runs: at least one.
        logarithmic: whether the errors' axes are.
        labels: what tells the runs apart; arms and run_labels() without it.
        width: of the figure [in]; a column of a journal is about 3.5.

    Raises:
        OptionError: the width is below 2 or above 20 inches.
    """
    size: Any = {"font.size": SMALL} if _checked_width(width) < NARROW else {}
    with matplotlib.rc_context(size):
        return _error_figure(runs, logarithmic, labels, width)


def _checked_width(width: float) -> float:
    """A figure's width [in], if a figure can have it."""
    if not 2.0 <= width <= 20.0:
        raise OptionError(
            f"width = {width:.3g} in; give 2 to 20, which is 51 to 508 mm, such as 88 mm for a "
            "column"
        )
    return width


def _letters(most: float) -> float:
    """Size of letters that are ``most`` [pt] in a figure of full width, and not above the rest."""
    return min(most, float(matplotlib.rcParams["font.size"]))


def _error_figure(
    runs: Sequence[Run], logarithmic: bool, labels: Sequence[str], width: float
) -> Figure:
    names = [_wrapped(label) for label in labels or _labels(runs)]
    columns = max(1, int((4 if max(map(len, names)) < 18 else 2) * width / WIDTH))
    lines = 1 + max(name.count("\n") for name in names)
    legend = lines * math.ceil(len(names) / columns)
    title = _shared_text(runs, int(2 * WIDE * width / WIDTH))
    height = 0.65 * width + 0.2 * legend
    if width < NARROW:  # the same letters take more of it
        height += 0.4 + 0.15 * title.count("\n")
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for plot, name in zip(axes, ("tip", "RCM"), strict=True):
        errors = [1e3 * getattr(run, f"{name.lower()}_error") for run in runs]
        if logarithmic:
            errors = [np.maximum(error, FLOOR_MM) for error in errors]
        for i, (run, error) in enumerate(zip(runs, errors, strict=True)):
            plot.plot(
                run.time,
                error,
                label=names[i],
                color=colour(i),
                linestyle=dash(i),
                linewidth=1.4,
                marker="" if run.time.size > 1 else ".",  # a line needs two
            )
        _label_axes(plot, f"{name} error [mm]", errors if logarithmic else [])
    axes[0].set_title(title, fontsize=SMALL if width < NARROW else 9)
    axes[1].set_xlabel("time [s]")
    figure.legend(
        *axes[0].get_legend_handles_labels(),
        loc="outside upper center",
        ncols=columns,
        frameon=False,
    )
    return figure


def save_figure(
    figure: Figure,
    path: str | os.PathLike[str],
    *,
    endings: Sequence[str] = (".png", ".pdf"),
    dpi: float = 160,
) -> list[Path]:
    """Write a figure, as PNG and as PDF, and return the paths.

    Letters are TrueType fonts (Type 42) in PDF and EPS, and text in SVG.

    Args:
        figure: to write.
        path: of the files, without their endings; it may have dots of its own.
        endings: of the files to write, of ENDINGS.
        dpi: of PNG, and of images inside other files [dots per inch].

    Raises:
        UnknownName: there is no such ending.
        OptionError: dpi is below 30 or above 2400.
        RunFileError: a file cannot be written.
    """
    for ending in endings:
        if ending not in ENDINGS:
            raise UnknownName("ending of a figure", ending, ENDINGS)
    if not 30 <= dpi <= 2400:
        raise OptionError(f"dpi = {dpi:g}; give 30 to 2400, such as 600 for print")
    stem = Path(path)
    paths = [stem.with_name(f"{stem.name}{ending}") for ending in endings]
    for target in paths:
        about = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}.get(target.suffix, {})
        with whole_file(target) as part, matplotlib.rc_context(FONTS):
            figure.savefig(part, dpi=dpi, metadata=about)
    return paths


def _draw_arm(axes: Axes3D, run: Run, colour: str) -> None:
    insertion = run.insertion()
    arm = insertion.arm.skeleton(run.q[0])
    pivot = run.pivot[0]
    axes.plot(*arm[:-1].T, color="0.45", linewidth=5, solid_capstyle="round", marker="o")
    axes.plot(*np.array([arm[-2], run.tip[0]]).T, color="0.2", linewidth=1.6)
    axes.plot(*run.tip.T, color=colour, linewidth=1.2)
    axes.scatter(*pivot[:, None], color="black", s=22, depthshade=False)
    points = np.vstack([arm, run.tip, pivot])
    centre, half = (points.max(0) + points.min(0)) / 2, np.ptp(points, axis=0).max() / 2
    low, high = centre - half, centre + half
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.locator_params(nbins=5)
    axes.zaxis.labelpad = 0.9 * _letters(10)
    axes.set_box_aspect((1, 1, 1), zoom=0.9)
    _make_solid(axes)
    axes.view_init(elev=18, azim=-55)


def _draw_trajectory(axes: Axes3D, run: Run, colour: str) -> None:
    desired, reached = _in_trocar_axes(run, run.tip_d), _in_trocar_axes(run, run.tip)
    for k in np.linspace(0, len(run.time) - 1, SHAFTS).astype(int):
        axes.plot(*np.column_stack([np.zeros(3), reached[k]]), color="0.6", linewidth=0.8)
    axes.plot(*desired.T, color="0.75", linewidth=2.8, label="desired tip")
    axes.plot(*reached.T, color=colour, linewidth=1.2, label="tip")
    axes.scatter([0.0], [0.0], [0.0], color="black", s=30, label="trocar", depthshade=False)
    drawn = np.vstack([desired, reached])
    deep = float(np.nanmax(drawn[:, 2]))
    half = max(0.3 * deep, float(np.nanmax(np.abs(drawn[:, :2]))))
    axes.set(xlim=(-half, half), ylim=(-half, half), zlim=(deep, 0.0))
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="depth [mm]")
    space = _letters(10)
    axes.xaxis.labelpad, axes.yaxis.labelpad = 0.4 * space, 0.8 * space
    axes.zaxis.labelpad = 1.2 * space
    axes.set_box_aspect((2 * half, 2 * half, deep), zoom=0.72)
    axes.locator_params(nbins=3)
    axes.locator_params(axis="z", nbins=6)
    axes.tick_params(axis="z", pad=0.7 * space)
    axes.view_init(elev=18, azim=-60)
    _make_solid(axes)
    axes.legend(loc="upper left", fontsize=_letters(8), frameon=False)


def _make_solid(axes: Axes3D) -> None:
    """Give the walls behind a plot colours that EPS, which is never transparent, can have."""
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((0.975, 0.975, 0.975, 1.0))


def _in_trocar_axes(run: Run, points: Array) -> Array:
    """Points (n, 3) of the world relative to the moving trocar, in the axes of the start [mm]."""
    start = dq.quaternion_conj(dq.P(run.x[0]))
    return 1e3 * dq.rotate(start, points - run.pivot)


def _wrapped(label: str, wide: int = WIDE) -> str:
    """In lines short enough for half a figure, or of at most ``wide`` letters.

    No line ends inside ``K = 60 1/s``.
    """
    label = re.sub(r" = [^,]+", lambda found: found[0].replace(" ", "\u00a0"), label)
    return _literal(textwrap.fill(label, wide, break_on_hyphens=False))


def _literal(text: str) -> str:
    """Text in which matplotlib takes no dollar sign for mathematics."""
    return text.replace("$", r"\$")


def _one_arm(runs: Sequence[Run]) -> bool:
    return len({run.scenario.arm for run in runs}) == 1


def _shared_text(runs: Sequence[Run], wide: int = 2 * WIDE) -> str:
    """Arm and settings that all runs share, in lines of at most ``wide`` letters."""
    arm = [arm_title(runs[0].scenario.arm)] if _one_arm(runs) else []
    return _wrapped(", ".join([*arm, *run_marks(runs)[0]]), wide)


def _labels(runs: Sequence[Run]) -> list[str]:
    """A label for each run; it begins with the arm if there are several."""
    if _one_arm(runs):
        return run_labels(runs)
    return [
        ", ".join([arm_title(run.scenario.arm), *marks])
        for run, marks in zip(runs, run_marks(runs)[1], strict=True)
    ]


def _label_axes(axes: Axes, label: str, errors: Sequence[Array]) -> None:
    """Label and limit an axis; a logarithmic one, if given errors, starts below all of them.

    Their lowest hundredth does not count, or the zero of a start would set the scale; neither
    does what is missing.
    """
    axes.set_ylabel(label)
    if errors:
        axes.set_yscale("log")
        there = [error[np.isfinite(error)] for error in errors]
        lowest = [float(np.quantile(error, 0.01)) for error in there if error.size]
        axes.set_ylim(bottom=0.5 * min(lowest, default=FLOOR_MM))
    else:
        axes.set_ylim(bottom=0.0)
    axes.grid(color="0.9")
