"""Recorded hands replayed: the same movements with each controller of a study."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rcmqp.errors import OptionError, RcmqpError
from rcmqp.experiments.study.comparisons import title
from rcmqp.experiments.study.outcome import Outcome, sum_up
from rcmqp.experiments.study.plan import Law, Study, part_of_name
from rcmqp.experiments.study.trial_file import TrialFile
from rcmqp.experiments.study.vocabulary import TRIALS
from rcmqp.files import make_folder
from rcmqp.references.hand import HandMapping
from rcmqp.references.paths import HandTrace
from rcmqp.runs.head import check_own
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.simulate import simulate
from rcmqp.show.table import Table, literal

RECORDED = "recorded"
"""Group of recorded hands, and the folder of their runs."""

SHOWN = (
    "rcm_rms_mm",
    "rcm_max_mm",
    "tip_rms_mm",
    "tip_max_mm",
    "effector_rms_mm",
    "tip_speed_rms_mm_s",
    "speed_ratio_max",
)
"""Measures of a replay."""

NOTE = """\
A recorded hand moves as it did, whatever the camera shows: its task was another one. So it finds
no pictures, has no times, and the obstacle is left out. The replay is simulated, at the period of
each controller; what differs from row to row of one hand is the controller. There are no p values:
a recording is one hand, and the same one in each row.
"""


def read_hands(files: Sequence[str | os.PathLike[str]]) -> dict[str, HandTrace]:
    """Recorded hands out of CSV files for HandTrace.read_csv(); the name of a file is its hand's.

    Raises:
        OptionError: a file cannot be read, or two files have the same name.
    """
    hands = {Path(file).stem: HandTrace.read_csv(file) for file in files}
    if len(hands) < len(files):
        names = ", ".join(str(file) for file in files)
        raise OptionError(f"recorded hands {names}: two have the same name; rename one")
    return hands


def replay(
    hands: Mapping[str, HandTrace],
    conditions: Sequence[tuple[Law, Scenario]],
    folder: Path,
    *,
    scale: float = 1.0,
) -> list[TrialFile]:
    """Let recorded hands steer with each controller, and keep the runs in ``folder``/recorded.

    A controller that fails is an outcome, with its reason.

    Args:
        hands: by their names, see read_hands().
        conditions: controllers, each with the scenario in which it is used.
        folder: of the study.
        scale: tip over hand.

    Raises:
        RunFileError: a run cannot be written.
    """
    runs, found = make_folder(folder / RECORDED), []
    for name, hand in hands.items():
        path = dataclasses.replace(hand, mapping=HandMapping(scale))
        for law, base in conditions:
            scenario = dataclasses.replace(
                base, path=path, duration=hand.duration, obstacles=(), name=name[:200]
            )
            controller = law.controller(scenario)
            file = runs / f"{name}_{part_of_name(scenario.arm)}_{law.stem}.h5"
            check_own(file, scenario, controller)
            try:
                run = simulate(scenario, controller)
            except (RcmqpError, np.linalg.LinAlgError) as error:
                what = name, RECORDED, scenario.arm, str(law), scenario.period
                failed = Outcome(*what, failure=str(error))
                found.append(TrialFile(failed, scenario.to_json(), law.to_json(), "", {}))
                continue
            run.save(file)
            outcome, traces = sum_up(run, name, RECORDED, law)
            found.append(TrialFile(outcome, scenario.to_json(), law.to_json(), "", traces))
    return found


def study_conditions(study: Study) -> list[tuple[Law, Scenario]]:
    """Every arm and controller of a study, as replay() takes them."""
    return [(trial.law, trial.made()) for trial in study.trials() if trial.operator == 0]


def replay_table(outcomes: Sequence[Outcome]) -> str:
    """Markdown: a row for each recorded hand with each controller, and what they say."""
    arms = {o.arm for o in outcomes}
    heads = ["hand", "with", *(TRIALS[name].column for name in SHOWN)]
    rows = []
    for o in outcomes:
        law = o.controller if len(arms) == 1 else f"{title(o.arm)}, {o.controller}"
        cells = [TRIALS[name].text(getattr(o, name)) for name in SHOWN]
        rows.append([str(o.operator), law, *cells])
    failed = [
        f"\n{o.operator}, {o.controller} failed: {literal(o.failure)}\n"
        for o in outcomes
        if o.failure
    ]
    return f"{Table(heads, rows, words=2).markdown()}{''.join(failed)}\n{NOTE}"
