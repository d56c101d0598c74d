"""A view that follows the hand as if through honey, and never moves abruptly."""

from __future__ import annotations

import math

from rcmqp.errors import OptionError
from rcmqp.references.view import ViewCommand

STIFFNESS = 350.0
"""Stiffness of the arm that holds the device [N/m]: see rcmqp.references.operators.Operator."""

QUICKEST = 0.02
"""Least time constant of the filter [s]: messages of a hand come every 16 ms."""

SPEEDS = (0.5, 0.5, 1.0, 0.05)
"""Largest rates of alpha, beta, gamma [rad/s] and t_z [m/s]: chosen here."""

ACCELERATIONS = (2.5, 2.5, 5.0, 0.25)
"""Largest changes of those rates [rad/s^2], [m/s^2]: chosen here."""


class Viscous:
    """A device's viscosity B, emulated for a device that takes no forces.

    A hand that pulls with stiffness K at a handle in a fluid of viscosity B moves it by
    B x_dot = K (x_hand - x): a first-order filter with the time constant tau = B / K. Each
    coordinate of the view follows the one asked for in this way, its rate and its acceleration
    limited; the rate follows with tau / 4, so that nothing overshoots.

    Attributes:
        view: now, with its rates.
    """

    def __init__(self, period: float, viscosity: float = 15.0) -> None:
        """Start at the view of the start, at rest.

        Args:
            period: from one step() to the next [s].
            viscosity: B [N s/m]; 15 as of the study's device.

        Raises:
            OptionError: the viscosity is negative or not finite.
        """
        if not 0.0 <= viscosity < math.inf:
            raise OptionError(f"viscosity = {viscosity} N s/m, it must be finite and 0 or more")
        self.view = ViewCommand()
        self._period, self._tau = period, max(viscosity / STIFFNESS, QUICKEST)

    def step(self, asked: ViewCommand) -> ViewCommand:
        """The view one period on, on the way to the one asked for."""
        view, tau = self.view, self._tau
        away = (
            asked.alpha - view.alpha,
            asked.beta - view.beta,
            asked.gamma - view.gamma,
            asked.t_z - view.t_z,
        )
        quick, T = 4.0 / tau, self._period
        places = [view.alpha, view.beta, view.gamma, view.t_z]
        rates = [view.alpha_dot, view.beta_dot, view.gamma_dot, view.t_z_dot]
        for k, (d, speed, most) in enumerate(zip(away, SPEEDS, ACCELERATIONS, strict=True)):
            wanted = math.copysign(min(abs(d) / tau, speed, math.sqrt(most * abs(d))), d)
            rates[k] += T * max(-most, min(most, quick * (wanted - rates[k])))
            places[k] += T * rates[k]
        self.view = ViewCommand(*places, *rates)
        return self.view
