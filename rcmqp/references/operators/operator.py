"""One person at the haptic device, as numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from rcmqp.errors import OptionError, UnknownName

GROUPS = ("novice", "experienced")
"""Those new to such systems, and those who know them; none is a surgeon, as in the paper."""


@dataclass(frozen=True, slots=True)
class Operator:
    """How somebody sees, decides and moves.

    Each number has its source and its range in rcmqp.references.operators.population, which also
    draws them; the defaults are the medians of the experienced.

    Attributes:
        group: one of GROUPS; a name only, what it means is in the numbers.
        delay: from what the camera shows to a movement begun for it [s].
        interval: least time from the start of one submovement to the next [s].
        gain: share of the perceived distance that a submovement is meant to cover.
        motor_noise: standard deviation of where a submovement ends, over its length, each axis.
        weber_lateral, weber_depth: standard deviation of a perceived distance over the
            distance, across the image and along the view.
        weber_cross: what the distance across adds to the uncertainty in depth, likewise.
        floor_lateral, floor_depth: what remains of it at the goal [m].
        depth_bias: standard deviation of a further error in depth, whatever the distance, drawn
            anew at each decision [m].
        memory: error, each axis, of where something is that is not in the image, over its distance
            from the nearest thing that is.
        recognition: mean time to find out from the two pictures where to go [s], once an
            objective; gamma distributed, with ``recognition_shape``.
        recognition_shape: of that distribution.
        fitts_intercept, fitts_slope: a, b of a submovement's duration a + b log2(1 + d / 1 mm)
            [s], [s/bit].
        shortest: duration of the shortest submovement [s].
        speed: highest speed of a submovement [m/s].
        tremor: rms of the free hand's tremor, each axis [m].
        tremor_frequency: [Hz].
        tremor_damping: damping ratio of the narrow band about it.
        margin: distance that the shaft is meant to keep from the obstacle [m], had the way no
            error.
        caution: standard deviations of the way's own error that are kept on top of it.
        mass: of hand, handle and what moves with them [kg].
        stiffness: of the arm [N/m].
        damping: of the arm [N s/m].
    """

    group: str = "experienced"
    delay: float = 0.20
    interval: float = 0.40
    gain: float = 0.85
    motor_noise: float = 0.07
    weber_lateral: float = 0.045
    weber_depth: float = 0.22
    weber_cross: float = 0.05
    floor_lateral: float = 0.375e-3
    floor_depth: float = 1.6e-3
    depth_bias: float = 0.5e-3
    memory: float = 0.1
    recognition: float = 8.7
    recognition_shape: float = 3.0
    fitts_intercept: float = 0.18
    fitts_slope: float = 0.09
    shortest: float = 0.25
    speed: float = 0.08
    tremor: float = 80e-6
    tremor_frequency: float = 10.0
    tremor_damping: float = 0.06
    margin: float = 5e-3
    caution: float = 2.0
    mass: float = 0.35
    stiffness: float = 350.0
    damping: float = 12.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.group not in GROUPS:
            raise UnknownName("group of operators", str(self.group), GROUPS)
        for item in fields(self)[1:]:
            value = getattr(self, item.name)
            if not (isinstance(value, int | float) and 0.0 <= value < math.inf):
                raise OptionError(f"{item.name} = {value}, it must be finite and 0 or more")
        for name in ("interval", "gain", "shortest", "speed", "mass", "stiffness", "damping"):
            if getattr(self, name) == 0.0:
                raise OptionError(f"{name} = 0, it must be positive: nobody would move")
        if not self.recognition_shape > 0.0:
            raise OptionError(f"recognition_shape = {self.recognition_shape}, must be positive")
        if not (self.tremor_frequency > 0.0 and 0.0 < self.tremor_damping < 1.0):
            raise OptionError(
                f"tremor_frequency = {self.tremor_frequency} Hz must be positive, tremor_damping "
                f"= {self.tremor_damping} between 0 and 1"
            )
