from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from rcmqp.errors import RunFileError
from rcmqp.files import whole


def spoil(file: Path, failure: Exception) -> None:
    with whole(file) as part:
        part.write_text("half")
        raise failure


def test_a_file_that_fails_leaves_what_was_there_and_nothing_else(tmp_path: Path) -> None:
    file = tmp_path / "x.txt"
    file.write_text("old")
    for failure, raised in ((OSError("full"), RunFileError), (KeyError("full"), KeyError)):
        with pytest.raises(raised, match="full"):
            spoil(file, failure)
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_the_message_names_the_file_that_was_asked_for_only(tmp_path: Path) -> None:
    file = tmp_path / "x.txt"
    hidden = f".{os.getpid()}.x.txt"
    for failure in (
        OSError(errno.ENOSPC, "No space left on device", str(tmp_path / hidden)),
        OSError(f"unable to open file: name = '{tmp_path / hidden}'"),
    ):
        with pytest.raises(RunFileError, match=f"{file}: could not be written: ") as raised:
            spoil(file, failure)
        assert hidden not in str(raised.value)


def test_a_whole_file_takes_its_name_and_keeps_its_ending(tmp_path: Path) -> None:
    with whole(tmp_path / "x.txt") as part:
        assert part.suffix == ".txt"
        part.write_text("new")
        assert not (tmp_path / "x.txt").exists()
    assert [path.read_text() for path in tmp_path.iterdir()] == ["new"]
