"""Damaged copies of run files, trial files and scenario files: what damaged.py tries.

Each kind of damage takes the path of a good file and a random generator and changes the file.
"""

from __future__ import annotations

import contextlib
import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rcmqp import Run
from rcmqp.errors import RcmqpError

Rng = np.random.Generator

DEEP = 100_000
"""Brackets inside each other."""

LONG = 5_000
"""Letters of a name."""

ABSURD: tuple[Any, ...] = (
    float("nan"),
    float("inf"),
    float("-inf"),
    1e308,
    -1e308,
    1e-308,
    0,
    -1,
    10**400,
    2**63,
    True,
    None,
    "",
    "x" * LONG,
    "\x1b[2J\x07",
    "=1+1",
    "a\0b",
    "/dev/zero",
    [],
    {},
    [[[]]],
    [float("nan")] * 7,
)
"""What takes the place of a value in JSON, or of an attribute."""


def json_text(text: str, rng: Rng) -> str:
    """JSON with one to three values replaced, removed or added."""
    data = json.loads(text)
    for _ in range(int(rng.integers(1, 4))):
        places = list(_places(data))
        if not places:
            break
        parent, key = places[int(rng.integers(len(places)))]
        what = rng.random()
        if what < 0.15:
            del parent[key]
        elif what < 0.25 and isinstance(parent, dict):
            parent["x" * int(rng.choice([1, LONG]))] = _absurd(rng)
        else:
            parent[key] = _absurd(rng)
    return json.dumps(data)


def _places(data: Any) -> Any:
    """Each place in JSON data, as what holds it and the key."""
    keys = list(data) if isinstance(data, dict) else range(len(data))
    for key in keys:
        yield data, key
        if isinstance(data[key], dict | list):
            yield from _places(data[key])


def _absurd(rng: Rng) -> Any:
    return copy.deepcopy(ABSURD[int(rng.integers(len(ABSURD)))])


def _nested(rng: Rng) -> str:
    opening = str(rng.choice(["[", '{"a":', "[["]))
    return opening * DEEP + str(rng.choice(["", "]" * DEEP]))


# Any file ------------------------------------------------------------------------------------


def bits(path: Path, rng: Rng) -> None:
    """One to eight bits are flipped, or a word is overwritten."""
    content = bytearray(path.read_bytes())
    for _ in range(int(rng.integers(1, 9))):
        at = int(rng.integers(len(content)))
        if rng.random() < 0.2:
            word = [b"\xff" * 8, b"\0" * 8, b"\xff\xff\xff\x7f", rng.bytes(8)][
                int(rng.integers(4))
            ]
            content[at : at + len(word)] = word
        else:
            content[at] ^= 1 << int(rng.integers(8))
    path.write_bytes(content)


def head_bits(path: Path, rng: Rng) -> None:
    """As bits(), in the first kilobytes: in HDF5 most of its own structure."""
    content = path.read_bytes()
    path.write_bytes(content[:4096])
    bits(path, rng)
    path.write_bytes(path.read_bytes() + content[4096:])


def truncated(path: Path, rng: Rng) -> None:
    """The file ends early, or goes on."""
    content = path.read_bytes()
    cut = content[: int(rng.integers(len(content)))]
    path.write_bytes(cut if rng.random() < 0.8 else content + rng.bytes(1000))


# Scenario files ------------------------------------------------------------------------------


def values(path: Path, rng: Rng) -> None:
    """Values of the scenario are absurd or missing."""
    path.write_text(json_text(path.read_text(encoding="utf-8"), rng), encoding="utf-8")


def nesting(path: Path, rng: Rng) -> None:
    """The scenario, or one of its values, is deeply nested."""
    text = path.read_text(encoding="utf-8")
    data = json.loads(text)
    key = str(rng.choice(list(data)))
    deep = text.replace(json.dumps(data[key]), _nested(rng), 1)
    path.write_text(deep if rng.random() < 0.7 else _nested(rng), encoding="utf-8")


# HDF5 files ----------------------------------------------------------------------------------


def _datasets(file: h5py.File) -> list[str]:
    names: list[str] = []
    file.visititems(
        lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None
    )
    return names


def _one(file: h5py.File, rng: Rng) -> str:
    return str(rng.choice(_datasets(file)))


def _sealed(path: Path) -> None:
    """Give a run the digest of what it says now, if it can be read."""
    with contextlib.suppress(RcmqpError, KeyError, OSError), h5py.File(path, "r+") as file:
        file.attrs["digest"] = Run.read(file, slice(None)).digest


def attributes(path: Path, rng: Rng) -> None:
    """An attribute is missing, absurd, of another type, or JSON with absurd values."""
    with h5py.File(path, "r+") as file:
        name = str(rng.choice(list(file.attrs)))
        holder = file if rng.random() < 0.85 else file[_one(file, rng)]
        name = name if name in holder.attrs or holder == file else "unit"
        value, kind = holder.attrs.get(name), rng.random()
        if kind < 0.1:
            holder.attrs.pop(name, None)
        elif kind < 0.2:
            holder.attrs[name] = _nested(rng)
        elif kind < 0.7 and isinstance(value, str) and value[:1] in "[{":
            holder.attrs[name] = json_text(value, rng)
        else:
            shapes: list[Any] = [
                np.zeros(3),
                np.nan,
                np.inf,
                h5py.Empty("f8"),
                np.void(b"\xff\xfe"),
                b"\xff\xfe",
                file.ref,
                np.array(["a", "b"], dtype=h5py.string_dtype()),
                10**18,
                "\x1b[2J",
                "x" * LONG,
                "NaN",
                "[" * DEEP,
            ]
            holder.attrs[name] = shapes[int(rng.integers(len(shapes)))]
    if rng.random() < 0.6:
        _sealed(path)


def links(path: Path, rng: Rng) -> None:
    """A dataset is a link to elsewhere, or is kept elsewhere."""
    outside = path.parent / "outside"
    with h5py.File(path, "r+") as file:
        name = _one(file, rng)
        old = file[name]
        shape, dtype = old.shape, old.dtype
        kind = int(rng.integers(8))
        if kind == 6:
            file["diagnostics_again"] = file["/"]
            file[f"loop{LONG}"] = h5py.SoftLink("/loop")
            return
        if kind == 7:
            file.attrs["format"] = h5py.SoftLink("/") is None or "rcmqp run "
            return
        del file[name]
        if kind == 0:
            file[name] = h5py.ExternalLink(str(outside / "secret.h5"), "data")
        elif kind == 1:
            file[name] = h5py.SoftLink("/time")
        elif kind == 2:
            file[name] = h5py.SoftLink(f"/{name}")
        elif kind == 3 and shape:
            layout = h5py.VirtualLayout(shape, dtype)
            layout[...] = h5py.VirtualSource(str(outside / "secret.h5"), "data", shape)
            file.create_virtual_dataset(name, layout)
        elif kind == 4 and shape and dtype.kind == "f":
            raw = [(str(outside / "secret.raw"), 0, h5py.h5f.UNLIMITED)]
            file.create_dataset(name, shape, dtype, external=raw)
        else:
            file[name] = file["/"]
    return


def sizes(path: Path, rng: Rng) -> None:
    """Datasets say that they are huge, empty or longer than others."""
    with h5py.File(path, "r+") as file:
        kind = int(rng.integers(6))
        if kind == 0:
            for i in range(int(rng.choice([1, 3000]))):
                file.require_group("diagnostics")[f"{'x' * int(rng.choice([3, LONG]))}{i}"] = 1.0
            return
        every = rng.random() < 0.5
        if every and "scenario" in file.attrs:
            scenario = json.loads(file.attrs["scenario"])
            scenario["duration"] = scenario["period"] * 9_999_990
            file.attrs["scenario"] = json.dumps(scenario)
        rows = [10**12, 0, 9_999_990, 2**62, 1][kind - 1]
        for name in _datasets(file) if every else [_one(file, rng)]:
            old = file[name]
            if old.shape:
                said, tail = dict(old.attrs), old.shape[1:]
                del file[name]
                made = file.create_dataset(
                    name, (rows, *tail), "f8", chunks=(4096, *tail), maxshape=(None, *tail)
                )
                made.attrs.update(said)


def types(path: Path, rng: Rng) -> None:
    """A dataset is of another type or shape, or a group."""
    with h5py.File(path, "r+") as file:
        name = _one(file, rng)
        old = file[name]
        shape, said = old.shape, dict(old.attrs)
        del file[name]
        made: list[Any] = [
            np.zeros(shape, dtype=int),
            np.zeros(shape, dtype=complex),
            np.zeros(shape, dtype=[("a", "f8"), ("b", "i4")]),
            np.zeros((*shape, 2)),
            np.zeros(()),
            np.array(b"text"),
            np.zeros(shape, dtype=">f8"),
            np.zeros(shape, dtype=np.float16),
            h5py.Empty("f8"),
            np.full(shape, file.ref, dtype=h5py.ref_dtype),
            np.full(shape, "[" * 100, dtype=h5py.string_dtype()),
            np.zeros((2, 2, 2, 2)),
        ]
        value = made[int(rng.integers(len(made)))]
        if rng.random() < 0.1:
            file.create_group(f"{name}/inside")
            return
        file.create_dataset(name, data=value).attrs.update(said)


def numbers(path: Path, rng: Rng) -> None:
    """Numbers are absurd, and the digest is theirs."""
    huge = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200, 0.0, -1.0)
    with h5py.File(path, "r+") as file:
        for _ in range(int(rng.integers(1, 4))):
            data = file[_one(file, rng)]
            if data.dtype.kind == "f":
                found = np.array(data[()], dtype=float)
                where = rng.random(found.shape) < float(rng.choice([0.05, 1.0]))
                found[where] = huge[int(rng.integers(len(huge)))]
                data[...] = found
    _sealed(path)


def deep(path: Path, rng: Rng) -> None:
    """Groups inside each other, JSON inside itself, the stops' text too."""
    with h5py.File(path, "r+") as file:
        if "stops" in file and rng.random() < 0.5:
            del file["stops"]
            file["stops"] = [_nested(rng), '{"a": [0, 1e999]}', '{"a": []}', "[]"][
                int(rng.integers(4))
            ]
        elif rng.random() < 0.5:
            file.create_group("diagnostics/" + "/".join(["a"] * 2000))
        else:
            name = str(rng.choice(["scenario", "options", "outcome", "law", "joints", "versions"]))
            file.attrs[name] = _nested(rng)


Damage = Callable[[Path, Rng], None]

OF_JSON: tuple[Damage, ...] = (bits, truncated, values, values, nesting)
OF_HDF5: tuple[Damage, ...] = (
    bits,
    head_bits,
    truncated,
    attributes,
    attributes,
    links,
    sizes,
    types,
    numbers,
    deep,
)
