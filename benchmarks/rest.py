"""What controllers do over time: whether they come to rest, and how they get there.

Three tables in Markdown, a line a controller and arm, or a controller and scenario:

- four views that are known to be hard, each reached in 4 s and then held for 10 s;
- views drawn at random, reachable or not, reached and held likewise, with and without limits of
  acceleration and jerk, with K_c of 0 and 7, gains of 5 to 200 1/s and periods of 1 to 8 ms; every
  controller gets the same draws, as far as it has the option;
- the scenarios that are shipped, the worst of all arms.

    python benchmarks/rest.py --runs 50 --jobs 2
    python benchmarks/rest.py --runs 3 --controllers hierarchical_qp weighted_qp --no-scenarios
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from rcmqp import (
    Insertion,
    Instrument,
    RcmqpError,
    Run,
    Scenario,
    arm_names,
    compute_metrics,
    load_arm,
    load_scenario,
    make_controller,
    scenario_names,
    simulate,
)
from rcmqp.controllers import CONTROLLERS, controller_options
from rcmqp.references.operators import STEERED
from rcmqp.references.paths import ViewMoves
from rcmqp.runs.behaviour import SETTLED
from rcmqp.show.table import Table

View = tuple[float, float, float, float]

HARD: tuple[tuple[str, View], ...] = (
    ("lwa3", (-0.7, 0.5, 0.0, 0.1)),
    ("lwa3", (-0.58, 0.35, 0.15, -0.02)),
    ("ur5", (0.6, -0.71, -0.98, -0.05)),
    ("meka_a2", (0.0, 0.7, 0.0, 0.0)),
)
"""Views at which the exact optimum of every cycle swings for ever."""

LOW, HIGH = (-0.8, -0.8, -2.0, -0.06), (0.8, 0.8, 2.0, 0.1)
"""Of alpha, beta, gamma [rad] and t_z [m]."""

MOVE, HOLD = 4.0, 10.0
"""How long a view is approached, and held [s]."""

PERIODS = (1e-3, 2e-3, 4e-3, 8e-3)
GAINS = (5.0, 200.0)
"""Drawn evenly in their logarithm, but at most 1 / T, above which every law overshoots."""

AT_REST = 1e-3
"""Swing over a speed limit below which a run is at rest."""


@dataclass(frozen=True)
class Held:
    """A view to reach and hold.

    Attributes:
        arm: name.
        view: alpha, beta, gamma [rad], t_z [m].
        limited: whether the arm has limits of acceleration and jerk, as load_arm() has them.
        options: of the controller, as far as it has them.
        period: T [s].
    """

    arm: str
    view: View
    limited: bool = True
    options: dict[str, Any] = field(default_factory=dict)
    period: float = 1e-3


Result = dict[str, float]
"""Metrics of a run by name, and its last tip error; empty where it could not be run."""


def draws(arm: str, runs: int, seed: int) -> list[Held]:
    """What is held on an arm, the same for every controller."""
    rng = np.random.default_rng([seed, arm_names().index(arm)])
    found = []
    for k in range(runs):
        view = tuple(rng.uniform(LOW, HIGH).tolist())
        period = float(rng.choice(PERIODS))
        gain = min(float(np.exp(rng.uniform(*np.log(GAINS)))), 1.0 / period)
        options = {"gain": gain, "K_c": float(rng.choice([0.0, 7.0]))}
        found.append(Held(arm, view, k % 2 == 0, options, period))
    return found


def hold(held: Held, controller: str, backend: str) -> Result:
    """Reach and hold a view."""
    arm = load_arm(held.arm)
    if not held.limited:
        arm = load_arm(held.arm, acceleration=math.inf, jerk=math.inf)
    insertion = Insertion.on_shaft(arm, Instrument(), depth=0.1)
    path = ViewMoves(views=(held.view,), move=MOVE, dwell=HOLD)
    scenario = Scenario.of("held_view", insertion, path, period=held.period)
    return _result(scenario, insertion, controller, held.options | _backend(controller, backend))


def ship(name: str, arm: str, controller: str, backend: str) -> Result:
    """Run a scenario that is shipped."""
    scenario = load_scenario(name, arm)
    return _result(scenario, scenario.insertion(), controller, _backend(controller, backend))


def _backend(controller: str, name: str) -> dict[str, str]:
    return {"backend": name} if controller == "hierarchical_qp" else {}


def _result(
    scenario: Scenario, insertion: Insertion, controller: str, options: dict[str, Any]
) -> Result:
    known = controller_options(controller)
    given = {name: value for name, value in options.items() if name in known}
    made = make_controller(controller, insertion, scenario.period, **given)
    try:
        run = simulate(scenario, made)
    except RcmqpError:
        return {}
    return summary(run)


def summary(run: Run) -> Result:
    """Metrics of a run, and what else the tables have."""
    found = dataclasses.asdict(compute_metrics(run))
    stops = float(sum(map(len, run.stops.values())))
    return {**found, "tip_end_mm": 1e3 * float(run.tip_error[-1]), "safe_stops": stops}


def largest(name: str) -> Callable[[Sequence[Result]], float]:
    """Column: the largest of a measure, those that are NaN or infinite left out."""

    def column(results: Sequence[Result]) -> float:
        values = [result.get(name, math.nan) for result in results]
        return max((value for value in values if math.isfinite(value)), default=math.nan)

    return column


def share_at_rest(results: Sequence[Result]) -> float:
    """Column: of the runs whose reference stops, those whose joints are at rest then [%]."""
    swings = [result["swing_ratio_end"] for result in results]
    stopped = [swing < AT_REST for swing in swings if not math.isnan(swing)]
    return 100.0 * sum(stopped) / len(stopped) if stopped else math.nan


def share_arrived(results: Sequence[Result]) -> float:
    """Column: of the runs, those whose tip ends within 1 mm [%]."""
    return 100.0 * float(np.mean([result["tip_end_mm"] < 1e3 * SETTLED for result in results]))


COLUMNS: dict[str, Callable[[Sequence[Result]], float]] = {
    "at rest [%]": share_at_rest,
    "swing / limit": largest("swing_ratio_end"),
    "reversals in a row": largest("reversals_in_a_row"),
    "step of v / limit": largest("step_ratio_max"),
    "speed / limit": largest("speed_ratio_max"),
    "acc. / limit": largest("acceleration_ratio_max"),
    "jerk / limit": largest("jerk_ratio_max"),
    "arrived [%]": share_arrived,
    "overshoot [mm]": largest("overshoot_max_mm"),
    "settling [s]": largest("settling_time_s"),
    "orientation rms [mrad]": largest("orientation_rms_mrad"),
    "max [mrad]": largest("orientation_max_mrad"),
    "RCM max [mm]": largest("rcm_max_mm"),
    "tip at the end [mm]": largest("tip_end_mm"),
    "stops": largest("safe_stops"),
}
"""Largest of all runs, but for shares."""


def table(heads: Sequence[str], rows: Iterable[tuple[Sequence[str], Sequence[Result]]]) -> str:
    """Markdown: a line for each name and its results; runs that failed are counted only."""
    titles = [*heads, "runs", *COLUMNS]
    lines = []
    for names, results in rows:
        made = [result for result in results if result]
        failed = f", {len(results) - len(made)} failed" if len(made) < len(results) else ""
        cells = [*names, f"{len(made)}{failed}"]
        cells += [_cell(column(made)) if made else "" for column in COLUMNS.values()]
        lines.append(cells)
    return Table(titles, lines, words=len(heads)).markdown()


def _cell(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}"


def given(controller: str, backend: str) -> tuple[str, ...]:
    """What a controller is given besides gain and K_c: feed-forward, limits kept, options."""
    known = controller_options(controller)
    had = make_controller(controller, load_scenario("circle").insertion(), 1e-3).given
    takes = [name for name in ("gain", "K_c") if name in known]
    solver = (known | _backend(controller, backend)).get("backend", "")
    return (controller, had.feed_forward_text, had.limits_text, ", ".join(takes), str(solver))


def main() -> None:
    """Run, and print Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=50, help="random views for each arm")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--controllers", nargs="+", choices=CONTROLLERS, default=[*CONTROLLERS])
    parser.add_argument("--arms", nargs="+", choices=arm_names(), default=arm_names())
    parser.add_argument("--backend", default="active_set", help="of hierarchical_qp")
    parser.add_argument("--no-scenarios", action="store_true", help="held views only")
    asked = parser.parse_args()
    parallel = Parallel(n_jobs=asked.jobs, return_as="generator", batch_size=1)
    heads = ["controller", "feed-forward", "joint limits enforced", "drawn options", "backend"]
    rows = [given(name, asked.backend) for name in asked.controllers]
    print(Table(heads, rows, words=len(heads)).markdown(), end="")

    def held(views: Sequence[Held]) -> list[tuple[Held, str]]:
        return [(one, name) for name in asked.controllers for one in views]

    print(f"\nHard views, T = 1 ms, {MOVE:g} s to reach and {HOLD:g} s to hold:\n")
    work = held([Held(arm, view) for arm, view in HARD if arm in asked.arms])
    found = parallel(delayed(hold)(one, name, asked.backend) for one, name in work)
    lines = zip(work, found, strict=True)
    named = (((name, one.arm, str(one.view)), [result]) for (one, name), result in lines)
    print(table(("controller", "arm", "view"), named), flush=True)

    print(f"Random views, seed {asked.seed}, likewise; the worst of the runs:\n", flush=True)
    work = held([one for arm in asked.arms for one in draws(arm, asked.runs, asked.seed)])
    found = list(parallel(delayed(hold)(one, name, asked.backend) for one, name in work))
    print(table(("controller", "arm"), _grouped([(n, o.arm) for o, n in work], found)), flush=True)

    if not asked.no_scenarios:
        print("Shipped scenarios at their own period; the worst of the arms:\n")
        steered = tuple(STEERED.values())
        names = [s for s in scenario_names() if not isinstance(load_scenario(s).path, steered)]
        shipped = [(c, s, a) for c in asked.controllers for s in names for a in asked.arms]
        found = list(parallel(delayed(ship)(s, a, c, asked.backend) for c, s, a in shipped))
        print(table(("controller", "scenario"), _grouped([(c, s) for c, s, _ in shipped], found)))


def _grouped(
    keys: Sequence[tuple[str, ...]], found: Sequence[Result]
) -> list[tuple[tuple[str, ...], list[Result]]]:
    """The results of each key, in the order of the keys."""
    groups: dict[tuple[str, ...], list[Result]] = {}
    for key, result in zip(keys, found, strict=True):
        groups.setdefault(key, []).append(result)
    return list(groups.items())


if __name__ == "__main__":
    main()
