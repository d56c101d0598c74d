"""Damaged files over the whole command line: a sample of what benchmarks/damaged.py tries."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import rcmqp.cli.run

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
import damaged
from damage import OF_HDF5, OF_JSON

KINDS = {kind.__name__ for kind in (*OF_HDF5, *OF_JSON)}
SAMPLE = [9 * k + 7 * k % 9 for k in range(60)]
"""Cases that take turns with the nine good files and the kinds of damage."""


def test_no_damaged_file_ends_in_a_traceback_a_hang_or_a_look_elsewhere() -> None:
    found = list(damaged.answers(SAMPLE))
    assert [each for each in found if each.fault] == []
    assert {each.damage.partition(" ")[0] for each in found} == KINDS
    assert len({each.damage.partition(" of ")[2] for each in found}) == 9
    refused = [each for each in found if each.code == 1]
    assert len(refused) > 100
    assert all(each.said.strip() for each in refused)


def test_a_fault_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(rcmqp.cli.run, "_show", broken)
    found = list(damaged.answers([1]))
    assert [each.command for each in found if each.fault == "traceback"] == ["show"]
