"""What a benchmark found: numbers of each case, on what machine, as JSON."""

from __future__ import annotations

import dataclasses
import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Result:
    """One case; times in microseconds, of whole cycles.

    Attributes:
        task: ``rcm``, the RCM as a task; ``pose``, a whole pose.
        package, case: what ran.
        versions: of the packages that it ran on.
        cycles: that it ran; fewer than the others if it took too long.
        blocks_us: median of each block, in the order of time: ratios of two cases are taken
            block by block, where the machine was as fast for one as for the other.
        interrupted: how often another process took the core: what is in max, and in p99 when it
            is often, is then the machine's.
        tip_rms_mm, rcm_max_mm, speed_max, acceleration_max: see workload.Accuracy.
        failure: why there is nothing; empty where there is something.
    """

    task: str
    package: str
    case: str
    versions: Mapping[str, str] = field(default_factory=dict)
    cycles: int = 0
    median_us: float = np.nan
    p95_us: float = np.nan
    p99_us: float = np.nan
    max_us: float = np.nan
    interrupted: int = 0
    tip_rms_mm: float = np.nan
    rcm_max_mm: float = np.nan
    speed_max: float = np.nan
    acceleration_max: float = np.nan
    blocks_us: Sequence[float] = ()
    failure: str = ""

    @property
    def name(self) -> str:
        """Package, task and case in one."""
        return f"{self.package} {self.task}/{self.case}"


def times(blocks: Sequence[Sequence[int]]) -> dict[str, Any]:
    """The times of a Result out of those of its blocks [ns]."""
    every = np.concatenate([np.asarray(block, dtype=float) for block in blocks]) / 1e3
    p50, p95, p99 = np.percentile(every, [50, 95, 99])
    return {
        "median_us": float(p50),
        "p95_us": float(p95),
        "p99_us": float(p99),
        "max_us": float(every.max()),
        "blocks_us": [float(np.median(block)) / 1e3 for block in blocks],
    }


@dataclass(frozen=True)
class Report:
    """A whole benchmark.

    Attributes:
        machine: CPU, cores, system, load.
        settings: of the benchmark.
        results: one a case.
    """

    machine: Mapping[str, str]
    settings: Mapping[str, str]
    results: Sequence[Result]

    def save(self, path: Path) -> None:
        """Write JSON; what is not a number is null."""
        data = dataclasses.asdict(self)
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(_without_nan(data), indent=1, allow_nan=False)
        path.write_text(text + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> Report:
        """Read what save() wrote."""
        data = json.loads(path.read_text(encoding="utf-8"))
        results = []
        for item in data["results"]:
            values: dict[str, Any] = {key: _number(value) for key, value in item.items()}
            results.append(Result(**values))
        return cls(data["machine"], data["settings"], results)


def machine() -> dict[str, str]:
    """What this is run on."""
    cpu = platform.processor() or platform.machine()
    about = Path("/proc/cpuinfo")
    if about.is_file():
        names = [line for line in about.read_text().splitlines() if line.startswith("model name")]
        cpu = names[0].partition(":")[2].strip() if names else cpu
    load = f"{os.getloadavg()[0]:.2f}" if hasattr(os, "getloadavg") else "unknown"
    return {
        "cpu": cpu,
        "cores": str(os.cpu_count()),
        "system": platform.platform(),
        "load": load,
    }


def _number(value: object) -> object:
    return np.nan if value is None else value


def _without_nan(data: object) -> object:
    if isinstance(data, dict):
        return {key: _without_nan(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_without_nan(value) for value in data]
    return None if isinstance(data, float) and not np.isfinite(data) else data
