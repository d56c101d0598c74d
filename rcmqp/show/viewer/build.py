"""One web page of recorded runs, whole in one file: scene, endoscope, plots, table."""

from __future__ import annotations

import dataclasses
import functools
import html
import importlib.resources
import importlib.util
import os
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

import rcmqp
from rcmqp.errors import RcmqpError, ViewError
from rcmqp.files import check_ending, check_writable, whole_file
from rcmqp.runs.run import Run
from rcmqp.runs.scenario import Scenario
from rcmqp.show.labels import colour, dash, run_labels, versions_text
from rcmqp.show.table import definitions_html
from rcmqp.show.tables import metrics_meanings, metrics_table
from rcmqp.show.viewer.bundle import Bundle, bundled, compressed
from rcmqp.show.viewer.timeline import curves, frames, stopped
from rcmqp.world.insertion import Insertion
from rcmqp.world.loading import arm_title

MAY_DIFFER = ("period", "seed")
"""Fields of a scenario that may differ between runs of one page."""

ENDINGS = (".html", ".htm")
"""What the name of a page's file may end in."""


def page(runs: Sequence[Run], *, dark: bool = False) -> str:
    """A web page of runs of one scenario, laid over each other; it needs no other file.

    Args:
        runs: at least one; arm, trocar, path and all else but period and seed are the same.
        dark: whether the background is dark at first; there is a button for it.

    Raises:
        ViewError: no run, runs of several scenarios, or an arm that this machine does not have.
    """
    insertion = check_runs(runs)
    title = f"{runs[0].scenario.name} on {arm_title(runs[0].scenario.arm)}"
    labels = run_labels(runs)
    marks = [f'<i class="run {dash(i)}" style="color:{colour(i)}"></i>' for i in range(len(runs))]
    body = Template(asset("page.html")).substitute(
        title=html.escape(title),
        subtitle=html.escape(", ".join(dict.fromkeys(run.controller for run in runs))),
        table=metrics_table(runs, labels).html(marks) + definitions_html(metrics_meanings()),
        versions=html.escape(versions_text(runs)),
        version=html.escape(rcmqp.__version__),
        meshcat=library("meshcat", "viewer/dist/main.min.js"),
        plotly=library("plotly", "package_data/plotly.min.js"),
        data=page_data(runs, labels, insertion),
        script=bundled("player.js", asset),
    )
    return framed(title, asset("page.css"), body, dark=dark)


def framed(title: str, style: str, body: str, *, dark: bool = False) -> str:
    """A whole HTML file in the common look, of a title, more CSS, and what its body holds."""
    return Template(asset("frame.html")).substitute(
        title=html.escape(title),
        theme="dark" if dark else "light",
        style=asset("look.css") + style,
        version=html.escape(rcmqp.__version__),
        body=body,
    )


def write_page(runs: Sequence[Run], path: str | os.PathLike[str], *, dark: bool = False) -> Path:
    """Write page() to a file, and return its path.

    Raises:
        OptionError: the file's name does not end in one of ENDINGS.
        ViewError: see page().
        RunFileError: the file cannot be written.
    """
    check_ending(path, *ENDINGS)
    check_writable(path)
    text = page(runs, dark=dark)
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")
    return Path(path)


def check_runs(runs: Sequence[Run]) -> Insertion:
    """Check that runs can be laid over each other; the arm with its instrument in the trocar.

    Raises:
        ViewError: they cannot; the message says which field of the scenario differs.
    """
    if not runs:
        raise ViewError("no run to show; give at least one")
    first = runs[0].scenario
    for run in runs[1:]:
        for name in differences(first, run.scenario):
            here, there = getattr(first, name), getattr(run.scenario, name)
            raise ViewError(
                f"{run.title} cannot be laid over {runs[0].title}: {name} is {there!r:.200} "
                f"there and {here!r:.200} here; only {' and '.join(MAY_DIFFER)} may differ. Show "
                "runs of other scenarios in pages of their own"
            )
    for run in runs:
        for name in ("tip", "tip_d", "tip_error", "rcm_error"):
            if not np.isfinite(run.column(name)[:]).any():
                raise ViewError(f"{run.title} cannot be drawn: no row of {name} is a number")
        try:
            insertion = run.insertion()
        except RcmqpError as error:
            raise ViewError(
                f"{run.title} cannot be drawn here, its arm {first.arm!r} is not the one that "
                f"it was made with, or not on this machine: {error}"
            ) from error
    return insertion


def differences(first: Scenario, other: Scenario) -> list[str]:
    """Fields that keep runs of two scenarios from being laid over each other."""
    names = [field.name for field in dataclasses.fields(first) if field.name not in MAY_DIFFER]
    different = [name for name in names if getattr(first, name) != getattr(other, name)]
    if first.carried_arm is None or other.carried_arm is None:  # a file of an earlier version
        return [name for name in different if name != "carried_arm"]
    return different


def grouped(runs: Sequence[Run]) -> list[list[Run]]:
    """Runs that can be laid over each other, together; in the order of the first of each."""
    groups: list[list[Run]] = []
    for run in runs:
        for group in groups:
            if not differences(group[0].scenario, run.scenario):
                group.append(run)
                break
        else:
            groups.append([run])
    return groups


def page_data(
    runs: Sequence[Run], labels: Sequence[str], insertion: Insertion, *, deepest: float = 0.0
) -> str:
    """The data that readRecording() in recording.js reads: scene, arm and runs.

    Args:
        runs: of one scenario.
        labels: one for each run.
        insertion: of the scenario.
        deepest: the least depth that the ground lies beyond [m].
    """
    import pinocchio as pin

    from rcmqp.show.viewer.scene import commands, kinematics, surroundings  # meshcat takes long

    bundle = Bundle()
    flange = insertion.arm.with_effector(pin.SE3.Identity())
    packed, parts = commands(insertion.arm)
    scene = surroundings(runs[0], insertion)
    scene["deepest"] = max(deepest, *(surroundings(run, insertion)["deepest"] for run in runs))
    header: dict[str, Any] = {
        "scene": scene,
        "arm": kinematics(flange, insertion.q_start)
        | {"commands": [bundle.chunk(command) for command in packed], "parts": parts},
        "runs": [
            {
                "label": label,
                "colour": colour(i),
                "dash": dash(i),
                "frames": {name: bundle.floats(array) for name, array in frames(run).items()},
                "curves": {
                    name: [bundle.floats(array) for array in curve]
                    for name, curve in curves(run).items()
                },
                "stops": stopped(run).tolist(),
            }
            for i, (run, label) in enumerate(zip(runs, labels, strict=True))
        ],
    }
    return bundle.text(header)


@functools.cache
def library(package: str, inside: str) -> str:
    """A script out of an installed package, which is not imported; compressed."""
    spec = importlib.util.find_spec(package)
    assert spec is not None
    assert spec.origin is not None
    return compressed((Path(spec.origin).parent / inside).read_bytes())


def asset(name: str) -> str:
    """Text of a file out of show/viewer/assets."""
    return (importlib.resources.files("rcmqp.show.viewer") / "assets" / name).read_text("utf-8")
