"""What the command line does with damaged files: run, show, view, report and study.

Good run files, trial files and scenario files are damaged, see damage.py, always in the same way
for one seed. Every command gets each of them, in a process with a limit of time and of memory.
Faults are: an error that rcmqp did not foresee, a process that dies, a command that takes longer
than 5 s, more than 1 GB of memory, a terminal escape, a file elsewhere that was opened.

    python benchmarks/damaged.py --cases 2000
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import io
import math
import multiprocessing
import os
import re
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from damage import OF_HDF5, OF_JSON

from rcmqp import load_scenario, make_controller, simulate
from rcmqp.cli import main as rcmqp
from rcmqp.experiments.study.perform import perform
from rcmqp.experiments.study.plan import Law, Study
from rcmqp.realtime.system import time_waited
from rcmqp.runs.simulate import record

MOST_TIME, MOST_MEMORY = 5.0, 1000.0
"""Of a command [s], [MB]."""

PATIENCE = 30.0
"""Seconds after which a process is killed, without those in which it waited for a processor."""

COMMANDS = ("run", "show", "view", "report", "study")

UNFORESEEN = "failed where it did not expect to"


@dataclass(frozen=True)
class Answer:
    """What a command did with a damaged file.

    Attributes:
        case: number of the file.
        damage: kind of damage and of file.
        command: what was called.
        code: the exit code.
        seconds: of processor time.
        memory: the largest resident set [MB].
        fault: what ought not to be; empty if nothing.
        said: the last line of stderr.
    """

    case: int
    damage: str
    command: str
    code: int
    seconds: float
    memory: float
    fault: str
    said: str


def good_files(folder: Path) -> list[Path]:
    """Runs, scenarios and a trial, short ones; and a folder that nobody may read."""
    for name, arm in (("conical_helix", "lwa3"), ("moving_trocar", "panda"), ("obstacle", "ur5")):
        scenario = load_scenario(name, arm, duration=0.05, period=2e-3)
        controller = make_controller("dual_quaternion", scenario.insertion(), scenario.period)
        if name == "conical_helix":
            record(scenario, controller, folder / f"{name}.h5")
        else:
            simulate(scenario, controller).save(folder / f"{name}.h5")
        (folder / f"{name}.json").write_text(scenario.to_json(), encoding="utf-8")
    camera = load_scenario("camera_task", duration=0.2, period=0.02)
    (folder / "camera.json").write_text(camera.to_json(), encoding="utf-8")
    perform(Study(str(folder / "camera.json"), 1, laws=(Law(period=0.02),)), folder / "study")
    (trial,) = (folder / "study" / "runs").glob("*.h5")
    shutil.copy(trial, folder / "trial.h5")
    outside = folder / "outside"
    outside.mkdir()
    (outside / "secret.raw").write_bytes(bytes(100_000))
    with h5py.File(outside / "secret.h5", "w") as file:
        file["data"] = np.zeros(26)
    return sorted([*folder.glob("*.h5"), *folder.glob("*.json")])


def damaged(good: Sequence[Path], folder: Path, case: int, seed: int) -> tuple[Path, str]:
    """Copy a good file into a folder and damage it; the copy, and the kinds of both."""
    rng = np.random.default_rng([seed, case])
    source = good[case % len(good)]
    kinds = OF_JSON if source.suffix == ".json" else OF_HDF5
    damage = kinds[case // len(good) % len(kinds)]
    path = folder / source.name
    shutil.copy(source, path)
    with contextlib.suppress(KeyError, RuntimeError, ValueError, TypeError, OSError):
        damage(path, rng)  # what h5py does not write stays as it is
    return path, f"{damage.__name__} of {source.name}"


def line_of(command: str, file: Path, out: Path) -> list[str]:
    """The command line that gives a file to a command."""
    more = {
        "run": ["--duration", "0.05"],
        "view": ["--html", str(out / "page.html"), "--no-open"],
        "report": ["--out", str(out / "report")],
        "study": ["--out", str(out / "study"), "--operators", "1", "--period", "0.02"],
    }
    return [command, str(file), *more.get(command, [])]


class Watch:
    """Which files in a folder are opened, by whatever library: inotify tells it."""

    def __init__(self, folder: Path) -> None:
        """Watch it from now on."""
        libc = ctypes.CDLL(None)
        self._watch = libc.inotify_init1(os.O_NONBLOCK)
        libc.inotify_add_watch(self._watch, os.fsencode(folder), 0x20)  # IN_OPEN

    def opened(self) -> bool:
        """Whether one was, since the last question."""
        with contextlib.suppress(BlockingIOError):
            return bool(os.read(self._watch, 65536))
        return False


def called(line: Sequence[str], watch: Watch) -> tuple[int, float, float, str, str]:
    """Exit code, processor time [s], memory [MB], fault and last words of a command line."""
    Path("/proc/self/clear_refs").write_text("5")  # resets VmHWM
    out, err, code, fault = io.StringIO(), io.StringIO(), -1, ""
    watch.opened()
    begin = time.process_time()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            rcmqp(line)
        except SystemExit as end:
            code = int(end.code or 0)
        except BaseException as error:  # noqa: BLE001  (it is what is counted)
            fault = f"{type(error).__name__}: {error}"
    seconds = time.process_time() - begin
    status = Path("/proc/self/status").read_text()
    memory = 1e-3 * float(re.findall(r"VmHWM:\s+(\d+)", status)[0])
    said = out.getvalue() + err.getvalue()
    if UNFORESEEN in said or "Traceback (most recent call last)" in said:
        fault = "traceback"
    elif code not in (0, 1, 2):
        fault = fault or f"exit code {code}"
    elif seconds > MOST_TIME:
        fault = "slow"
    elif memory > MOST_MEMORY:
        fault = "memory"
    elif watch.opened():
        fault = "read outside"
    elif "\x1b[2J" in said:
        fault = "terminal escape"
    return code, seconds, memory, fault, (err.getvalue().strip().splitlines() or [""])[-1]


def _work(jobs: Connection, folder: Path, outside: Path) -> None:
    """Answer command lines until there are no more."""
    resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what C libraries say
    os.chdir(folder)
    watch = Watch(outside)
    while line := jobs.recv():
        jobs.send(called(line, watch))


class Worker:
    """A process that runs commands, and another one after it dies or hangs."""

    def __init__(self, folder: Path, outside: Path) -> None:
        """Start it in a folder."""
        self._folders = folder, outside
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("fork")
        self._jobs, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs, *self._folders), daemon=True)
        self._process.start()
        theirs.close()

    def call(self, line: Sequence[str]) -> Any:
        """What called() answers; a fault if the process dies or hangs."""
        self._jobs.send(line)
        begin = time.monotonic() - self._waited()
        try:
            while (left := begin + PATIENCE + self._waited() - time.monotonic()) > 0.0:
                if self._jobs.poll(left):
                    return self._jobs.recv()
            fault, seconds = "hang", PATIENCE
        except EOFError:
            fault, seconds = "crash", 0.0
        self.stop()
        self._start()
        return -1, seconds, 0.0, fault, fault

    def _waited(self) -> float:
        """How long the process could have run so far and waited for a processor [s]."""
        waited = time_waited(f"/proc/{self._process.pid}/schedstat")
        return 0.0 if math.isnan(waited) else waited  # it has ended, or has not begun

    def stop(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()


def answers(cases: Sequence[int], seed: int = 0) -> Iterator[Answer]:
    """What every command does with these cases."""
    with tempfile.TemporaryDirectory(prefix="damaged-") as name:
        folder = Path(name)
        (folder / "good").mkdir()
        good = good_files(folder / "good")
        work = folder / "work"
        work.mkdir()
        shutil.move(folder / "good" / "outside", work / "outside")
        worker = Worker(work, work / "outside")
        try:
            for case in cases:
                file, kind = damaged(good, work, case, seed)
                for command in COMMANDS:
                    out = folder / "out"
                    out.mkdir()
                    answer = worker.call(line_of(command, file, out))
                    yield Answer(case, kind, command, *answer)
                    shutil.rmtree(out, ignore_errors=True)
                file.unlink(missing_ok=True)
        finally:
            worker.stop()


def main() -> None:
    """Try them all, print every fault and a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    found = []
    for each in answers(range(given.first, given.first + given.cases), given.seed):
        found.append(each)
        if each.fault:
            said = f"{each.fault}: {each.said[:300]}"
            print(f"{each.case} {each.damage}, {each.command}: {said}", flush=True)
    print(f"{len(found)} commands on {given.cases} files, faults:", dict(_faults(found)))
    print("exit codes:", dict(Counter(each.code for each in found)))
    slow, large = max(f.seconds for f in found), max(f.memory for f in found)
    print(f"longest {slow:.1f} s of processor time, largest {large:.0f} MB")
    sys.exit(any(each.fault for each in found))


def _faults(found: Sequence[Answer]) -> Counter[str]:
    return Counter(each.fault for each in found if each.fault)


if __name__ == "__main__":
    main()
