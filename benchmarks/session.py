"""One benchmark: every case in a process of its own, in turns, on one core."""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from environments import CannotInstall, python
from processes import Worker, WorkerFailed, case_names
from results import Result, times
from workload import Workload

COLD = 10
"""Cycles at the start of a turn that are run and not counted: another process had the caches."""

ENOUGH = 60.0
"""A case that has taken this long [s] gets no more turns: some backends need a second a cycle."""


@dataclass
class _Turns:
    """A worker, the times [ns] that it has given, turn by turn, and the cycles it has run."""

    worker: Worker
    blocks: list[list[int]] = field(default_factory=list)
    cycles: int = 0

    @property
    def done(self) -> bool:
        """Whether that is enough."""
        return sum(map(sum, self.blocks)) > 1e9 * ENOUGH


def measure(
    packages: Sequence[str], pattern: str, envs: Path, *, cycles: int, block: int, core: int
) -> list[Result]:
    """Results of all cases, of what cannot be run too.

    Args:
        packages: rcmqp, and names out of environments.PEERS.
        pattern: a regular expression; cases are run in whose name it is found.
        envs: folder for the peers' environments.
        cycles: how many to run of each case.
        block: how many to run in one turn.
        core: where all of them run.
    """
    workload = Workload(cycles)
    results: list[Result] = []
    with TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        path = workload.save(folder)
        running: list[_Turns] = []
        for package, case, interpreter in _cases(packages, pattern, envs, results):
            print(f"starting {package} {case}", file=sys.stderr)
            try:
                worker = Worker(package, case, interpreter, path, core)
            except WorkerFailed as error:
                results.append(_failed(package, case, error))
                continue
            stack.callback(worker.stop)
            running.append(_Turns(worker))
        for first in range(0, cycles, block):
            last = min(first + block, cycles)
            print(f"cycles {first} to {last} of {len(running)} cases", file=sys.stderr)
            for turns in [turns for turns in running if not turns.done]:
                turns.cycles = last
                try:
                    turns.blocks.append(turns.worker.block(first, last, COLD))
                except WorkerFailed as error:
                    results.append(_failed(turns.worker.package, turns.worker.case, error))
                    running.remove(turns)
        results += [_result(workload, turns, folder / "q.npy") for turns in running]
    return sorted(results, key=lambda result: (result.task, result.package, result.case))


def _cases(
    packages: Sequence[str], pattern: str, envs: Path, results: list[Result]
) -> list[tuple[str, str, Path]]:
    """Package, case and interpreter; what cannot be installed or imported goes to results."""
    found = []
    for package in packages:
        try:
            interpreter = python(package, envs)
            names = case_names(package, interpreter)
        except (CannotInstall, WorkerFailed) as error:
            results.append(Result("", package, "", failure=str(error)))
            continue
        wanted = [name for name in names if re.search(pattern, f"{package} {name}")]
        found += [(package, name, interpreter) for name in wanted]
    return found


def _result(workload: Workload, turns: _Turns, file: Path) -> Result:
    worker = turns.worker
    worker.save(file)
    task, _, case = worker.case.partition("/")
    return Result(
        task,
        worker.package,
        case,
        worker.versions,
        interrupted=worker.interrupted,
        **times(turns.blocks),
        cycles=turns.cycles,
        **dataclasses.asdict(workload.accuracy(np.load(file)[: turns.cycles])),
    )


def _failed(package: str, name: str, error: WorkerFailed) -> Result:
    task, _, case = name.partition("/")
    return Result(task, package, case, failure=str(error))
