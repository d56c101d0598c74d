"""Runs of any length: streamed to a file and summed up from it in the memory of one part."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rcmqp import Run, Scenario, compute_metrics, load_scenario, make_controller, simulate
from rcmqp.cli.results import warnings
from rcmqp.controllers import Controller
from rcmqp.errors import RunFileError
from rcmqp.runs.head import SIGNATURE
from rcmqp.runs.metrics import Extent
from rcmqp.runs.run_file import RunFile
from rcmqp.runs.simulate import record

EARLIER = SIGNATURE + b"earlier"


def made(scenario: Scenario) -> Controller:
    return make_controller("dual_quaternion", scenario.insertion(), scenario.period)


def record_and_run(scenario: Scenario, path: Path) -> Run:
    """Record it, and answer the same run from memory, the clock's times apart."""
    record(scenario, made(scenario), path)
    run, loaded = simulate(scenario, made(scenario)), Run.load(path)
    assert loaded.digest == run.digest
    return loaded


# The same run ------------------------------------------------------------------------------


def test_a_recorded_run_is_the_simulated_one_and_its_sums_are_the_same(tmp_path: Path) -> None:
    """More than two parts; too fast for the joints, so that there is something to warn of."""
    scenario = load_scenario("fast_helix", "lwa3", duration=8.5, period=1e-3)
    run = record_and_run(scenario, tmp_path / "run.h5")
    with RunFile(tmp_path / "run.h5") as file:
        assert len(list(file.parts())) == 3
        found = compute_metrics(file)
        assert found == compute_metrics(run)
        assert warnings(file, found) == warnings(run, found) != []
        assert (file.digest, file.title) == (run.digest, run.title)
    worst = np.abs(run.v / run.velocity_limit).max(axis=1)
    said = f"at {run.time[worst.argmax()]:.3f} s was asked for {worst.max():.3g} times"
    assert any(said in text for text in warnings(run, found))


def test_a_path_that_ends_early_is_recorded_until_then(tmp_path: Path) -> None:
    scenario = load_scenario("camera_task", period=8e-3)
    run = record_and_run(scenario, tmp_path / "run.h5")
    assert 100 < len(run.time) < scenario.cycles
    with RunFile(tmp_path / "run.h5") as file:
        assert compute_metrics(file) == compute_metrics(run)


def test_a_file_whose_numbers_were_changed_is_refused(tmp_path: Path) -> None:
    import h5py

    scenario = load_scenario("conical_helix", duration=0.02)
    record(scenario, made(scenario), tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5", "r+") as file:
        file["tip"][3] += 1e-9
    with pytest.raises(RunFileError, match="do not fit its digest"), RunFile(tmp_path / "run.h5"):
        pass


# In flat memory ----------------------------------------------------------------------------

PROGRAM = """
import re, sys
from rcmqp.cli import main
try:
    main(["run", "conical_helix", "--duration", sys.argv[1], "--out", sys.argv[2], "--json"])
finally:
    status = open("/proc/self/status").read()
    print(re.search(r"VmHWM:\\s+(\\d+) kB", status)[1], file=sys.stderr)
"""


def test_a_longer_run_takes_no_more_memory(tmp_path: Path) -> None:
    """Recorded, read and summed up; in memory the longer one would take 20 MB more."""
    peaks = []
    for duration in ("10", "40"):
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, duration, tmp_path / f"{duration}.h5"],
            capture_output=True,
            text=True,
            check=True,
        )
        peaks.append(1e-3 * float(done.stderr))
    assert Run.load(tmp_path / "40.h5").time[-1] == 40.0
    assert peaks[1] < peaks[0] + 6.0


# Least, largest ----------------------------------------------------------------------------


def test_an_extent_does_not_depend_on_the_blocks() -> None:
    values, found = np.random.default_rng(7).normal(size=1000), Extent()
    for block in (values[:3], values[3:3], values[3:].reshape(-1, 1)):
        found.add(block)
    assert (found.count, found.low, found.high) == (1000, values.min(), values.max())
    assert abs(found.rms - np.sqrt(np.mean(values**2))) < 1e-15
    assert np.isnan(Extent().rms)


# Killed half way ---------------------------------------------------------------------------


def test_a_killed_recording_keeps_the_earlier_file_and_the_next_one_sweeps_up(
    tmp_path: Path,
) -> None:
    program = (
        "import sys, rcmqp\nfrom rcmqp.runs.simulate import record\n"
        "s = rcmqp.load_scenario('conical_helix', 'ur5', duration=600.0)\n"
        "c = rcmqp.make_controller('dual_quaternion', s.insertion(), s.period)\n"
        "record(s, c, sys.argv[1], lambda done: print(done, flush=True))\n"
    )
    path = tmp_path / "run.h5"
    path.write_bytes(EARLIER)
    with subprocess.Popen(
        [sys.executable, "-c", program, path], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.kill()
    (left,) = tmp_path.glob(".run@*")
    assert path.read_bytes() == EARLIER
    scenario = load_scenario("conical_helix", "ur5", duration=0.01)
    others = tmp_path / f".run@{os.getpid()}0.txt"
    others.touch()
    record(scenario, made(scenario), path)
    assert len(Run.load(path).time) == 11
    assert sorted(tmp_path.iterdir()) == sorted([path, others])
    assert not left.exists()
