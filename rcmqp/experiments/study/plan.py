"""What a study consists of: operators x arms x controllers, each a trial of its own."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import itertools
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Self

from rcmqp.controllers import CONTROLLERS, Controller, make_controller
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.options import options, refused, rule, whole
from rcmqp.references.operators import Learning, Operator, camera_trial, operator_of_study
from rcmqp.runs.loading import load_scenario
from rcmqp.runs.moved import at_port
from rcmqp.runs.scenario import Scenario
from rcmqp.world.arm_limits import ArmLimits
from rcmqp.world.instrument import Instrument
from rcmqp.world.loading import names_its_flange
from rcmqp.world.port import Port

PAPERS_PERIOD = 8e-3
"""Sampling period of the paper's law [s]: the paper gives none, its Table I implies this one."""

PERIOD = 1e-3
"""Sampling period of every other controller [s]."""

Stamp = tuple[int, int]


class _Law(NamedTuple):
    name: str
    period: float
    options: tuple[tuple[str, Any], ...]


class Law(_Law):
    """A controller, its period and its options.

    Attributes:
        name: a key of CONTROLLERS, hyphens as good as underscores.
        period: sampling period [s]; without it PAPERS_PERIOD for the paper's law, else PERIOD.
        options: of the controller, by name.
    """

    __slots__ = ()

    def __new__(
        cls,
        name: str = "dual_quaternion",
        period: float | None = None,
        options: tuple[tuple[str, Any], ...] = (),
    ) -> Self:
        """Check the name and fill in the period."""
        name = name.replace("-", "_")
        if name not in CONTROLLERS:
            raise UnknownName("controller", name, CONTROLLERS)
        if period is None:
            period = PAPERS_PERIOD if name == "dual_quaternion" else PERIOD
        if not 0.0 < period < 0.04:
            allowed = "positive and below 0.04 s, or an operator's tremor cannot be shown"
            raise refused("period", period, allowed, "s")
        return super().__new__(cls, name, period, options)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the check: a worker may learn of the controller later."""
        return type(self)._make, (tuple(self),)

    def __str__(self) -> str:
        """Name, period and options."""
        options = "".join(f", {name} = {value}" for name, value in self.options)
        return f"{self.name}, {1e3 * self.period:g} ms{options}"

    def controller(self, scenario: Scenario) -> Controller:
        """The controller for a scenario with this period.

        Raises:
            UnknownName: there is no such controller or option.
            OptionError: an option's value is not allowed.
        """
        options = dict(self.options)
        return make_controller(self.name, scenario.insertion(), scenario.period, **options)

    def to_json(self) -> str:
        """Name, period and options; what JSON does not know, as text."""
        return json.dumps([self.name, self.period, list(self.options)], default=str)

    @classmethod
    def from_json(cls, text: str) -> Law:
        """The inverse of to_json(); the controller need not be known here.

        Raises:
            OptionError: the name is not a word, or the period is not allowed.
        """
        name, period, options = json.loads(text)
        if not (isinstance(name, str) and re.fullmatch(r"\w{1,100}", name)):
            raise OptionError(f"controller {name!r:.50}, its name must be letters, digits and _")
        law = cls(period=period, options=tuple((option, value) for option, value in options))
        return law._replace(name=name)

    def known(self) -> Self:
        """Itself.

        Raises:
            UnknownName: there is no such controller.
        """
        return type(self)(*self)

    @property
    def stem(self) -> str:
        """As part of a file's name."""
        options = "".join(f"_{name}_{value}" for name, value in self.options)
        return part_of_name(f"{self.name}_{1e3 * self.period:g}ms{options}")


@dataclass(frozen=True, slots=True)
class Trial:
    """One operator, one arm, one controller.

    Attributes:
        scenario: name or file of a scenario whose path is a camera_trial().
        operator: number of the person in the study.
        seed: of the study.
        arm: name or path of a URDF; empty for the scenario's own.
        law: the controller.
        flange: with a URDF, the frame that carries the instrument.
        limits: of the joints, in place of the arm's own; None for those.
        learning: of the novices; None for the scenario's, as a rule none.
        port: where the incision is; None for the scenario's.
        instrument: in place of the scenario's own; None for that.
    """

    scenario: str
    operator: int
    seed: int
    arm: str
    law: Law
    flange: str | None = None
    limits: ArmLimits | None = None
    learning: Learning | None = None
    port: Port | None = None
    instrument: Instrument | None = None

    @property
    def stem(self) -> str:
        """Its file's name, without what kind of file it is."""
        arm = f"{part_of_name(self.arm)}_" if self.arm else ""
        return f"{arm}{self.law.stem}_operator{self.operator:04d}"

    def made(self) -> Scenario:
        """The scenario with this operator.

        Raises:
            OptionError: nobody steers in this scenario, or somebody of its own.
        """
        flange = self.flange if self.arm and not names_its_flange(self.arm) else None
        files = tuple(_stamp(name) for name in (self.scenario, self.arm))
        base = _base(
            self.scenario,
            self.arm,
            flange,
            self.law.period,
            self.limits,
            self.port,
            self.instrument,
            files,
        )
        given = camera_trial(base.path, self.scenario)
        if given.operator != Operator():
            raise OptionError(
                f"{self.scenario} has an operator of its own, and a study draws its people; leave "
                "the operator out, or run the scenario by itself with rcmqp run"
            )
        person, seed = operator_of_study(self.operator, self.seed)
        path = dataclasses.replace(
            given, operator=person, learning=self.learning or given.learning
        )
        return dataclasses.replace(base, path=path, seed=seed)


def _distinct(name: str, values: Iterable[Any]) -> tuple[Any, ...]:
    values = tuple(values)
    if not values or len(set(values)) < len(values):
        raise refused(name, values, "at least one, and none twice")
    return values


@options
@dataclass(frozen=True, slots=True)
class Study:
    """Every operator with every arm and controller.

    The same people, with the same luck, use every arm and controller: that is what makes
    comparisons between those paired.

    Attributes:
        scenario: name or file.
        operators: how many people; each second one is a novice, the first is.
        seed: of everything random. A person depends on it and the own number alone.
        arms: names, or paths of URDFs; an empty one is the scenario's own.
        laws: controllers.
        flange: for the arms that are URDFs.
        limits: of the joints, in place of every arm's own; None for those.
        learning: of the novices, practice before the trial and learning in it; None for people
            who do not learn.
        port: where the incision is; None for the scenario's.
        instrument: in place of the scenario's own; None for that.
    """

    scenario: str = "camera_task"
    operators: int = field(default=20, metadata=whole(1))
    seed: int = 0
    arms: tuple[str, ...] = field(default=("",), metadata=rule(_distinct))
    laws: tuple[Law, ...] = field(default=(Law(),), metadata=rule(_distinct))
    flange: str | None = None
    limits: ArmLimits | None = None
    learning: Learning | None = None
    port: Port | None = None
    instrument: Instrument | None = None

    def __post_init__(self) -> None:
        """Check the flange and the seed."""
        urdfs = [arm for arm in self.arms if arm and not names_its_flange(arm)]
        if self.flange is not None and not urdfs:
            raise OptionError(f"flange = {self.flange} is for a URDF, and none of the arms is one")
        operator_of_study(0, self.seed)

    def trials(self) -> list[Trial]:
        """Every trial; all of a person's one after the other."""
        return [
            Trial(
                self.scenario,
                i,
                self.seed,
                arm,
                law,
                self.flange,
                self.limits,
                self.learning,
                self.port,
                self.instrument,
            )
            for i, arm, law in itertools.product(range(self.operators), self.arms, self.laws)
        ]


@functools.cache
def _base(
    scenario: str,
    arm: str,
    flange: str | None,
    period: float,
    limits: ArmLimits | None,
    port: Port | None,
    instrument: Instrument | None,
    files: tuple[Stamp, ...],
) -> Scenario:
    """The scenario without anybody in it; ``files`` is for the cache alone."""
    base = load_scenario(
        scenario, arm or None, flange=flange, instrument=instrument, period=period
    )
    if limits is not None:
        given = dataclasses.replace(base.limits or ArmLimits(), **limits.given())
        base = dataclasses.replace(base, limits=given)
    return base if port is None else at_port(base, port)


def _stamp(name: str) -> Stamp:
    """Time of a file's last change [ns], and its size; (0, 0) if the file does not exist."""
    try:
        found = Path(name).stat()
    except OSError:
        return 0, 0
    return found.st_mtime_ns, found.st_size


def part_of_name(text: str) -> str:
    """The text if it can be part of a file's name; else some of its letters and a hash."""
    if re.fullmatch(r"[\w.+-]{1,80}", text):
        return text
    some = re.sub(r"[^\w.+-]", "", Path(text).stem)[:40]
    return f"{some}_{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def learning_of(practice: float | None) -> Learning | None:
    """Learning after ``practice`` seconds at the device; None if ``practice`` is None."""
    return None if practice is None else Learning(practice)
