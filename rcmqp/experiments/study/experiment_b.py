"""The paper's experiment B, with simulated people, and what its factors do one by one."""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rcmqp.experiments.study.outcome import Outcome
from rcmqp.experiments.study.perform import Performed, perform
from rcmqp.experiments.study.plan import Law, Study
from rcmqp.experiments.study.report import write_figures, write_tables
from rcmqp.experiments.study.statistics import summary
from rcmqp.experiments.study.vocabulary import TRIALS
from rcmqp.files import make_folder, write_text
from rcmqp.references.operators import Learning
from rcmqp.runs.loading import load_scenario
from rcmqp.runs.metrics import compute_metrics
from rcmqp.runs.run import Run
from rcmqp.runs.simulate import simulate
from rcmqp.show.table import Table
from rcmqp.world.instrument import Instrument
from rcmqp.world.port import Port

PERIODS = (8e-3, 1e-3)

Options = tuple[tuple[str, object], ...]

SETTINGS: dict[str, dict[str, dict[str, Options]]] = {
    "dual_quaternion": {
        "feed_forward": {"off": (), "on": (("feed_forward", True),)},
        "limits": {"off": (), "on": (("velocity_limit", "scale"),)},
    },
    "hierarchical_qp": {
        "feed_forward": {"on": ()},
        "limits": {"off": (("approach", 0.0), ("limits", ())), "on": ()},
    },
}
"""Options of each law for each level of the two factors; what is missing cannot be had.

hierarchical_qp always follows the reference's velocity. Without limits it has none at all: the
obstacle's and the trocar's go with the joints', and no braking distance is counted.
"""

MEASURES = (
    ("rcm_rms_mm", "mean", ".2g"),
    ("rcm_max_mm", "largest", ".2g"),
    ("tip_rms_mm", "mean", ".2g"),
    ("effector_rms_mm", "mean", ".2g"),
    ("effector_max_mm", "largest", ".3g"),
    ("speed_ratio_max", "largest", ".2f"),
)
"""Outcome's field, which number of its Summary, and how that is written."""

EFFECTS = ("rcm_rms_mm", "tip_rms_mm", "effector_rms_mm")
"""What the effects of the factors are given for."""

NOTES = """\
The same people, with the same luck, in every row. A factor's effect is the ratio of a person's
errors, at its second level over its first, everything else the same; the geometric mean over
people and over the levels of the other factors, ± its Monte-Carlo error. A ratio of 1
means that the factor changes nothing. Where factors depend on each other, the
rows say how; the mean does not. Law is hierarchical_qp over
dual_quaternion, at equal period, both with feed-forward.
Limits "on" is not the same for both: velocity_limit=scale of the law counts speeds only,
hierarchical_qp counts positions, accelerations and jerks too, and keeps off the obstacle.
hierarchical_qp has no feed-forward "off".
"""

Levels = tuple[str, float, str, str]
"""Name of the law, period [s], feed-forward, limits."""

_People = dict[int | str, Outcome]


def factors() -> dict[Levels, Law]:
    """Each combination of law, period, feed-forward and limits that can be had."""
    found = {}
    for name, settings in SETTINGS.items():
        levels = itertools.product(
            PERIODS, settings["feed_forward"].items(), settings["limits"].items()
        )
        for period, (ahead, following), (kept, limiting) in levels:
            found[name, period, ahead, kept] = Law(name, period, (*following, *limiting))
    return found


def factor_table(outcomes: Sequence[Outcome]) -> str:
    """Markdown: a row for each combination, and a table of the factors' effects.

    Args:
        outcomes: of a study whose laws are those of factors().
    """
    of = {
        levels: {o.operator: o for o in outcomes if o.controller == str(law)}
        for levels, law in factors().items()
    }
    rows = []
    for (name, period, ahead, kept), mine in of.items():
        numbers = [
            format(getattr(summary([getattr(o, field) for o in mine.values()]), kind), style)
            for field, kind, style in MEASURES
        ]
        rows.append([name, f"{1e3 * period:g} ms", ahead, kept, *numbers])
    effects = [
        [label, law, *(_ratio([(of[a], of[b]) for a, b in pairs], field) for field in EFFECTS)]
        for label, law, pairs in _contrasts(list(of))
    ]
    columns = [TRIALS[field].column for field, _, _ in MEASURES]
    both = (
        Table(["controller", "period", "feed-forward", "limits", *columns], rows, words=4),
        Table(["factor", "with", *(TRIALS[field].column for field in EFFECTS)], effects, words=2),
    )
    return "\n".join([*(table.markdown() for table in both), NOTES])


def _contrasts(all_levels: Sequence[Levels]) -> list[tuple[str, str, list[tuple[Levels, Levels]]]]:
    """Label and law of each factor's effect, and the pairs of conditions that differ in it."""
    found = []
    labels = ("period, 8 to 1 ms", "feed-forward, off to on", "limits, off to on")
    for law, (place, label) in itertools.product(SETTINGS, enumerate(labels, start=1)):
        pairs = [p for p in _pairs(all_levels, place) if p[0][0] == law]
        if pairs:
            found.append((label, law, pairs))
    for kept in ("off", "on"):
        if pairs := [p for p in _pairs(all_levels, 0) if p[0][3] == kept]:
            found.append((f"law, limits {kept}", "both", pairs))
    return found


def _pairs(all_levels: Sequence[Levels], place: int) -> list[tuple[Levels, Levels]]:
    """Conditions that differ in the factor at ``place`` and in nothing else."""
    return [
        (a, b)
        for a, b in itertools.combinations(all_levels, 2)
        if [i for i in range(len(a)) if a[i] != b[i]] == [place]
    ]


def _ratio(pairs: Sequence[tuple[_People, _People]], field: str) -> str:
    """Geometric mean of the second over the first, person by person; ± the Monte-Carlo error."""
    people = [i for i in pairs[0][0] if all(i in side for pair in pairs for side in pair)]
    logs = [
        np.mean([math.log(getattr(b[i], field) / getattr(a[i], field)) for a, b in pairs])
        for i in people
    ]
    found = summary(logs)
    if found.count == 0:
        return ""
    mean = math.exp(found.mean)
    return f"{mean:.3g}" if found.count < 2 else f"{mean:.3g} ± {mean * found.error:.2g}"


JUMP = "device_jump.h5"
FACTORS = "factors"


@dataclass(frozen=True)
class ExperimentB:
    """What reproduce_b() found, and the files it left.

    Attributes:
        performed: the study with the paper's law at 8 ms.
        jump: the scenario device_jump under the same law.
        table: Markdown, the paper's figures in the first column.
        factorial: the study of every combination of law, period, feed-forward and limits.
        factor_table: Markdown of it; empty without it.
        files: all that were written, but for the trials'.
    """

    performed: Performed
    jump: Run
    table: str
    factorial: Performed | None
    factor_table: str
    files: list[Path]


def reproduce_b(
    out: str | os.PathLike[str],
    *,
    operators: int = 20,
    seed: int = 0,
    jobs: int = 1,
    factors: bool = False,
    learning: Learning | None = None,
    port: Port | None = None,
    instrument: Instrument | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> ExperimentB:
    """Run experiment B with the paper's law at T = 8 ms on the LWA3, and write what it gives.

    Args:
        out: folder, made if it is not there.
        operators: how many simulated people; every second one is a novice, the first is.
        seed: of everything random.
        jobs: processes, see perform().
        factors: whether the same people also use every combination of law, period, feed-forward
            and limits: SETTINGS; 12 further trials for each person.
        learning: of the novices; None for people who do not learn.
        port: where the incision is; None for the scenario's.
        instrument: in place of the scenario's own; None for that.
        progress: see perform().

    Raises:
        RunFileError: a file cannot be written, or belongs to another study.
    """
    folder = make_folder(out)
    law = Law()
    study = Study(
        operators=operators,
        seed=seed,
        laws=(law,),
        learning=learning,
        port=port,
        instrument=instrument,
    )
    performed = perform(study, folder, jobs=jobs, progress=progress)
    jump = device_jump(law)
    jump.save(folder / JUMP)
    table, files = write_tables(performed, compute_metrics(jump))
    files += [folder / JUMP, *write_figures(performed)]
    factorial, text = None, ""
    if factors:
        factorial, text = _factorial(study, folder, jobs, progress)
        write_text(folder / f"{FACTORS}.md", f"# Experiment B: factors\n\n{text}")
        files.append(folder / f"{FACTORS}.md")
    return ExperimentB(performed, jump, table, factorial, text, files)


def device_jump(law: Law) -> Run:
    """The scenario device_jump on the LWA3 under a law, at the law's period."""
    scenario = load_scenario("device_jump", "lwa3", period=law.period)
    return simulate(scenario, law.controller(scenario))


def _factorial(
    study: Study, folder: Path, jobs: int, progress: Callable[[str, int, int], None] | None
) -> tuple[Performed, str]:
    """The study of every combination, in a folder of its own, and its table."""
    every = dataclasses.replace(study, laws=tuple(factors().values()))
    performed = perform(every, folder / FACTORS, jobs=jobs, progress=progress)
    return performed, factor_table(performed.outcomes)
