"""Messages about the hand: from the page to the server, and from the server to the loop."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

from rcmqp.errors import RcmqpError

LONGEST = 1024
"""Letters of a message from a page."""

FARTHEST = 1e3
"""A hand's way [m] and turn [rad] are below it."""

LARGEST = 2**53
"""Whole numbers of a page are below it."""

DEVICES = ("mouse", "touch", "pen", "keys", "gamepad", "headset", "space mouse", "haply")
"""What may hold the hand."""

SAID = ("start", "break", "answers")
"""What a page of a trial says besides."""

MOST_ANSWERS = 10
"""Answers of one message."""

_PACKED = struct.Struct("<QQQ??6d")


class Malformed(RcmqpError):
    """A message is not one that a page of ours sends."""


class Hand(NamedTuple):
    """A hand at one time.

    Attributes:
        number: of the message; it rises.
        grip: how often the operator has taken hold; one grip is never used again after a stop.
        held: whether the dead-man is held: a pointer is down, or a key or button.
        at: when it was sent, by the server's clock [s].
        event: when the input happened, likewise; NaN where nothing happened since the last one.
        way: (4,) x to the right, y down, z into the patient [m], roll clockwise [rad]; counted
            from anywhere, in the axes of the picture.
        operator: how often the steering has changed hands.
        felt: whether the device renders the viscosity.
        devices: what holds the hand, of DEVICES; the loop is not told of them.
    """

    number: int
    grip: int
    held: bool
    at: float
    event: float
    way: tuple[float, float, float, float]
    operator: int = 0
    felt: bool = False
    devices: tuple[str, ...] = ()

    def pack(self) -> bytes:
        """As bytes, without the devices."""
        head = (self.number, self.grip, self.operator, self.held, self.felt)
        return _PACKED.pack(*head, self.at, self.event, *self.way)

    @classmethod
    def unpack(cls, data: bytes) -> Hand:
        """Of what pack() made.

        Raises:
            Malformed: it is of another length.
        """
        if len(data) != _PACKED.size:
            raise Malformed(f"{len(data)} bytes, a hand has {_PACKED.size}")
        number, grip, operator, held, felt, at, event, *way = _PACKED.unpack(data)
        x, y, z, roll = way
        return cls(number, grip, held, at, event, (x, y, z, roll), operator, felt)


class Ping(NamedTuple):
    """A page asks what time it is.

    Attributes:
        at: its own clock [ms].
        drawn: how old states were when their pictures were drawn [ms], since the last ping.
    """

    at: float
    drawn: tuple[float, ...]


class Take(NamedTuple):
    """A page asks to steer."""


class Said(NamedTuple):
    """A participant of a trial begins, breaks off, or answers questions.

    Attributes:
        kind: one of SAID.
        values: the answers by question; empty but for "answers".
    """

    kind: str
    values: Mapping[str, int | bool | str]


def parse(text: str) -> Hand | Ping | Take | Said:
    """What a page's message says.

    Raises:
        Malformed: it is not a message of ours.
    """
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise Malformed("no JSON") from error
    if not isinstance(data, dict):
        raise Malformed("no object")
    kind = data.pop("kind", None)
    if kind == "take" and not data:
        return Take()
    if kind == "ping" and data.keys() == {"at", "drawn"}:
        return Ping(_number(data["at"]), tuple(map(_number, _array(data["drawn"], 0, 80))))
    if kind == "hand" and data.keys() == {*Hand._fields} - {"operator"}:
        if not isinstance(data["held"], bool) or not isinstance(data["felt"], bool):
            raise Malformed("held or felt is neither true nor false")
        x, y, z, roll = (_number(value, FARTHEST) for value in _array(data["way"], 4, 4))
        event = math.nan if data["event"] is None else _number(data["event"])
        number, grip = _whole(data["number"]), _whole(data["grip"])
        way, at = (x, y, z, roll), _number(data["at"])
        devices = tuple(_array(data["devices"], 0, len(DEVICES)))
        if not all(device in DEVICES for device in devices):
            raise Malformed("a device is not one that a page knows")
        return Hand(number, grip, data["held"], at, event, way, felt=data["felt"], devices=devices)
    if kind in SAID[:2] and not data:
        return Said(kind, {})
    if kind == SAID[2] and data.keys() == {"values"}:
        return Said(kind, _answers(data["values"]))
    raise Malformed("no message of a kind that is known, with all that it needs")


def _answers(values: Any) -> dict[str, int | bool | str]:
    """Answers by question; texts are no longer than the message."""
    if not isinstance(values, dict) or len(values) > MOST_ANSWERS:
        raise Malformed("not an object of some answers")
    return {
        name: value if isinstance(value, bool | str) else _whole(value)
        for name, value in values.items()
    }


def _number(value: Any, most: float = 1e15) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < most:
        raise Malformed("not a finite number of a size that makes sense")
    return float(value)


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < LARGEST:
        raise Malformed("not a whole number")
    return value


def _array(value: Any, least: int, most: int) -> list[Any]:
    if not isinstance(value, list) or not least <= len(value) <= most:
        raise Malformed("not an array of a length that makes sense")
    return value
