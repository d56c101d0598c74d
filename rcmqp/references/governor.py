"""A reference governor: a path that waits is followed only as fast as the arm keeps up."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from rcmqp import _kernel
from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.options import at_least, options, positive
from rcmqp.references.operators import Steered
from rcmqp.references.paths import Path, views_of
from rcmqp.references.view import STILL, Reference, Stamped
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion


@options
@dataclass(frozen=True, slots=True)
class Governor:
    """How a path slows down where the tip falls behind.

    The path has a clock of its own, which runs at a rate from 0 to 1. If e is the distance of the
    measured tip from where it was asked to be at the same instant, the rate goes towards

        min(1, max(0, (stop - e) / (stop - free))),

    no faster than ``slowing`` and ``recovery`` allow. As long as e stays below ``free``, the
    reference is the same as without a governor, to the bit. Where the arm can never reach the
    path, the path waits for ever.

    An arm that has fallen behind needs time to catch up. A rate that rises as fast as it falls
    swings: the tip runs after the path, passes it, and the path stops again. So the recovery
    is slow.

    Attributes:
        free: distance up to which the path is not slowed [m]; a law without feed-forward is always
            speed / gain behind, which should stay below it.
        stop: distance from which on the path stands still [m].
        slowing: shortest time from full rate to standstill [s].
        recovery: shortest time from standstill to full rate [s].
    """

    free: float = field(default=1e-3, metadata=at_least(0.0, "m"))
    stop: float = field(default=3e-3, metadata=positive("m"))
    slowing: float = field(default=0.05, metadata=positive("s"))
    recovery: float = field(default=2.0, metadata=positive("s"))

    def __post_init__(self) -> None:
        if not self.free < self.stop:
            raise OptionError(f"free = {self.free} m, it must be below stop = {self.stop} m")

    def rate(self, distance: float) -> float:
        """The rate wanted with the tip ``distance`` [m] off; 0 if that is NaN."""
        return min(1.0, max(0.0, (self.stop - distance) / (self.stop - self.free)))


class PathClock:
    """The clock of a path during one run.

    Attributes:
        time: of the path [s]; never later than real time, never going back.
        rate: seconds of the path per second, from 0 to 1: the derivative of ``time``.
        wanted: rate that ``rate`` goes towards, see Governor.
    """

    def __init__(self, governor: Governor | None = None) -> None:
        """Before the first instant, which the path starts at in time and at full rate."""
        self._governor = governor or Governor()
        self.reset()

    def reset(self) -> None:
        """Begin anew: in time, at full rate."""
        self.time, self.rate, self.wanted = 0.0, 1.0, 1.0
        self._now, self._behind = -math.inf, 0.0

    def see(self, distance: float) -> None:
        """The measured tip is ``distance`` [m] from where it was asked to be."""
        self.wanted = self._governor.rate(distance)

    def advance(self, t: float) -> None:
        """Go on to real time ``t`` [s]; if it is earlier than the last one, nothing changes.

        The sum is over how far the path falls behind, with the mean of the rates before and after.
        So the rate is the derivative of the time, and a path that was never slowed is in time to
        the bit.
        """
        step, law = t - self._now, self._governor
        if not step > 0.0:
            return
        if step < math.inf:
            low, high = self.rate - step / law.slowing, self.rate + step / law.recovery
            rate = min(max(self.wanted, low), high)
            self._behind += step * (1.0 - 0.5 * (self.rate + rate))
            self.rate = rate
        self._now = t
        self.time = max(self.time, t - self._behind)


class Governed:
    """The references of a path under a governor, for loops.

    ``references`` of run_realtime() may be one. In a loop of one's own, each cycle asks for
    reference() and then tells see() the state that was measured.

    Attributes:
        clock: of the path.
    """

    def __init__(self, path: Path, insertion: Insertion, clock: PathClock | None = None) -> None:
        """Before the path begins.

        Args:
            path: the views asked for.
            insertion: the instrument in the patient.
            clock: of the path, with the governor that slows it; PathClock() if not given.

        Raises:
            OptionError: the path is steered by what the camera shows.
        """
        check_may_wait(path)
        self.clock = PathClock() if clock is None else clock
        self._path, self._insertion = path, insertion
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self.clock.reset()
        self._sent: Reference | None = None

    def __call__(self, t: float) -> Stamped:
        """The reference at ``t`` [s], the trocar being where it was at the start."""
        return Stamped(self.reference(t), t)

    def reference(
        self, t: float, offset: ArrayLike = STILL, pivot_dot: ArrayLike = STILL
    ) -> Reference:
        """The controller's reference at ``t`` [s].

        The view's rates are those of the path times the rate of its clock. The trocar's motion is
        the patient's, and goes on in real time.

        Args:
            t: real time [s], not before the last one.
            offset: where the trocar is (3,) from where it was at the start [m].
            pivot_dot: its velocity (3,) [m/s].

        Raises:
            InsertionError: the view is deeper than the shaft is long.
        """
        clock, insertion = self.clock, self._insertion
        clock.advance(t)
        views = views_of(self._path, np.array([clock.time]), insertion.tip_depth)
        insertion.check_reach(t, views[0, 3])
        views[:, 4:] *= clock.rate
        offset, pivot_dot = (np.array(vector, dtype=float) for vector in (offset, pivot_dot))
        x_d, x_d_dot, pivot = _kernel.view_poses(insertion.x_rcm, views, offset, pivot_dot)
        self._sent = Reference(x_d[0], x_d_dot[0], pivot[0], pivot_dot)
        return self._sent

    def see(self, state: ArmState, sent: Reference | None = None) -> None:
        """Compare what was measured with the last reference, which was for the same instant.

        Args:
            state: as measured.
            sent: what the controller was told, if that was not the last reference itself.
        """
        sent = self._sent if sent is None else sent
        if sent is not None:
            self.clock.see(tip_distance(state, sent, self._insertion))


def tip_distance(state: ArmState, reference: Reference, insertion: Insertion) -> float:
    """Distance of a state's tip from a reference's [m]."""
    if len(state.tool_at) == 3:
        tip = dq.translation(state.tool_at[1])
    else:
        tip = insertion.tip(state.x)
    return math.dist(tip.tolist(), insertion.tip(reference.x_d).tolist())


def check_may_wait(path: Path | Steered) -> None:
    """Refuse a path that cannot be slowed.

    Raises:
        OptionError: it is steered by what the camera shows.
    """
    if isinstance(path, Steered):
        raise OptionError(
            f"a governor cannot slow a {type(path).__name__}: its views come from a hand that "
            "moves in real time; leave the governor out: a person sees the camera and waits"
        )
