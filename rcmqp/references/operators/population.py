"""Who takes part: operators drawn at random, every number with its source and range.

A source in brackets says how it is known. [V] was read: Riviere, Rader and Khosla 1997 (eye
surgeons held an instrument still to 49 um rms; 98.9 % of voluntary movement is below 2 Hz);
PMC3989364 (144 to 285 um in three dimensions, peak in 6 to 12 Hz); Muerbe 2001 (tremor at 8.1 Hz
on average); PMC3032442 (15 to 254 um an axis); Seydell et al. 2008, PMC3844797 (people allow
for the spread of their own movements near what they must not touch). [M] is customary in the
literature on manual control and quoted from memory: Meyer et al. 1988 and Crossman and Goodeve on
submovements, Harris and Wolpert 1998 on noise in proportion to the signal, McRuer on the
operator's delay, Fitts 1954. [C] was fitted, for this project and before this study, so that the
completion times of a kinematic model match the paper's mean and deviation: what these times come
out as is not a result. [A] is assumed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rcmqp.maths.options import allowed, at_least, between, one_of, options, positive, whole

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


@dataclass(frozen=True, slots=True)
class Spread:
    """How a number varies between people.

    Attributes:
        kind: ``normal`` with mean and deviation, ``lognormal`` with median and the deviation of
            the logarithm, ``uniform`` between the two, ``fixed`` at the first.
        first, second: its two numbers.
    """

    kind: str
    first: float
    second: float = 0.0

    def draw(self, rng: np.random.Generator) -> float:
        """One person's number; ``fixed`` uses up no chance."""
        if self.kind == "normal":
            return float(rng.normal(self.first, self.second))
        if self.kind == "lognormal":
            return self.first * math.exp(self.second * float(rng.normal()))
        if self.kind == "uniform":
            return float(rng.uniform(self.first, self.second))
        return self.first


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number of an Operator.

    Attributes:
        unit: its unit.
        novice, experienced: how it varies in each group.
        low, high: the range that the source gives, or that makes sense; what is drawn outside
            is brought to its edge.
        source: where the numbers come from.
    """

    unit: str
    novice: Spread
    experienced: Spread
    low: float
    high: float
    source: str


def _both(
    unit: str, kind: str, first: float, second: float, low: float, high: float, source: str
) -> Parameter:
    return Parameter(
        unit, Spread(kind, first, second), Spread(kind, first, second), low, high, source
    )


def _fixed(unit: str, value: float, low: float, high: float, source: str) -> Parameter:
    return _both(unit, "fixed", value, 0.0, low, high, source)


def _each(
    unit: str,
    kind: str,
    novice: tuple[float, float],
    experienced: tuple[float, float],
    low: float,
    high: float,
    source: str,
) -> Parameter:
    return Parameter(unit, Spread(kind, *novice), Spread(kind, *experienced), low, high, source)


PARAMETERS: Mapping[str, Parameter] = {
    "delay": _each(
        "s", "normal", (0.25, 0.03), (0.20, 0.03), 0.15, 0.35, "[M] McRuer, crossover model"
    ),
    "interval": _each(
        "s", "lognormal", (0.55, 0.25), (0.40, 0.25), 0.2, 1.2, "[M] Meyer: refractory 0.2-0.5 s"
    ),
    "gain": _each(
        "1",
        "normal",
        (0.75, 0.06),
        (0.85, 0.06),
        0.55,
        1.0,
        "[M] Meyer: primary submovements fall 5-25 % short",
    ),
    "motor_noise": _each(
        "1",
        "lognormal",
        (0.10, 0.25),
        (0.07, 0.25),
        0.03,
        0.2,
        "[M] Harris and Wolpert: 0.05-0.15",
    ),
    "weber_lateral": _fixed("1", 0.045, 0.02, 0.08, "[C]; a Weber fraction of length"),
    "weber_depth": _each(
        "1",
        "lognormal",
        (0.35, 0.35),
        (0.22, 0.35),
        0.05,
        1.0,
        "[C]; the paper's users complained of depth",
    ),
    "weber_cross": _fixed("1", 0.05, 0.0, 0.1, "[A]"),
    "floor_lateral": _fixed("m", 0.375e-3, 0.1e-3, 1e-3, "[C]"),
    "floor_depth": _each(
        "m", "lognormal", (2.6e-3, 0.35), (1.6e-3, 0.35), 0.5e-3, 6e-3, "[C]; see weber_depth"
    ),
    "depth_bias": _each("m", "fixed", (0.8e-3, 0), (0.5e-3, 0), 0.0, 2e-3, "[A]"),
    "memory": _fixed("1", 0.1, 0.02, 0.3, "[A] a tenth of the distance"),
    "recognition": _each(
        "s",
        "lognormal",
        (15.5, 0.45),
        (8.7, 0.45),
        2.0,
        60.0,
        "[C]; most of the paper's times is looking, not moving",
    ),
    "recognition_shape": _fixed("1", 3.0, 1.0, 10.0, "[C]"),
    "fitts_intercept": _fixed("s", 0.18, 0.05, 0.3, "[M] Fitts"),
    "fitts_slope": _fixed("s/bit", 0.09, 0.05, 0.25, "[M] Fitts: about 0.1 s/bit"),
    "shortest": _fixed("s", 0.25, 0.15, 0.4, "[M] duration of corrective submovements"),
    "speed": _each(
        "m/s", "fixed", (0.06, 0), (0.08, 0), 0.02, 0.2, "[M] tools in surgery: mean 20-60 mm/s"
    ),
    "tremor": _both(
        "m",
        "lognormal",
        80e-6,
        0.4,
        30e-6,
        250e-6,
        "[V] Riviere: 49 um; PMC3989364: 144-285 um in 3-D",
    ),
    "tremor_frequency": _both(
        "Hz", "uniform", 8.0, 12.0, 8.0, 12.0, "[V] PMC3989364: 6-12 Hz; Muerbe: 8.1 Hz"
    ),
    "tremor_damping": _fixed("1", 0.06, 0.02, 0.2, "[A] a narrow band"),
    "margin": _each(
        "m",
        "lognormal",
        (7.5e-3, 0.35),
        (5e-3, 0.35),
        2e-3,
        12e-3,
        "[A] about the shaft's radius",
    ),
    "caution": _fixed(
        "1", 2.0, 0.0, 3.0, "[A]; that people allow for their own spread: [V] Seydell et al. 2008"
    ),
    "mass": _fixed("kg", 0.35, 0.2, 1.0, "[M] hand and handle"),
    "stiffness": _fixed("N/m", 350.0, 100.0, 800.0, "[M] a relaxed to a firm arm"),
    "damping": _fixed("N s/m", 12.0, 5.0, 40.0, "[M] likewise"),
}
"""Every number of an Operator."""


def draw_operator(group: str, seed: int | np.random.SeedSequence) -> Operator:
    """One person of a group.

    The same person comes of the same seed; the two groups differ in their numbers' spreads only,
    so a novice and an experienced operator of one seed have the same luck.

    Raises:
        UnknownName: there is no such group.
    """
    Operator(group)
    rng, values = np.random.default_rng(seed), {}
    for name, parameter in PARAMETERS.items():
        value = getattr(parameter, group).draw(rng)
        values[name] = min(max(value, parameter.low), parameter.high)
    return Operator(group, **values)


def operator_of_study(index: int, seed: int) -> tuple[Operator, int]:
    """The person with number ``index`` in a study, and the seed of the person's trial.

    Neither depends on how many there are: novices and experienced take turns, so half of an
    even number belong to each group, as in the paper (the mean of its two groups' mean times is
    the mean of all).

    Raises:
        OptionError: index or seed is not a whole number from 0 on.
    """
    index, seed = allowed("index", index, whole(0)), allowed("seed", seed, whole(0))
    person, trial = np.random.SeedSequence(seed, spawn_key=(index,)).spawn(2)
    return draw_operator(GROUPS[index % 2], person), int(trial.generate_state(1)[0])
