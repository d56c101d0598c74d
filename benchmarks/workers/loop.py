"""The timed loop, the same in every package's environment: needs Python and numpy alone.

A worker is a script. python workers/pink_.py tells the names of its cases, as one line of JSON;
python workers/pink_.py workload.npz case 1 runs on core 1, tells its versions when it is ready,
then reads lines from stdin and answers each with a line of JSON:

    {"first": 0, "last": 250, "skip": 10}    runs cycles 0 to 249 and gives their times in ns, but
                                             for the first ten, which find cold caches; and how
                                             often another process took the core meanwhile
    {"save": "q.npy"}                        writes the joint angles after each cycle, and ends
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import resource
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Cycle: TypeAlias = Callable[[int], Array]
"""Runs cycle k: new target, kinematics, solve, integrate; gives the joint angles after it."""

WARM_UP = 100
"""Cycles run and thrown away, so that what compiles, loads or allocates at first has done so."""


@dataclass(frozen=True)
class Work:
    """What is asked; see benchmarks/workload.py.

    Attributes:
        urdf: of the arm, with links ``tip`` and ``trocar``.
        period: of a cycle [s].
        depth: of the tip at the start [m].
        q_start: (nv,) joint angles at the start [rad].
        views: (cycles + 1, 8) what the surgeon asks at the start of each cycle: ViewCommand.
        tips: (cycles + 1, 4, 4) where the tip is to be at the start of each cycle, in the world.
        tips_dq: (cycles + 1, 8) the same as unit dual quaternions, w first.
        pivot: (3,) the trocar in the world [m].
        lower, upper, velocity, acceleration: (nv,) limits of the joints.
    """

    urdf: str
    period: float
    depth: float
    q_start: Array
    views: Array
    tips: Array
    tips_dq: Array
    pivot: Array
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array

    @classmethod
    def load(cls, path: str) -> Work:
        """Read workload.npz."""
        with np.load(path) as file:
            values: dict[str, Any] = {name: file[name] for name in file.files}
        values["urdf"] = str(values["urdf"])
        for name in ("period", "depth"):
            values[name] = float(values[name])
        return cls(**values)


def serve(cases: Mapping[str, Callable[[Work], Cycle]], packages: Sequence[str]) -> None:
    """Be a worker, as the command line says.

    Args:
        cases: by name, what makes a cycle out of the work, started afresh each time.
        packages: whose versions are told.
    """
    answer = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what the packages print is not an answer
    if not sys.argv[1:]:
        _say(answer, list(cases))
        return
    path, name, core = sys.argv[1:]
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(core)})
    try:
        work = Work.load(path)
        cycle = cases[name](work)
        for k in range(min(WARM_UP, len(work.views) - 1)):
            cycle(k)
        cycle = cases[name](work)
    except Exception as error:  # noqa: BLE001  (whatever it is, the table tells)
        _say(answer, {"error": f"{type(error).__name__}: {error}"})
        return
    versions = {package: importlib.metadata.version(package) for package in packages}
    _say(answer, {"versions": {"python": platform.python_version(), **versions}})
    q = np.full((len(work.views) - 1, len(work.q_start)), np.nan)
    for line in sys.stdin:
        request = json.loads(line)
        if "save" in request:
            np.save(request["save"], q)
            _say(answer, {})
            return
        try:
            before = resource.getrusage(resource.RUSAGE_SELF).ru_nivcsw
            times = _timed(cycle, q, request["first"], request["last"])
            taken = resource.getrusage(resource.RUSAGE_SELF).ru_nivcsw - before
        except Exception as error:  # noqa: BLE001  (whatever it is, the table tells)
            _say(answer, {"error": f"{type(error).__name__}: {error}"})
            return
        _say(answer, {"ns": times[request["skip"] :], "interrupted": taken})


def _timed(cycle: Cycle, q: Array, first: int, last: int) -> list[int]:
    """Times of cycles [ns]; the joint angles go into q (cycles, nv)."""
    clock, times = time.perf_counter_ns, []
    for k in range(first, last):
        start = clock()
        angles = cycle(k)
        times.append(clock() - start)
        q[k] = angles
    return times


def _say(stream: Any, message: object) -> None:
    print(json.dumps(message), file=stream, flush=True)
