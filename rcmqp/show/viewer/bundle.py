"""Numbers, meshes and scripts packed into a page."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from rcmqp.maths.dualquaternion import Array


class Bundle:
    """A header of plain data that points into one block of bytes."""

    def __init__(self) -> None:
        self._block = bytearray()

    def floats(self, array: Array) -> dict[str, Any]:
        """Add an array in single precision; return its entry in the header."""
        data = np.ascontiguousarray(array, dtype="<f4")
        return {"at": self._put(data.tobytes()), "shape": list(data.shape)}

    def chunk(self, data: bytes) -> dict[str, int]:
        """Add bytes; return their entry in the header."""
        return {"at": self._put(data), "size": len(data)}

    def text(self, header: dict[str, Any]) -> str:
        """Length of the header, header and block; compressed, in base64."""
        head = json.dumps(header, allow_nan=False).encode()
        head += b" " * (-len(head) % 4)
        return compressed(len(head).to_bytes(4, "little") + head + bytes(self._block))

    def _put(self, data: bytes) -> int:
        at = len(self._block)
        self._block += data + bytes(-len(data) % 4)
        return at


def compressed(data: bytes) -> str:
    """Gzip in base64, which the page's browser takes apart by itself."""
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode()


IMPORT = re.compile(
    r'^import (?:\{\s*\w+(?:\s*,\s*\w+)*,?\s*\} from )?"\./([\w.]+)";\n', re.MULTILINE
)
"""An import as bundled() understands it: names as they are, or for what the module does."""

EXPORT = re.compile(r"^export (?=(?:async )?function |class |const )", re.MULTILINE)

LEFT = re.compile(r"^(?:import|export)\b.*", re.MULTILINE)


def bundled(entry: str, read: Callable[[str], str]) -> str:
    """Put a JavaScript module and all that it imports into one script.

    Modules come in the order in which a browser runs them, each once, without the words import
    and export: they share one scope, so that no two may use one name at their top level.

    Args:
        entry: file name of the module that runs last.
        read: returns the text of a module by its file name.

    Raises:
        ValueError: a module imports or exports in a form that would need more than that, such as
            ``as`` or ``default``, or modules import each other in a circle.
    """
    done: dict[str, str] = {}

    def add(name: str, importers: tuple[str, ...]) -> None:
        if name in importers:
            raise ValueError(f"modules import each other: {' > '.join([*importers, name])}")
        if name in done:
            return
        text = read(name)
        for imported in IMPORT.findall(text):
            add(imported, (*importers, name))
        text = EXPORT.sub("", IMPORT.sub("", text))
        if left := LEFT.search(text):
            raise ValueError(f"{name} cannot be bundled: {left[0]}")
        done[name] = text

    add(entry, ())
    return "\n".join(done.values())
