"""Whole control cycles of rcmqp and of its peers, in turns on one core; see README.md here."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer
from environments import PEERS
from results import Report, machine
from session import COLD, measure
from tables import about, promises, table


def main(
    cycles: Annotated[int, typer.Option(min=2 * COLD, help="How many to run of each.")] = 5000,
    block: Annotated[int, typer.Option(min=2 * COLD, help="How many to run in a turn.")] = 250,
    peers: Annotated[
        str, typer.Option(help=f"all, none, or names with commas: {','.join(PEERS)}")
    ] = "all",
    cases: Annotated[
        str, typer.Option(help="Only cases in whose name this regular expression is found.")
    ] = "",
    core: Annotated[
        int, typer.Option(help="Core to run on; without it, the last that may be used.")
    ] = -1,
    envs: Annotated[Path, typer.Option(help="Folder for the peers' environments.")] = Path(
        "~/.cache/rcmqp-benchmarks"
    ),
    save: Annotated[Path | None, typer.Option(help="JSON file to write.")] = None,
    compare: Annotated[Path | None, typer.Option(help="An earlier one to compare with.")] = None,
    show: Annotated[Path | None, typer.Option(help="Run nothing; show this file.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Figure to draw: .png, .pdf or .svg.")] = None,
) -> None:
    """Time whole cycles (reference, kinematics, control, integration) and print tables."""
    earlier = None if compare is None else Report.load(compare)
    if show is None:
        report = _run(_packages(peers), cases, envs, cycles, block, core)
    else:
        report = Report.load(show)
    if save is not None:
        report.save(save)
    typer.echo("\n".join([f"{about(report)}\n", table(report, earlier, cases), promises(report)]))
    if plot is not None:
        from plots import draw  # matplotlib takes long to import

        draw(report, plot)


def _packages(peers: str) -> list[str]:
    chosen = {"all": list(PEERS), "none": []}.get(peers, peers.split(","))
    if unknown := sorted(set(chosen) - set(PEERS)):
        raise typer.BadParameter(f"--peers: {unknown}; known are {list(PEERS)}, all and none")
    return ["rcmqp", *chosen]


def _run(
    packages: list[str], cases: str, envs: Path, cycles: int, block: int, core: int
) -> Report:
    if core < 0:
        core = max(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 0
    before = machine()
    results = measure(packages, cases, envs.expanduser(), cycles=cycles, block=block, core=core)
    settings = {
        "cycles": cycles,
        "cycles a turn": block,
        "not counted at a turn's start": COLD,
        "core": core,
    }
    return Report(
        before | {"load after": machine()["load"]},
        {key: str(value) for key, value in settings.items()},
        results,
    )


if __name__ == "__main__":
    typer.run(main)
