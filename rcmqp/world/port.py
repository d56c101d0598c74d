"""Where the incision is in a patient of one's own, and how the instrument gets into it."""

from __future__ import annotations

import dataclasses
import math
import warnings
from dataclasses import dataclass

from rcmqp.errors import ArmWarning, OptionError
from rcmqp.world.geometry import Collisions
from rcmqp.world.insertion import SHAFT_TOLERANCE, Insertion
from rcmqp.world.instrument import Vector3, vector3
from rcmqp.world.start import find_start

DOWN: Vector3 = (0.0, 0.0, -1.0)

UPWARDS = 0.1
"""Sine of the angle to the horizontal above which an axis points upwards."""


@dataclass(frozen=True, slots=True)
class Port:
    """Values of the incision; None keeps the scenario's.

    With a pivot alone the arm moves to a start that find_start() finds. With a tolerance as well
    the instrument is in already: the arm stays at its start, and the pivot, measured a little off
    the shaft, is taken as it is if it is no farther off than that. With a depth and no pivot the
    incision is put on the shaft where it is, that far before the tip.

    Attributes:
        pivot: (3,) in the world [m].
        axis: (3,) in the world, into the patient; straight down without it, or the shaft's own
            direction where the arm stays.
        depth: how far the tip is beyond the pivot at the start [m].
        cone: how far the shaft may tilt from the axis [rad].
        tolerance: how far off the shaft the pivot may be found [m].
    """

    pivot: Vector3 | None = None
    axis: Vector3 | None = None
    depth: float | None = None
    cone: float | None = None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if self.pivot is None:
            for name in ("axis", "tolerance"):
                if getattr(self, name) is not None:
                    raise OptionError(f"{name} goes with a trocar; say where that is as well")
        elif self.tolerance is not None and self.depth is not None:
            raise OptionError(
                "depth and tolerance do not go together: with a tolerance the arm stays where it "
                "is, and so does the tip; leave one of them out"
            )
        if self.tolerance is not None and not 0.0 < self.tolerance <= 0.05:
            raise OptionError(
                f"tolerance = {1e3 * self.tolerance:g} mm, it must be above 0 and at most 50 mm"
            )

    def insertion(self, before: Insertion) -> Insertion:
        """The instrument of another insertion in this port.

        Args:
            before: its arm, instrument and obstacles stay; so do its joint angles, unless a pivot
                without a tolerance is given, and of its trocar what the port does not say.

        Raises:
            TrocarOffShaft: the pivot is farther off the shaft than the tolerance.
            InsertionError: no start was found, or depth or cone do not fit.

        Warns:
            ArmWarning: the trocar's axis points upwards, or the arm touches itself or the shaft.
        """
        arm, instrument, angles = before.bare, before.instrument, before.angles_start
        trocar, tolerance = before.trocar, before.tolerance
        if self.cone is not None:
            trocar = dataclasses.replace(trocar, cone_half_angle=self.cone)
        if not self.keeps_pivot:
            tolerance = SHAFT_TOLERANCE if self.tolerance is None else self.tolerance
            depth = before.tip_depth if self.depth is None else self.depth
            stays = self.pivot is None or self.tolerance is not None
            effector = arm.with_effector(instrument.on_shaft(instrument.tip - depth))
            at = effector.state(arm.configuration(angles[: arm.nv])).oMe
            shaft = vector3("shaft", at.rotation[:, 2])
            trocar = dataclasses.replace(
                trocar,
                pivot=self.pivot or vector3("pivot", at.translation),
                axis=self.axis or (shaft if stays else DOWN),
            )
            if not stays:
                angles = find_start(arm, instrument, trocar, depth=depth)
        made = Insertion(
            arm,
            instrument,
            trocar,
            angles,
            tolerance=tolerance,
            obstacles=before.obstacles,
        )
        if self.pivot is not None:
            for question in _questions(made):
                warnings.warn(question, ArmWarning, stacklevel=2)
        return made

    @property
    def keeps_pivot(self) -> bool:
        """Whether the incision stays where it is; then only its cone may change."""
        return self.pivot is None and self.depth is None


def _questions(made: Insertion) -> list[str]:
    """A sentence, with a remedy, for an axis that points upwards, and for parts that touch."""
    found, axis = [], made.trocar.axis
    if axis[2] > UPWARDS:
        angle = math.degrees(math.asin(min(1.0, axis[2])))
        given = ", ".join(f"{each:.3g}" for each in axis)
        found.append(
            f"the trocar's axis ({given}) points {angle:.0f} deg upwards, so the instrument comes "
            "from below; the axis points into the patient: if it was meant the other way round, "
            "change its signs, and where the arm stays at its start, choose a start with the "
            "shaft downwards"
        )
    if touching := Collisions(made.arm, made.instrument).first(made.angles_start):
        found.append(
            f"{made.arm.name} starts with {touching} touching; choose another start: without a "
            "tolerance one free of collisions is searched"
        )
    return found
