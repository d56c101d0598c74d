"""The hand at a page as a device: messages in, a DeviceState a cycle out."""

from __future__ import annotations

import math
import socket
from collections.abc import Callable

from rcmqp.live.desk import STALE
from rcmqp.live.messages import Hand, Malformed
from rcmqp.references.hand import DeviceState

AT_ONCE = 64
"""Messages that are read in one cycle."""

AWAY = Hand(0, 0, False, -math.inf, math.nan, (0.0, 0.0, 0.0, 0.0))
"""Before anybody has come."""


class PageHand:
    """What the newest message says, as long as it is held and not stale.

    A grip ends when the dead-man is let go, when the page says nothing for STALE, and when
    somebody else takes over. It never begins again: the operator has to take hold anew.

    Attributes:
        newest: message.
        taken: how many messages came.
        stopped: how often a held grip was ended by silence.
        event: when the input of the newest message happened, by the clock [s]; NaN once it was
            asked for.
    """

    def __init__(self, channel: socket.socket, clock: Callable[[], float]) -> None:
        """Messages come by ``channel``, which does not block; ``clock`` is that of Hand.at."""
        self._channel, self._clock = channel, clock
        self.newest, self.taken, self.stopped, self.event = AWAY, 0, 0, math.nan
        self._grip: tuple[int, int] | None = None
        self._spent = (-1, -1)

    def __call__(self) -> DeviceState:
        """The handle now."""
        self._receive()
        hand, engaged = self.newest, False
        grip = hand.operator, hand.grip
        if self._grip is not None and (grip != self._grip or not hand.held):
            self._end(self._grip)
        if hand.held and grip > self._spent:
            if self._clock() - hand.at > STALE:
                self.stopped += 1
                self._end(grip)
            else:
                engaged, self._grip = self._grip == grip, grip  # the first reading is the origin
        x, y, z, roll = hand.way
        return DeviceState((x, y, z), engaged=engaged, roll=roll, felt=hand.felt)

    def _end(self, grip: tuple[int, int]) -> None:
        """Never follow this grip again, or one from before."""
        self._grip, self._spent = None, max(self._spent, grip)

    def _receive(self) -> None:
        """Take what has come; the newest is kept."""
        for _ in range(AT_ONCE):
            try:
                hand = Hand.unpack(self._channel.recv(4096))
            except (OSError, Malformed):
                return
            self.taken += 1
            if not hand.held:
                self._end((hand.operator, hand.grip))
            self.newest = hand
            if not math.isnan(hand.event):
                self.event = hand.event

    def take_event(self) -> float:
        """When the input happened that the newest reference followed; NaN for none."""
        event, self.event = self.event, math.nan
        return event
