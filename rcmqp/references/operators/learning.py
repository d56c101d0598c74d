"""Practice: how a novice becomes better, before a trial and during it.

The paper gave two minutes of practice to those without experience, and says that they were then
nearly as good as the others. By itself the operator model does not learn: its novices are people
after those two minutes, from the first second of a trial to its last. This is the option.

A source in brackets says how it is known. [V] was read, at least in its abstract: Newell and
Rosenbloom's power law of practice (1981), as PMC8686050 sums it up; Heathcote, Brown and Mewhort
2000 (Psychonomic Bulletin and Review 7, 185-207), who find in 40 sets of data that people one by
one learn exponentially, and that averages over people look like a power law; Kunert et al. 2021
(Surgical Endoscopy 35, 3303-3312: 40 novices, ten repetitions of a positioning task in a box
trainer: times fall exponentially to a plateau, time is learned faster than precision);
PMC5570794 (60 novices in laparoscopic hand-eye coordination: two-phase exponential decay);
Stefanidis's camera navigation trainer (corescholar.libraries.wright.edu/internal_medicine/95:
students who practised navigating the camera became faster, those who did not did not). [A] is
assumed. Nobody has published how fast people learn this device and task, so the time constants
below are assumed: a study with learning shows what learning could do; it is not a measurement.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field

from rcmqp.maths.options import at_least, one_of, options
from rcmqp.references.operators.population import GROUPS, PARAMETERS, Operator

SHAPES = ("exponential", "power")

REFERENCE = 120.0
"""Practice after which a novice has the numbers of PARAMETERS [s]: the paper's two minutes."""


@options
@dataclass(frozen=True, slots=True)
class Learning:
    """How what a novice lacks goes away with the time at the device.

    The plateau is the experienced group: each number p in which the groups differ is

        p(t) = p (r + (1 - r) w(t)),   r = experienced / novice, of the groups' medians,

    and w, the share of the difference that is left after ``practice`` + t seconds, is

        exponential:  w = exp(-(practice + t - 120) / time)
        power:        w = ((prior + practice + t) / (prior + 120))^(-rate).

    So w = 1 at the start of a trial after two minutes of practice: that is where the novices'
    numbers belong. With less practice they are worse, and no number leaves its range in
    PARAMETERS. The experienced do not change: they had no practice in the paper either.

    Attributes:
        practice: before the trial [s]; the paper's 120. 0 for none.
        shape: exponential, as single people learn [V: Heathcote et al.; Kunert et al.], or power,
            as averages over people do [V: Newell and Rosenbloom].
        time: time constant of ``exponential`` [s] [A]: a trial of the novices is about 80 s, and
            in that time a quarter of the difference goes.
        prior: experience that a novice brings along, of ``power`` [s] [A].
        rate: exponent of ``power`` [A]; 0.5 takes about as much off during a trial.
    """

    practice: float = field(default=REFERENCE, metadata=at_least(0.0, "s"))
    shape: str = field(default="exponential", metadata=one_of("shape of learning", SHAPES))
    time: float = field(default=300.0, metadata=at_least(1.0, "s"))
    prior: float = field(default=60.0, metadata=at_least(1.0, "s"))
    rate: float = field(default=0.5, metadata=at_least(0.0))

    def share(self, t: float) -> float:
        """Share of the difference between the groups that is left ``t`` [s] into the trial.

        1 is all of it; it is above 1 with less practice than the paper's.
        """
        if self.shape == "exponential":
            return math.exp((REFERENCE - self.practice - t) / self.time)
        return math.pow((self.prior + self.practice + t) / (self.prior + REFERENCE), -self.rate)

    def person(self, operator: Operator, t: float) -> Operator:
        """The operator as ``t`` [s] into the trial has made them."""
        share = self.share(t)
        if operator.group != GROUPS[0] or share == 1.0:
            return operator
        changes = {}
        for name, ratio in _RATIOS.items():
            value = getattr(operator, name) * (ratio + (1.0 - ratio) * share)
            changes[name] = min(max(value, PARAMETERS[name].low), PARAMETERS[name].high)
        return dataclasses.replace(operator, **changes)


_RATIOS = {
    name: p.experienced.first / p.novice.first
    for name, p in PARAMETERS.items()
    if p.experienced.first != p.novice.first
}
"""Experienced over novice of each number in which the groups differ."""
