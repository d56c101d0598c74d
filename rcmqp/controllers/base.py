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
        account: what the controller's solver says of the step, for whoever asks; None where
            there is none.
    """

    v: Array
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    account: object | None = None


@dataclass(frozen=True, eq=False)
class Controller(abc.ABC):
    """Joint velocities from arm states and references.

    A step depends on its two arguments and on a solver's warm start, nothing else; after
    reset() a rerun gives the same bits.

    Attributes:
        name: in CONTROLLERS.
        diagnostics: unit and meaning of each number that a Command's diagnostics hold.
        insertion: what is controlled.
        period: sampling period T [s].
    """

    name: ClassVar[str]
    diagnostics: ClassVar[Mapping[str, tuple[str, str]]] = {}

    insertion: Insertion
    period: float

    def __post_init__(self) -> None:
        """Check the period, and that each option is of its default's kind.

        Raises:
            OptionError: one is not.
        """
        for item in dataclasses.fields(self):
            if item.init and isinstance(item.default, bool | float | str):
                _check_kind(item.name, getattr(self, item.name), type(item.default))
        if not 0.0 < self.period < math.inf:
            raise OptionError(f"period = {self.period} s, it must be positive")

    @property
    def options(self) -> dict[str, Any]:
        """The options that this controller runs with."""
        names = [item.name for item in dataclasses.fields(self) if item.init]
        return {name: getattr(self, name) for name in names if name not in ("insertion", "period")}

    def reset(self) -> None:  # noqa: B027  (most controllers keep nothing)
        """Forget the run so far."""

    @abc.abstractmethod
    def step(self, state: ArmState, reference: Reference) -> Command:
        """The joint velocity to hold until the next cycle.

        Raises:
            InvalidCommand: the reference is not a pose.
        """


def _check_kind(name: str, value: object, kind: type) -> None:
    allowed: dict[type, tuple[type, ...]] = {bool: (bool,), float: (float, int), str: (str,)}
    if not isinstance(value, allowed[kind]) or (kind is float and isinstance(value, bool)):
        raise OptionError(f"{name} = {value!r}, it must be a {kind.__name__}")
