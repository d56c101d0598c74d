"""rcmqp view, snapshot, video and report: runs to look at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from rcmqp.cli import console
from rcmqp.cli.console import err
from rcmqp.cli.options import Files, vector
from rcmqp.errors import OptionError
from rcmqp.files import check_ending
from rcmqp.runs.run import Run

Dark = Annotated[bool, typer.Option("--dark", help="On a dark background, not a white one.")]
CameraOption = Annotated[
    str,
    typer.Option(help="scene: the arm; endoscope: its own image; page: scene, scope and plots."),
]
ArmOption = Annotated[
    str | None,
    typer.Option("--arm", "-a", help="Draw this file of the arm, whose meshes are here."),
]
FlangeOption = Annotated[
    str | None, typer.Option("--flange", help="With a URDF: the frame that carries the scope.")
]
SizeOption = Annotated[
    str | None, typer.Option(metavar="WIDTHxHEIGHT", help="In pixels, such as 1280x800.")
]


def view(
    files: Files,
    page: Annotated[
        Path | None, typer.Option("--html", help="File to write; a temporary one without it.")
    ] = None,
    dark: Dark = False,
    arm: ArmOption = None,
    flange: FlangeOption = None,
    show: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in the browser.")
    ] = True,
) -> None:
    """Show runs as a web page: scene, endoscope, plots, table; several are laid over each other.

    For example,

      rcmqp view helix.h5

      rcmqp view paper.h5 qp.h5 --html comparison.html

    The page is one file, works offline, and can be sent to anyone.
    """
    import shutil
    import tempfile
    import webbrowser

    from rcmqp.show.viewer.build import ENDINGS, write_page

    if page is not None:
        check_ending(page, *ENDINGS)
        if page.resolve() in [file.resolve() for file in files]:
            raise OptionError(f"{page} is one of the runs; give another file with --html")
    runs = _loaded(files, arm, flange)
    if page is not None:
        written = write_page(runs, page, dark=dark)
    else:
        folder = Path(tempfile.mkdtemp(prefix="rcmqp-"))
        try:
            written = write_page(runs, folder / f"{files[0].stem}.html", dark=dark)
        except BaseException:  # Ctrl-C, too
            shutil.rmtree(folder)
            raise
    size = written.stat().st_size / 1e6
    console.print_written(written, f" ({size:.1f} MB)")
    if show and not webbrowser.open(written.resolve().as_uri()):
        err.print("[yellow]warning:[/] no browser here; open the file in one yourself")


def snapshot(
    files: Files,
    file: Annotated[Path, typer.Option("--out", "-o", help="PNG file to write.")],
    time: Annotated[float, typer.Option("--time", "-t", help="On the run's clock, in s.")] = 0.0,
    camera: CameraOption = "scene",
    size: SizeOption = None,
    dark: Dark = False,
    direction: Annotated[
        str | None,
        typer.Option("--from", metavar="X,Y,Z", help="Direction that the scene is seen from."),
    ] = None,
    zoom: Annotated[float, typer.Option(help="2 shows the scene's middle twice as large.")] = 1.0,
    transparent: Annotated[
        bool, typer.Option("--transparent", help="The scene without a background.")
    ] = False,
    arm: ArmOption = None,
    flange: FlangeOption = None,
) -> None:
    """Draw runs at one time into a picture, without a display; needs Chromium and playwright.

    For example,

      rcmqp snapshot helix.h5 --time 5 --out helix.png

      rcmqp snapshot helix.h5 --time 5 --camera endoscope --out inside.png

      rcmqp snapshot helix.h5 --from 1,-1,0.4 --zoom 1.5 --transparent --size 3840x2160 --out a.png
    """
    from rcmqp.show.viewer import capture

    runs = _loaded(files, arm, flange)
    written = capture.snapshot(
        runs,
        file,
        time=time,
        camera=camera,
        size=_size(size),
        dark=dark,
        direction=None if direction is None else vector("from", direction, math.inf),
        zoom=zoom,
        transparent=transparent,
    )
    console.print_written(written)


def video(
    files: Files,
    file: Annotated[Path, typer.Option("--out", "-o", help="MP4 file to write.")],
    camera: CameraOption = "scene",
    speed: Annotated[float, typer.Option(help="2 is twice as fast as the run.")] = 1.0,
    size: SizeOption = None,
    dark: Dark = False,
    arm: ArmOption = None,
    flange: FlangeOption = None,
) -> None:
    """Draw runs into a video, without a display; needs Chromium, playwright and ffmpeg.

    For example,

      rcmqp video helix.h5 --out helix.mp4
    """
    from rcmqp.show.viewer import capture

    runs = _loaded(files, arm, flange)
    with console.bar(quiet=False) as advance:
        written = capture.video(
            runs,
            file,
            camera=camera,
            speed=speed,
            size=_size(size),
            dark=dark,
            progress=lambda done, total: advance(str(file), done, total),
        )
    console.print_written(written)


def _loaded(files: Sequence[Path], arm: str | None, flange: str | None) -> list[Run]:
    """The runs, drawn with another file of their arm if one is given."""
    runs = [Run.load(file) for file in files]
    if arm is None:
        if flange is not None:
            raise OptionError("--flange goes with --arm and a URDF")
        return runs
    return [run.drawn_with(arm, flange) for run in runs]


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, cross, height = text.partition("x")
    if not (cross and width.isdecimal() and height.isdecimal()):
        raise OptionError(f"--size {text}: write WIDTHxHEIGHT in pixels, such as 1280x800")
    return int(width), int(height)


def report(
    files: Files,
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for all files.")] = Path(
        "report"
    ),
) -> None:
    """Put runs into one report: tables, figures, viewers, and how to make it all again.

    For example,

      rcmqp report paper.h5 qp.h5 --out study

    The folder gets index.html, which works offline and from any place the folder is copied to;
    the same as Markdown, CSV and LaTeX (booktabs); figures as PNG and PDF; and for each scenario
    and arm a page to play its runs in and the scenario itself.
    """
    from rcmqp.show.report import write_report  # matplotlib takes long to import

    runs = [Run.load(file) for file in files]
    for path in write_report(runs, folder, files=[file.name for file in files]):
        console.print_written(path)
