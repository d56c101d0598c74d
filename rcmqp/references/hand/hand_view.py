"""The haptic reference: handle in, view out, one a cycle."""

from __future__ import annotations

from rcmqp.references.hand.clutch import Clutch
from rcmqp.references.hand.mapping import HandMapping
from rcmqp.references.hand.state import DeviceState
from rcmqp.references.view import ViewCommand
from rcmqp.world.instrument import Camera, Vector3


class HandView:
    """Clutch and mapping of one run; ask() once a cycle."""

    def __init__(
        self, mapping: HandMapping, tip_depth: float, camera: Camera | None = None
    ) -> None:
        """The tip is ``tip_depth`` [m] inside at the start.

        The hand moves it in the axes of the first image of the ``camera``, which may look to the
        side and be rolled; without one, of a camera that looks along the shaft.
        """
        self._mapping, self._tip_depth, self._clutch = mapping, tip_depth, Clutch()
        self._rows = (camera or Camera()).rotation.tolist()

    def ask(self, state: DeviceState) -> ViewCommand:
        """The view that the handle asks for; at the first call, that of the start."""
        way = self._clutch.step(state.position, state.engaged)
        velocity = state.velocity if state.engaged else (0.0, 0.0, 0.0)
        return self._mapping.view(self._turned(way), self._turned(velocity), self._tip_depth)

    def _turned(self, vector: Vector3) -> Vector3:
        """From the camera's axes to those of the shaft, number by number: wanted every cycle."""
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        x, y, z = vector
        return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z
