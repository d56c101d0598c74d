"""Which part of the handle's way drives the camera."""

from __future__ import annotations

from rcmqp.world.instrument import Vector3


class Clutch:
    """Adds up the way that the handle goes while it is engaged.

    The first reading is the origin, and a handle that is engaged anew goes on from where the
    camera is: neither makes the view jump.

    Attributes:
        way: (3,) gone so far [m].
        counted: whether what the handle did before the last reading counts.
    """

    def __init__(self) -> None:
        """Nothing gone yet."""
        self.way: Vector3 = (0.0, 0.0, 0.0)
        self.counted = False
        self._last: Vector3 | None = None

    def step(self, position: Vector3, engaged: bool = True) -> Vector3:
        """The way (3,) [m] that counts, with the handle now at ``position`` (3,) [m].

        What the handle does between two readings counts if it is engaged at both.
        """
        self.counted = engaged and self._last is not None
        if engaged and self._last is not None:
            (x, y, z), (a, b, c), (u, v, w) = position, self._last, self.way
            self.way = (u + (x - a), v + (y - b), w + (z - c))
        self._last = position if engaged else None
        return self.way
