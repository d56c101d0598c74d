"""The haptic reference: handle in, view out, one a cycle."""

from __future__ import annotations

from rcmqp.references.hand.clutch import Clutch
from rcmqp.references.hand.mapping import HandMapping
from rcmqp.references.hand.state import DeviceState
from rcmqp.references.view import ViewCommand


class HandView:
    """Clutch and mapping of one run; ask() once a cycle."""

    def __init__(self, mapping: HandMapping, tip_depth: float) -> None:
        """The tip is ``tip_depth`` [m] inside at the start."""
        self._mapping, self._tip_depth, self._clutch = mapping, tip_depth, Clutch()

    def ask(self, state: DeviceState) -> ViewCommand:
        """The view that the handle asks for; at the first call, that of the start."""
        way = self._clutch.step(state.position, state.engaged)
        velocity = state.velocity if state.engaged else (0.0, 0.0, 0.0)
        return self._mapping.view(way, velocity, self._tip_depth)
