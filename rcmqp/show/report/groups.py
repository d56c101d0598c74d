"""Runs of a report, sorted into those that one viewer shows."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rcmqp.files import unlike
from rcmqp.runs.run import Run
from rcmqp.show.labels import run_labels
from rcmqp.show.viewer.build import grouped
from rcmqp.world.loading import arm_title


@dataclass(frozen=True)
class Group:
    """Runs of one scenario on one arm.

    Attributes:
        title: of scenario and arm.
        stem: of the group's files.
        runs: at least one.
        files: name of each run's file.
    """

    title: str
    stem: str
    runs: Sequence[Run]
    files: Sequence[str]

    @property
    def viewer(self) -> str:
        """Name of the viewer's file."""
        return f"view_{self.stem}.html"

    @property
    def scenario(self) -> str:
        """Name of the file that holds the scenario."""
        return f"scenario_{self.stem}.json"

    @property
    def labels(self) -> list[str]:
        """What tells the runs apart."""
        return run_labels(self.runs)


def groups_of(runs: Sequence[Run], files: Sequence[str]) -> list[Group]:
    """Sort runs into groups; no two groups, and no two files, have the same name."""
    names = {id(run): name for run, name in zip(runs, _unique(files, ".h5"), strict=True)}
    found = grouped(runs)
    scenarios = [group[0].scenario for group in found]
    titles = _unique(f"{each.name} on {arm_title(each.arm)}" for each in scenarios)
    stems = _unique(
        re.sub(r"[^\w.-]+", "_", f"{each.name}_{Path(each.arm).stem}") for each in scenarios
    )
    return [
        Group(title, stem, group, [names[id(run)] for run in group])
        for title, stem, group in zip(titles, stems, found, strict=True)
    ]


def _unique(names: Iterable[str], ending: str = "") -> list[str]:
    """The names; one that was there before gets a number, before a file's ending."""
    found: list[str] = []
    for name in names:
        known = ending if name.endswith(ending) else ""
        found.append(unlike(found, name.removesuffix(known), known))
    return found
