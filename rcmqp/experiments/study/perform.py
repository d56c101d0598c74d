"""Running a study: in parallel, each trial to a file of its own, to be continued at any time."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import json
import os
import uuid
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rcmqp.controllers import CONTROLLERS, Controller
from rcmqp.errors import OptionError, RcmqpError, RunFileError
from rcmqp.experiments.batch import Progress, batch, check_jobs, classes_outside
from rcmqp.experiments.study.outcome import Outcome, failed_outcome, outcome_of
from rcmqp.experiments.study.plan import Law, Study, Trial
from rcmqp.experiments.study.trial_file import SUFFIX, TrialFile
from rcmqp.files import check_writable, make_folder, sweep
from rcmqp.references.operators import camera_trial
from rcmqp.runs.run import Run
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.simulate import simulate, versions
from rcmqp.world.carried import CarriedArm
from rcmqp.world.plugins import distributions_of


def identity(controller: Controller, scenario: Scenario) -> str:
    """SHA-256 over the URDF, the options as they are, and all code that is not rcmqp's own.

    Of controller, path, motion and plant that are not rcmqp's the code is known by the files that
    hold their classes, and a plug-in's by the version of its distribution too; rcmqp itself is
    known by its version. After a change of another file that they import, give the study another
    folder. A class that is in no file, such as one of a notebook, is never the same.
    """
    sha = hashlib.sha256(controller.insertion.arm.sha256.encode())
    sha.update(json.dumps(controller.options, sort_keys=True, default=str).encode())
    for kind in classes_outside(controller, scenario):
        sha.update(" ".join(distributions_of(kind)).encode())
        sha.update(_file_of(kind))
    return sha.hexdigest()


def _file_of(kind: type) -> bytes:
    """The content of the file that holds a class; new random bytes if it is in no file."""
    try:
        return Path(inspect.getfile(kind)).read_bytes()
    except (OSError, TypeError):
        return uuid.uuid4().bytes


RUNS = "runs"
"""Folder of the trials' files, in the study's."""


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

    def record(self, index: int) -> TrialFile:
        """What is kept of the trial with that index."""
        return TrialFile.load(trial_file(self.folder, self.study.trials()[index]))


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

    The process that runs a trial writes its file, whole or not at all. A study that is killed goes
    on when it is started again, with the same results. Files that are
    damaged, trials that failed, and those of a controller or URDF that has changed since, see
    identity(), are made again. The outcomes do not depend on the number of jobs.

    Args:
        study: what to run.
        out: folder, made if it is not there; on a cluster, one that every worker sees.
        jobs: how many processes, see batch().
        progress: called with a title, how many trials were done since the last call, and in all.

    Raises:
        RunFileError: a file cannot be written, or belongs to another study.
        OptionError: an arm is there twice, or ``jobs`` is 0.
        RcmqpError: scenario, arm or controller cannot be made.
    """
    check_jobs(jobs)
    folder = make_folder(out).resolve()  # workers may be elsewhere
    runs = make_folder(folder / RUNS)
    check_writable(runs / f"a_trial{SUFFIX}")
    trials = study.trials()
    notes = []
    if swept := sweep(runs):
        notes.append(f"removed {swept} unfinished files of a study that was stopped")
    made_of = _check_makeable(study)
    todo = {}
    for trial in trials:
        whose = made_of[trial.arm, trial.law]
        reason = _missing(trial, folder, whose)
        if reason is not None:
            todo[trial] = reason
    told = Counter(reason for reason in todo.values() if reason)
    notes += [f"{reason}; {count} trials are made again" for reason, count in told.items()]
    report = progress or (lambda title, done, total: None)
    report("trials", len(trials) - len(todo), len(trials))
    work = [
        (trial, folder, CONTROLLERS[trial.law.name], made_of[trial.arm, trial.law])
        for trial in todo
    ]
    try:
        for _ in batch(run_trial, work, jobs=jobs):
            report("trials", 1, len(trials))
    except RunFileError as error:
        done = sum(trial_file(folder, trial).is_file() for trial in trials)
        raise RunFileError(
            error.path,
            f"{error.reason}; {done} of {len(trials)} trials are kept: once there is room and "
            "leave to write, run the study again, it goes on from there",
        ) from error
    kept = [_kept(trial, folder) for trial in trials]
    outcomes = [outcome for outcome, _ in kept]
    notes += _other_versions([of for _, of in kept])
    if failed := [o for o in outcomes if o.failure]:
        first = failed[0]
        notes.append(
            f"{len(failed)} of {len(outcomes)} trials failed, the first, operator "
            f"{first.operator}, {first.arm}, {first.controller}: {first.failure}; the same "
            "command runs them again"
        )
    return Performed(study, folder, outcomes, notes)


def run_trial(trial: Trial, folder: Path, kind: type[Controller], made_of: str) -> None:
    """Run one trial and write its file.

    A controller that fails is an outcome, with its reason.

    Args:
        trial: what to run.
        folder: of the study.
        kind: the trial's controller; it comes along because another process knows those of
            rcmqp only.
        made_of: the trial's identity().

    Raises:
        RunFileError: the file cannot be written.
        RcmqpError: scenario or controller cannot be made.
    """
    CONTROLLERS[trial.law.name] = kind
    scenario = trial.made()
    controller = trial.law.controller(scenario)
    try:
        outcome, traces = outcome_of(trial, simulate(scenario, controller))
    except (RcmqpError, np.linalg.LinAlgError) as error:
        outcome, traces = failed_outcome(trial, scenario, str(error)), {}
    carried = CarriedArm.of(controller.insertion.arm)
    said = dataclasses.replace(scenario.portable(), carried_arm=carried).to_json(carry=True)
    record = TrialFile(outcome, said, trial.law.to_json(), made_of, traces)
    record.save(trial_file(folder, trial))


def remake(file: str | os.PathLike[str]) -> Run:
    """The whole run of a trial, of which a study keeps the numbers only: simulated again.

    Args:
        file: of the trial.

    Raises:
        RunFileError: the file is missing, damaged or no trial's.
        RcmqpError: arm or controller cannot be made here.
    """
    record = TrialFile.load(Path(file))
    scenario = Scenario.from_json(record.scenario)
    return simulate(scenario, Law.from_json(record.law).controller(scenario))


def _check_makeable(study: Study) -> dict[tuple[str, Law], str]:
    """Find before the work what cannot be made at all, or would be counted twice.

    Returns:
        The identity() of each arm's and law's controller.

    Raises:
        OptionError: two arms are the same one, or two trials would share a file.
        RcmqpError: scenario, arm or controller cannot be made.
    """
    firsts = [trial for trial in study.trials() if trial.operator == 0]
    arms, made_of = [], {}
    for trial in firsts:
        scenario = trial.made()
        controller = trial.law.controller(scenario)
        camera_trial(scenario.path, scenario.name).start(
            controller.insertion, scenario.period, scenario.seed
        )
        arms.append(scenario.arm)
        made_of[trial.arm, trial.law] = identity(controller, scenario)
    if len(set(arms)) < len(study.arms):
        raise OptionError(f"arms = {study.arms} are only {sorted(set(arms))}; give each once")
    if len({trial.stem for trial in firsts}) < len(firsts):
        raise OptionError(f"{study}: two of its trials would share a file; rename an arm's file")
    return made_of


def _other_versions(found: Sequence[Mapping[str, str]]) -> list[str]:
    """What there is to say of trials that other versions of rcmqp or its packages ran."""
    now = versions()
    other = [each for each in found if each != now]
    if not other:
        return []
    names = sorted({name for each in other for name in now if each.get(name) != now[name]})
    told = ", ".join(f"{name} {other[0].get(name, 'unknown')} (now {now[name]})" for name in names)
    return [
        f"{len(other)} of {len(found)} trials were run by other versions, the first by {told}; "
        "to compare like with like, run the study in another folder"
    ]


def _missing(trial: Trial, folder: Path, made_of: str) -> str | None:
    """Why a trial has to be run, "" if it never was or failed; None if its file is good.

    Raises:
        RunFileError: the file is another trial's.
    """
    file = trial_file(folder, trial)
    if not file.exists():
        return ""
    try:
        record = TrialFile.load(file)
    except RunFileError as error:
        return str(error)
    _check_whose(trial, record, file)
    if record.made_of != made_of:
        return f"{trial.law} or its code or URDF has changed since it was run"
    return "" if record.outcome.failure else None


def _kept(trial: Trial, folder: Path) -> tuple[Outcome, Mapping[str, str]]:
    """A trial's outcome and the versions that ran it; its traces stay in the file.

    Raises:
        RunFileError: the file is damaged, or another trial's.
    """
    file = trial_file(folder, trial)
    record = TrialFile.load(file)
    _check_whose(trial, record, file)
    return record.outcome, record.versions


def _check_whose(trial: Trial, record: TrialFile, file: Path) -> None:
    said = json.loads(record.scenario)
    said.pop("carried_arm", None)  # the arm's sum is in made_of
    if (said, record.law) != (
        json.loads(trial.made().portable().to_json()),
        trial.law.to_json(),
    ):
        raise RunFileError(
            file,
            "is of another study: other seed, scenario, arm, controller or operators; give "
            "another folder, or remove this one",
        )
