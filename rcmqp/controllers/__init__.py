"""Controllers: from where the arm is and where it should be to a joint velocity.

A new controller is a dataclass derived from Controller, added to CONTROLLERS under its name, or by
a plug-in; its fields, but the first two, are its options, on the command line too.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from rcmqp.controllers.aghakhani import Aghakhani
from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.dual_quaternion import DualQuaternion
from rcmqp.controllers.hierarchical_qp import HierarchicalQP, default_limits
from rcmqp.controllers.pose_laws import Damped, PoseError
from rcmqp.controllers.task_priority import TaskPriority, TaskReconstructionLaw
from rcmqp.controllers.vfi_qp import VfiQP
from rcmqp.controllers.weighted_qp import WeightedQP
from rcmqp.errors import OptionError, UnknownName
from rcmqp.world.insertion import Insertion
from rcmqp.world.plugins import Registry

_OWN: dict[str, type[Controller]] = {
    "dual_quaternion": DualQuaternion,
    "hierarchical_qp": HierarchicalQP,
    "weighted_qp": WeightedQP,
    "pose_error": PoseError,
    "damped": Damped,
    "task_priority": TaskPriority,
    "task_reconstruction": TaskReconstructionLaw,
    "aghakhani": Aghakhani,
    "vfi_qp": VfiQP,
}

CONTROLLERS: Registry[Controller] = Registry("rcmqp.controllers", _OWN, Controller)


def make_controller(name: str, insertion: Insertion, period: float, **options: Any) -> Controller:
    """Make a controller by name; hyphens and underscores are the same.

    Args:
        name: a key of CONTROLLERS.
        insertion: what it controls.
        period: sampling period T [s].
        options: its own fields.

    Raises:
        UnknownName: the controller is not known, or does not have the option.
        PluginError: it is a plug-in's, which cannot be used.
        OptionError: an option's value is not allowed, the class goes by another name, or
            ``insertion`` is something else, such as a scenario.
    """
    if not isinstance(insertion, Insertion):
        hint = "; give scenario.insertion()" if hasattr(insertion, "insertion") else ""
        raise OptionError(
            f"make_controller() needs an Insertion, got a {type(insertion).__name__}{hint}"
        )
    name = name.replace("-", "_")
    if name not in CONTROLLERS:
        raise UnknownName("controller", name, CONTROLLERS)
    known = controller_options(name)
    for option in options:
        if option not in known:
            check_is_dataclass(name, option)
            raise UnknownName(f"option of {name}", option, known)
    kind = CONTROLLERS[name]
    if kind.name != name:
        raise OptionError(
            f"{kind.__name__} is in CONTROLLERS as {name!r}, and its runs would say "
            f"{kind.name!r}; add it under that name, or give it name = {name!r}"
        )
    return kind(insertion, period, **options)


def check_is_dataclass(name: str, option: str) -> None:
    """Refuse an unknown option that a controller annotates without being a dataclass.

    Raises:
        OptionError: the decorator is missing.
    """
    for kind in CONTROLLERS[name].__mro__:
        annotations = vars(kind).get("__annotations__", {})
        plain = "__dataclass_fields__" not in vars(kind)
        if plain and "ClassVar" not in str(annotations.get(option, "ClassVar")):
            raise OptionError(
                f"{kind.__name__} has the annotation {option}, but is not a dataclass, so "
                f"{option} is not an option of it: write @dataclass(frozen=True, eq=False) above "
                "the class"
            )


def controller_options(name: str) -> dict[str, Any]:
    """Options of a controller and their defaults."""
    fields = dataclasses.fields(CONTROLLERS[name])
    return {
        field.name: field.default
        for field in fields
        if field.init and field.default is not dataclasses.MISSING
    }


__all__ = [
    "CONTROLLERS",
    "Aghakhani",
    "Command",
    "Controller",
    "Damped",
    "DualQuaternion",
    "HierarchicalQP",
    "PoseError",
    "TaskPriority",
    "TaskReconstructionLaw",
    "VfiQP",
    "WeightedQP",
    "controller_options",
    "default_limits",
    "make_controller",
]
