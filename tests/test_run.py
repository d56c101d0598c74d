"""A run's file: what is saved is loaded, what is damaged is refused, a failure leaves nothing."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rcmqp import (
    Run,
    ViewCommand,
    arm_names,
    compute_metrics,
    load_scenario,
    make_controller,
    simulate,
)
from rcmqp.errors import OptionError, RunFileError, UnknownName
from rcmqp.files import check_writable
from rcmqp.references.paths import PATHS, Foreign, Search
from rcmqp.runs.head import Head
from rcmqp.runs.loop_record import TIMES
from rcmqp.runs.run_file import RunFile
from rcmqp.show.report import groups_of, remake_text
from rcmqp.world.obstacles import Sphere

CHANNELS = [field for field in dataclasses.fields(Run) if "unit" in field.metadata]
DATASETS = [field.name for field in CHANNELS] + [
    "diagnostics/objective",
    "diagnostics/sigma_6_of_N",
    "diagnostics/scale",
]

every_dataset = pytest.mark.parametrize("name", DATASETS)


def short_run(arm: str = "lwa3") -> Run:
    scenario = load_scenario("conical_helix", arm, duration=0.02, seed=11)
    return simulate(
        scenario, make_controller("dual_quaternion", scenario.insertion(), scenario.period)
    )


@pytest.fixture(scope="module")
def run() -> Run:
    return short_run()


@pytest.fixture
def saved(run: Run, tmp_path: Path) -> Path:
    run.save(tmp_path / "run.h5")
    return tmp_path / "run.h5"


def stored_at(file: h5py.File, name: str) -> int:
    """Where a dataset's numbers begin in its file, chunked or not."""
    dataset = file[name]
    if dataset.chunks:
        return int(dataset.id.get_chunk_info(0).byte_offset)
    return int(dataset.id.get_offset())


# What is saved is loaded -------------------------------------------------------------------


@pytest.mark.parametrize("arm", arm_names())
def test_a_saved_run_is_loaded_equal(arm: str, tmp_path: Path) -> None:
    run = short_run(arm)
    run.save(tmp_path / "run.h5")
    loaded = Run.load(tmp_path / "run.h5")
    assert loaded == run
    assert loaded.digest == run.digest
    assert loaded.scenario == run.scenario
    assert (loaded.controller, loaded.joints) == (run.controller, run.joints)
    assert dict(loaded.options) == dict(run.options)
    assert dict(loaded.versions) == dict(run.versions)
    assert loaded.arrays().keys() == run.arrays().keys()
    for name, values in run.arrays().items():
        assert np.array_equal(loaded.arrays()[name], values), name
    assert loaded.diagnostics.keys() == run.diagnostics.keys()
    for name, values in run.diagnostics.items():
        assert np.array_equal(loaded.diagnostics[name], values), name


def test_a_saved_run_is_made_again_from_its_file(saved: Path) -> None:
    loaded = Run.load(saved)
    insertion, period = loaded.scenario.insertion(), loaded.scenario.period
    controller = make_controller(loaded.controller, insertion, period, **loaded.options)
    assert simulate(loaded.scenario, controller).digest == loaded.digest


def test_a_file_says_by_itself_what_is_in_it(run: Run, saved: Path) -> None:
    """Read by h5py alone, as someone without rcmqp would."""
    with h5py.File(saved, "r") as file:
        for field in CHANNELS:
            dataset = file[field.name]
            assert np.array_equal(dataset[()], getattr(run, field.name))
            assert dataset.attrs["unit"] == field.metadata["unit"] != ""
            assert dataset.attrs["meaning"] == field.metadata["meaning"] != ""
        assert set(file["diagnostics"]) == set(run.diagnostics)
        assert file.attrs["format"] == "rcmqp run"
        assert file.attrs["format_version"] == 2
        assert file.attrs["seed"] == 11
        assert file.attrs["controller"] == "dual_quaternion"
        assert file.attrs["digest"] == run.digest
        assert json.loads(file.attrs["versions"]) == run.versions
        assert json.loads(file.attrs["options"])["gain"] == 60.0
        assert json.loads(file.attrs["scenario"])["name"] == "conical_helix"
        assert json.loads(file.attrs["joints"]) == list(run.joints)
        assert file.attrs["versions"].count("pin")


def test_an_earlier_file_is_replaced(run: Run, saved: Path) -> None:
    other = dataclasses.replace(run, controller="another")
    other.save(saved)
    assert Run.load(saved) == other
    assert list(saved.parent.iterdir()) == [saved]


def test_a_file_of_an_earlier_version_has_no_jerk_limits_and_assumes_nothing(
    run: Run, saved: Path
) -> None:
    dataclasses.replace(run, jerk_limit=np.full_like(run.jerk_limit, np.inf), assumed=()).save(
        saved
    )
    with h5py.File(saved, "r+") as file:
        del file["jerk_limit"], file.attrs["assumed"]
    found = Run.load(saved)
    assert np.isposinf(found.jerk_limit).all()
    assert found.assumed == ()
    assert np.array_equal(found.v, run.v)
    with RunFile(saved) as again:
        assert again.digest == found.digest
        assert math.isnan(compute_metrics(again).jerk_ratio_max)


# Equality and digest -----------------------------------------------------------------------


@every_dataset
def test_the_digest_changes_with_every_number_but_the_solve_time(run: Run, name: str) -> None:
    group, _, channel = name.rpartition("/")
    values = np.array(run.diagnostics[channel] if group else run.arrays()[channel])
    values.flat[-1] = np.nextafter(values.flat[-1], np.inf)
    change: dict[str, Any] = {channel: values}
    if group:
        change = {"diagnostics": {**run.diagnostics, channel: values}}
    other = dataclasses.replace(run, **change)
    assert other != run
    assert (other.digest == run.digest) == (name == "solve_time")


def test_the_digest_changes_with_what_the_run_was_made_of(run: Run) -> None:
    changes: list[dict[str, Any]] = [
        {"controller": "another"},
        {"options": {**run.options, "gain": 61.0}},
        {"scenario": dataclasses.replace(run.scenario, seed=12)},
        {"joints": ("a", "b")},
        {"urdf_sha256": 64 * "0"},
        {"stops": {"no reason": [3]}},
        {"assumed": ("acceleration",)},
    ]
    digests = {dataclasses.replace(run, **change).digest for change in changes}
    assert len(digests | {run.digest}) == 8
    assert dataclasses.replace(run, versions={"python": "4"}).digest == run.digest


@pytest.mark.parametrize("change", [{"versions": {}}, {"joints": ("a",) * 7}])
def test_runs_with_other_names_or_versions_are_not_equal(run: Run, change: dict[str, Any]) -> None:
    assert dataclasses.replace(run, **change) != run


def test_a_run_equals_a_copy_and_nothing_else(run: Run) -> None:
    assert dataclasses.replace(run, q=run.q.copy()) == run
    assert run != "run"


# What is damaged is refused ----------------------------------------------------------------


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="no such file"):
        Run.load(tmp_path / "none.h5")


@pytest.mark.parametrize("content", [b"", b"\x89HD", b"time,q\n0,1\n"])
def test_a_file_that_is_not_hdf5_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "run.h5").write_bytes(content)
    with pytest.raises(RunFileError, match="not an HDF5 file"):
        Run.load(tmp_path / "run.h5")


def test_a_foreign_hdf5_file_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["time"] = np.zeros(3)
    with pytest.raises(RunFileError, match="not a run of rcmqp"):
        Run.load(tmp_path / "other.h5")


@pytest.mark.parametrize("version", [1, 3])
def test_another_format_version_is_refused(version: int, saved: Path) -> None:
    with h5py.File(saved, "r+") as file:
        file.attrs["format_version"] = version
    with pytest.raises(RunFileError, match=f"format version {version}, this rcmqp reads 2"):
        Run.load(saved)


@pytest.mark.parametrize("share", [0.01, 0.3, 0.7, 0.999])
def test_a_truncated_file_is_refused(share: float, saved: Path) -> None:
    content = saved.read_bytes()
    saved.write_bytes(content[: int(share * len(content))])
    with pytest.raises(RunFileError, match="damaged"):
        Run.load(saved)


def test_a_file_that_is_cut_short_says_how_many_bytes_it_has(saved: Path) -> None:
    content = saved.read_bytes()
    half = len(content) // 2
    saved.write_bytes(content[:half])
    said = f"cut short, it has {half} of {len(content)} bytes; copy it again, or run the scenario"
    with pytest.raises(RunFileError, match=said):
        Run.load(saved)


@every_dataset
def test_a_flipped_bit_in_any_dataset_is_noticed(name: str, saved: Path) -> None:
    with h5py.File(saved, "r") as file:
        position = stored_at(file, name) + 3
    content = bytearray(saved.read_bytes())
    content[position] ^= 1
    saved.write_bytes(content)
    with pytest.raises(RunFileError, match="damaged"):
        Run.load(saved)


@pytest.mark.parametrize("name", [name for name in DATASETS if name != "path_time"])
def test_a_missing_dataset_is_noticed(name: str, saved: Path) -> None:
    with h5py.File(saved, "r+") as file:
        del file[name]
    with pytest.raises(RunFileError, match="damaged"):
        Run.load(saved)


@pytest.mark.parametrize(
    "attribute", ["scenario", "controller", "options", "versions", "joints", "digest"]
)
@pytest.mark.parametrize("value", ["{", 3, None])
def test_a_missing_or_spoilt_attribute_is_noticed(
    attribute: str, value: str | int | None, saved: Path
) -> None:
    with h5py.File(saved, "r+") as file:
        if value is None:
            del file.attrs[attribute]
        else:
            file.attrs[attribute] = value
    with pytest.raises(RunFileError, match="damaged"):
        Run.load(saved)


@dataclasses.dataclass(frozen=True)
class Nod:
    """Somebody's own path, up and down."""

    duration: float = 0.05
    ways: tuple[float, ...] = (0.1, -0.1)

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        return ViewCommand(beta=self.ways[0] * math.sin(t))


def test_a_run_along_a_path_that_is_not_known_here_can_be_looked_at_and_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as where_it_was_made:
        where_it_was_made.setitem(PATHS, "nod", Nod)
        scenario = load_scenario("view_steps", "panda", path=Nod(), duration=0.05)
        made = make_controller("dual_quaternion", scenario.insertion(), scenario.period)
        simulate(scenario, made).save(tmp_path / "run.h5")
    found = Run.load(tmp_path / "run.h5")
    assert isinstance(found.scenario.path, Foreign)
    assert found.scenario.path.duration == 0.05
    found.save(tmp_path / "again.h5")
    assert Run.load(tmp_path / "again.h5").digest == found.digest
    assert compute_metrics(found).rcm_max_mm < 1e-3
    (group,) = groups_of([found], ["run.h5"])
    assert "its path 'nod' is not one of rcmqp's" in remake_text([group], "")
    in_real_time = dataclasses.replace(found.scenario, path=Foreign("realtime", {}))
    (group,) = groups_of([dataclasses.replace(found, scenario=in_real_time)], ["run.h5"])
    assert "run.h5: recorded in real time" in remake_text([group], "")
    search = Search(((0.0, 0.0, 0.1),), (Sphere((0.0, 0.0, 0.15), 0.01),))
    of_a_person = dataclasses.replace(
        found,
        scenario=dataclasses.replace(found.scenario, path=search),
        diagnostics=dict.fromkeys(TIMES, np.zeros(len(found.time))),
        about_diagnostics=TIMES,
    )
    (group,) = groups_of([of_a_person], ["run.h5"])
    assert "run.h5: recorded in real time" in remake_text([group], "")
    with pytest.raises(OptionError, match="does not know the path 'nod'"):
        simulate(found.scenario, made)
    (tmp_path / "scenario.json").write_text(found.scenario.to_json())
    with pytest.raises(UnknownName, match=r"path 'nod' \(known: .*camera_trial, circle"):
        load_scenario(str(tmp_path / "scenario.json"))


def test_a_file_that_is_no_run_is_not_written_over(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "notes.py"
    file.write_text("print()")
    with pytest.raises(RunFileError, match="is there already, and is no run"):
        run.save(file)
    assert file.read_text() == "print()"


# What cannot be written --------------------------------------------------------------------


def test_a_folder_that_is_missing_is_found_before_the_run(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match=r"there is no folder .*missing; make it first"):
        check_writable(tmp_path / "missing" / "run.h5")


def test_a_folder_in_place_of_the_file_is_found_before_the_run(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="is a folder"):
        check_writable(tmp_path)


def test_a_file_in_place_of_the_folder_is_found_before_the_run(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RunFileError, match="there is no folder"):
        check_writable(tmp_path / "file" / "run.h5")


def test_a_folder_that_takes_no_files_is_found_before_the_run() -> None:
    """/proc refuses even root."""
    with pytest.raises(RunFileError, match=r"/proc/run\.h5: cannot be written") as refused:
        check_writable("/proc/run.h5")
    assert "part" not in str(refused.value)


def test_a_name_that_is_too_long_is_found_before_the_run(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="too long"):
        check_writable(tmp_path / (300 * "x"))


def test_checking_leaves_nothing_behind_and_keeps_what_is_there(tmp_path: Path) -> None:
    check_writable(tmp_path / "new.h5")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "old.h5").write_text("kept")
    check_writable(tmp_path / "old.h5")
    assert (tmp_path / "old.h5").read_text() == "kept"


def test_save_refuses_what_check_writable_refuses(run: Run, tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="there is no folder"):
        run.save(tmp_path / "missing" / "run.h5")


@pytest.mark.parametrize("failure", [OSError("disk full"), KeyboardInterrupt()], ids=str)
def test_a_failed_save_leaves_the_folder_as_it_was(
    failure: BaseException, run: Run, saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = saved.read_bytes()

    def fail_halfway(self: Head, file: h5py.File, digest: str) -> None:
        raise failure

    monkeypatch.setattr(Head, "write", fail_halfway)
    expected = RunFileError if isinstance(failure, OSError) else KeyboardInterrupt
    for target in (saved, saved.with_name("new.h5")):
        with pytest.raises(expected):
            run.save(target)
    assert list(saved.parent.iterdir()) == [saved]
    assert saved.read_bytes() == before


def test_a_disk_that_is_full_is_an_error_and_leaves_the_folder_as_it_was(tmp_path: Path) -> None:
    """A limit on the size of a file in place of it, saved and recorded: 0 is full already."""
    program = (
        "import os, resource\n"
        "from rcmqp import load_scenario, make_controller, simulate\n"
        "from rcmqp.errors import RunFileError\n"
        "from rcmqp.runs.simulate import record\n"
        "s = load_scenario('conical_helix', duration=2.0)\n"
        "controller = make_controller('dual_quaternion', s.insertion(), s.period)\n"
        "run = simulate(s, controller)\n"
        "for size in (0, 8_000, 300_000, 1_300_000):\n"
        "    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))\n"
        "    for write in (run.save, lambda path: record(s, controller, path)):\n"
        "        try:\n"
        "            write('run.h5')\n"
        "        except RunFileError as error:\n"
        "            print(error.reason, os.listdir())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout.splitlines() == 8 * ["could not be written: File too large []"]
    assert (done.returncode, done.stderr) == (0, "")


def test_others_may_read_a_saved_run_as_they_may_any_new_file(saved: Path) -> None:
    (saved.parent / "plain").touch()
    assert saved.stat().st_mode == (saved.parent / "plain").stat().st_mode
