"""Running a study: in parallel, each trial to a file of its own, to be continued at any time."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from rcmqp.errors import RcmqpError, RunFileError
from rcmqp.run import make_folder
from rcmqp.simulate import simulate, versions
from rcmqp.study.outcome import Outcome, outcome_of
from rcmqp.study.plan import Study, Trial
from rcmqp.study.record import SUFFIX, Record, sweep

RUNS = "runs"
"""Folder of the trials' files, in the study's."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Performed:
    """A study that is done.

    Attributes:
        study: what it was.
        folder: its files.
        outcomes: of its trials, in their order.
        notes: what was found on the way: files that were made again, and such.
    """

    study: Study
    folder: Path
    outcomes: Sequence[Outcome]
    notes: Sequence[str] = field(default=())

    def record(self, index: int) -> Record:
        """What is kept of the trial with that index."""
        return Record.load(trial_file(self.folder, self.study.trials()[index]))


def trial_file(folder: Path, trial: Trial) -> Path:
    """Where a trial is kept."""
    return folder / RUNS / f"{trial.stem}{SUFFIX}"


def perform(
    study: Study,
    out: str | os.PathLike[str],
    *,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Performed:
    """Run every trial that is not in the folder yet, and read all of them.

    Whoever runs a trial writes its file, at once or not at all: a study that is killed goes on
    where it was when it is started again, and what comes of it is the same. Files that are
    damaged are made again. The outcomes do not depend on the number of jobs.

    Args:
        study: what to run.
        out: folder, made if it is not there; on a cluster, one that every worker sees.
        jobs: how many processes; joblib's n_jobs, so -1 is one for each core. A backend chosen
            with joblib.parallel_config(), such as Dask's, is used.
        progress: called with a title, how many trials were done since the last call, and in all.

    Raises:
        RunFileError: a file cannot be written, or belongs to another study.
        RcmqpError: scenario, arm or controller cannot be made.
    """
    folder = make_folder(out)
    runs = make_folder(folder / RUNS)
    trials = study.trials()
    notes = []
    if swept := sweep(runs):
        notes.append(f"removed {swept} unfinished files of a study that was stopped")
    todo = []
    for trial in trials:
        if note := _missing(trial, folder):
            todo.append(trial)
            notes.extend(note if note != [""] else [])
    for first in {(trial.arm, trial.law): trial for trial in reversed(trials)}.values():
        first.controller(first.made())  # what cannot be made at all is found before the work
    report = progress or (lambda title, done, total: None)
    report("trials", len(trials) - len(todo), len(trials))
    work = Parallel(n_jobs=jobs, return_as="generator_unordered", pre_dispatch="2*n_jobs")(
        delayed(run_trial)(trial, folder) for trial in todo
    )
    for problem in work:
        if problem is not None:
            done = len(list(runs.glob(f"*{SUFFIX}")))
            raise RunFileError(
                Path(problem[0]),
                f"{problem[1]}; {done} of {len(trials)} trials are kept: make room and run the "
                "study again, it goes on from there",
            )
        report("trials", 1, len(trials))
    records = [Record.load(trial_file(folder, trial)) for trial in trials]
    notes += _other_versions(records)
    return Performed(study, folder, [record.outcome for record in records], notes)


def run_trial(trial: Trial, folder: Path) -> tuple[str, str] | None:
    """Run one trial and write its file.

    A controller that fails is an outcome, with its reason; what cannot be written is answered
    as (file, reason), which, unlike an exception of ours, gets home from any process.
    """
    scenario = trial.made()
    try:
        outcome, traces = outcome_of(trial, simulate(scenario, trial.controller(scenario)))
    except (RcmqpError, np.linalg.LinAlgError) as error:
        group = trial.made().path.operator.group  # type: ignore[union-attr]
        outcome = Outcome(
            trial.operator,
            group,
            scenario.arm,
            str(trial.law),
            scenario.period,
            failure=str(error),
        )
        traces = {}
    try:
        Record(outcome, scenario.to_json(), traces).save(trial_file(folder, trial))
    except RunFileError as error:
        return str(error.path), error.reason
    return None


def _other_versions(records: Sequence[Record]) -> list[str]:
    """What there is to say of trials that other versions of rcmqp or its packages ran."""
    now = versions()
    other = [record.versions for record in records if record.versions != now]
    if not other:
        return []
    names = sorted({name for found in other for name in now if found.get(name) != now[name]})
    told = ", ".join(f"{name} {other[0].get(name, 'unknown')} (now {now[name]})" for name in names)
    return [
        f"{len(other)} of {len(records)} trials were run by other versions, the first by {told}; "
        "to compare like with like, run the study in another folder"
    ]


def _missing(trial: Trial, folder: Path) -> list[str]:
    """Why a trial has to be run, [""] if it never was; empty if its file is good.

    Raises:
        RunFileError: the file is another trial's.
    """
    file, scenario = trial_file(folder, trial), trial.made().to_json()
    if not file.exists():
        return [""]
    try:
        record = Record.load(file)
    except RunFileError as error:
        return [f"{error}; it is made again"]
    if record.scenario != scenario:
        raise RunFileError(
            file,
            "is of another study: other seed, scenario or operators; give another folder, or "
            "remove this one",
        )
    return []
