"""One person at the haptic device, as numbers."""

from __future__ import annotations

from dataclasses import dataclass, field

from rcmqp.maths.options import at_least, between, one_of, options, positive

GROUPS = ("novice", "experienced")
"""Those new to such systems, and those who know them; none is a surgeon, as in the paper."""


@options
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

    group: str = field(default="experienced", metadata=one_of("group of operators", GROUPS))
    delay: float = field(default=0.20, metadata=at_least(0.0, "s"))
    interval: float = field(default=0.40, metadata=positive("s"))
    gain: float = field(default=0.85, metadata=positive())
    motor_noise: float = field(default=0.07, metadata=at_least(0.0))
    weber_lateral: float = field(default=0.045, metadata=at_least(0.0))
    weber_depth: float = field(default=0.22, metadata=at_least(0.0))
    weber_cross: float = field(default=0.05, metadata=at_least(0.0))
    floor_lateral: float = field(default=0.375e-3, metadata=at_least(0.0, "m"))
    floor_depth: float = field(default=1.6e-3, metadata=at_least(0.0, "m"))
    depth_bias: float = field(default=0.5e-3, metadata=at_least(0.0, "m"))
    memory: float = field(default=0.1, metadata=at_least(0.0))
    recognition: float = field(default=8.7, metadata=at_least(0.0, "s"))
    recognition_shape: float = field(default=3.0, metadata=positive())
    fitts_intercept: float = field(default=0.18, metadata=at_least(0.0, "s"))
    fitts_slope: float = field(default=0.09, metadata=at_least(0.0, "s/bit"))
    shortest: float = field(default=0.25, metadata=positive("s"))
    speed: float = field(default=0.08, metadata=positive("m/s"))
    tremor: float = field(default=80e-6, metadata=at_least(0.0, "m"))
    tremor_frequency: float = field(default=10.0, metadata=positive("Hz"))
    tremor_damping: float = field(default=0.06, metadata=between(0.0, 1.0))
    margin: float = field(default=5e-3, metadata=at_least(0.0, "m"))
    caution: float = field(default=2.0, metadata=at_least(0.0))
    mass: float = field(default=0.35, metadata=positive("kg"))
    stiffness: float = field(default=350.0, metadata=positive("N/m"))
    damping: float = field(default=12.0, metadata=positive("N s/m"))
