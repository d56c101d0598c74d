"""Scenarios x arms x controllers, each run in a process of its own, in one table."""

from __future__ import annotations

import dataclasses
import itertools
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed

from rcmqp.controllers import make_controller
from rcmqp.controllers.settings import controller_of
from rcmqp.errors import OptionError, RunFileError
from rcmqp.files import check_writable, make_folder, unlike, whole
from rcmqp.runs.loading import load_scenario, own_arm
from rcmqp.runs.run import Run
from rcmqp.runs.simulate import simulate
from rcmqp.show.tables import Row, as_csv, as_markdown, row_of
from rcmqp.world.loading import names_its_flange


@dataclass(frozen=True)
class Case:
    """One run to make.

    Attributes:
        scenario: name.
        controller: its setting, NAME or NAME:OPTION=VALUE,OPTION=VALUE.
        arm: name; None for the scenario's own.
        changes: fields of the scenario to be other than it has them.
        flange: where the arm is a URDF, the frame that carries the instrument.
    """

    scenario: str
    arm: str | None
    controller: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    flange: str | None = None


def cases(
    scenarios: Sequence[str],
    arms: Sequence[str | None],
    controllers: Sequence[str],
    changes: Mapping[str, Any] | None = None,
    flange: str | None = None,
) -> list[Case]:
    """Every combination, scenarios first; see Case.

    Args:
        scenarios: names.
        arms: names, or paths of URDFs; None for the scenario's own.
        controllers: settings, NAME or NAME:OPTION=VALUE,OPTION=VALUE.
        changes: fields of every scenario.
        flange: for the arms that are URDFs.
    """
    return [
        Case(
            scenario,
            arm,
            setting,
            changes or {},
            None if arm is None or names_its_flange(arm) else flange,
        )
        for scenario, arm, setting in itertools.product(scenarios, arms, controllers)
    ]


def compare(
    todo: Sequence[Case],
    out: str | os.PathLike[str],
    *,
    jobs: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[Row]:
    """Run every case and write the runs, comparison.csv and comparison.md into a folder.

    The rows come in the order of the cases, and but for times they are the same whatever the
    number of jobs, the names of the files too: where a name would come twice, the second is
    numbered. A case that cannot be run is a row that says why, unless none can.

    Args:
        todo: what to run.
        out: folder, made if it is not there.
        jobs: how many processes; joblib's n_jobs, so -1 is one for each core, and a backend
            chosen with joblib.parallel_config() is used.
        progress: called with 1 after each case.

    Raises:
        RunFileError: the folder or a file in it cannot be written.
        OptionError: no case could be run; tables that are there stay as they were.
    """
    folder = make_folder(out).resolve()  # workers may be elsewhere
    check_writable(folder / "comparison.csv")
    stems, files = _names(todo)
    rows = []
    parallel = Parallel(n_jobs=jobs, return_as="generator", batch_size=1)
    work = (delayed(run_case)(case, folder / file) for case, file in zip(todo, files, strict=True))
    for row in parallel(work):
        rows.append(row)
        if progress is not None:
            progress(1)
    if rows and all(row.failure for row in rows):
        more = f" (nor could the {len(rows) - 1} others)" if len(rows) > 1 else ""
        first = f"{todo[0].scenario} with {todo[0].controller}"
        raise OptionError(f"{first} could not be run{more}: {rows[0].failure}")
    for name, text in (
        ("comparison.csv", as_csv(rows)),
        ("comparison.md", f"# Comparison\n\n{as_markdown(rows)}"),
    ):
        with whole(folder / name) as part:
            part.write_text(text, encoding="utf-8")
    figures: dict[str, list[str]] = {}
    for stem, row in zip(stems, rows, strict=True):
        if row.file:
            figures.setdefault(stem, []).append(row.file)
    for problem in parallel(delayed(_draw)(folder, *figure) for figure in figures.items()):
        if problem is not None:
            raise RunFileError(Path(problem[0]), problem[1])
    return rows


def run_case(case: Case, file: Path) -> Row:
    """Run one case and save the run."""
    try:
        scenario = load_scenario(case.scenario, case.arm, flange=case.flange, **case.changes)
        insertion = scenario.insertion()
        name, options = controller_of(case.controller)
        controller = make_controller(name, insertion, scenario.period, **options)
        run = simulate(scenario, controller)
        run.save(file)
        return dataclasses.replace(row_of(run), setting=case.controller, file=file.name)
    except Exception as error:  # noqa: BLE001  (the other cases go on, and the row has it)
        failure = f"{type(error).__name__}: {error}"
        name = case.controller.partition(":")[0].replace("-", "_")
        return Row(case.scenario, case.arm or "", name, case.controller, failure=failure)


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
        law = case.controller.partition(":")[0].replace("-", "_")
        name = f"{stems[-1]}_{law}"
        files.append(unlike(files, name, ".h5"))
    return stems, files


def _stem(case: Case) -> str:
    """Scenario and arm of a case."""
    try:
        arm = case.arm or own_arm(case.scenario)
    except Exception:  # noqa: BLE001  (nor can it be run, which is said then)
        arm = "none"
    return f"{Path(case.scenario).stem.replace('-', '_')}_{Path(arm).stem}"


def _draw(folder: Path, stem: str, files: Sequence[str]) -> tuple[str, str] | None:
    """The errors of all controllers over the same time axis; or (file, reason) why not."""
    from rcmqp.show import plots  # matplotlib takes long to import

    try:
        runs = [Run.load(folder / file) for file in files]
        plots.save_figure(plots.error_figure(runs, logarithmic=True), folder / stem)
    except RunFileError as error:
        return str(error.path), error.reason
    return None
