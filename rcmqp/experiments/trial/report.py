"""What a study with people leaves in its folder: tables, and the paper's figures of each task."""

from __future__ import annotations

from pathlib import Path

from rcmqp.experiments.study.comparisons import conditions
from rcmqp.experiments.study.hands import compare_asked
from rcmqp.experiments.study.tables import outcomes_csv
from rcmqp.experiments.trial.people import FIGURES, SUMMARIES
from rcmqp.experiments.trial.results import Results
from rcmqp.experiments.trial.tables import answers_csv, asked_of, results_table
from rcmqp.files import make_folder, write_text
from rcmqp.runs.scenario import Scenario


def write_results(results: Results) -> tuple[str, list[Path]]:
    """table.md, trials.csv, answers.csv, recorded.csv; the table's text and the files.

    Raises:
        RunFileError: a file cannot be written.
    """
    text = results_table(results)
    contents = (
        f"# Study with people: {results.design.scenario}\n\n{text}",
        outcomes_csv(results.outcomes),
        answers_csv(results),
    )
    files = [results.folder / name for name in SUMMARIES]
    for file, content in zip(files, contents, strict=True):
        write_text(file, content)
    if results.recorded:
        files.append(results.folder / "recorded.csv")
        write_text(files[-1], outcomes_csv([each.outcome for each in results.recorded]))
    return text, files


def write_figures(results: Results) -> Path:
    """Fig. 4, groups, spectra of the hands, and Figs. 6 and 7 of each task; their folder.

    Raises:
        RunFileError: a file cannot be written.
    """
    from rcmqp.experiments.study import figures
    from rcmqp.show import plots  # matplotlib takes long to import

    folder = make_folder(results.folder / FIGURES)
    first = Scenario.from_json(results.ended[0].record.scenario)
    drawn = {"fig4_views": figures.views_figure(first)}
    for i, condition in enumerate(conditions(results.outcomes), start=1):
        mine = [o for o in results.outcomes if (o.arm, o.controller) == condition]
        drawn[f"groups_{i}"] = figures.groups_figure(mine)
    for each in results.ended:
        stem, scenario = f"{each.outcome.operator}-{each.number}", each.record.scenario
        drawn[f"{stem}_fig6_errors"] = figures.trial_figure(each.record)
        made = Scenario.from_json(scenario)
        drawn[f"{stem}_fig7_trajectory"] = figures.trajectory_figure(made, each.record)
    if compared := compare_asked(*asked_of(results)):
        drawn["hands"] = compared[1]
    for name, figure in drawn.items():
        plots.save_figure(figure, folder / name, endings=(".png",))
    return folder
