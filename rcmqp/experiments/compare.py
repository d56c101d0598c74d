"""Scenarios x arms x controllers, each run in a process of its own, in one table."""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rcmqp.controllers import CONTROLLERS, Controller, make_controller
from rcmqp.controllers.settings import controller_of
from rcmqp.errors import OptionError, PluginError, RunFileError
from rcmqp.experiments.batch import batch, check_jobs, date, kept_run
from rcmqp.files import check_writable, make_folder, unlike, whole_file
from rcmqp.runs.head import check_own
from rcmqp.runs.loading import changed, load_scenario, own_arm
from rcmqp.runs.run import Run
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.simulate import simulate
from rcmqp.show.tables import Row, as_csv, as_latex, as_markdown, columns_explained, row_of
from rcmqp.world.loading import URDF_ENDINGS, names_its_flange

PAUSE = 1.0
"""Least time between two writings of unfinished tables [s]."""


@dataclass(frozen=True)
class Case:
    """One run to make.

    Attributes:
        scenario: its name or file; or a Scenario, which has its arm already.
        controller: its setting, NAME or NAME:OPTION=VALUE,OPTION=VALUE.
        arm: name, or the path of a URDF; None for the scenario's own.
        changes: fields of the scenario to be other than it has them.
        flange: where the arm is a URDF, the frame that carries the instrument.
    """

    scenario: str | Scenario
    arm: str | None
    controller: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    flange: str | None = None

    @property
    def law(self) -> str:
        """Name of the controller."""
        return self.controller.partition(":")[0].replace("-", "_")

    @property
    def name(self) -> str:
        """Name or file of the scenario."""
        return self.scenario if isinstance(self.scenario, str) else self.scenario.name

    def made(self) -> Scenario:
        """The scenario, with its changes.

        Raises:
            OptionError: a Scenario is to be run on another arm, or a value is not allowed.
            RcmqpError: there is no such scenario, arm or field.
        """
        if isinstance(self.scenario, str):
            return load_scenario(self.scenario, self.arm, flange=self.flange, **self.changes)
        if self.arm is not None:
            raise OptionError(
                f"arm = {self.arm}: the Scenario {self.name} has its arm, {self.scenario.arm}, "
                "already; give None, or the scenario by name"
            )
        return changed(self.scenario, **self.changes)


def cases(
    scenarios: Sequence[str | Scenario],
    arms: Sequence[str | None],
    controllers: Sequence[str],
    changes: Mapping[str, Any] | None = None,
    flange: str | None = None,
) -> list[Case]:
    """Every combination, scenarios first; see Case.

    Args:
        scenarios: names, files or Scenario objects.
        arms: names, or paths of URDFs, each with its flange behind a colon or without it; None
            for the scenario's own.
        controllers: settings, NAME or NAME:OPTION=VALUE,OPTION=VALUE.
        changes: fields of every scenario.
        flange: for the arms that are URDFs and do not say theirs.
    """
    mounted = [arm_and_flange(arm, flange) for arm in arms]
    return [
        Case(scenario, arm, setting, changes or {}, own)
        for scenario, (arm, own), setting in itertools.product(scenarios, mounted, controllers)
    ]


def arm_and_flange(arm: str | None, flange: str | None = None) -> tuple[str | None, str | None]:
    """An arm and its flange out of NAME, FILE, or a URDF's FILE with a colon and FLANGE behind it.

    Args:
        arm: the text; None for the scenario's own arm, which has no flange of a URDF.
        flange: of a URDF that does not say its own.
    """
    if arm is None or names_its_flange(arm):
        return arm, None
    file, _, own = arm.rpartition(":")
    if file.lower().endswith(URDF_ENDINGS) and not Path(arm).is_file():
        return file, own
    return arm, flange


def compare(
    todo: Sequence[Case],
    out: str | os.PathLike[str],
    *,
    jobs: int = 1,
    progress: Callable[[int], None] | None = None,
    note: Callable[[str], None] | None = None,
) -> list[Row]:
    """Run every case, and write the runs and comparison.csv, .md and .tex into a folder.

    The rows come in the order of the cases, and but for times they are the same whatever the
    number of jobs, the names of the files too: where a name would come twice, the second is
    numbered. A case that cannot be run is a row that says why, unless none can.

    The tables are written as the rows come. A comparison that is stopped goes on where it was when
    it is started again: runs that are in the folder already are kept, see kept_run(). A run of
    another comparison is not written over.

    Args:
        todo: what to run.
        out: folder, made if it is not there; on a cluster, one that every worker sees.
        jobs: how many processes, see batch().
        progress: called with 1 after each case.
        note: called with a sentence if runs were kept.

    Raises:
        RunFileError: the folder or a file in it cannot be written, or a file holds another run.
        OptionError: no case could be run; tables that are there stay as they were.
    """
    check_jobs(jobs)
    folder = make_folder(out).resolve()  # workers may be elsewhere
    check_writable(folder / "comparison.csv")
    stems, files = _names(todo)
    for case, file in zip(todo, files, strict=True):
        _check_own(case, folder / file)
    found: dict[int, Row] = {}
    kept, written = 0, -math.inf
    work = [(case, folder / file, _kind(case.law)) for case, file in zip(todo, files, strict=True)]
    for number, (row, was_kept) in batch(run_case, work, jobs=jobs):
        found[number] = row
        kept += was_kept
        if progress is not None:
            progress(1)
        made = any(not each.failure for each in found.values())
        if made and len(found) < len(todo) and time.monotonic() - written >= PAUSE:
            _write(folder, [found[i] for i in sorted(found)], len(todo))
            written = time.monotonic()
    rows = [found[i] for i in range(len(todo))]
    if rows and all(row.failure for row in rows):
        more = f" (nor could the {len(rows) - 1} others)" if len(rows) > 1 else ""
        first = f"{todo[0].name} with {todo[0].controller}"
        raise OptionError(f"{first} could not be run{more}: {rows[0].failure}")
    _write(folder, rows, len(todo))
    if kept and note is not None:
        note(
            f"{kept} of {len(rows)} runs were in {folder} already and are kept; to run them "
            "again, give another folder or remove them"
        )
    figures: dict[str, list[str]] = {}
    for stem, row in zip(stems, rows, strict=True):
        if row.file:
            figures.setdefault(stem, []).append(row.file)
    drawn = [(folder, *figure) for figure in figures.items()]
    for _, problem in batch(_draw, drawn, jobs=jobs):
        if problem is not None:
            raise RunFileError(Path(problem[0]), problem[1])
    return rows


def run_case(case: Case, file: Path, kind: type[Controller] | None = None) -> tuple[Row, bool]:
    """Run one case and save the run; or take the run that is in the file already.

    Args:
        case: what to run.
        file: of the run.
        kind: the case's controller; it comes along because another process knows those of rcmqp
            only.

    Returns:
        The row; and whether the run was kept.
    """
    if kind is not None:
        CONTROLLERS[case.law] = kind
    try:
        scenario, controller = _made(case)
        kept = kept_run(file, scenario, controller)
        run = kept or simulate(scenario, controller)
        if kept is None:
            run.save(file)
            date(file)
        row = dataclasses.replace(row_of(run), setting=case.controller, file=file.name)
        return row, kept is not None
    except Exception as error:  # noqa: BLE001  (the other cases go on, and the row has it)
        failure = f"{type(error).__name__}: {error}"
        row = Row(case.name, _arm(case), case.law, case.controller, failure=failure)
        return row, False


def _made(case: Case) -> tuple[Scenario, Controller]:
    scenario = case.made()
    name, options = controller_of(case.controller)
    return scenario, make_controller(name, scenario.insertion(), scenario.period, **options)


def _check_own(case: Case, file: Path) -> None:
    """Check that a case's file is its own; one that cannot be made writes none.

    Raises:
        RunFileError: it holds another run.
    """
    if not file.exists():
        return
    try:
        scenario, controller = _made(case)
    except Exception:  # noqa: BLE001  (which run_case() says)
        return
    check_own(file, scenario, controller)


def _kind(law: str) -> type[Controller] | None:
    """The class of a controller; None if it cannot be used, which run_case() reports."""
    try:
        return CONTROLLERS.get(law)
    except PluginError:
        return None


def _write(folder: Path, rows: Sequence[Row], count: int) -> None:
    """Write the tables of the rows that are there, of ``count`` cases."""
    done = "" if len(rows) == count else f"Unfinished: {len(rows)} of {count} cases.\n\n"
    explained = f"## What the columns mean\n\n{columns_explained()}"
    for name, text in (
        ("comparison.csv", as_csv(rows)),
        ("comparison.tex", as_latex(rows)),
        ("comparison.md", f"# Comparison\n\n{done}{as_markdown(rows)}\n{explained}"),
    ):
        with whole_file(folder / name) as part:
            part.write_text(text, encoding="utf-8")


def _names(todo: Iterable[Case]) -> tuple[list[str], list[str]]:
    """For each case the name of its figure, and that of its run's file; no file's comes twice.

    Cases that differ in nothing but the controller and its options share a figure.
    """
    figures: dict[str, str] = {}
    stems, files = list[str](), list[str]()
    for case in todo:
        key = repr((case.scenario, case.arm, case.flange, sorted(case.changes.items())))
        if key not in figures:
            figures[key] = unlike(figures.values(), _stem(case))
        stems.append(figures[key])
        files.append(unlike(files, f"{stems[-1]}_{case.law}", ".h5"))
    return stems, files


def _stem(case: Case) -> str:
    """Scenario and arm of a case."""
    return f"{Path(case.name).stem.replace('-', '_')}_{Path(_arm(case) or 'none').stem}"


def _arm(case: Case) -> str:
    """Arm of a case; empty if its scenario cannot be loaded, which run_case() says then."""
    if case.arm is not None:
        return case.arm
    try:
        own = case.scenario
        return own_arm(own) if isinstance(own, str) else own.arm
    except Exception:  # noqa: BLE001
        return ""


def _draw(folder: Path, stem: str, files: Sequence[str]) -> tuple[str, str] | None:
    """The errors of all controllers over the same time axis; or (file, reason) why not."""
    from rcmqp.show import plots  # matplotlib takes long to import

    try:
        runs = [Run.load(folder / file) for file in files]
        plots.save_figure(plots.error_figure(runs, logarithmic=True), folder / stem)
    except RunFileError as error:
        return str(error.path), error.reason
    return None
