"""Haptic devices: turn the position of the handle into the view that is asked for.

A recorded trace, a model of an operator or the driver of a device gives one DeviceState in each
cycle; a HandView turns it into a ViewCommand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rcmqp.errors import InvalidCommand, OptionError
from rcmqp.maths.options import options, positive
from rcmqp.references.view import ViewCommand, view_of_tip
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Vector3


@dataclass(frozen=True, slots=True)
class DeviceState:
    """The state of the handle now.

    Its axes are those of the camera's image as the hand feels them: x to the right, y down,
    z into the patient.

    Attributes:
        position: (3,) of the handle [m], counted from anywhere.
        velocity: (3,) [m/s].
        engaged: whether the handle drives the camera; without, the camera stays.
        roll: of the handle about z [rad], counted from anywhere; positive is clockwise.
        felt: whether the device renders the viscosity as a force; otherwise it is emulated.

    Raises:
        InvalidCommand: a number is not finite.
    """

    position: Vector3
    velocity: Vector3 = (0.0, 0.0, 0.0)
    engaged: bool = True
    roll: float = 0.0
    felt: bool = False

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.position, *self.velocity, self.roll))):
            raise InvalidCommand(f"not finite: {self}; a handle needs seven finite numbers")


class Clutch:
    """Adds up the way that the handle goes while it is engaged.

    The first reading is the origin, and a handle that is engaged anew goes on from where the
    camera is: neither makes the view jump.

    Attributes:
        way: (3,) gone so far [m].
        counted: whether what the handle did before the last reading counts.
    """

    def __init__(self) -> None:
        self.way: Vector3 = (0.0, 0.0, 0.0)
        self.counted = False
        self._last: Vector3 | None = None

    def step(self, position: Vector3, engaged: bool = True) -> Vector3:
        """The way (3,) [m] that counts, with the handle now at ``position`` (3,) [m].

        What the handle does between two readings counts if it is engaged at both.
        """
        self.counted = engaged and self._last is not None
        if engaged and self._last is not None:
            (x, y, z), (a, b, c), (u, v, w) = position, self._last, self.way
            self.way = (u + (x - a), v + (y - b), w + (z - c))
        self._last = position if engaged else None
        return self.way


SHALLOWEST = 0.01
"""The least depth of the tip that a hand may ask for [m]: a view must stay inside."""


@options
@dataclass(frozen=True, slots=True)
class HandMapping:
    """Section IV-B: the hand's way from its start becomes (t_z, alpha, beta) of equation (5).

    With h the way, L the depth of the tip at the start and d = L + s h_z,

        t_z = s h_z,   alpha = atan2(s h_x, d),   beta = -atan2(s h_y, sqrt(d^2 + s^2 h_x^2)),

    so that the tip looks along (s h_x, s h_y, d) and, for a small tilt, moves s times as far as
    the hand, to the same side of the image, at any depth. The paper gives neither the formula nor
    the scale; with s = 1 its square of 5 cm fits into the device.

    Attributes:
        scale: s, tip over hand.
    """

    scale: float = field(default=1.0, metadata=positive())

    def view(self, way: Vector3, velocity: Vector3, tip_depth: float) -> ViewCommand:
        """The view of a hand that has gone ``way`` (3,) [m] and moves with ``velocity`` (3,).

        A hand that pulls the tip to within 1 cm of the trocar gets no further.
        """
        s = self.scale
        x, y, d = s * way[0], s * way[1], tip_depth + s * way[2]
        u, v, w = s * velocity[0], s * velocity[1], s * velocity[2]
        if d < SHALLOWEST:
            d, w = SHALLOWEST, 0.0
        towards = view_of_tip((x, y, d), (u, v, w), tip_depth)
        return ViewCommand(
            alpha=towards.alpha,
            beta=towards.beta,
            t_z=d - tip_depth,
            alpha_dot=towards.alpha_dot,
            beta_dot=towards.beta_dot,
            t_z_dot=w,
        )

    def way(self, p: Vector3, tip_depth: float) -> Vector3:
        """How far (3,) [m] the hand must move to bring the tip to ``p``; inverse of view().

        Args:
            p: (3,) tip seen from the trocar, in the axes of x_d(0) [m]; p[2] > 0.
            tip_depth: of the tip at the start [m].
        """
        d = math.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2)
        return (
            d * p[0] / p[2] / self.scale,
            d * p[1] / p[2] / self.scale,
            (d - tip_depth) / self.scale,
        )


class HandView:
    """Clutch and mapping of one run; ask() once a cycle."""

    def __init__(self, mapping: HandMapping, insertion: Insertion) -> None:
        """The hand moves the tip in the axes of the first image.

        The instrument's camera may look to the side and be rolled.
        """
        self._mapping, self._clutch, self._depth = mapping, Clutch(), insertion.tip_depth
        self._rows = insertion.instrument.camera.rotation.tolist()

    def ask(self, state: DeviceState) -> ViewCommand:
        """The view that the handle asks for; at the first call, that of the start."""
        way = self._clutch.step(state.position, state.engaged)
        velocity = state.velocity if state.engaged else (0.0, 0.0, 0.0)
        return self._mapping.view(self._turned(way), self._turned(velocity), self._depth)

    def _turned(self, vector: Vector3) -> Vector3:
        """From the camera's axes to those of the shaft, number by number: wanted every cycle."""
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        x, y, z = vector
        return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


STEEPEST = math.radians(80.0)
"""The largest tilt that a hand may ask for [rad]: the angles of a view end at 90 degrees."""


class ImageHand:
    """Adds the way of a hand to the view, in the axes of the picture as it is now.

    HandMapping makes a view of where the hand is, and its axes are those of the first picture.
    Here each step of the hand turns and moves the camera from where it is. With (x, y, z) the
    step turned from the camera's axes to the shaft's and then by the view's roll gamma, s the
    scale and d the depth of the tip,

        d alpha = s x / (d cos(beta)),   d beta = -s y / d,   d t_z = s z,

    so that the tip moves s times as far as the hand, in the hand's direction in the picture. The
    handle's roll turns the shaft.

    For a camera that looks to the side, inwards is its direction of view, not the shaft's. In a
    view that is tilted, d alpha alone spins the shaft by -sin(beta) d alpha, which sweeps such a
    camera sideways. So d gamma = sin(beta) d alpha is added for it: a drag does not spin the
    shaft. The price is that a way around a wide circle ends with a picture that is rolled.

    Attributes:
        view: what the hand asks for.
    """

    def __init__(self, insertion: Insertion, scale: float = 1.0) -> None:
        """Start at the view of the start.

        Args:
            insertion: whose trocar limits tilt and depth of the views.
            scale: s, tip over hand.

        Raises:
            OptionError: the scale is not positive and finite, or the instrument has a wrist.
        """
        if not 0.0 < scale < math.inf:
            raise OptionError(f"scale = {scale}, it must be positive and finite")
        insertion.check_camera_on_shaft("a hand in front of the picture")
        trocar, instrument = insertion.trocar, insertion.instrument
        x, y, z = insertion.from_start((0.0, 0.0, 1.0))
        a, b, c = trocar.axis
        leaning = math.acos(max(-1.0, min(1.0, x * a + y * b + z * c)))
        self.view = ViewCommand()
        self._turn = instrument.camera.rotation
        self._looks_aside = instrument.camera.angle > 0.0
        self._scale, self._depth, self._clutch = scale, insertion.tip_depth, Clutch()
        self._flattest = math.cos(max(0.0, min(trocar.cone_half_angle - leaning, STEEPEST)))
        self._depths = (
            max(SHALLOWEST, trocar.depth_range[0]),
            min(instrument.length, trocar.depth_range[1]),
        )
        self._way, self._roll = self._clutch.way, 0.0

    def ask(self, state: DeviceState) -> ViewCommand:
        """The view that the hand asks for now; a step beyond cone or depths is not taken."""
        way, before = self._clutch.step(state.position, state.engaged), self._way
        turn = state.roll - self._roll if self._clutch.counted else 0.0
        self._way, self._roll = way, state.roll
        view, right, down, inwards = self.view, 0.0, 0.0, 0.0
        if way != before:
            step = self._scale * (np.array(way) - np.array(before))
            right, down, inwards = (self._turn @ step).tolist()
        if right or down or inwards or turn:
            sine, cosine = math.sin(view.gamma), math.cos(view.gamma)
            x, y = cosine * right - sine * down, sine * right + cosine * down
            depth = self._depth + view.t_z
            alpha = view.alpha + x / (depth * math.cos(view.beta))
            beta = view.beta - y / depth
            if math.cos(alpha) * math.cos(beta) < self._flattest or abs(beta) > STEEPEST:
                alpha, beta = view.alpha, view.beta
            elif self._looks_aside:
                turn += math.sin(0.5 * (view.beta + beta)) * (alpha - view.alpha)
            low, high = self._depths
            deep = min(max(depth + inwards, low), max(depth, high))
            self.view = ViewCommand(alpha, beta, view.gamma + turn, deep - self._depth)
        return self.view


STIFFNESS = 350.0
"""Stiffness of the arm that holds the device [N/m]: see rcmqp.references.operators.Operator."""

QUICKEST = 0.02
"""Least time constant of the filter [s]: messages of a hand come every 16 ms."""

SPEEDS = (0.5, 0.5, 1.0, 0.05)
"""Largest rates of alpha, beta, gamma [rad/s] and t_z [m/s]: chosen here."""

ACCELERATIONS = (2.5, 2.5, 5.0, 0.25)
"""Largest changes of those rates [rad/s^2], [m/s^2]: chosen here."""


class Viscous:
    """Emulate a device's viscosity B on a device that cannot render forces.

    A hand that pulls with stiffness K at a handle in a fluid of viscosity B moves it by
    B x_dot = K (x_hand - x): a first-order filter with the time constant tau = B / K. Each
    coordinate of the view follows the one asked for in this way, its rate and its acceleration
    limited; the rate follows with tau / 4, so that nothing overshoots. For a device that renders
    the viscosity, tau is that of B = 0.

    Attributes:
        viscosity: B [N s/m].
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
        self.view, self.viscosity = ViewCommand(), viscosity
        self._period, self._tau = period, max(viscosity / STIFFNESS, QUICKEST)

    def step(self, asked: ViewCommand, *, felt: bool = False) -> ViewCommand:
        """The view one period on, on the way to the one asked for.

        Args:
            asked: the view that the hand asks for.
            felt: whether the device renders the viscosity itself.
        """
        view, tau = self.view, QUICKEST if felt else self._tau
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
