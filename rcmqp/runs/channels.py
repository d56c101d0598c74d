"""The channels of a run, declared once: name, unit, shape, meaning, and who gives the numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from rcmqp.maths.dualquaternion import Array

PART = 4096
"""Rows of a part of a run: some four seconds at 1 kHz, four megabytes."""

Allowed = Literal["anything", "nan", "numbers", "rising"]
Source = Literal["arm", "cycle", "clock", "derived"]


class Channel(NamedTuple):
    """The description of an array of a run.

    Attributes:
        unit: of its numbers.
        shape: sizes, as numbers or names: ``n`` cycles, ``nq`` and ``nv`` of the arm.
        meaning: what the numbers say.
        source: where they come from: ``arm``, once for the run; ``cycle``, what the loop leaves;
            ``clock``, one time that the loop leaves; ``derived``, computed from the others.
        allow: which numbers a file may hold, see StoredRows. NaN is allowed where a controller
            may have been told NaN.
    """

    unit: str
    shape: tuple[str | int, ...]
    meaning: str
    source: Source
    allow: Allowed

    @property
    def about(self) -> dict[str, str]:
        """Unit and meaning, as attributes of the dataset in a file."""
        shape = str(self.shape).replace("'", "")
        return {"unit": self.unit, "meaning": f"{shape} {self.meaning}"}

    def sizes(self, **named: int) -> tuple[int, ...]:
        """The shape in numbers, with ``n``, ``nq`` and ``nv`` as given."""
        return tuple(size if isinstance(size, int) else named[size] for size in self.shape)


def _channel(
    unit: str, shape: str, meaning: str, source: Source = "derived", allow: Allowed = "nan"
) -> Any:
    sizes = tuple(int(size) if size.isdecimal() else size for size in shape.split())
    channel = Channel(unit, sizes, meaning, source, "anything" if source == "arm" else allow)
    return field(metadata={"channel": channel})


@dataclass(frozen=True, eq=False, kw_only=True)
class Channels:
    """The arrays of a run, in the order of its file; each row is taken before the step."""

    lower: Array = _channel(
        "rad", "nv", "lower position limits; -inf for continuous joints; m if prismatic", "arm"
    )
    upper: Array = _channel("rad", "nv", "upper position limits; inf for continuous joints", "arm")
    velocity_limit: Array = _channel("rad/s", "nv", "joint speed limits", "arm")
    acceleration_limit: Array = _channel(
        "rad/s^2", "nv", "joint acceleration limits; inf for no limit", "arm"
    )
    jerk_limit: Array = _channel("rad/s^3", "nv", "joint jerk limits; inf for no limit", "arm")
    time: Array = _channel("s", "n", "sampling instants", "clock", "rising")
    q: Array = _channel("rad", "n nq", "Pinocchio's configuration", "cycle", "numbers")
    q_measured: Array = _channel(
        "rad", "n nq", "the configuration that the controller saw", "cycle"
    )
    angles: Array = _channel("rad", "n nv", "joint angles; m if prismatic", "cycle")
    v: Array = _channel(
        "rad/s", "n nv", "joint velocity commanded, until the next instant", "cycle"
    )
    v_actual: Array = _channel("rad/s", "n nv", "joint velocity at the instant", "cycle")
    v_measured: Array = _channel(
        "rad/s", "n nv", "joint velocity as the plant measured it", "cycle"
    )
    pivot: Array = _channel("m", "n 3", "trocar in the world", allow="numbers")
    x: Array = _channel(
        "1, m",
        "n 8",
        "effector pose in the world, a unit dual quaternion r + "
        "eps t r / 2: r w first, then t r / 2; its sign is continuous in time",
        "cycle",
    )
    x_d: Array = _channel("1, m", "n 8", "desired effector pose, its sign that of x", "cycle")
    tip: Array = _channel("m", "n 3", "tip in the world")
    tip_d: Array = _channel("m", "n 3", "desired tip")
    tip_error: Array = _channel("m", "n", "distance of the tip from the desired one")
    effector_error: Array = _channel("m", "n", "distance of the effector from the desired one")
    orientation_error: Array = _channel("rad", "n", "angle from the desired orientation")
    rcm_error: Array = _channel("m", "n", "distance of the trocar from the shaft's axis")
    depth: Array = _channel("m", "n", "insertion depth of the tip beyond the trocar")
    tilt: Array = _channel("rad", "n", "angle of the shaft from the trocar's axis")
    singular_value: Array = _channel(
        "m, rad", "n", "least singular value of the effector's geometric Jacobian"
    )
    solve_time: Array = _channel("s", "n", "time the controller took for the step", "clock")
    path_time: Array = _channel(
        "s", "n", "time on the path's own clock, which a governor slows down", "clock", "numbers"
    )


CHANNELS: Mapping[str, Channel] = {
    item.name: item.metadata["channel"] for item in dataclasses.fields(Channels)
}
"""Every channel by its name."""

FIXED = tuple(name for name, channel in CHANNELS.items() if channel.source == "arm")
"""Channels that are the arm's, without a row for each cycle."""

ROWS = tuple(name for name in CHANNELS if name not in FIXED)
"""Channels with a row for each cycle."""

NOT_IN_DIGEST = "solve_time"
"""The channel that says how a run was made and not what it is."""

EARLIER = ("path_time", "jerk_limit")
"""Channels that files of earlier versions do not have."""


def about_diagnostic(name: str, known: Mapping[str, tuple[str, str]]) -> dict[str, str]:
    """Unit and meaning of one of a controller's diagnostics, as attributes of its dataset."""
    unit, meaning = known.get(name, ("", "(n,) see the controller"))
    return {"unit": unit, "meaning": meaning}
