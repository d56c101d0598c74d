"""Checks of HDF5 files and texts that may come from anybody."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import unicodedata
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcmqp.errors import RcmqpError, RunFileError

if TYPE_CHECKING:
    import h5py

MOST_LETTERS = 1000
"""Letters of an error message that are printed."""

_UNSEEN = ("Cc", "Cf", "Cs", "Zl", "Zp")  # control, format (bidi), surrogates, separators


def printable(text: str) -> str:
    r"""Write control characters as escapes; tabs and line ends stay as they are.

    A terminal runs escape sequences: a name with ``\x1b[2J`` in it would clear the screen.
    """
    return "".join(x if x in "\n\t" else _seen(x) for x in text)


def one_line(text: str) -> str:
    """Write every control character as an escape, line ends too: for names."""
    return "".join(map(_seen, text))


def shortened(text: str, most: int = MOST_LETTERS) -> str:
    """The text, or its beginning and end if it is longer than ``most`` letters."""
    if len(text) <= most:
        return text
    return f"{text[: most - 100]} [... {len(text) - most} letters ...] {text[-100:]}"


def _seen(x: str) -> str:
    if (x.isascii() and x.isprintable()) or unicodedata.category(x) not in _UNSEEN:
        return x
    return x.encode("unicode_escape").decode("ascii")


MOST_TEXT = 16_000_000
"""Bytes of a text in a file, such as the scenario."""

MOST_DATASETS = 200
"""Datasets of a file; a run has some thirty."""

MOST_COMPRESSED = 1032
"""How many times smaller deflate makes numbers, at most."""

MOST_NUMBER = 1e30
"""What lengths, angles, times and speeds are below: squares and float32 can hold it."""

MOST_CHUNK = 1 << 24
"""Bytes of a chunk that is larger than its dataset, as of a run that ended early."""


DAMAGED = "damaged"
"""How the reason begins why a damaged file is not read."""

CUT_SHORT = re.compile(r"truncated file: eof = (\d+),.* stored_eof = (\d+)")
"""Matches HDF5's message about a truncated file: its size now, and its full size, in bytes."""


@contextlib.contextmanager
def reading(path: str | os.PathLike[str], part: str) -> Iterator[None]:
    """Turn any error in the block into a RunFileError that names the file and the part.

    A damaged file can make HDF5, NumPy and JSON raise almost any error, so all are caught.

    Raises:
        RunFileError: something went wrong.
    """
    try:
        yield
    except RunFileError:
        raise
    except Exception as error:
        if found := CUT_SHORT.search(str(error)):
            raise RunFileError(
                Path(path),
                f"{DAMAGED}: cut short, it has {found[1]} of {found[2]} bytes; copy it again, or "
                "run the scenario again if the original is cut short, too",
            ) from error
        reason = str(error) if isinstance(error, RcmqpError | OSError) else _said(error)
        raise RunFileError(
            Path(path), f"{DAMAGED}, the run must be made again: {part}: {shortened(reason, 500)}"
        ) from error


def _said(error: Exception) -> str:
    """An error of Python's in words; some say nothing but their name."""
    return f"{type(error).__name__}: {error}".removesuffix(": ")


class StoredRows:
    """A dataset of a file, read as it is sliced; an error names the file and the dataset."""

    def __init__(self, dataset: h5py.Dataset, allow: str = "anything") -> None:
        """Take a dataset in an open file.

        Args:
            dataset: where the numbers are.
            allow: ``anything``; ``nan`` beside numbers below MOST_NUMBER; ``numbers`` alone; or
                ``rising`` numbers, as of a clock.
        """
        self._dataset, self._allow = dataset, allow

    @property
    def shape(self) -> tuple[int, ...]:
        """The dataset's."""
        shape: tuple[int, ...] = self._dataset.shape
        return shape

    @property
    def dtype(self) -> Any:
        """The dataset's."""
        return self._dataset.dtype

    def __getitem__(self, rows: Any, /) -> Any:
        with reading(self._dataset.file.filename, self._dataset.name.lstrip("/")):
            values = self._dataset[rows]
            if self._allow != "anything":
                self._check(values)
            return values

    def _check(self, found: Any) -> None:
        """Check that numbers are possible for an arm."""
        import numpy as np

        good = np.abs(found) < MOST_NUMBER
        if self._allow == "nan":
            good |= np.isnan(found)
        if not good.all():
            wrong = float(found[~good].flat[0])
            raise ValueError(f"{wrong:g} is not possible there")
        if self._allow == "rising" and not (np.diff(found) > 0.0).all():
            raise ValueError("the clock goes back")


def datasets(
    path: Path,
    group: h5py.Group,
    folders: Collection[str] = (),
    texts: Collection[str] = (),
    *,
    compressed: bool = False,
) -> dict[str, h5py.Dataset]:
    """Check how each dataset of a file is stored, and return all of them by their paths.

    Nothing but this file is read: a link that leads elsewhere, a virtual dataset and numbers that
    are kept in another file are refused before they are followed.

    Args:
        path: of the file.
        group: the open file.
        folders: groups that it may have; numbers there may be missing in part, and are NaN then.
        texts: datasets that hold a text; all others hold floating-point numbers.
        compressed: whether the numbers may be.

    Raises:
        RunFileError: the file holds something else, or says that it holds more than it can.
    """
    found: dict[str, h5py.Dataset] = {}
    with reading(path, "its contents"):
        for prefix in ("", *(f"{name}/" for name in folders)):
            if prefix and prefix[:-1] not in group:
                continue
            _check_count(path, len(found) + len(group[prefix or "/"]))
            for name in group[prefix or "/"]:
                with reading(path, f"{prefix}{name}"):
                    kind = _kind(path, group[prefix or "/"], name)
                    if kind == "Group" and not prefix and name in folders:
                        continue
                    if kind != "Dataset":
                        raise RunFileError(path, f"{prefix}{name} is a {kind}, not a dataset")
                    dataset = group[f"{prefix}{name}"]
                    if f"{prefix}{name}" in texts:
                        _check_text(path, dataset)
                    else:
                        _check_numbers(path, dataset, compressed, whole=not prefix)
                    found[f"{prefix}{name}"] = dataset
        size, most = (
            path.stat().st_size,
            sum(_bytes(found[name]) for name in found if "/" not in name),
        )
        if most > (MOST_COMPRESSED if compressed else 1) * size:
            raise RunFileError(
                path, f"damaged: its datasets have {most} bytes, the whole file has {size}"
            )
    return found


def _check_count(path: Path, count: int) -> None:
    if count > MOST_DATASETS:
        raise RunFileError(path, f"has {count} datasets, a run has {MOST_DATASETS} at most")


def _kind(path: Path, group: h5py.Group, name: str) -> str:
    """Class of what a hard link leads to; other links are refused."""
    import h5py

    link = group.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink):
        raise RunFileError(
            path, f"{name} is a link to elsewhere ({type(link).__name__}), which is not followed"
        )
    return str(group.get(name, getclass=True).__name__)


def _check_place(path: Path, dataset: h5py.Dataset, known: Collection[int]) -> None:
    """Check that a dataset is in this file, behind no filters but those known."""
    import h5py

    name, made = dataset.name.lstrip("/"), dataset.id.get_create_plist()
    if made.get_layout() == h5py.h5d.VIRTUAL or made.get_external_count():
        raise RunFileError(path, f"{name} is kept in another file, which is not read")
    for i in range(made.get_nfilters()):
        if made.get_filter(i)[0] not in known:
            raise RunFileError(path, f"{name} is compressed in a way that rcmqp does not read")


def _check_text(path: Path, dataset: h5py.Dataset) -> None:
    import h5py

    _check_place(path, dataset, ())
    if dataset.shape != () or h5py.check_string_dtype(dataset.dtype) is None:
        name = dataset.name.lstrip("/")
        raise RunFileError(path, f"damaged: {name} is {dataset.dtype}, it must be one text")


def _check_numbers(path: Path, dataset: h5py.Dataset, compressed: bool, whole: bool) -> None:
    """Check that numbers are in this file, of a plain type, and no more than fit in it."""
    import h5py

    zipped = (h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE) if compressed else ()
    _check_place(path, dataset, (h5py.h5z.FILTER_FLETCHER32, *zipped))
    name, item = dataset.name.lstrip("/"), dataset.dtype.itemsize
    if dataset.dtype.kind != "f" or item not in (4, 8) or dataset.shape is None:
        raise RunFileError(path, f"damaged: {name} is {dataset.dtype}, it must be numbers")
    chunk, most = math.prod(dataset.chunks or ()) * item, _bytes(dataset)
    if chunk > max(MOST_CHUNK, most):
        raise RunFileError(path, f"damaged: {name} is kept in chunks of {chunk} bytes")
    kept = dataset.id.get_storage_size() * (MOST_COMPRESSED if compressed else 1)
    if whole and kept < most:
        raise RunFileError(
            path, f"damaged: {name} has shape {dataset.shape}, its numbers are not in the file"
        )


def _bytes(dataset: h5py.Dataset) -> int:
    """Bytes of its numbers."""
    return int(dataset.size or 0) * dataset.dtype.itemsize if dataset.dtype.kind == "f" else 0


def text_of(path: Path, file: h5py.File, name: str) -> str:
    """A text that is an attribute of the file.

    Raises:
        RunFileError: it is missing, or not a text.
    """
    import h5py

    with reading(path, name):
        attribute = h5py.h5a.open(file.id, name.encode())
        if attribute.shape != () or attribute.get_storage_size() > MOST_TEXT:
            raise RunFileError(path, f"damaged: {name} must be one text")
        return text(path, name, file.attrs[name])


def text(path: Path, name: str, value: Any) -> str:
    """A value out of a file that has to be a text, and not too long.

    Raises:
        RunFileError: it is not.
    """
    value = value.decode() if isinstance(value, bytes) else value
    if not isinstance(value, str) or len(value) > MOST_TEXT:
        kind = type(value).__name__
        raise RunFileError(path, f"damaged: {name} is {kind}, it must be a text, not too long")
    if not value.isascii() and any("\ud800" <= x <= "\udfff" for x in value):
        raise RunFileError(path, f"damaged: {name} is not a text in UTF-8")
    return value


def whole_number(path: Path, file: h5py.File, name: str) -> int:
    """A whole number that is an attribute of the file.

    Raises:
        RunFileError: it is not there, or it is something else.
    """
    with reading(path, name):
        value = file.attrs[name]
        if getattr(value, "shape", ()) != () or int(value) != value:
            raise RunFileError(path, f"damaged: {name} = {value!s:.50}, not a whole number")
        return int(value)


def json_of(path: Path, name: str, value: str, kind: type) -> Any:
    """Read a JSON text of a file.

    Args:
        path: of the file.
        name: of the part of the file.
        value: the text.
        kind: what it has to be, a dict or a list.

    Raises:
        RunFileError: it is not JSON, or of another kind.
    """
    with reading(path, name):
        data = json.loads(value)
        if not isinstance(data, kind):
            raise RunFileError(path, f"damaged: {name} is a {type(data).__name__} in JSON")
        return data
