"""The paper's experiment B, run again with simulated people: table beside the paper's, figures."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rcmqp.experiments.study.factors import factor_table, factors
from rcmqp.experiments.study.perform import Performed, perform
from rcmqp.experiments.study.plan import Law, Study
from rcmqp.experiments.study.report import write_figures, write_tables
from rcmqp.files import make_folder, write_text
from rcmqp.references.operators import Learning
from rcmqp.runs.loading import load_scenario
from rcmqp.runs.metrics import compute_metrics
from rcmqp.runs.run import Run
from rcmqp.runs.simulate import simulate
from rcmqp.world.instrument import Instrument
from rcmqp.world.port import Port

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
            and limits, see rcmqp.experiments.study.factors; 12 further trials for each person.
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


def device_jump(law: Law, arm: str = "lwa3") -> Run:
    """The scenario device_jump under a law, at the law's period."""
    scenario = load_scenario("device_jump", arm, period=law.period)
    return simulate(scenario, law.controller(scenario))


def _factorial(
    study: Study, folder: Path, jobs: int, progress: Callable[[str, int, int], None] | None
) -> tuple[Performed, str]:
    """The study of every combination, in a folder of its own, and its table."""
    every = dataclasses.replace(study, laws=tuple(factors().values()))
    performed = perform(every, folder / FACTORS, jobs=jobs, progress=progress)
    return performed, factor_table(performed.outcomes)
