"""Studies: the same whatever happens to them, and tables that are true."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import importlib.util
import io
import json
import os
import pickle
import platform
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import joblib
import pytest
from helpers import assert_allclose
from short_study import SHORT, SLOW, study

from rcmqp import Insertion, Instrument, files, load_arm
from rcmqp.cli import main
from rcmqp.controllers import CONTROLLERS, DualQuaternion
from rcmqp.errors import OptionError, RunFileError, UnknownName
from rcmqp.experiments.study import trial_file as study_record
from rcmqp.experiments.study.perform import (
    RUNS,
    Performed,
    identity,
    perform,
    trial_file,
)
from rcmqp.experiments.study.plan import Law, Study
from rcmqp.experiments.study.report import outcomes_csv, table, write_tables
from rcmqp.experiments.study.trial_file import TrialFile
from rcmqp.world.arm_limits import ArmLimits


def text_of(performed: Performed) -> str:
    return table(performed) + outcomes_csv(performed.outcomes)


# Whatever happens --------------------------------------------------------------------------


def test_the_outcomes_do_not_depend_on_the_number_of_jobs(short: str, tmp_path: Path) -> None:
    chosen = study(short)
    reported: list[tuple[int, int]] = []
    one = perform(chosen, tmp_path / "one", progress=lambda _, n, of: reported.append((n, of)))
    two = perform(chosen, tmp_path / "two", jobs=2)
    assert text_of(one) == text_of(two)
    assert sum(n for n, _ in reported) == 4
    assert {of for _, of in reported} == {4}
    assert len({outcome.digest for outcome in one.outcomes}) == 4


def test_a_larger_study_has_the_same_people_in_it(short: str, tmp_path: Path) -> None:
    few = perform(study(short, 2), tmp_path / "one")
    more = perform(study(short, 3), tmp_path / "one")
    assert [o.digest for o in more.outcomes][:2] == [o.digest for o in few.outcomes]


def test_a_killed_study_goes_on_where_it_was(tmp_path: Path) -> None:
    """SIGKILL in the middle; what was done is not done again; the table is the same."""
    file = tmp_path / "short.py"
    file.write_text(SHORT.format(duration=3.0), encoding="utf-8")
    call = "import sys; from rcmqp.experiments.study.perform import perform; "
    call += "from rcmqp.experiments.study.plan import *; "
    call += f"perform(Study({str(file)!r}, 8, laws=(Law(period=0.02),)), sys.argv[1])"
    folder = tmp_path / "killed"
    process = subprocess.Popen([sys.executable, "-c", call, str(folder)])
    try:
        while len(list((folder / RUNS).glob("[!.]*.h5"))) < 2:
            assert process.poll() is None, "it ended before it could be killed"
            time.sleep(0.002)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    done = {path: path.stat().st_mtime_ns for path in (folder / RUNS).glob("[!.]*.h5")}
    assert 2 <= len(done) < 8
    (folder / RUNS / f".left@{platform.node()}@{process.pid}-0.part.h5").write_bytes(
        b"half a file"
    )
    (folder / RUNS / ".x.part").touch()  # somebody else's
    again = perform(study(str(file), 8), folder)
    assert {path: path.stat().st_mtime_ns for path in done} == done
    assert text_of(again) == text_of(perform(study(str(file), 8), tmp_path / "whole"))
    assert any("removed 1 unfinished file" in note for note in again.notes)
    assert [file.name for file in (folder / RUNS).glob(".*")] == [".x.part"]


def test_two_hosts_on_one_folder_lose_nothing(
    short: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A whole study of a second host runs while the first one is in the midst of a file.

    To the second host, the process number of the first is that of a process that has ended.
    """
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    chosen, folder = study(short, 3), tmp_path / "shared"
    seconds, whole = list[Performed](), files.whole_file

    @contextlib.contextmanager
    def slow(path: Path) -> Iterator[Path]:
        with whole(path) as part:
            part.write_bytes(b"half")
            if not seconds:
                with monkeypatch.context() as second:
                    second.setattr(platform, "node", lambda: "second")
                    second.setattr(os, "getpid", os.getppid)
                    second.setattr(study_record, "whole_file", whole)
                    seconds.append(perform(chosen, folder))
            assert part.read_bytes() == b"half"
            yield part

    monkeypatch.setattr(platform, "node", lambda: "first")
    monkeypatch.setattr(os, "getpid", lambda: ended.pid)
    monkeypatch.setattr(study_record, "whole_file", slow)
    first = perform(chosen, folder)
    (second,) = seconds
    assert text_of(first) == text_of(second) == text_of(perform(chosen, tmp_path / "alone"))
    assert not first.notes
    assert not second.notes
    assert not list((folder / RUNS).glob(".*"))


def test_trials_that_another_version_ran_are_told_of(short: str, tmp_path: Path) -> None:
    chosen = study(short, 2)
    assert not perform(chosen, tmp_path).notes
    file = trial_file(tmp_path, chosen.trials()[0])
    record = TrialFile.load(file)
    dataclasses.replace(record, versions={**record.versions, "numpy": "1.0"}).save(file)
    (note,) = perform(chosen, tmp_path).notes
    assert "1 of 2 trials were run by other versions, the first by numpy 1.0 (now " in note


@pytest.mark.parametrize("damage", ["cut", "changed", "empty"])
def test_a_damaged_file_is_found_said_and_made_again(
    short: str, tmp_path: Path, damage: str
) -> None:
    chosen = study(short, 2)
    before = text_of(perform(chosen, tmp_path / "out"))
    file = trial_file(tmp_path / "out", chosen.trials()[1])
    content = file.read_bytes()
    damaged = {
        "cut": content[: len(content) // 2],
        "changed": content.replace(b'"operator": 1', b'"operator": 7'),
        "empty": b"",
    }
    assert damaged[damage] != content
    file.write_bytes(damaged[damage])
    again = perform(chosen, tmp_path / "out")
    assert text_of(again) == before
    (note,) = again.notes
    assert str(file) in note
    assert "damaged" in note
    assert "made again" in note


def test_a_full_disk_is_said_and_leaves_whole_files_only(short: str, tmp_path: Path) -> None:
    """The system's limit on a file's size stands in for the disk's end."""
    chosen, folder = study(short, 3), tmp_path / "out"
    perform(dataclasses.replace(chosen, operators=1), folder)
    perform(dataclasses.replace(chosen, operators=1, laws=(Law(period=0.03),)), folder)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, hard))
    try:
        with pytest.raises(RunFileError, match=r"could not be written.*1 of 3 trials are kept"):
            perform(chosen, folder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert len(list((folder / RUNS).iterdir())) == 2
    assert text_of(perform(chosen, folder)) == text_of(perform(chosen, tmp_path / "whole"))


def test_what_another_process_cannot_write_is_an_error_of_ours(short: str, tmp_path: Path) -> None:
    """A folder has the name of the second of six files."""
    chosen = study(short, 6)
    trial_file(tmp_path, chosen.trials()[1]).mkdir(parents=True)
    with pytest.raises(RunFileError, match=r"could not be written.*of 6 trials are kept: once"):
        perform(chosen, tmp_path, jobs=2)


def test_a_folder_of_another_study_is_refused(short: str, tmp_path: Path) -> None:
    perform(study(short, 1), tmp_path / "out")
    with pytest.raises(RunFileError, match="of another study"):
        perform(study(short, 1, seed=1), tmp_path / "out")


def test_a_file_of_another_law_is_not_taken_for_ones_own(short: str, tmp_path: Path) -> None:
    own, other = (
        Study(short, 1, laws=(Law(period=0.02, options=(("gain", k),)),)) for k in (20.0, 40.0)
    )
    perform(other, tmp_path)
    file = trial_file(tmp_path, other.trials()[0])
    file.rename(trial_file(tmp_path, own.trials()[0]))
    with pytest.raises(RunFileError, match="of another study"):
        perform(own, tmp_path)


def test_a_study_takes_limits_for_its_arms_and_goes_on_only_with_the_same(
    short: str, tmp_path: Path
) -> None:
    own = study(short, 1)
    (trial,) = dataclasses.replace(own, limits=ArmLimits(acceleration=2.0, jerk=40.0)).trials()
    made = trial.made().insertion().arm
    assert (made.acceleration[0], made.jerk[0]) == (2.0, 40.0)
    assert own.trials()[0].made().limits is None
    assert trial.made().to_json() != own.trials()[0].made().to_json()  # which tells studies apart


def test_arms_of_one_files_name_have_files_of_their_own(tmp_path: Path) -> None:
    arms = (str(tmp_path / "a" / "arm.urdf"), str(tmp_path / "b" / "arm.urdf"))
    stems = [trial.stem for trial in Study(operators=1, arms=arms).trials()]
    assert len(set(stems)) == 2
    assert all(re.fullmatch(r"arm_[0-9a-f]{8}_dual_quaternion_8ms_operator0000", x) for x in stems)
    odd = Law(options=(("objective", "a/b c"),)).stem
    assert "/" not in odd
    assert odd != Law(options=(("objective", "a/bc"),)).stem


def test_an_arm_that_is_there_twice_is_refused(short: str, tmp_path: Path) -> None:
    """The scenario's own, which is the Panda, and the Panda: nobody counts twice."""
    with pytest.raises(OptionError, match=r"are only \['panda'\]; give each once"):
        perform(study(short, 1, arms=("panda", "")), tmp_path)


OWN = """
from dataclasses import dataclass
from typing import ClassVar
import sys
import numpy as np
from rcmqp.controllers import CONTROLLERS, Command, Controller
from rcmqp.experiments.study.perform import perform
from rcmqp.experiments.study.plan import Law, Study

@dataclass(frozen=True, eq=False)
class Hold(Controller):
    name: ClassVar[str] = "hold"
    def _step(self, state, reference):
        return Command(np.zeros(self.insertion.arm.nv))

if __name__ == "__main__":
    CONTROLLERS["hold"] = Hold
    done = perform(Study(sys.argv[1], 2, laws=(Law("hold", 0.02),)), sys.argv[2], jobs=2)
    print([outcome.failure for outcome in done.outcomes], len(done.notes))
"""


def test_ones_own_controller_goes_along_to_other_processes(short: str, tmp_path: Path) -> None:
    """A program that defines one, and two processes that have never heard of it."""
    (tmp_path / "own.py").write_text(OWN, encoding="utf-8")
    call = [sys.executable, str(tmp_path / "own.py"), short, str(tmp_path / "out")]
    found = subprocess.run(call, capture_output=True, text=True, check=True)
    assert found.stdout == "['', ''] 0\n"


LAW = """
import dataclasses
from rcmqp.controllers import Command, DualQuaternion

@dataclasses.dataclass(frozen=True, eq=False)
class Mine(DualQuaternion):
    def _step(self, state, reference):
        return Command({share} * super()._step(state, reference).v)
"""


def law_of(file: Path, share: float) -> type[DualQuaternion]:
    """The class in a file that is written, or written again."""
    file.write_text(LAW.format(share=share), encoding="utf-8")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[file.stem] = importlib.util.module_from_spec(spec)
    exec(compile(file.read_bytes(), file, "exec"), module.__dict__)  # past cached byte-code
    return cast(type[DualQuaternion], module.Mine)


def test_a_controller_of_ones_own_that_was_edited_runs_again(
    short: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, notes = [], []
    for share in (1.0, 0.5, 0.5):
        monkeypatch.setitem(CONTROLLERS, "mine", law_of(tmp_path / "mine_law.py", share))
        done = perform(Study(short, 1, laws=(Law("mine", 0.02),)), tmp_path)
        found.append(done.outcomes[0].digest)
        notes.append(list(done.notes))
    assert found[0] != found[1] == found[2]
    assert notes[0] == notes[2] == []
    (note,) = notes[1]
    assert note == (
        "mine, 20 ms or its code or URDF has changed since it was run; 1 trials are made again"
    )


@pytest.mark.filterwarnings("ignore:.*axis points outwards")  # Kinova's frame
def test_an_identity_knows_the_urdf_the_options_and_the_files_of_the_code(
    short: str, tmp_path: Path
) -> None:
    scenario = study(short, 1).trials()[0].made()

    def made(kind: type[DualQuaternion], limit: str = "", **options: float) -> str:
        urdf = load_arm("kinova").urdf
        assert urdf is not None
        (tmp_path / "arm.urdf").write_text(urdf.read_text() + limit)
        arm = load_arm(str(tmp_path / "arm.urdf"), "j2s6s200_end_effector")
        insertion = Insertion.on_shaft(arm, Instrument())
        return identity(kind(insertion, 0.01, **options), scenario)  # type: ignore[arg-type]

    mine = law_of(tmp_path / "mine_law.py", 1.0)
    first = made(mine)
    assert first == made(mine)
    others = [made(DualQuaternion), made(mine, "<!-- -->"), made(mine, gain=59.0)]
    law_of(tmp_path / "mine_law.py", 0.5)
    assert len({first, *others, made(mine)}) == 5
    (tmp_path / "mine_law.py").unlink()  # as in a notebook: nobody can say that it is the same
    assert made(mine) != made(mine)


def test_a_scenarios_file_that_was_edited_is_read_again(tmp_path: Path) -> None:
    file, ends = tmp_path / "short.py", []
    for duration in (0.2, 0.4):
        file.write_text(SHORT.format(duration=duration), encoding="utf-8")
        done = perform(study(str(file), 1), tmp_path / str(duration))
        ends.append(done.record(0).traces["time"][-1])
    assert_allclose(ends, [0.2, 0.4], atol=1e-6)


def test_a_flange_without_a_urdf_is_refused(short: str) -> None:
    with pytest.raises(OptionError, match="flange = tool0 is for a URDF"):
        study(short, 1, arms=("lwa3",), flange="tool0")


def test_people_are_drawn_never_put_in_place_of_a_scenarios_own(tmp_path: Path) -> None:
    own = SHORT.format(duration=0.4).replace(
        "duration=0.4", "path=CameraTrial(operator=Operator(delay=0.3))"
    )
    file = tmp_path / "own.py"
    file.write_text(
        f"from rcmqp.references.operators import CameraTrial, Operator\n{own}", encoding="utf-8"
    )
    with pytest.raises(OptionError, match="has an operator of its own"):
        perform(study(str(file), 1), tmp_path / "out")


@pytest.mark.parametrize(
    ("option", "message"),
    [(("--jobs", "0"), "jobs = 0"), (("--period", "0"), r"period = 0.0 s, it must be positive")],
)
def test_zero_jobs_and_a_period_of_zero_are_refused(
    short: str,
    tmp_path: Path,
    option: tuple[str, str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["study", short, *option, "--out", str(tmp_path / "out")])
    assert ended.value.code == 1
    assert message in capsys.readouterr().err


@pytest.mark.usefixtures("dask")
def test_a_study_runs_on_a_dask_cluster_with_the_same_outcomes(short: str, tmp_path: Path) -> None:
    on_dask = perform(study(short, 3), tmp_path / "dask", jobs=-1)
    with joblib.parallel_config("sequential"):
        assert text_of(on_dask) == text_of(perform(study(short, 3), tmp_path / "here"))


def test_what_cannot_be_made_is_found_before_the_work(short: str, tmp_path: Path) -> None:
    with pytest.raises(UnknownName, match="did you mean gain"):
        perform(
            Study(short, 2, laws=(Law(period=0.02, options=(("gane", 1.0),)),)), tmp_path / "out"
        )
    with pytest.raises(OptionError, match="nobody steers in conical_helix"):
        perform(study("conical_helix"), tmp_path / "out")
    with pytest.raises(OptionError, match="none twice"):
        Study(laws=(SLOW, SLOW))
    with pytest.raises(OptionError, match="operators = 0"):
        Study(operators=0)
    with pytest.raises(OptionError, match="tremor cannot be shown"):
        Law(period=0.1)


def test_a_law_is_unpickled_where_its_controller_is_not_known_yet(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(CONTROLLERS, "later", CONTROLLERS["damped"])
    sent = pickle.dumps(Law("later", 0.02))
    monkeypatch.delitem(CONTROLLERS, "later")
    assert pickle.loads(sent).name == "later"


# What is in the files ----------------------------------------------------------------------


# The command line --------------------------------------------------------------------------


def test_the_command_leaves_trials_tables_operators_and_figures(
    short: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    call = ["study", short, "--operators", "2", "--period", "0.02", "--gain", "30", "--gain", "60"]
    with pytest.raises(SystemExit) as ended:
        main([*call, "--out", str(folder)])
    assert ended.value.code == 0
    printed = capsys.readouterr().out
    assert "gain = 30.0" in printed
    assert "Paired comparisons" in printed
    names = {path.name for path in folder.iterdir()}
    figures = ("fig4_views", "fig6_errors", "fig7_trajectory", "groups")
    assert names == {"runs", "table.md", "trials.csv", "operators.csv"} | {
        f"{figure}.{end}" for figure in figures for end in ("png", "pdf")
    }
    people = list(csv.DictReader(io.StringIO((folder / "operators.csv").read_text("utf-8"))))
    assert [row["operator"] for row in people] == ["unit", "low", "high", "source", "0", "1"]
    with pytest.raises(SystemExit):
        main([*call, "--out", str(folder), "--json"])
    assert len(json.loads(capsys.readouterr().out)) == 4


def test_tables_are_written_with_who_took_part(short: str, tmp_path: Path) -> None:
    performed = perform(study(short, 2), tmp_path)
    text, files = write_tables(performed)
    assert text in (tmp_path / "table.md").read_text(encoding="utf-8")
    assert all(file.stat().st_size for file in files)
    assert os.listdir(tmp_path / RUNS)
