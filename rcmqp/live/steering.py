"""References of a live hand, and the arm at rest where nobody holds on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rcmqp.controllers.base import Command, Controller
from rcmqp.references.governor import tip_distance
from rcmqp.references.hand import DeviceState, ImageHand, Viscous
from rcmqp.references.planner import Planner
from rcmqp.references.view import Reference, Stamped, ViewCommand, view_of_pose, view_pose
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion

PLANNER_TIME = 0.05
"""How long the planner takes to a far view [s]: a few messages of a hand."""

LEASH = 0.01
"""A view whose tip is farther from the arm's goes back to where the arm is [m]."""

RELEASED = "nobody holds on"
"""Why the arm is at rest, in the file of a run."""


class Steering:
    """What a hand asks for, one reference a cycle.

    For run_realtime(), with the controller in Held::

        steering = Steering(insertion, device, controller.period)
        run_realtime(robot, Held.by(steering, controller), steering, 60.0)

    The hand moves the view in the axes of the picture (ImageHand); a view that is far from the
    last one is approached by the paper's planner, section III-C; and the view that is sent on
    follows it through the viscosity (Viscous), limited in speed and acceleration. Where the hand
    does not hold on, the arm is brought to rest, and the next grip begins from where it is then.

    A device with a method ``send_force`` renders the viscosity itself: send_force() is called
    once a cycle with the force (3,) on the handle, -B times its velocity [N]. It must drop a force
    that is not renewed.

    Attributes:
        resting: whether the arm is to rest.
        reference: what was sent last.
        viscosity: B, of the device [N s/m].
    """

    def __init__(
        self,
        insertion: Insertion,
        device: Callable[[], DeviceState],
        period: float,
        *,
        scale: float = 1.0,
        viscosity: float = 15.0,
    ) -> None:
        """Start at the view of the start, at rest.

        Args:
            insertion: the instrument in the patient.
            device: says once a cycle where the handle is, and whether it is held.
            period: of the loop [s].
            scale: tip over hand.
            viscosity: of the device [N s/m].

        Raises:
            OptionError: scale or viscosity is not allowed.
        """
        self._insertion, self._device = insertion, device
        self._hand, self._viscous = ImageHand(insertion, scale), Viscous(period, viscosity)
        self.viscosity = viscosity
        self._send_force = getattr(device, "send_force", None)
        self._planner = Planner(insertion.x_rcm, round(PLANNER_TIME / period) - 1, period)
        self.reference = view_pose(insertion.x_rcm, ViewCommand())
        self.resting = self._still = True

    def __call__(self, t: float) -> Stamped:
        """The reference at ``t`` [s]; while the arm is to rest, the last one."""
        state = self._device()
        if self._send_force is not None:
            u, v, w = state.velocity
            B = self.viscosity
            self._send_force((-B * u, -B * v, -B * w))
            state = dataclasses.replace(state, felt=True)
        self.resting = not state.engaged or (self.resting and not self._still)
        if self.resting:
            self._hand.ask(dataclasses.replace(state, engaged=False) if state.engaged else state)
        else:
            self._still = False
            self.reference = self._follow(self._hand.ask(state), felt=state.felt)
        return Stamped(self.reference, t)

    def _follow(self, view: ViewCommand, *, felt: bool) -> Reference:
        """The reference on the way to the view that the hand asks for."""
        x_rcm = self._insertion.x_rcm
        asked = view_pose(x_rcm, view)
        planned = self._planner.step(asked, self.reference.x_d)
        if planned is not asked:
            view = view_of_pose(x_rcm, planned.x_d)
        return view_pose(x_rcm, self._viscous.step(view, felt=felt))

    def see(self, state: ArmState) -> None:
        """Take the state that was measured; what the arm cannot reach is not asked for."""
        if self.resting:
            if not self._still and not state.v.any():
                self._still = True
                self._hand.view = self._viscous.view = self._view(state)
                self.reference = view_pose(self._insertion.x_rcm, self._viscous.view)
        elif tip_distance(state, self.reference, self._insertion) > LEASH:
            self._hand.view = self._view(state)

    def _view(self, state: ArmState) -> ViewCommand:
        return view_of_pose(self._insertion.x_rcm, state.x)


@dataclass(frozen=True, eq=False)
class Held(Controller):
    """A controller while the hand holds on, and its safe stop while it does not.

    The safe stop brakes as fast as the joints' limits allow, the shaft staying on the trocar, and
    then holds zero, whatever the law would do with joints that the view does not need.

    Attributes:
        law: what moves the arm.
        steering: says whether the arm is to rest.
    """

    law: Controller
    steering: Steering

    @classmethod
    def by(cls, steering: Steering, law: Controller) -> Held:
        """The law, steered."""
        return cls(law.insertion, law.period, law, steering)

    @property
    def name(self) -> str:  # type: ignore[override]
        """The law's."""
        return self.law.name

    @property
    def diagnostics(self) -> Mapping[str, tuple[str, str]]:  # type: ignore[override]
        """The law's."""
        return self.law.diagnostics

    def reset(self) -> None:
        """Forget the run so far."""
        self.law.reset()

    def step(self, state: ArmState, reference: Reference) -> Command:
        """The law's velocity, or that of the safe stop."""
        if self.steering.resting:
            return self.law.safe_stop(state, RELEASED)
        return self.law.step(state, reference)

    def _step(self, state: ArmState, reference: Reference) -> Command:
        return self.step(state, reference)
