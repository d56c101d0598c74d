"""Options of frozen dataclasses: what each may be is declared beside it and checked here.

    @options
    @dataclass(frozen=True, slots=True)
    class Sphere:
        centre: Vector3 = field(metadata=rule(vector3))
        radius: float = field(default=0.01, metadata=positive("m"))

A rule is a function of an option's name and the value given. It returns the value to keep, which
may be another one, such as a tuple in place of a list, and raises an OptionError if the value is
not allowed. ``__post_init__()`` checks only what concerns several options at once.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from numbers import Integral, Real
from typing import Any, TypeAlias, TypeVar

from rcmqp.errors import OptionError, UnknownName

T = TypeVar("T")

Rule: TypeAlias = Callable[[str, Any], Any]
Metadata: TypeAlias = Mapping[str, Any]
"""What ``dataclasses.field(metadata=...)`` is given."""

KEY = "rule"


def options(cls: type[T]) -> type[T]:
    """Decorate a dataclass, so that each value given to it passes the rule of its field.

    It stands above ``@dataclass``. Defaults do not pass the rules: declare them as they are kept.
    """
    kind: Any = cls
    init, rules = kind.__init__, declared(cls, KEY)
    names = [item.name for item in dataclasses.fields(kind) if item.init]

    def kept(name: str, value: Any) -> Any:
        return rules[name](name, value) if name in rules else value

    @functools.wraps(init)
    def __init__(self: object, *given: Any, **named: Any) -> None:
        in_order = [kept(name, value) for name, value in zip(names, given, strict=False)]
        by_name = {name: kept(name, value) for name, value in named.items()}
        init(self, *in_order, *given[len(names) :], **by_name)

    kind.__init__ = __init__
    return cls


def check(made: object) -> None:
    """Check every option of an object that is made, for classes that ``options`` cannot decorate.

    Raises:
        OptionError, UnknownName: a value is not allowed.
    """
    for name, take in declared(type(made), KEY).items():
        take(name, getattr(made, name))


def allowed(name: str, value: Any, metadata: Metadata) -> Any:
    """Check an argument of a function or a plain class by a field's rule; return what to keep.

    Raises:
        OptionError, UnknownName: it is not allowed.
    """
    return metadata[KEY](name, value)


def declared(cls: type, key: str) -> dict[str, Any]:
    """Entries under ``key`` in the metadata of a dataclass's fields, by field name.

    A derived class that gives a field another default keeps what was declared of it.
    """
    return {
        name: item.metadata[key]
        for kind in reversed(cls.__mro__)
        for name, item in vars(kind).get("__dataclass_fields__", {}).items()
        if key in item.metadata
    }


def refused(name: str, value: object, allowed: str, unit: str = "") -> OptionError:
    """Make the error of an option, in one wording for all options."""
    text = f"{value!s:.50}" if isinstance(value, Real) else f"{value!r:.50}"
    return OptionError(f"{name} = {text}{unit and ' ' + unit}, it must be {allowed}")


def rule(take: Rule) -> Metadata:
    """Metadata of a field whose values pass ``take``."""
    return {KEY: take}


def positive(unit: str = "") -> Metadata:
    """A number above 0 and finite, in ``unit``."""
    return _number("positive and finite", lambda x: 0.0 < x < math.inf, unit)


def at_least(least: float, unit: str = "") -> Metadata:
    """A finite number, ``least`` or more, in ``unit``."""
    return _number(f"finite and {least:g} or more", lambda x: least <= x < math.inf, unit)


def positive_or_inf() -> Metadata:
    """Check a number above 0; inf means no limit."""
    return _number("positive, inf for none", lambda x: x > 0.0, "")


def between(low: float, high: float, unit: str = "") -> Metadata:
    """A number strictly between two others, in ``unit``."""
    return _number(f"between {low:.6g} and {high:.6g}", lambda x: low < x < high, unit)


def from_to(low: float, high: float, unit: str = "") -> Metadata:
    """A number between two others, or one of them, in ``unit``."""
    return _number(f"from {low:.6g} to {high:.6g}", lambda x: low <= x <= high, unit)


def share() -> Metadata:
    """A number above 0 and at most 1."""
    return _number("above 0 and at most 1", lambda x: 0.0 < x <= 1.0, "")


def finite(unit: str = "") -> Metadata:
    """A finite number, in ``unit``."""
    return _number("finite", math.isfinite, unit)


def whole(least: int) -> Metadata:
    """A whole number, ``least`` or more, kept as an int."""

    def take(name: str, value: Any) -> int:
        number = _real(value)
        if not (math.isfinite(number) and int(number) == number >= least):
            raise refused(name, value, f"a whole number of at least {least}")
        return int(value)

    return rule(take)


def one_of(kind: str, names: Collection[str]) -> Metadata:
    """One of some names; ``kind`` says in the error what they are names of."""

    def take(name: str, value: Any) -> str:
        if not isinstance(value, str) or value not in names:
            raise UnknownName(kind, str(value), names)
        return value

    return rule(take)


def part(kind: type) -> Metadata:
    """An object of a class; a mapping, as files have it, is taken for its keyword arguments."""

    def take(name: str, value: Any) -> Any:
        if isinstance(value, Mapping):
            return kind(**value)
        if not isinstance(value, kind):
            raise refused(name, value, f"of type {kind.__name__}")
        return value

    return rule(take)


def or_none(metadata: Metadata) -> Metadata:
    """None, or what another rule takes."""
    take = metadata[KEY]
    return rule(lambda name, value: None if value is None else take(name, value))


def _number(allowed: str, holds: Callable[[float], bool], unit: str) -> Metadata:
    def take(name: str, value: Any) -> int | float:  # NumPy's own numbers cannot go into JSON
        if not holds(_real(value)):
            raise refused(name, value, allowed, unit)
        return int(value) if isinstance(value, Integral) else float(value)

    return rule(take)


def _real(value: Any) -> float:
    """A real number as a float; NaN, which no rule allows, for anything else."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return math.nan
    try:
        return float(value)
    except OverflowError:  # an int beyond 1e308
        return math.nan


def check_name(kind: str, name: str, registry: Mapping[str, type], options: Iterable[str]) -> None:
    """Check a name of a registry, and the names of its options.

    Raises:
        UnknownName: the registry, or the dataclass of that name, does not have it.
    """
    if name not in registry:
        raise UnknownName(kind, name, registry)
    known = [item.name for item in dataclasses.fields(registry[name]) if item.init]
    for option in options:
        if option not in known:
            raise UnknownName(f"option of {name}", option, known)
