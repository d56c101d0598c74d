"""A hand in front of a live picture: right is right in it, however the camera is turned."""

from __future__ import annotations

import math

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.references.hand.clutch import Clutch
from rcmqp.references.hand.mapping import SHALLOWEST
from rcmqp.references.hand.state import DeviceState
from rcmqp.references.view import ViewCommand
from rcmqp.world.insertion import Insertion

STEEPEST = math.radians(80.0)
"""The largest tilt that a hand may ask for [rad]: the angles of a view end at 90 degrees."""


class ImageHand:
    """Adds the way of a hand to the view, in the axes of the picture as it is now.

    HandMapping makes a view of where the hand is, and its axes are those of the first picture.
    Here each step of the hand turns and moves the camera from where it is. With (x, y, z) the
    step turned from the camera's axes to the shaft's and then by the view's roll gamma, s the
    scale and d the depth of the tip,

        d alpha = s x / (d cos(beta)),   d beta = -s y / d,   d t_z = s z,

    so that the tip moves s times as far as the hand, in the hand's direction in the picture. For
    a camera that looks to the side, inwards is its direction of view, not the shaft's. The
    handle's roll turns the shaft.

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
        self._scale, self._tip_depth, self._clutch = scale, insertion.tip_depth, Clutch()
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
        view, step = self.view, self._scale * (np.array(way) - np.array(before))
        right, down, inwards = (self._turn @ step).tolist()
        if right or down or inwards or turn:
            sine, cosine = math.sin(view.gamma), math.cos(view.gamma)
            x, y = cosine * right - sine * down, sine * right + cosine * down
            depth = self._tip_depth + view.t_z
            alpha = view.alpha + x / (depth * math.cos(view.beta))
            beta = view.beta - y / depth
            if math.cos(alpha) * math.cos(beta) < self._flattest or abs(beta) > STEEPEST:
                alpha, beta = view.alpha, view.beta
            low, high = self._depths
            deep = min(max(depth + inwards, low), max(depth, high))
            self.view = ViewCommand(alpha, beta, view.gamma + turn, deep - self._tip_depth)
        return self.view
