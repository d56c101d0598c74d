"""What a study leaves in its folder beside the trials."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rcmqp.experiments.study.perform import Performed
from rcmqp.experiments.study.replay import replay_table
from rcmqp.experiments.study.tables import operators_csv, outcomes_csv, table
from rcmqp.experiments.study.trial_file import TrialFile
from rcmqp.files import write_text
from rcmqp.runs.metrics import Metrics

FIGURES = ("fig4_views", "fig6_errors", "fig7_trajectory", "groups")


def write_tables(
    performed: Performed, jump: Metrics | None = None, recorded: Sequence[TrialFile] = ()
) -> tuple[str, list[Path]]:
    """table.md, trials.csv, operators.csv, recorded.csv; the table's text and the files.

    Args:
        performed: the study.
        jump: see tables.table().
        recorded: replays of recorded hands; there is a recorded.csv of them only if there are any.

    Raises:
        RunFileError: a file cannot be written.
    """
    study, text = performed.study, table(performed, jump)
    replayed = [each.outcome for each in recorded]
    if replayed:
        text += f"\n## Recorded hands\n\n{replay_table(replayed)}"
    head = (
        f"# Study: {study.scenario}, {study.operators} simulated operators, seed {study.seed}\n\n"
    )
    files = {
        "table.md": head + text,
        "trials.csv": outcomes_csv(performed.outcomes),
        "operators.csv": operators_csv(study),
    }
    if replayed:
        files["recorded.csv"] = outcomes_csv(replayed)
    for name, content in files.items():
        write_text(performed.folder / name, content)
    return text, [performed.folder / name for name in files]


def write_figures(performed: Performed) -> list[Path]:
    """Figs. 4, 6 and 7 and the groups, of the first arm and controller.

    The errors and the trajectory are those of the trial whose completion time is the median.

    Raises:
        RunFileError: a file cannot be written.
    """
    from rcmqp.experiments.study import figures
    from rcmqp.show import plots  # matplotlib takes long to import

    outcomes, trials = performed.outcomes, performed.study.trials()
    first = outcomes[0].arm, outcomes[0].controller
    mine = [i for i, o in enumerate(outcomes) if (o.arm, o.controller) == first and not o.failure]
    if not mine:
        return []
    mine.sort(key=lambda i: (not outcomes[i].finished, outcomes[i].completion_s))
    finished = [i for i in mine if outcomes[i].finished] or mine
    middle = finished[(len(finished) - 1) // 2]
    scenario, record = trials[middle].made(), performed.record(middle)
    drawn = (
        figures.views_figure(scenario),
        figures.trial_figure(record),
        figures.trajectory_figure(scenario, record),
        figures.groups_figure([outcomes[i] for i in sorted(mine)]),
    )
    return [
        path
        for name, figure in zip(FIGURES, drawn, strict=True)
        for path in plots.save_figure(figure, performed.folder / name)
    ]
