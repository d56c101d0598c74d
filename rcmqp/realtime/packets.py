"""Packets between a controller and an arm's box, which only the holder of a key can make."""

from __future__ import annotations

import enum
import hashlib
import secrets
import struct
from hmac import compare_digest
from typing import Literal, NamedTuple

import numpy as np

from rcmqp.errors import RcmqpError
from rcmqp.maths.dualquaternion import Array

TAG = 16
"""Bytes of a packet's tag: one guess in 2^128 is right."""

KEY = 32
"""Bytes of a key."""

WINDOW = 1024
"""How many numbers below the newest are known as seen or not."""

DOUBLE = np.dtype("<f8")
"""How a number is written."""

Fault = Literal["malformed", "forged"]


class Rejected(RcmqpError):
    """A packet has another length or numbers that mean nothing, or was not made with the key.

    Attributes:
        fault: which of the two.
    """

    def __init__(self, fault: Fault) -> None:
        self.fault: Fault = fault
        super().__init__(f"the packet is {fault}")


class Kind(enum.IntEnum):
    """Kinds of requests from a controller to the box."""

    HELLO = 0
    MOVE = 1
    HALT = 2


class Order(NamedTuple):
    """A packet from the controller.

    Attributes:
        kind: what is asked.
        number: of the command, from 1; 0 for what is not a command.
        answers: the number of the state that the command answers.
        v: (nv,) joint velocities [rad/s], read-only.
    """

    kind: Kind
    number: int
    answers: int
    v: Array


def new_key() -> bytes:
    """A key for one session."""
    return secrets.token_bytes(KEY)


class Packets:
    """The two directions of packets, little-endian, each packet ending in its tag.

    A state: its number, joint positions (nq,) [rad], joint velocities (nv,) [rad/s].
    An order: its kind, its number, that of the state it answers, joint velocities (nv,) [rad/s].
    The tag is the keyed BLAKE2s of all bytes before it, personalized by direction: no packet of
    one direction passes for one of the other. A new key for each session makes packets of an
    earlier session worthless; inside a session, Numbers tells which were seen before.
    """

    def __init__(self, nq: int, nv: int, key: bytes) -> None:
        """Both ends get the same ``key``, of 32 bytes, from new_key()."""
        self._nq = nq
        self._state, self._order = struct.Struct("<q"), struct.Struct("<Bqq")
        self._state_size = self._state.size + DOUBLE.itemsize * (nq + nv)
        self._order_size = self._order.size + DOUBLE.itemsize * nv
        self._zero = np.zeros(nv)
        self._state_mac = hashlib.blake2s(key=key, digest_size=TAG, person=b"state")
        self._order_mac = hashlib.blake2s(key=key, digest_size=TAG, person=b"order")

    def state(self, number: int, q: Array, v: Array) -> bytes:
        """Pack a state."""
        return _tagged(self._state_mac, self._state.pack(number) + _bytes(q) + _bytes(v))

    def command(self, number: int, answers: int, v: Array) -> bytes:
        """Pack a command."""
        return self._tagged_order(Kind.MOVE, number, answers, v)

    def hello(self) -> bytes:
        """Make the first packet of a controller."""
        return self._tagged_order(Kind.HELLO, 0, 0, self._zero)

    def halt(self) -> bytes:
        """Come to rest, and take no command any more."""
        return self._tagged_order(Kind.HALT, 0, 0, self._zero)

    def read_state(self, packet: bytes) -> tuple[int, Array, Array]:
        """Number, q and v, which are read-only.

        Raises:
            Rejected: it is not a state that was made with the key.
        """
        body = _checked(self._state_mac, packet, self._state_size)
        values = np.frombuffer(body, DOUBLE, offset=self._state.size)
        return self._state.unpack_from(body)[0], values[: self._nq], values[self._nq :]

    def read_order(self, packet: bytes) -> Order:
        """Unpack a controller's request.

        Raises:
            Rejected: it is not an order that was made with the key.
        """
        body = _checked(self._order_mac, packet, self._order_size)
        kind, number, answers = self._order.unpack_from(body)
        v = np.frombuffer(body, DOUBLE, offset=self._order.size)
        if kind > Kind.HALT or not np.isfinite(v).all():
            raise Rejected("malformed")
        return Order(Kind(kind), number, answers, v)

    def _tagged_order(self, kind: Kind, number: int, answers: int, v: Array) -> bytes:
        return _tagged(self._order_mac, self._order.pack(kind, number, answers) + _bytes(v))


class Numbers:
    """Which numbers of commands have come.

    Attributes:
        highest: the newest; 0 before the first.
    """

    def __init__(self) -> None:
        self.highest = 0
        self._seen = 0  # bit k: highest - k has come

    def place(self, number: int) -> Literal["newer", "older", "again"]:
        """Record a number; say if it is newer than all, older but not seen yet, or seen again.

        A number that is WINDOW or more below the newest counts as seen.
        """
        ahead = number - self.highest
        if ahead > 0:
            self._seen = 1 | (self._seen << ahead if ahead < WINDOW else 0)
            self._seen &= (1 << WINDOW) - 1
            self.highest = number
            return "newer"
        if -ahead >= WINDOW or number < 1 or self._seen >> -ahead & 1:
            return "again"
        self._seen |= 1 << -ahead
        return "older"


def _bytes(values: Array) -> bytes:
    return np.asarray(values, DOUBLE).tobytes()


def _tagged(mac: hashlib.blake2s, body: bytes) -> bytes:
    fresh = mac.copy()
    fresh.update(body)
    return body + fresh.digest()


def _checked(mac: hashlib.blake2s, packet: bytes, size: int) -> bytes:
    """The packet without its tag, if that is right."""
    if len(packet) != size + TAG:
        raise Rejected("malformed")
    body, fresh = packet[:size], mac.copy()
    fresh.update(body)
    if not compare_digest(fresh.digest(), packet[size:]):
        raise Rejected("forged")
    return body
