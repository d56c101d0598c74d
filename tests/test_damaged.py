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
SAMPLE = [case for case in range(80) if case % 5 in (0, 2, 3)]
"""Of ten rounds over the eight good files, each round with the next kind of damage."""


def test_no_damaged_file_ends_in_a_traceback_a_hang_or_a_look_elsewhere() -> None:
    found = list(damaged.answers(SAMPLE))
    assert [each for each in found if each.fault] == []
    assert {each.damage.partition(" ")[0] for each in found} == KINDS
    assert len({each.damage.partition(" of ")[2] for each in found}) == 8
    refused = [each for each in found if each.code == 1]
    assert len(refused) > 100
    assert all(each.said.strip() for each in refused)


def test_a_fault_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(rcmqp.cli.run, "_show", broken)
    found = list(damaged.answers([1]))
    assert [each.command for each in found if each.fault == "traceback"] == ["show"]
