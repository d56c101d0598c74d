"""Files that anybody may have made: each is refused in a sentence that names file and part."""

from __future__ import annotations

import csv
import io
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rcmqp import Run, Scenario, load_scenario, make_controller, simulate
from rcmqp.cli import DEBUG, main
from rcmqp.cli import run as run_commands
from rcmqp.cli.console import err, out
from rcmqp.errors import OptionError, RunFileError
from rcmqp.experiments.study.perform import remake
from rcmqp.runs.run_file import RunFile
from rcmqp.runs.untrusted import one_line, printable, shortened
from rcmqp.show.table import Table

ATTRIBUTES = (
    "scenario",
    "controller",
    "options",
    "versions",
    "joints",
    "urdf_sha256",
    "given",
    "assumed",
    "digest",
    "format_version",
)
JSON = ("scenario", "options", "versions", "joints", "given", "assumed")
DEEP = "[" * 100_000


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("good") / "run.h5"
    scenario = load_scenario("conical_helix", duration=0.02)
    simulate(
        scenario, make_controller("dual_quaternion", scenario.insertion(), scenario.period)
    ).save(path)
    with h5py.File(path.with_name("secret.h5"), "w") as file:
        file["data"] = np.zeros(21)
    path.with_name("secret.raw").write_bytes(bytes(8 * 21))
    return path


@pytest.fixture
def saved(good: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(good, tmp_path / "run.h5"))


def refused(path: Path, part: str) -> str:
    """Load it in both ways; what is said is one sentence with the file and the part."""
    said = []
    with pytest.raises(RunFileError) as error:
        Run.load(path)
    said.append(str(error.value))
    with pytest.raises(RunFileError) as error, RunFile(path):
        pass
    said.append(str(error.value))
    for text in said:
        assert text.startswith(f"{path}: ")
        assert part in text
        assert "\n" not in text
        assert len(text) < 1000
    return said[0]


# Links and sizes ---------------------------------------------------------------------------


def external(file: h5py.File, folder: Path) -> None:
    file["tilt"] = h5py.ExternalLink(str(folder / "secret.h5"), "data")


def soft(file: h5py.File, folder: Path) -> None:
    file["tilt"] = h5py.SoftLink("/depth")


def virtual(file: h5py.File, folder: Path) -> None:
    layout = h5py.VirtualLayout((21,), "f8")
    layout[...] = h5py.VirtualSource(str(folder / "secret.h5"), "data", (21,))
    file.create_virtual_dataset("tilt", layout)


def raw(file: h5py.File, folder: Path) -> None:
    file.create_dataset("tilt", (21,), "f8", external=[(str(folder / "secret.raw"), 0, 168)])


@pytest.mark.parametrize("elsewhere", [external, soft, virtual, raw])
def test_nothing_but_the_file_itself_is_read(
    elsewhere: Callable[[h5py.File, Path], None], good: Path, saved: Path
) -> None:
    """The numbers elsewhere are of the right shape: only their place is wrong."""
    with h5py.File(saved, "r+") as file:
        del file["tilt"]
        elsewhere(file, good.parent)
        assert file["tilt"].shape == (21,)
    said = refused(saved, "tilt")
    assert "not followed" in said or "not read" in said


@pytest.mark.parametrize("rows", [10**12, 22, 20, 0])
def test_rows_are_the_scenarios_cycles_before_any_is_read(rows: int, saved: Path) -> None:
    with h5py.File(saved, "r+") as file:
        del file["v"]
        file.create_dataset("v", (rows, 7), "f8", chunks=(64, 7), maxshape=(None, 7))
    refused(saved, "v")


def test_every_dataset_together_is_no_larger_than_the_file(saved: Path) -> None:
    """A small file whose datasets are one and the same, many times."""
    with h5py.File(saved, "r+") as file:
        file["a"] = np.zeros(100_000)
        for i in range(100):
            file[f"a{i}"] = file["a"]
    refused(saved, "the whole file has")


@pytest.mark.parametrize("rows", [10**12, 22])
def test_a_diagnostic_that_is_missing_in_part_has_the_scenarios_cycles(
    rows: int, saved: Path
) -> None:
    """Of a diagnostic that is not there every time, the file may keep nothing."""
    for count, number in ((21, np.nan), (rows, None)):
        with h5py.File(saved, "r+") as file:
            file.pop("diagnostics/a", None)
            made = file.create_dataset(
                "diagnostics/a", (count,), "f8", chunks=(21,), fillvalue=np.nan
            )
            made.attrs.update(unit="", meaning="")
            file.attrs["digest"] = "" if number is None else Run.read(file, slice(None)).digest
        if number is not None:
            assert np.isnan(Run.load(saved).diagnostics["a"]).all()
    refused(saved, "diagnostics/a has shape")


def test_a_run_has_no_more_cycles_than_its_scenario(saved: Path) -> None:
    with h5py.File(saved, "r+") as file:
        scenario = json.loads(file.attrs["scenario"]) | {"duration": 0.01}
        file.attrs["scenario"] = json.dumps(scenario)
    refused(saved, "time has 21 rows, the scenario 11 cycles")


@pytest.mark.parametrize("dtype", ["i8", "c16", "f2", h5py.string_dtype(), h5py.ref_dtype])
def test_datasets_hold_numbers(dtype: Any, saved: Path) -> None:
    with h5py.File(saved, "r+") as file:
        del file["tilt"]
        file.create_dataset("tilt", (21,), dtype)
    refused(saved, "tilt")


# Attributes --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ATTRIBUTES)
@pytest.mark.parametrize("value", [np.nan, np.inf, np.zeros(3), h5py.Empty("f8"), b"\xff"])
def test_an_attribute_of_another_type_is_named(name: str, value: Any, saved: Path) -> None:
    with h5py.File(saved, "r+") as file:
        file.attrs[name] = value
    refused(saved, name)


@pytest.mark.parametrize("text", [DEEP, '{"a":' * 100_000, "NaN", "1e999", "[", '"text"', "0"])
@pytest.mark.parametrize("name", [*JSON, "stops"])
def test_json_that_says_something_else_is_named(name: str, text: str, saved: Path) -> None:
    with h5py.File(saved, "r+") as file:
        if name == "stops":
            del file["stops"]
            file["stops"] = text
        else:
            file.attrs[name] = text
    refused(saved, name)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("controller", "x" * 5000),
        ("options", json.dumps({"x" * 5000: 1})),
        ("options", '{"gain": NaN}'),
        ("options", '{"gain": "much"}'),
        ("versions", '{"numpy": 2}'),
        ("joints", "[1, 2, 3, 4, 5, 6, 7]"),
        ("joints", '["one"]'),
        ("assumed", '["speed"]'),
        ("given", '{"limits": ["all"]}'),
        ("given", '{"limits": null, "gain": "much"}'),
        ("stops", '{"why": []}'),
        ("stops", '{"why": [21]}'),
        ("stops", '{"why": [true]}'),
        ("stops", '{"why": 3}'),
    ],
)
def test_a_value_that_cannot_be_is_named(name: str, text: str, saved: Path) -> None:
    with h5py.File(saved, "r+") as file:
        if name == "stops":
            del file["stops"]
            file["stops"] = text
        else:
            file.attrs[name] = text
    refused(saved, name)


# Scenarios and trials ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        {"name": "x" * 5000},
        {"arm": "x" * 5000},
        {"arm": "a\0b"},
        {"flange": 3},
        {"obstacles": 3},
        {"instrument": [1]},
        {"path": {"kind": ["circle"]}},
        {"path": {"kind": None}},
        {"period": 1e301},
        {"limits": [1]},
    ],
    ids=str,
)
def test_a_scenario_with_an_absurd_value_is_refused(change: dict[str, Any]) -> None:
    text = load_scenario("conical_helix").to_json()
    with pytest.raises(OptionError) as error:
        Scenario.from_json(json.dumps(json.loads(text) | change))
    (name,) = change
    assert name in str(error.value)
    assert len(str(error.value)) < 500


@pytest.mark.parametrize("text", [DEEP, '{"path":' * 100_000, '{"period": NaN}'])
def test_a_scenario_file_that_is_nested_or_no_number_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "deep.json").write_text(text)
    with pytest.raises(OptionError, match=r"cannot read the scenario .*deep\.json"):
        load_scenario(str(tmp_path / "deep.json"))


def test_a_run_is_no_trial_and_a_trial_that_is_nested_is_refused(saved: Path) -> None:
    with pytest.raises(RunFileError, match="no trial of a study"):
        remake(saved)
    with h5py.File(saved, "r+") as file:
        file.attrs["format"], file.attrs["format_version"] = "rcmqp trial", 5
        for name in [*file]:
            del file[name]
        file.attrs["law"] = file.attrs["made_of"] = ""
        file.attrs["outcome"] = DEEP
    with pytest.raises(RunFileError, match="outcome: RecursionError"):
        remake(saved)


# What is printed ---------------------------------------------------------------------------

EVIL = "\x1b[2Ja\x07\x9b1m\u202eb\udcff"


def test_control_characters_are_printed_as_escapes() -> None:
    assert printable(EVIL) == r"\x1b[2Ja\x07\x9b1m\u202eb\udcff"
    assert printable("µ\tñ\n中") == "µ\tñ\n中"
    assert one_line("a\nb") == r"a\nb"
    assert len(shortened("x" * 5000)) < 1100


def test_nothing_that_is_printed_runs_a_terminal_escape(
    capsys: pytest.CaptureFixture[str],
) -> None:
    out.print(EVIL)
    err.print(EVIL)
    out.print(Table([EVIL], [[EVIL]]))
    said = "".join(capsys.readouterr())
    assert said.count(r"\x1b[2Ja\x07") == 4
    assert not {"\x1b", "\x07", "\x9b", "\u202e"} & set(said)


def test_a_name_out_of_a_file_runs_no_terminal_escape(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = json.loads(load_scenario("conical_helix", duration=0.02).to_json())
    (tmp_path / "s.json").write_text(json.dumps(scenario | {"name": "\x1b[2J\nhelix"}))
    for line in (["run", str(tmp_path / "s.json")], ["show", str(tmp_path / "\x1b[2J.h5")]):
        with pytest.raises(SystemExit):
            main(line)
        said = "".join(capsys.readouterr())
        assert r"\x1b[2J" in said
        assert "\x1b" not in said


def test_a_spreadsheet_runs_no_cell() -> None:
    cells = ["=1+1", "+a", "-1+1", "@a", "\tb", "plain", "", -1.5, None, "-1.5"]
    text = Table(["=head", *map(str, range(9))], [cells]).csv()
    head, row = csv.reader(io.StringIO(text))
    assert head[0] == "'=head"
    quoted = ["'=1+1", "'+a", "'-1+1", "'@a", "'\tb"]
    assert row == [*quoted, "plain", "", "-1.5", "", "-1.5"]


@pytest.mark.parametrize("debug", ["", "1"])
def test_an_error_that_nobody_foresaw_is_a_sentence(
    debug: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setenv(DEBUG, debug)
    monkeypatch.setattr(run_commands, "_show", broken)
    with pytest.raises(SystemExit) as end:
        main(["show", "run.h5"])
    said = capsys.readouterr().err
    assert end.value.code == 1
    assert "ZeroDivisionError: by nothing; please report" in said
    assert ("Traceback" in said) == bool(debug)
