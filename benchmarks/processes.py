"""Worker processes, one a case, that take turns on one core."""

from __future__ import annotations

import json
import os
import select
import subprocess
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from environments import WORKERS

PATIENCE = 300.0
"""How long a worker may take for an answer [s]."""

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class WorkerFailed(Exception):
    """A case cannot be run; the message says why."""


def case_names(package: str, python: Path) -> list[str]:
    """What a package's worker can run.

    Raises:
        WorkerFailed: the package cannot be imported.
    """
    done = subprocess.run(
        [python, WORKERS / f"{package}_.py"],
        capture_output=True,
        text=True,
        env=_environment(package),
        check=False,
    )
    if done.returncode != 0:
        raise WorkerFailed(_last_line(done.stderr))
    return [str(name) for name in json.loads(done.stdout)]


class Worker:
    """One case in a process of its own, idle but for its turns.

    Attributes:
        package, case: what it runs.
        versions: of the packages that it runs on.
        interrupted: how often another process took its core in a block.
    """

    def __init__(self, package: str, case: str, python: Path, workload: Path, core: int) -> None:
        """Start it, and wait until it has warmed up.

        Raises:
            WorkerFailed: it does not come up.
        """
        self.package, self.case, self.interrupted = package, case, 0
        self._errors = TemporaryFile("w+")
        self._process = subprocess.Popen(
            [python, WORKERS / f"{package}_.py", workload, case, str(core)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            env=_environment(package),
        )
        self.versions: dict[str, str] = self._answer()["versions"]

    def block(self, first: int, last: int, skip: int) -> list[int]:
        """Times of cycles first + skip to last - 1 [ns].

        Raises:
            WorkerFailed: a cycle failed.
        """
        answer = self._ask({"first": first, "last": last, "skip": skip})
        self.interrupted += int(answer["interrupted"])
        times: list[int] = answer["ns"]
        return times

    def save(self, path: Path) -> None:
        """Have it write its joint angles, and end."""
        self._ask({"save": str(path)})
        self.stop()

    def stop(self) -> None:
        """End the process; a second time is harmless."""
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._errors):
            if stream is not None:
                stream.close()

    def _ask(self, request: object) -> dict[str, Any]:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except OSError as error:
            raise WorkerFailed(f"its process has ended: {self._last_error()}") from error
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        stream = self._process.stdout
        assert stream is not None
        ready, _, _ = select.select([stream], [], [], PATIENCE)
        line = stream.readline() if ready else ""
        if not line:
            reason = self._last_error() if ready else f"no answer within {PATIENCE:g} s"
            self.stop()
            raise WorkerFailed(f"its process has ended: {reason}")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            self.stop()
            raise WorkerFailed(str(answer["error"]))
        return answer

    def _last_error(self) -> str:
        self._errors.seek(0)
        return _last_line(self._errors.read())


def _environment(package: str) -> dict[str, str]:
    """One thread; and for the others, nothing of this environment's Python."""
    ours = () if package == "rcmqp" else ("PYTHONPATH", "PYTHONHOME")
    kept = {key: value for key, value in os.environ.items() if key not in ours}
    return kept | dict.fromkeys(ONE_THREAD, "1")


def _last_line(text: str) -> str:
    return (text.strip().splitlines() or ["no message"])[-1]
