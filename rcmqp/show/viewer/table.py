"""The metrics table and the versions on a page, as HTML."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable, Sequence

from rcmqp.runs.metrics import Metrics, after_the_stop, against_limit, compute_metrics, until
from rcmqp.runs.run import Run
from rcmqp.show.labels import GIVEN, given_cells
from rcmqp.show.palette import colour, dash

ROWS: tuple[tuple[str, Callable[[Metrics], str]], ...] = (
    ("rms until [s]", lambda m: until(m.errors_until_s, m.duration_s)),
    ("tip error, rms [mm]", lambda m: f"{m.tip_rms_mm:.3g}"),
    ("tip error, max [mm]", lambda m: f"{m.tip_max_mm:.3g}"),
    ("contour error, rms [mm]", lambda m: f"{m.contour_rms_mm:.3g}"),
    ("contour error, max [mm]", lambda m: f"{m.contour_max_mm:.3g}"),
    ("lag of the tip, max [s]", lambda m: f"{m.lag_max_s:.3g}"),
    ("RCM error, rms [mm]", lambda m: f"{m.rcm_rms_mm:.3g}"),
    ("RCM error, max [mm]", lambda m: f"{m.rcm_max_mm:.3g}"),
    ("orientation error, rms [mrad]", lambda m: f"{m.orientation_rms_mrad:.3f}"),
    ("orientation error, max [mrad]", lambda m: f"{m.orientation_max_mrad:.3f}"),
    ("depth of the tip [mm]", lambda m: f"{m.depth_min_mm:.1f} to {m.depth_max_mm:.1f}"),
    ("joint speed over its limit, max", lambda m: f"{m.speed_ratio_max:.3f}"),
    ("joint acceleration over its limit, max", lambda m: against_limit(m.acceleration_ratio_max)),
    ("joint jerk over its limit, max", lambda m: against_limit(m.jerk_ratio_max)),
    (
        "margin to joint limits, least [rad]",
        lambda m: against_limit(m.limit_margin_min_rad, ".3f"),
    ),
    ("singular value, least", lambda m: f"{m.singular_value_min:.4f}"),
    ("tip speed asked for, rms [mm/s]", lambda m: f"{m.tip_speed_rms_mm_s:.1f}"),
    ("cycles in a row in which a joint turns round", lambda m: f"{m.reversals_in_a_row:.0f}"),
    ("cycles in which a joint turns round", lambda m: f"{m.reversals:.0f}"),
    ("step of a joint's speed over its limit, max", lambda m: f"{m.step_ratio_max:.3f}"),
    ("reference stops [s]", lambda m: after_the_stop(m.reference_end_s, ".4g")),
    ("tip past its end, max [mm]", lambda m: after_the_stop(m.overshoot_max_mm)),
    ("tip below 1 mm for good, after [s]", lambda m: after_the_stop(m.settling_time_s)),
    (
        "swing of a joint over its speed limit, at the end",
        lambda m: after_the_stop(m.swing_ratio_end),
    ),
    ("controller step, median [\u00b5s]", lambda m: f"{m.solve_time_median_us:.0f}"),
)


def metrics_table(runs: Sequence[Run], labels: Sequence[str]) -> str:
    """What runs were given and their metrics down, runs across; what is missing says so."""
    found = [compute_metrics(run) for run in runs]
    given = [given_cells(run.head) for run in runs]
    rows = [(title, [each[name] for each in given]) for name, title in GIVEN.items()]
    for name, text in ROWS:
        rows.append((name, [text(metrics) for metrics in found]))
    stops = [sum(map(len, run.stops.values())) for run in runs]
    rows.append(("cycles in the safe stop", [str(count) for count in stops]))
    heads = "".join(
        f'<th><span class="mark"><i class="run {dash(i)}" style="color:{colour(i)}"></i>'
        f"{html.escape(label)}</span></th>"
        for i, label in enumerate(labels)
    )
    lines = "".join(
        f"<tr><td>{html.escape(name)}</td>{''.join(map(_cell, texts))}</tr>"
        for name, texts in rows
    )
    return f"<table><thead><tr><th></th>{heads}</tr></thead><tbody>{lines}</tbody></table>"


def _cell(text: str) -> str:
    return f"<td>{'missing' if 'nan' in text else html.escape(text)}</td>"


def versions_text(runs: Sequence[Run]) -> str:
    """What the runs were made with, and how long they are."""
    versions = {f"{name} {version}" for run in runs for name, version in run.versions.items()}
    lengths = _all(f"{run.time[-1]:.4g} s" for run in runs)
    periods = _all(f"{1e3 * run.period:g} ms" for run in runs)
    seeds = _all(str(run.scenario.seed) for run in runs)
    return (
        f"{lengths}, sampled every {periods}; {'seeds' if ' and ' in seeds else 'seed'} {seeds}; "
        f"{', '.join(sorted(versions))}"
    )


def _all(texts: Iterable[str]) -> str:
    """Each text once, in the order in which they come: a, b and c."""
    *first, last = dict.fromkeys(texts)
    return f"{', '.join(first)} and {last}" if first else last
