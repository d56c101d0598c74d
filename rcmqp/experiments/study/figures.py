"""Figures of experiment B, to stand beside the paper's."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from mpl_toolkits.mplot3d.axes3d import Axes3D

from rcmqp.experiments.study.comparisons import given_of
from rcmqp.experiments.study.outcome import Outcome, task_of
from rcmqp.experiments.study.statistics import FEWEST
from rcmqp.experiments.study.trial_file import TrialFile
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.hand import HandMapping
from rcmqp.references.operators import GROUPS
from rcmqp.references.view import view_pose
from rcmqp.runs.metrics import BEHIND
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.setup import given_words
from rcmqp.show.labels import SPHERES
from rcmqp.world.camera import Pinhole, camera_pose
from rcmqp.world.obstacles import Sphere

OBSTACLE = (0.62, 0.62, 0.66)
PAPER_TIMES = dict(zip(GROUPS, (84.0, 52.0), strict=True))
"""Mean completion times of the paper's two groups [s]."""

PAPER_ERROR = 0.34
"""The paper's effector error, rms [mm]; of which point is not said."""

GROUP_COLOURS = dict(zip(GROUPS, ("#D55E00", "#0072B2"), strict=True))


def views(scenario: Scenario, size: int = 480) -> list[Array]:
    """The images (size, size, 3) of the start and of the objectives: Fig. 4."""
    task = task_of(scenario)
    depth = scenario.insertion().tip_depth
    mapping = HandMapping()
    shown = [*task.spheres, *([task.obstacle] if task.obstacle else [])]
    colours = [*SPHERES[: len(task.spheres)], OBSTACLE]
    images = []
    for target in ((0.0, 0.0, depth), *task.places):
        view = mapping.view(mapping.way(target, depth), (0.0, 0.0, 0.0), depth)
        camera = scenario.instrument.camera
        x = camera_pose(view_pose(dq.IDENTITY, view).x_d, depth, camera)
        pinhole = Pinhole(camera, size)
        images.append(pinhole.render(x, shown, colours[: len(shown)]))
    return images


def views_figure(scenario: Scenario) -> Figure:
    """The camera views, as the paper's Fig. 4."""
    images = views(scenario)
    figure = Figure(figsize=(2.6 * len(images), 3.0), layout="constrained")
    count = len(images)
    titles = ["(a) start", *(f"({chr(ord('a') + i)}) objective {i}" for i in range(1, count))]
    for axes, image, title in zip(figure.subplots(1, count), images, titles, strict=True):
        half = len(image) / 2.0
        shown = axes.imshow(image, interpolation="nearest", extent=(0, 2 * half, 2 * half, 0))
        shown.set_clip_path(Circle((half, half), half, transform=axes.transData))
        axes.set_title(title, fontsize=10)
        axes.set_axis_off()
    return figure


def trial_figure(record: TrialFile) -> Figure:
    """Effector, tip and RCM error over one trial, as the paper's Fig. 6."""
    figure = Figure(figsize=(8.0, 5.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    traces, outcome = record.traces, record.outcome
    time = traces["time"]
    above.plot(time, 1e3 * traces["tip_error"], color="#56B4E9", lw=0.8, label="tip (camera)")
    above.plot(
        time,
        1e3 * traces["effector_error"],
        color="#0072B2",
        lw=0.8,
        label="effector (shaft at the trocar)",
    )
    below.plot(time, 1e3 * traces["rcm_error"], color="#D55E00", lw=0.8)
    for axes, label in ((above, "error [mm]"), (below, "RCM error [mm]")):
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.3)
        for t in outcome.reached_s:
            if not math.isnan(t):
                axes.axvline(t, color="0.3", linestyle="--", linewidth=0.9)
    for i, t in enumerate(outcome.reached_s):
        if not math.isnan(t):
            above.annotate(
                f"objective {i + 1} ",
                (t, 0.97),
                xycoords=above.get_xaxis_transform(),
                rotation=90,
                ha="right",
                va="top",
                fontsize=8,
            )
    below.set_xlabel("time [s]")
    figure.legend(loc="outside upper center", ncols=2, fontsize=8, title=_title(outcome))
    return figure


def trajectory_figure(scenario: Scenario, record: TrialFile) -> Figure:
    """The camera's way with objectives and obstacle, as the paper's Fig. 7 [mm]."""
    task = task_of(scenario)
    figure = Figure(figsize=(6.4, 6.0), layout="constrained")
    axes: Axes3D = figure.add_subplot(projection="3d")
    tip = 1e3 * record.traces["tip"]
    axes.plot(*tip.T, color="#0072B2", linewidth=1.0, label="camera")
    axes.scatter(*tip[:1].T, color="black", s=24, label="start", depthshade=False)
    places = 1e3 * np.array(task.places)
    for i, (x, y, z) in enumerate(places):
        colour = SPHERES[i % len(SPHERES)]
        label = "objectives" if i == 0 else None
        axes.scatter(
            [x], [y], [z], color=colour, s=50, edgecolor="black", depthshade=False, label=label
        )
        axes.text(x, y, z - 3.0, f"  {i + 1}", fontsize=11)
    if task.obstacle is not None:
        x, y, z = _ball(task.obstacle)
        axes.plot_surface(x, y, z, color=OBSTACLE, alpha=0.5, linewidth=0, label="obstacle")
    low, high = tip[:, 2].min() - 2.0, places[:, 2].max() + 15.0
    half = np.abs(places[:, :2]).max() + 15.0
    axes.set(xlim=(-half, half), ylim=(-half, half), zlim=(high, low))
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="depth [mm]")
    ticks = np.arange(-math.floor(half / 20.0) * 20.0, half, 20.0)
    axes.set(xticks=ticks[np.abs(ticks) < half - 5.0], yticks=ticks[np.abs(ticks) < half - 5.0])
    axes.set_box_aspect((2 * half, 2 * half, high - low), zoom=0.85)
    axes.view_init(elev=28, azim=-62)
    axes.legend(loc="upper left", fontsize=8, frameon=False)
    axes.set_title(_title(record.outcome), fontsize=8)
    return figure


def groups_figure(outcomes: Sequence[Outcome]) -> Figure:
    """Novices and experienced with one arm and controller: time in all and an objective, errors.

    Unless the study has Learning, what differs from objective to objective is the way alone.
    """
    figure = Figure(figsize=(11.0, 3.9), layout="constrained")
    if outcomes:
        counts = ", ".join(f"{len(_of(outcomes, group))} {group}" for group in GROUPS)
        figure.suptitle(
            f"{outcomes[0].arm}, {outcomes[0].controller}: {counts}; bars in the middle are "
            f"standard deviations\n{_given(outcomes[0])}",
            fontsize=10,
        )
    whole, legs, errors = figure.subplots(1, 3)
    _boxes(whole, [[o.completion_s for o in _of(outcomes, group)] for group in GROUPS], GROUPS)
    for i, group in enumerate(GROUPS):
        label = "the paper's mean" if i == 0 else None
        mean = PAPER_TIMES[group]
        whole.plot([i + 0.7, i + 1.3], [mean, mean], "k--", label=label)
    whole.set_ylim(0.0, 1.1 * max(whole.get_ylim()[1], *PAPER_TIMES.values()))
    whole.legend(fontsize=8)
    whole.set_ylabel("completion time [s]")
    for group in GROUPS:
        times = np.array([(0.0, *o.reached_s) for o in _of(outcomes, group) if o.finished])
        if len(times):
            each = np.diff(times, axis=1)
            number = np.arange(1, each.shape[1] + 1)
            spread = np.std(each, axis=0, ddof=1) if len(each) > 1 else 0.0 * each[0]
            legs.errorbar(
                number + (0.05 if group == GROUPS[1] else -0.05),
                each.mean(axis=0),
                spread,
                color=GROUP_COLOURS[group],
                marker="o",
                capsize=3,
                label=group,
            )
    legs.set(
        xlabel="objective",
        ylabel="time for it [s]",
        xticks=range(1, 1 + max((len(o.reached_s) for o in outcomes), default=0)),
    )
    legs.set_ylim(0.0, 1.15 * legs.get_ylim()[1])
    if legs.containers:
        legs.legend(fontsize=8, loc="upper center", ncols=len(GROUPS))
    names = ("effector_rms_mm", "tip_rms_mm")
    sets = [[getattr(o, name) for o in _of(outcomes, group)] for name in names for group in GROUPS]
    labels = [f"{what},\n{group}" for what in ("effector", "tip") for group in GROUPS]
    _boxes(errors, sets, labels)
    errors.axhline(PAPER_ERROR, color="black", linestyle="--", label="the paper's mean")
    errors.set_ylim(0.0, 1.1 * max(errors.get_ylim()[1], PAPER_ERROR))
    errors.legend(fontsize=8)
    errors.tick_params(axis="x", labelsize=7)
    errors.set_ylabel("error, rms [mm]")
    return figure


def _boxes(axes: Axes, sets: Sequence[Sequence[float]], labels: Sequence[str]) -> None:
    clean = [[value for value in values if not math.isnan(value)] for values in sets]
    boxed = [values if len(values) >= FEWEST else [] for values in clean]  # points alone of few
    axes.boxplot(boxed, tick_labels=list(labels), widths=0.5, showfliers=False)
    for i, values in enumerate(clean):
        x = i + 1 + np.linspace(-0.12, 0.12, len(values)) * (len(values) > 1)
        axes.plot(x, values, ".", color=list(GROUP_COLOURS.values())[i % 2], alpha=0.7)
    axes.set_ylim(0.0, 1.1 * max((y for values in clean for y in values), default=1.0))
    axes.grid(axis="y", alpha=0.3)


def _of(outcomes: Sequence[Outcome], group: str) -> list[Outcome]:
    return [o for o in outcomes if o.group == group and not o.failure]


def _ball(sphere: Sphere) -> tuple[Array, Array, Array]:
    """Surface points of a sphere [mm], as a grid."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13))
    unit = (np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v))
    x, y, z = (
        1e3 * (c + sphere.radius * part) for c, part in zip(sphere.centre, unit, strict=True)
    )
    return x, y, z


def _title(outcome: Outcome) -> str:
    kind = "participant" if isinstance(outcome.operator, str) else "operator"
    person = f"{kind} {outcome.operator} ({outcome.group})"
    late = ""
    if outcome.behind_share > BEHIND:
        late = f"\nbehind the clock by {100 * outcome.behind_share:.0f} % of the time"
    return f"{person}, {outcome.arm}, {outcome.controller}\n{_given(outcome)}{late}"


def _given(outcome: Outcome) -> str:
    return ", ".join(given_words(given_of([outcome])).values())
