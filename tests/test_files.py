from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from rcmqp.errors import RunFileError
from rcmqp.files import check_writable, make_folder, sweep, whole_file


def spoil(file: Path, failure: Exception) -> None:
    with whole_file(file) as part:
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
    for words in ("[Errno 28] No space left on device: '{}'", "unable to open file: name = '{}'"):
        with (
            pytest.raises(RunFileError, match=f"{file}: could not be written: ") as raised,
            whole_file(file) as part,
        ):
            raise OSError(words.format(part))
        assert part.name not in str(raised.value)


def test_a_whole_file_takes_its_name_and_keeps_its_ending(tmp_path: Path) -> None:
    with whole_file(tmp_path / "x.txt") as part:
        assert part.suffix == ".txt"
        part.write_text("new")
        assert not (tmp_path / "x.txt").exists()
    assert [path.read_text() for path in tmp_path.iterdir()] == ["new"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("law.py", "law.py: is a file; give the name of a folder"),
        ("law.py/out", "law.py/out: cannot be made: {}/law.py is a file"),
        ("law.py/a/b", "law.py/a/b: cannot be made: {}/law.py is a file"),
        ("x" * 300, "x: cannot be made: File name too long"),
        ("a\0b", "cannot be made: no name of a folder"),
        ("link", "link: is a link to nothing; remove it"),
    ],
)
def test_a_folder_that_cannot_be_made_is_said_without_an_error_number(
    tmp_path: Path, name: str, said: str
) -> None:
    (tmp_path / "law.py").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "gone")
    with pytest.raises(RunFileError) as raised:
        make_folder(tmp_path / name)
    assert said.format(tmp_path) in str(raised.value)
    assert "Errno" not in str(raised.value)
    assert (tmp_path / "law.py").read_text() == "mine"


# Folders that several hosts share ------------------------------------------------------------


@pytest.fixture
def dead() -> int:
    """Number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_a_sweep_removes_only_what_dead_processes_of_this_host_left(
    tmp_path: Path, dead: int
) -> None:
    here, stay = platform.node(), list[str]()
    for host, process, stays in (
        (here, dead, False),
        (here, os.getppid(), True),
        (f"{here}.else", dead, True),
        (f"else@{here}x", dead, True),
        ("elsewhere", dead, True),
    ):
        path = tmp_path / f".x@y@{host}@{process}-0.part.h5"
        path.touch()
        stay += [path.name] * stays
    for name in (".x.part", f"x@{here}@{dead}-0.part.h5", f".x.{here}.{dead}"):
        (tmp_path / name).touch()
        stay.append(name)
    assert sweep(tmp_path) == 1
    assert {path.name for path in tmp_path.iterdir()} == set(stay)


def test_another_host_does_not_remove_what_is_being_written(
    tmp_path: Path, dead: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Process numbers mean nothing elsewhere: on the other host, the writer's seems dead."""
    monkeypatch.setattr(platform, "node", lambda: "first")
    monkeypatch.setattr(os, "getpid", lambda: dead)
    with whole_file(tmp_path / "a.txt") as part:
        part.write_text("a")
        with monkeypatch.context() as other:
            other.setattr(platform, "node", lambda: "second")
            check_writable(tmp_path / "a.txt")
            with whole_file(tmp_path / "a.txt") as theirs:
                theirs.write_text("b")
        assert part.read_text() == "a"
        assert (tmp_path / "a.txt").read_text() == "b"
    assert [path.read_text() for path in tmp_path.iterdir()] == ["a"]


def test_a_process_killed_while_it_writes_leaves_the_earlier_file_and_its_part(
    tmp_path: Path,
) -> None:
    file = tmp_path / "x.txt"
    file.write_text("old")
    program = (
        "import sys, time\nfrom rcmqp.files import whole_file\n"
        "with whole_file(sys.argv[1]) as part:\n"
        "    part.write_text('half')\n    print(flush=True)\n    time.sleep(600)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, file], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert sweep(tmp_path) == 0  # it still runs
        process.kill()
    assert file.read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 2
    with whole_file(file) as part:
        part.write_text("new")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["new"]
