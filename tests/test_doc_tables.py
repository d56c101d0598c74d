"""The numbers in the tables of docs/ are those that the commands above them give.

The whole file takes less than a minute of processor time. So commands that take longer are run in
part, if they have a row for each controller; all else of them is compared with what `make tables`
has put on record, with the kernel that made it.
"""

from __future__ import annotations

import json
import re
import shlex
import sys
from pathlib import Path

import pytest

from rcmqp.cli import main
from rcmqp.controllers.settings import every_setting

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from doc_tables import MARKED, RESULTS, marked, tables_in

RECORD = json.loads(RESULTS.read_text(encoding="utf-8"))
OWN = [law for law in every_setting() if law.startswith(("dual_quaternion", "hierarchical"))]
"""Settings of the two controllers that are in compiled code."""

COMMANDS = list(dict.fromkeys(each.command for each in marked()))

WHOLE = [
    command
    for command in COMMANDS
    if command == "rcmqp reproduce" or command.startswith("rcmqp compare -s conical_helix ")
]
"""Those that are quick enough to be run here as they stand, but for figures."""


def written(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, list[str]]:
    """The tables that a command writes now; it draws and shows nothing."""
    monkeypatch.setattr("rcmqp.experiments.compare._draw", lambda *_: None)
    monkeypatch.setattr("rcmqp.experiments.experiment_a.write_report", lambda *_, **__: [])
    monkeypatch.chdir(folder)
    with pytest.raises(SystemExit) as ended:
        main(shlex.split(command)[1:])
    assert not ended.value.code
    return tables_in(folder)


def test_every_marked_table_is_the_one_on_record() -> None:
    assert len(COMMANDS) >= 4
    assert set(RECORD) == set(COMMANDS)
    for each in marked():
        assert each.text, f"{each.document.name}: make tables, for {each.command}"
        assert each.text == RECORD[each.command]["tables"][each.name]
        assert re.fullmatch("[0-9a-f]{64}", RECORD[each.command]["kernel"])


@pytest.mark.parametrize("command", WHOLE)
def test_a_quick_command_writes_the_tables_that_stand_there(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = written(command, tmp_path, monkeypatch)
    for each in marked():
        if each.command == command:
            assert each.text == tables[each.file][each.number - 1]


@pytest.mark.parametrize(
    "command",
    [x for x in COMMANDS if x.startswith("rcmqp compare") and x not in WHOLE],
)
def test_a_long_comparison_has_the_rows_of_our_own_controllers(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert " -c " not in command
    laws = " ".join(f"-c {law}" for law in OWN)
    tables = written(f"{command} {laws}", tmp_path, monkeypatch)
    for each in marked():
        if each.command == command:
            title, _, *lines = tables[each.file][each.number - 1].splitlines()
            _, _, *rows = (line for line in lines if line.startswith("|"))
            assert each.text.startswith(title)
            assert len(rows) == len(OWN) == 5
            for row in rows:
                assert f"{row}\n" in each.text


def test_a_mark_takes_its_table_and_the_line_above_it_and_nothing_else() -> None:
    mark, table = "<!-- a/b.md, table 2: rcmqp run x -->\n\n", "| a |\n| --- |\n| 1 |\n"
    for text in (table, f"Errors: all\n\n{table}", f"{table}\n- a: b\n- c\n", ""):
        (found,) = MARKED.finditer(f"Before.\n\n{mark}{text}\nOne line.\n\n| other |\n")
        assert found.groups() == ("a/b.md", "2", "rcmqp run x", text)
