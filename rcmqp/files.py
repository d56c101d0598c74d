"""Files that are whole or not there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rcmqp.errors import RunFileError


@contextmanager
def whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Another name, of the same ending, to write a file to; it takes its own when it is whole.

    What was there under its own name stays until then, and if anything goes wrong.

    Raises:
        RunFileError: the file cannot be written.
    """
    target = Path(path).resolve()
    part = target.with_name(f".{os.getpid()}.{target.name}")
    try:
        yield part
        part.replace(target)
    except OSError as error:
        why = error.strerror or str(error).replace(str(part), str(target))
        raise RunFileError(Path(path), f"could not be written: {why}") from error
    finally:
        part.unlink(missing_ok=True)
