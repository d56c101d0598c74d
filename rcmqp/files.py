"""Files that are whole or not there; folders; names."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from rcmqp.errors import OptionError, RunFileError


@contextmanager
def whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Another name, of the same ending, to write a file to; it takes its own when it is whole.

    What was there under its own name stays until then, and if anything goes wrong.

    Raises:
        RunFileError: the file cannot be written.
    """
    target = Path(path).resolve()
    part = _part(target)
    try:
        yield part
        part.replace(target)
    except (OSError, RuntimeError) as error:  # h5py raises either
        reason = why(error).replace(str(part), str(target))
        raise RunFileError(Path(path), f"could not be written: {reason}") from error
    finally:
        part.unlink(missing_ok=True)


def make_folder(path: str | os.PathLike[str]) -> Path:
    """A folder that is there, made with its parents if it was not.

    Raises:
        RunFileError: it cannot be made.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFileError(folder, f"cannot be made: {error}") from error
    return folder


def check_writable(path: str | os.PathLike[str]) -> None:
    """Find out before a run, not after it, whether a file can be written.

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
        _part(path).touch()
        _part(path).unlink()
    except OSError as error:
        raise RunFileError(path, f"cannot be written: {why(error)}") from error


def check_ending(path: str | os.PathLike[str], *endings: str) -> None:
    """Find out whether a file to be written is named as its kind is: a run's would be lost.

    Raises:
        OptionError: it is not.
    """
    if Path(path).suffix.lower() not in endings:
        raise OptionError(f"{path}: give the name of a file that ends in {' or '.join(endings)}")


def unlike(others: Collection[str], stem: str, ending: str = "") -> str:
    """A name that is none of the others: numbered where it would be."""
    name, count = f"{stem}{ending}", 2
    while name in others:
        name, count = f"{stem}_{count}{ending}", count + 1
    return name


def why(error: OSError | RuntimeError) -> str:
    """What the system says, without what HDF5 adds and the name of the file it was told."""
    number = re.search(r"[Ee]rrno =? ?(\d+)", str(error))
    return os.strerror(int(number[1])) if number else str(error)


def _part(target: Path) -> Path:
    """Where a file is written before it gets its name."""
    return target.with_name(f".{os.getpid()}.{target.name}")
