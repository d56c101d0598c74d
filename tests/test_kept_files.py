"""No command writes over the run of another; it may write over its own."""

from __future__ import annotations

import shlex
from pathlib import Path

import h5py
import pytest

from rcmqp.cli import main
from rcmqp.errors import RunFileError
from rcmqp.experiments.experiment_a import HELIX, LAW, helix, reproduce_a
from rcmqp.runs.head import check_own
from rcmqp.runs.run import Run

RUN = "run circle -a panda --duration 0.02 --out"


def told(command: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and what stderr says, in one line."""
    with pytest.raises(SystemExit) as ended:
        main(shlex.split(command))
    code = ended.value.code
    assert code is None or isinstance(code, int)
    return code or 0, " ".join(capsys.readouterr().err.split())


@pytest.fixture
def kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    assert told(f"{RUN} {tmp_path / 'run.h5'}", capsys)[0] == 0
    return tmp_path / "run.h5"


@pytest.mark.parametrize(
    "more", ["-c damped", "--set K_c=3", "--period 0.002", "--seed 1", "--instrument wide.toml"]
)
def test_run_keeps_another_run(
    more: str, kept: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(kept.parent)
    Path("wide.toml").write_text("radius = 0.006")
    before = kept.read_bytes()
    code, said = told(f"{RUN} run.h5 {more}", capsys)
    assert code == 1
    assert "run.h5: holds another run, circle on panda, dual_quaternion; give another" in said
    assert kept.read_bytes() == before


def test_the_same_command_may_write_over_its_run_and_over_a_damaged_one(
    kept: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = kept.stat().st_ino
    assert told(f"{RUN} {kept}", capsys)[0] == 0
    assert kept.stat().st_ino != first
    kept.write_bytes(kept.read_bytes()[:5000])
    assert told(f"{RUN} {kept}", capsys)[0] == 0
    assert len(Run.load(kept).time) == 21


def test_a_file_that_is_no_run_is_kept(kept: Path) -> None:
    with h5py.File(kept, "w") as file:
        file.attrs["mine"] = 1
    with pytest.raises(RunFileError, match=r"is there already, and is no run"):
        check_own(kept)


def test_a_recording_in_real_time_keeps_every_run(
    kept: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = told(f"loopback --minutes 0.01 --out {kept}", capsys)
    assert (code, "holds another run" in said) == (1, True)
    code, said = told(f"live circle -a panda --no-open --out {kept}", capsys)
    assert (code, "holds another run" in said) == (1, True)


def test_compare_keeps_the_runs_of_another_comparison(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    compare = f"compare -s circle -a panda -c dual_quaternion --duration 0.02 -o {tmp_path}"
    assert told(compare, capsys)[0] == 0
    file = tmp_path / "circle_panda_dual_quaternion.h5"
    before = {each: each.read_bytes() for each in tmp_path.iterdir()}
    code, said = told(f"{compare} -c damped --period 0.002", capsys)
    assert code == 1
    assert f"{file.name}: holds another run, circle on panda" in said
    assert {each: each.read_bytes() for each in tmp_path.iterdir()} == before
    code, said = told(f"{compare} -c damped", capsys)
    assert (code, "1 of 2 runs" in said) == (0, True)


def test_reproduce_keeps_runs_of_another_length(tmp_path: Path) -> None:
    file = tmp_path / "lwa3_8ms.h5"
    helix(HELIX, LAW, "lwa3", 0.008, 0.05).save(file)
    with pytest.raises(RunFileError, match=r"lwa3_8ms\.h5: holds another run"):
        reproduce_a(tmp_path, arms=("lwa3",), duration=0.1)
    assert list(tmp_path.iterdir()) == [file]
