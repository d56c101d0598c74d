"""A scenario: everything about a run but the controller, as frozen data."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Generator, Iterable
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import (
    at_least,
    between,
    one_of,
    options,
    or_none,
    part,
    positive,
    refused,
    rule,
    whole,
)
from rcmqp.plants import Kinematic, Plant
from rcmqp.references.governor import Governor, PathClock, check_may_wait
from rcmqp.references.operators import Steered
from rcmqp.references.paths import Foreign, Path
from rcmqp.references.planner import Planner
from rcmqp.references.view import Reference
from rcmqp.runs import asked, scenario_json
from rcmqp.world.arm import Arm, ArmState
from rcmqp.world.arm_limits import ArmLimits
from rcmqp.world.carried import CarriedArm, own_name
from rcmqp.world.insertion import SHAFT_TOLERANCE, Insertion
from rcmqp.world.instrument import Instrument, Trocar
from rcmqp.world.loading import arm_names, load_arm, names_its_flange
from rcmqp.world.motions import Motion, Still
from rcmqp.world.obstacles import Sphere

DEFAULT_ARM = "lwa3"

PIVOT_VELOCITIES = ("measured", "estimated", "unknown")

PLANNER_STARTS = ("reference", "measured")

MOST_CYCLES = 10_000_000
"""Sampling instants that a run may have; each takes about a kilobyte."""

MOST_LETTERS = {"name": 200, "arm": 4096, "flange": 1000}
"""Of texts in a scenario: an arm may be the path of a URDF."""

MOST_TIME = 1e300
"""Seconds that duration and period are below: their ratio is finite."""


def _angles(name: str, values: Iterable[float]) -> tuple[float, ...]:
    angles = tuple(map(float, values))
    if not all(map(math.isfinite, angles)):
        raise refused(name, angles, "finite numbers")
    return angles


def _text(name: str, value: str) -> str:
    """A text of at most MOST_LETTERS."""
    if not isinstance(value, str):
        raise refused(name, value, "text")
    if len(value) > MOST_LETTERS[name] or "\0" in value:
        raise refused(name, value, f"at most {MOST_LETTERS[name]} letters without NUL")
    return value


def _path(name: str, path: Path | Steered) -> Path | Steered:
    if not isinstance(path, Foreign) and scenario_json.kind_of("path", path) is None:
        raise OptionError(
            f"{name} = {path!r} is of no registered kind; add its class to "
            "rcmqp.references.paths.PATHS"
        )
    return path


def _spheres(name: str, values: Iterable[Sphere]) -> tuple[Sphere, ...]:
    spheres = tuple(values)
    for sphere in spheres:
        if not isinstance(sphere, Sphere):
            raise OptionError(f"{name}: {sphere!r} is no Sphere")
    return spheres


def _limits(name: str, limits: ArmLimits | None) -> ArmLimits | None:
    """The limits, or None if they set no limit."""
    if not isinstance(limits, ArmLimits | None):
        raise refused(name, limits, "of type ArmLimits, or None")
    return None if limits == ArmLimits() else limits


@options
@dataclass(frozen=True, slots=True)
class Scenario:
    """An arm with an endoscope in a trocar, and what is asked of it.

    Plain numbers and names only: two scenarios that compare equal give the same run to the bit.

    Attributes:
        name: what it is called.
        arm: a name that load_arm() knows, or the path of an arm's file or of a URDF.
        angles_start: (nv,) joint angles at the start [rad].
        instrument: the endoscope.
        trocar: the incision.
        path: the views asked for; a steered one depends on what the camera shows.
        duration: how long to simulate [s]; past its own end, the path stays where it is, and a
            steered one may end the run before.
        period: sampling period T [s].
        flange: with a URDF, the frame that carries the instrument.
        planner_time: how long the path planner takes from one view to a far one [s], in equal
            parts of one period each; None sends every view to the controller as it is.
        shaft_tolerance: how far off the shaft the trocar may be found at the start [m].
        seed: of what is random in the scenario.
        motion: of the trocar, counted from ``trocar.pivot``; the views go along with it.
        pivot_velocity: what the controller is told of the trocar's velocity, whose position it
            always knows: ``measured``, the velocity itself; ``estimated``, the way since the
            last cycle over the period; ``unknown``, zero.
        obstacles: what the instrument is to keep out of.
        plant: what the joint velocity drives.
        governor: slows the path down where the tip falls behind; the duration stays what it is,
            so a slowed path may not come to its end. Neither the trocar's motion nor the path
            planner's parts are slowed. None for a path that does not wait.
        limits: of the joints, in place of the arm's own; None if none was set.
        planner_from: where the path planner starts towards a far view: ``reference``, at the last
            reference; ``measured``, as in the paper's text, at the pose of the effector, which was
            measured one period before.
        carried_arm: the arm as the file of a run has it.
    """

    name: str = field(metadata=rule(_text))
    arm: str = field(metadata=rule(_text))
    angles_start: tuple[float, ...] = field(metadata=rule(_angles))
    instrument: Instrument
    trocar: Trocar
    path: Path | Steered = field(metadata=rule(_path))
    duration: float = field(metadata=between(0.0, MOST_TIME, "s"))
    period: float = field(default=1e-3, metadata=between(0.0, MOST_TIME, "s"))
    flange: str | None = field(default=None, metadata=or_none(rule(_text)))
    planner_time: float | None = field(default=None, metadata=or_none(positive("s")))
    shaft_tolerance: float = field(default=SHAFT_TOLERANCE, metadata=at_least(0.0, "m"))
    seed: int = field(default=0, metadata=whole(0))
    motion: Motion = field(default_factory=Still)
    pivot_velocity: str = field(
        default="measured", metadata=one_of("pivot_velocity", PIVOT_VELOCITIES)
    )
    obstacles: tuple[Sphere, ...] = field(default=(), metadata=rule(_spheres))
    plant: Plant = field(default_factory=Kinematic)
    governor: Governor | None = field(default=None, metadata=or_none(part(Governor)))
    limits: ArmLimits | None = field(default=None, metadata=rule(_limits))
    planner_from: str = field(default="reference", metadata=one_of("planner_from", PLANNER_STARTS))
    carried_arm: CarriedArm | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        if self.cycles > MOST_CYCLES:
            raise OptionError(
                f"duration = {self.duration} s has {self.cycles} periods of {self.period} s; a "
                f"run keeps at most {MOST_CYCLES} in memory"
            )
        if self.cycles < 2:
            raise OptionError(
                f"duration = {self.duration} s is shorter than one period of {self.period} s"
            )
        if self.governor is not None:
            check_may_wait(self.path)
        if self.planner_time is not None and not 2.0 * self.period <= self.planner_time:
            raise OptionError(
                f"planner_time = {self.planner_time} s, it must be two periods of "
                f"{self.period} s or more"
            )

    @classmethod
    def on_shaft(
        cls,
        name: str,
        arm: str,
        path: Path | Steered,
        *,
        flange: str | None = None,
        angles_start: ArrayLike | None = None,
        depth: float = 0.1,
        limits: ArmLimits | None = None,
        **fields: Any,
    ) -> Self:
        """A scenario with the trocar where the shaft is, ``depth`` [m] before the tip.

        Args:
            name: what it is called.
            arm: a name that load_arm() knows, or the path of a URDF.
            path: the views asked for; they are simulated to their end.
            flange: with a URDF, the frame that carries the instrument.
            angles_start: (nv,) joint angles at the start [rad]; the arm's home without them.
            depth: how far the tip is inside at the start [m].
            limits: of the joints, in place of the arm's own.
            fields: of the scenario, other than their defaults.
        """
        loaded = load_arm(arm, flange, **given_limits(limits))
        insertion = Insertion.on_shaft(loaded, Instrument(), angles_start, depth=depth)
        return cls.of(name, insertion, path, **({"limits": limits} | fields))

    def __str__(self) -> str:
        return f"{self.name} on {own_name(self.arm)}"

    @property
    def cycles(self) -> int:
        """Number of sampling instants, the first at 0, the last nearest to ``duration``."""
        return round(self.duration / self.period) + 1

    @classmethod
    def of(cls, name: str, insertion: Insertion, path: Path | Steered, **fields: Any) -> Self:
        """The scenario of a path on an insertion that is at hand, for the path's duration.

        Args:
            name: what to call it.
            insertion: its arm was loaded by name, or from a file; limits set by hand are kept.
            path: the views asked for.
            fields: any other field of Scenario.

        Raises:
            OptionError: the arm holds joints that load_arm() was told to hold.
        """
        arm = insertion.bare
        if arm.source is not None and arm.source.locked:
            joint, angle = next(iter(arm.source.locked.items()))
            raise OptionError(
                f"{arm.name} holds {joint} at {angle:g} by load_arm(locked=...), which a scenario "
                "does not keep; write an arm's file, my_robot.toml, with the joint in [locked], "
                "and load that"
            )
        carried = arm.source is not None and arm.source.carried
        given = {
            "arm": arm.name if carried or arm.name in arm_names() else os.path.abspath(arm.name),
            "carried_arm": CarriedArm.of(arm) if carried else None,
            "flange": None if names_its_flange(arm.name) else arm.flange,
            "angles_start": tuple(insertion.angles_start),
            "instrument": insertion.instrument,
            "trocar": insertion.trocar,
            "duration": path.duration,
            "limits": arm.limits_by_hand,
        }
        return cls(name=name, path=path, **(given | fields))

    def load_arm(self) -> Arm:
        """The arm, with the limits given by hand; of a run's scenario, the one that it carries.

        Raises:
            RcmqpError: the arm cannot be loaded.
        """
        if self.carried_arm is None:
            return load_arm(self.arm, self.flange, **given_limits(self.limits))
        return self.carried_arm.load(self.flange, given_limits(self.limits))

    def portable(self) -> Scenario:
        """The scenario as a file has it: an arm's file is named without its folders."""
        return dataclasses.replace(self, arm=own_name(self.arm))

    def insertion(self) -> Insertion:
        """Load the arm, and return it with the instrument in the trocar.

        Raises:
            RcmqpError: the arm cannot be loaded, or things do not fit together.
        """
        return Insertion(
            self.load_arm(),
            self.instrument,
            self.trocar,
            self.angles_start,
            tolerance=self.shaft_tolerance,
            obstacles=self.obstacles,
        )

    def has_limits_of(self, arm: Arm) -> bool:
        """Whether an arm of the scenario's name has the limits that the scenario gives it."""
        by_hand = arm.limits_by_hand.given()
        if not by_hand.keys() | given_limits(self.limits).keys():
            return True
        own = self.load_arm()
        names = ("lower", "upper", "velocity", "acceleration", "jerk")
        return (
            all(np.array_equal(getattr(own, name), getattr(arm, name)) for name in names)
            and own.speed_near_limits == arm.speed_near_limits
            and own.assumed == arm.assumed
        )

    def planner(self, x_rcm: Array) -> Planner | None:
        """The path planner about x_rcm (8,), N + 1 = planner_time / period; None without one."""
        if self.planner_time is None:
            return None
        return Planner(x_rcm, round(self.planner_time / self.period) - 1, self.period)

    def pivots(self, cycles: range | None = None) -> Array:
        """The trocar in the world (n, 3) at n sampling instants, by default all [m]."""
        cycles = range(self.cycles) if cycles is None else cycles
        return np.array(self.trocar.pivot) + asked.offsets(self, cycles)

    def clock(self) -> PathClock | None:
        """A clock for references(), to look at from outside; None without a governor."""
        return None if self.governor is None else PathClock(self.governor)

    def references(
        self, insertion: Insertion, clock: PathClock | None = None
    ) -> Generator[Reference, ArmState | None]:
        """The controller's references, one for each sampling instant.

        The view asked for, carried along by the trocar, through the path planner; and of the
        trocar's velocity what ``pivot_velocity`` says. A steered path, a governor, or a planner
        that starts from the measured pose, needs to see what the last reference led to: send() the
        state that was measured then. If nothing is sent, the arm is taken to be where it was
        asked to be.

        Args:
            insertion: the instrument in the patient.
            clock: what clock() made, which shows the path's time; one is made if not given.

        Raises:
            InsertionError: a view is deeper than the shaft is long.
            OptionError: the path is Foreign.
        """
        return asked.references(self, insertion, clock)

    def to_json(self, *, carry: bool = False) -> str:
        """Write the scenario as JSON; from_json() reads an equal one.

        Args:
            carry: whether the arm of a file of one's own goes along, so that the scenario can be
                run elsewhere.
        """
        return scenario_json.written(self, carry)

    @classmethod
    def from_json(cls, text: str) -> Scenario:
        """Read the JSON of to_json().

        Fields that have a default may be missing, as they are in files of earlier versions. A
        path of an unknown kind is Foreign: it cannot be run, but what was run can be looked at.

        Raises:
            OptionError: the text is not a scenario; the message says what is wrong with it.
            UnknownName: its motion or plant is of an unknown kind.
        """
        return scenario_json.read(text, cls)


def given_limits(limits: ArmLimits | None) -> dict[str, Any]:
    """The limits set by hand, as load_arm() takes them."""
    return {} if limits is None else limits.given()
