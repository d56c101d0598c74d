"""Numbers, meshes and scripts packed for a page: compressed, and as text."""

from __future__ import annotations

import base64
import gzip
import json
from typing import Any

import numpy as np

from rcmqp.maths.dualquaternion import Array


class Bundle:
    """A header of plain data that points into one block of bytes."""

    def __init__(self) -> None:
        self._block = bytearray()

    def floats(self, array: Array) -> dict[str, Any]:
        """Put an array in, in single precision; what the header says of it."""
        data = np.ascontiguousarray(array, dtype="<f4")
        return {"at": self._put(data.tobytes()), "shape": list(data.shape)}

    def chunk(self, data: bytes) -> dict[str, int]:
        """Put bytes in; what the header says of them."""
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
