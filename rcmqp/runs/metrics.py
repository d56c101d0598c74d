"""Numbers that sum up a run."""

from __future__ import annotations

import math
import os
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rcmqp import _kernel
from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.operators import Steered
from rcmqp.references.paths import Foreign
from rcmqp.runs.behaviour import Behaviour, Standstill, standstill
from rcmqp.runs.channels import PART
from rcmqp.runs.run import Run
from rcmqp.runs.run_file import Recording
from rcmqp.runs.scenario import Scenario
from rcmqp.world.obstacles import clearance


class Extent:
    """Streaming count, minimum, maximum and sum of squares.

    Attributes:
        count: how many there were.
        low, high: least and largest; NaN where one was.
        squares: the sum of their squares.
    """

    def __init__(self) -> None:
        self.count, self.low, self.high, self.squares = 0, math.inf, -math.inf, 0.0

    def add(self, values: Array) -> None:
        """Take some more, of any shape."""
        if values.size:
            self.count += values.size
            self.low = float(np.minimum(self.low, values.min()))
            self.high = float(np.maximum(self.high, values.max()))
            self.squares += float(np.sum(np.square(values)))

    @property
    def mean_square(self) -> float:
        """Mean square of all numbers; NaN without any."""
        return self.squares / self.count if self.count else math.nan

    @property
    def rms(self) -> float:
        """Root of the mean square."""
        return math.sqrt(self.mean_square)


class ChangeRatios:
    """Compares the changes of joint speed in a run's parts with the joints' limits.

    Sizes of parts do not change a bit of the ratios.
    """

    def __init__(self) -> None:
        self._last: Array | None = None

    def of(self, part: Run) -> dict[str, Array]:
        """Acceleration and jerk over their limits, each (n, nv), of the run's next part.

        The acceleration is (v_k - v_{k-1}) / T, the jerk (v_k - 2 v_{k-1} + v_{k-2}) / T^2. v is
        zero before the run.
        """
        before = np.zeros((2, part.v.shape[1])) if self._last is None else self._last
        v = np.concatenate([before, part.v])
        self._last = v[-2:]
        jerk = np.abs(v[2:] - 2.0 * v[1:-1] + v[:-2]) / part.period**2
        return {
            "acceleration": np.abs(np.diff(v[1:], axis=0)) / part.period / part.acceleration_limit,
            "jerk": jerk / part.jerk_limit,
        }


class Contour:
    """The curve that the tip was asked to draw in a run, which the run's parts are compared with.

    The curve has straight lines between the sampling instants. It is seen from the trocar, in axes
    parallel to the world's, so that a trocar that moves takes it along. All of it is in memory, 40
    bytes a cycle.
    """

    def __init__(self, run: Recording) -> None:
        """Read the curve; an instant at which it is not finite stays where it was before."""
        desired, pivot = run.column("tip_d"), run.column("pivot")
        n = desired.shape[0]
        self._curve = np.empty((n, 3))
        for first in range(0, n, PART):
            rows = slice(first, first + PART)
            self._curve[rows] = desired[rows] - pivot[rows]
        finite = np.isfinite(self._curve).all(axis=1)
        if not finite.all():
            before = np.maximum.accumulate(np.where(finite, np.arange(n), int(finite.argmax())))
            self._curve = self._curve[before]
        self._along = np.zeros(n)
        for first in range(1, n, PART):
            steps = np.diff(self._curve[first - 1 : first + PART], axis=0)
            self._along[first : first + PART] = np.linalg.norm(steps, axis=1)
        np.cumsum(self._along, out=self._along)
        self._path_time = np.asarray(run.column("path_time")[0:n])
        self._done = self._reached = 0

    def measure(self, part: Run) -> dict[str, Array]:
        """Compare the run's next part with the curve.

        Returns:
            ``contour``: (n,) distance of the tip from the nearest point of the whole curve [m],
            to a picometre.
            ``lag``: (n,) how late the tip is [s]: the time less the path's time at the instant
            whose desired tip is nearest. Only instants up to now count, and none before the one
            found last; of several that are equally near, the last. Both are NaN where the tip is.
        """
        tip = part.tip - part.pivot
        contour, reached = _kernel.contour(
            tip, self._curve, self._along, self._done, self._reached
        )
        rows = reached.astype(int)
        self._done, self._reached = self._done + len(rows), int(rows[-1])
        lag = part.time - self._path_time[rows]
        return {"contour": contour, "lag": np.where(np.isnan(contour), np.nan, lag)}


SATURATED = 1.0 - 1e-6
"""Share of a limit from which on a joint counts as saturated."""

ROUNDING = 1e-9
"""Excess of a limit that is none [1], [rad]."""

ERRORS = {"tip": "mm", "effector": "mm", "rcm": "mm", "orientation": "mrad"}
"""What has an rms, a largest value and a 95th percentile, and its unit."""


LATE = 0.5
"""Periods after which a cycle that has not begun is late."""

BEHIND = 0.01
"""Share of the time above which an arm behind the clock is remarked on."""

NOT_TIMED = {"late_share": np.nan, "behind_s": np.nan}
"""Of a run without a real-time loop."""


@dataclass(frozen=True, slots=True)
class Metrics:
    """Errors, limits and times of a run, over all its sampling instants.

    Names end in their unit. rcmqp.runs.vocabulary says what each number means; contour and lag
    are defined in contour.Contour, the last ones, from ``reversals_in_a_row`` on, in
    behaviour.Behaviour.

    A run may go on after its path has ended. Then rms and p95 are of the time until
    ``errors_until_s``, so that rest is not averaged in; all else is of the whole run. A number is
    NaN where there is nothing to measure: no such limit, or a reference that does not stop.
    """

    tip_rms_mm: float
    tip_max_mm: float
    tip_p95_mm: float
    contour_rms_mm: float
    contour_max_mm: float
    lag_max_s: float
    late_share: float
    behind_s: float
    effector_rms_mm: float
    effector_max_mm: float
    effector_p95_mm: float
    rcm_rms_mm: float
    rcm_max_mm: float
    rcm_p95_mm: float
    orientation_rms_mrad: float
    orientation_max_mrad: float
    orientation_p95_mrad: float
    depth_min_mm: float
    depth_max_mm: float
    tilt_max_mrad: float
    speed_ratio_max: float
    acceleration_ratio_max: float
    jerk_ratio_max: float
    saturated_share: float
    limit_margin_min_rad: float
    obstacle_distance_min_mm: float
    singular_value_min: float
    tip_speed_rms_mm_s: float
    solve_time_median_us: float
    solve_time_p99_us: float
    errors_until_s: float
    duration_s: float
    reversals_in_a_row: float
    reversals: float
    step_ratio_max: float
    swing_ratio_end: float
    overshoot_max_mm: float
    settling_time_s: float
    reference_end_s: float

    @property
    def behind_share(self) -> float:
        """Share of the clock's time that a real-time loop fell behind; see ``behind_s``."""
        return self.behind_s / max(self.duration_s + self.behind_s, 1e-9)


def compute_metrics(run: Recording) -> Metrics:
    """Sum up a run, or a run's file, a part at a time: the same numbers to the bit.

    Raises:
        OptionError: ``run`` is the path of a file.
    """
    if isinstance(run, str | os.PathLike):
        raise OptionError(f"{run} is a path; give a Run: Run.load(path)")
    contour = Contour(run)
    found: defaultdict[str, Extent] = defaultdict(Extent)
    asked: defaultdict[str, Extent] = defaultdict(Extent)
    scenario = run.head.scenario
    stop = standstill(run.column("x_d"), run.column("pivot"))
    left = count = _rows_asked(scenario, stop)
    behaviour = Behaviour(stop, scenario.period)
    before: Run | None = None
    changes, began_late = ChangeRatios(), 0
    for part in run.parts():
        waited = part.diagnostics.get("began_late", np.zeros(0))
        began_late += int(np.sum(waited >= LATE * scenario.period))
        ratios = {kind: each.max(axis=-1) for kind, each in changes.of(part).items()}
        found["jerk_ratio"].add(ratios["jerk"])
        late = max(0, len(part.time) - max(0, left))
        left -= len(part.time)
        for name, channel in (
            _measures(part, before, ratios["acceleration"]) | contour.measure(part)
        ).items():
            found[name].add(channel)
            asked[name].add(channel[: max(0, len(channel) - late)])
        behaviour.add(part.v, part.velocity_limit, part.tip, part.tip_d)
        before = part
    solve_time = run.column("solve_time")[:]
    has_limit = np.isfinite(part.acceleration_limit).any()
    has_jerk_limit = np.isfinite(part.jerk_limit).any()
    values = {
        "errors_until_s": scenario.period * (count - 1),
        "duration_s": scenario.period * (stop.rows - 1),
        **_errors(run, count, found, asked),
        "contour_rms_mm": 1e3 * asked["contour"].rms,
        "contour_max_mm": 1e3 * found["contour"].high,
        "lag_max_s": found["lag"].high,
        **(_lateness(run, began_late) if "sent_after" in part.diagnostics else NOT_TIMED),
        **behaviour.summary(),
        "depth_min_mm": 1e3 * found["depth"].low,
        "depth_max_mm": 1e3 * found["depth"].high,
        "tilt_max_mrad": 1e3 * found["tilt"].high,
        "speed_ratio_max": found["speed_ratio"].high,
        "acceleration_ratio_max": found["acceleration_ratio"].high if has_limit else np.nan,
        "jerk_ratio_max": found["jerk_ratio"].high if has_jerk_limit else np.nan,
        "saturated_share": found["saturated"].mean_square,
        "limit_margin_min_rad": found["margin"].low,
        "obstacle_distance_min_mm": 1e3 * found["obstacle"].low,
        "singular_value_min": found["singular_value"].low,
        "tip_speed_rms_mm_s": 1e3 * asked["tip_speed"].rms,
        "solve_time_median_us": 1e6 * np.nanpercentile(solve_time, 50),
        "solve_time_p99_us": 1e6 * np.nanpercentile(solve_time, 99),
    }
    return Metrics(**{name: float(value) for name, value in values.items()})


def _lateness(run: Recording, began_late: int) -> dict[str, float]:
    """How late the cycles of a real-time loop were, see LATE, and how far it fell behind."""
    steps, period = np.diff(run.column("time")[:]), run.head.scenario.period
    share, behind = began_late / (len(steps) + 1), max(0.0, float((steps - period).sum()))
    return {"late_share": share, "behind_s": behind}


def _measures(part: Run, before: Run | None, acceleration_ratio: Array) -> dict[str, Array]:
    """Quantities that are summed up over a part of a run; ``before`` is None at the start."""
    tip_d = part.tip_d[:0] if before is None else before.tip_d[-1:]
    speed_ratio = np.abs(part.v / part.velocity_limit).max(axis=-1)
    tip_velocity = np.diff(np.concatenate([tip_d, part.tip_d]), axis=0) / part.period
    return {
        **{name: getattr(part, f"{name}_error") for name in ERRORS},
        **{name: getattr(part, name) for name in ("depth", "tilt", "singular_value")},
        "speed_ratio": speed_ratio,
        "acceleration_ratio": acceleration_ratio,
        "saturated": np.maximum(speed_ratio, acceleration_ratio) >= SATURATED,
        "margin": np.minimum(part.angles - part.lower, part.upper - part.angles),
        "obstacle": obstacle_distance(part),
        "tip_speed": np.linalg.norm(tip_velocity, axis=-1),
    }


def obstacle_distance(run: Run) -> Array:
    """Distance (n,) of the instrument's surface from the nearest obstacle's [m].

    Negative inside an obstacle, inf without obstacles. Of an instrument with a wrist, the least of
    those of its shaft and of its pieces.
    """
    obstacles, instrument = run.scenario.obstacles, run.scenario.instrument
    if not obstacles:
        return np.full(len(run.tip), np.inf)
    shaft = dq.rotate(dq.P(run.x), np.array([0.0, 0.0, 1.0]))
    pieces = [(run.tip, run.tip - instrument.length * shaft)]
    if (wrist := instrument.wrist) is not None:
        arm, m = run.insertion().arm, len(wrist.joints)
        joints = np.array([arm.skeleton(q)[-1 - m : -1] for q in run.q])
        ends = [*joints.swapaxes(0, 1), run.tip]
        pieces = [(ends[0], ends[0] - (instrument.length + wrist.joints[0].along) * shaft)]
        pieces += [(ends[k + 1], ends[k]) for k, length in enumerate(wrist.pieces) if length > 0.0]
    distances = [clearance(tip, mount, sphere) for tip, mount in pieces for sphere in obstacles]
    return np.asarray(np.min(distances, axis=0) - instrument.radius)


def _rows_asked(scenario: Scenario, stop: Standstill) -> int:
    """Number of a run's rows until its path has ended, see Metrics; all of a steered one."""
    path, last = scenario.path, stop.rows - 1
    if isinstance(path, Steered) or (isinstance(path, Foreign) and not path.duration):
        return last + 1
    return min(last, max(round(path.duration / scenario.period), stop.both)) + 1


def _errors(
    run: Recording, count: int, found: Mapping[str, Extent], asked: Mapping[str, Extent]
) -> dict[str, float]:
    """RMS and 95th percentile of each error's first ``count`` rows, and the largest of all."""
    values = {}
    for name, unit in ERRORS.items():
        rows = run.column(f"{name}_error")[:count]
        values[f"{name}_rms_{unit}"] = 1e3 * asked[name].rms
        values[f"{name}_max_{unit}"] = 1e3 * found[name].high
        values[f"{name}_p95_{unit}"] = 1e3 * np.percentile(rows, 95)
    return values
