"""What every controller is."""

from __future__ import annotations

import abc
import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from rcmqp.arm import ArmState
from rcmqp.dualquaternion import Array
from rcmqp.errors import OptionError
from rcmqp.insertion import Insertion
from rcmqp.reference import Reference


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """What a controller answers.

    Attributes:
        v: (nv,) joint velocity [rad/s], finite.
        diagnostics: numbers that the run records, the same names each cycle.
    """

    v: Array
    diagnostics: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Controller(abc.ABC):
    """Joint velocities from arm states and references.

    A step depends on its two arguments and on a solver's warm start, nothing else; after
    reset() a rerun gives the same bits.

    Attributes:
        insertion: what is controlled.
        period: sampling period T [s].
    """

    name: ClassVar[str]

    insertion: Insertion
    period: float

    def __post_init__(self) -> None:
        """Check the period."""
        if not 0.0 < self.period < math.inf:
            raise OptionError(f"period = {self.period} s, it must be positive")

    @property
    def options(self) -> dict[str, Any]:
        """The options that this controller runs with."""
        names = [item.name for item in dataclasses.fields(self) if item.init]
        return {name: getattr(self, name) for name in names[2:]}

    def reset(self) -> None:  # noqa: B027  (most controllers keep nothing)
        """Forget the run so far."""

    @abc.abstractmethod
    def step(self, state: ArmState, reference: Reference) -> Command:
        """The joint velocity to hold until the next cycle.

        Raises:
            InvalidCommand: the reference is not a pose.
        """
