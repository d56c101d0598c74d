"""Physiological tremor: noise in a narrow band about a frequency."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from rcmqp.errors import OptionError

BLOCK = 1024
"""Draws taken at a time."""

TICK = 1e-3
"""Between two values of the tremor [s], whatever the sampling period: a person's tremor does not
depend on the controller's."""


class Tremor:
    """One number a cycle and axis, standard deviation 1, peak at a frequency.

    A damped oscillator x'' + 2 zeta w x' + w^2 x driven by white noise, sampled: with
    p = exp((-zeta + i sqrt(1 - zeta^2)) w T),

        x(k) = 2 Re(p) x(k-1) - |p|^2 x(k-2) + e(k),   n(k) = s (x(k) - x(k-1)),

    s such that n has unit variance. The difference leaves nothing at low frequencies, to which
    an arm gives way more than to tremor. It starts at rest.
    """

    def __init__(
        self, frequency: float, damping: float, period: float, rng: np.random.Generator
    ) -> None:
        """At ``frequency`` [Hz] with damping ratio zeta, looked at every ``period`` [s].

        Raises:
            OptionError: the period is too long to sample the frequency.
        """
        if not frequency * period < 0.5:
            raise OptionError(
                f"a period of {period} s cannot show a tremor of {frequency} Hz; make it "
                f"shorter than {0.5 / frequency:.3g} s"
            )
        turn = 2.0 * math.pi * frequency * TICK
        size, angle = math.exp(-damping * turn), math.sqrt(1.0 - damping**2) * turn
        self._a, self._b = 2.0 * size * math.cos(angle), -(size**2)
        a, b = self._a, self._b
        variance = (1.0 - b) / ((1.0 + b) * ((1.0 - b) ** 2 - a**2))  # of x
        self._scale = 1.0 / math.sqrt(2.0 * variance * (1.0 - a / (1.0 - b)))
        self._now, self._before = [0.0] * 3, [0.0] * 3
        self._rng, self._period = rng, period
        self._steps, self._ticks = 0, 0
        self._drawn: Iterator[list[float]] = iter(())

    def step(self) -> list[float]:
        """The value of each of the three axes a period later."""
        self._steps += 1
        due = int(self._steps * self._period / TICK + 1e-6)
        while self._ticks < due:
            self._tick()
        return [now - before for now, before in zip(self._now, self._before, strict=True)]

    def _tick(self) -> None:
        """One value further."""
        drawn = next(self._drawn, None)
        if drawn is None:
            noise = self._scale * self._rng.normal(size=(BLOCK, 3))
            self._drawn = iter(noise.tolist())
            drawn = next(self._drawn)
        a, b, now, before = self._a, self._b, self._now, self._before
        after = [a * now[i] + b * before[i] + drawn[i] for i in range(3)]
        self._before, self._now = now, after
        self._ticks += 1
