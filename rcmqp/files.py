"""Atomic writing of files, on shared folders too; folders and names of files."""

from __future__ import annotations

import itertools
import os
import platform
import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from rcmqp.errors import OptionError, RunFileError

_COUNT = itertools.count()
"""Numbers the part files of this process."""


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write a file atomically: yield a part file's path, rename it to ``path`` at the end.

    What ``path`` held before stays until then, and stays if the block raises. The part file is in
    the same folder, has the same ending, and names this host and process, so several hosts may
    share the folder. A process that is killed leaves its part file; the next one that writes into
    the folder on the same host removes it, see sweep().

    Raises:
        RunFileError: the file cannot be written.
    """
    target = Path(path).resolve()
    sweep(target.parent)
    part = _part(target)
    try:
        yield part
        with part.open("rb+") as stream:
            os.fsync(stream.fileno())  # on the disk before it has its name
        part.replace(target)
    except (OSError, RuntimeError) as error:  # h5py raises either
        reason = why(error).replace(str(part), str(target))
        raise RunFileError(Path(path), f"could not be written: {reason}") from error
    finally:
        part.unlink(missing_ok=True)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file in UTF-8, atomically.

    Raises:
        RunFileError: it cannot be written.
    """
    with whole_file(path) as part:
        part.write_bytes(text.encode())


def sweep(folder: Path) -> int:
    """Remove the part files of processes of this host that are gone; return how many.

    Part files of other hosts stay: whether their processes run cannot be seen from here.
    """
    mine = re.compile(rf"\..*@{re.escape(_host())}@(\d+)-\d+\.part(\.\w+)?")
    parts = ((file, mine.fullmatch(file.name)) for file in folder.glob(".*.part*"))
    left = [file for file, match in parts if match and not _runs(int(match[1]))]
    for file in left:
        file.unlink(missing_ok=True)
    return len(left)


def make_folder(path: str | os.PathLike[str]) -> Path:
    """Make a folder with its parents, if it is not there, and return it.

    Raises:
        RunFileError: it cannot be made.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        if not folder.exists():
            raise RunFileError(folder, "is a link to nothing; remove it") from error
        raise RunFileError(folder, "is a file; give the name of a folder") from error
    except NotADirectoryError as error:
        file = next(each for each in folder.parents if each.exists())
        raise RunFileError(folder, f"cannot be made: {file} is a file") from error
    except (OSError, ValueError) as error:
        reason = why(error) if isinstance(error, OSError) else "no name of a folder"
        raise RunFileError(folder, f"cannot be made: {reason}") from error
    return folder


def remove(path: str | os.PathLike[str]) -> None:
    """Remove a file, if it is there.

    Raises:
        RunFileError: it cannot be removed.
    """
    try:
        Path(path).unlink(missing_ok=True)
    except OSError as error:
        raise RunFileError(Path(path), f"cannot be removed: {why(error)}") from error


@contextmanager
def held(path: str | os.PathLike[str]) -> Iterator[bool]:
    """Lock a file for one process and yield whether it was free; an empty file is made first.

    The system lets it go with the process, so one that was killed holds nothing.

    Raises:
        RunFileError: it cannot be made, or its file system, or Windows, has no such locks.
    """
    try:
        import fcntl
    except ImportError as error:
        raise RunFileError(Path(path), "cannot be locked: this system has no flock()") from error
    try:
        stream = Path(path).open("ab")
    except OSError as error:
        raise RunFileError(Path(path), f"cannot be written: {why(error)}") from error
    with stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            free = True
        except BlockingIOError:
            free = False
        except OSError as error:
            raise RunFileError(Path(path), f"cannot be locked: {why(error)}") from error
        yield free


def absent(path: str | os.PathLike[str]) -> str:
    """Say why there is no file to read at a path; an error has this behind the path."""
    path = Path(path)
    try:
        if path.is_dir():
            return "is a folder"
        return "is no regular file" if path.exists() else "no such file"
    except (OSError, ValueError):  # too long a name, or NUL in it
        return "no such file"


def check_readable(path: str | os.PathLike[str], what: str, most: int = 200_000_000) -> None:
    """Refuse anything but a regular file, and files that are too large.

    Args:
        path: the file.
        what: it should be, such as ``"a CSV file"``.
        most: bytes that it may have.

    Raises:
        OptionError: it is another thing, is not there, or is too large.
    """
    if not os.path.isfile(path):
        raise OptionError(f"{path}: {absent(path)}; give the path of {what}")
    if (size := os.path.getsize(path)) > most:
        raise OptionError(f"{path} has {size} bytes, {what} has {most} at most")


def check_writable(path: str | os.PathLike[str]) -> None:
    """Check before a run that a file can be written.

    Raises:
        RunFileError: it cannot; the message says why.
    """
    path = Path(path).resolve()
    try:
        if path.is_dir():
            raise RunFileError(path, "is a folder; give the name of a file")
        if path.exists() and not path.is_file():
            raise RunFileError(path, "is no regular file; give the name of one")
        if not path.parent.is_dir():
            raise RunFileError(path, f"there is no folder {path.parent}; make it first")
        part = _part(path)
        part.touch()
        part.unlink()
    except OSError as error:
        raise RunFileError(path, f"cannot be written: {why(error)}") from error


def check_ending(path: str | os.PathLike[str], *endings: str) -> None:
    """Check the ending of a file to be written, so that a run's file is not overwritten.

    Raises:
        OptionError: it is not.
    """
    if Path(path).suffix.lower() not in endings:
        raise OptionError(f"{path}: give the name of a file that ends in {' or '.join(endings)}")


def unlike(others: Collection[str], stem: str, ending: str = "") -> str:
    """A name unlike the others: a number is added if it is among them."""
    name, count = f"{stem}{ending}", 2
    while name in others:
        name, count = f"{stem}_{count}{ending}", count + 1
    return name


def why(error: OSError | RuntimeError) -> str:
    """The system's message for an error, without the file's name and HDF5's own words."""
    number = re.search(r"[Ee]rrno =? ?(\d+)", str(error))
    return os.strerror(int(number[1])) if number else str(error)


def _part(target: Path) -> Path:
    """A new name for a file that is not complete yet."""
    name = f".{target.stem[:100]}@{_host()}@{os.getpid()}-{next(_COUNT)}.part{target.suffix}"
    return target.with_name(name)


def _host() -> str:
    """Name of this host, fit for a file's name."""
    return re.sub(r"[^\w.-]", "_", platform.node()) or "unknown"


def _runs(process: int) -> bool:
    """Whether a process with that number runs on this host.

    On Windows the answer is always yes: there, asking as POSIX does would end the process.
    """
    if os.name == "nt":
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True  # another user's
    return True
