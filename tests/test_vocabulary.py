"""Every number that is shown has a title, a unit and a meaning, in one place."""

from __future__ import annotations

import dataclasses
import html
import runpy
from pathlib import Path

import pytest
from rich.console import Console

from rcmqp import load_arm, load_scenario, make_controller, simulate
from rcmqp.cli import console, lists
from rcmqp.experiments.study.hands import HandMeasures
from rcmqp.experiments.study.outcome import Outcome
from rcmqp.experiments.study.vocabulary import HANDS, TRIALS
from rcmqp.runs.measures import Measure
from rcmqp.runs.metrics import Metrics
from rcmqp.runs.setup import joint_units, unit_of
from rcmqp.runs.vocabulary import MEASURES
from rcmqp.show.tables import (
    Row,
    columns_explained,
    metrics_meanings,
    metrics_table,
    row_of,
    tables,
)
from rcmqp.show.viewer.build import page

ROOT = Path(__file__).parents[1]
UNITS = {"mm": "mm", "mrad": "mrad", "us": "us", "s": "s", "hz": "Hz", "ms": "ms", "rad": "rad"}


def fields(kind: type) -> set[str]:
    return {item.name for item in dataclasses.fields(kind)}


@pytest.mark.parametrize(
    ("kind", "measures", "more"),
    [
        (Metrics, MEASURES, set()),
        (Row, MEASURES, set()),
        (Outcome, TRIALS, set()),
        (HandMeasures, HANDS, {"label", "spectrum"}),
    ],
)
def test_every_number_has_a_measure(
    kind: type, measures: dict[str, Measure], more: set[str]
) -> None:
    assert fields(kind) - more <= set(measures)


def test_no_measure_is_of_nothing() -> None:
    assert set(TRIALS) <= fields(Metrics) | fields(Row) | fields(Outcome)
    assert set(HANDS) <= fields(HandMeasures)


@pytest.mark.parametrize("measure", [*TRIALS.values(), *HANDS.values()], ids=lambda m: m.name)
def test_a_measure_says_what_it_is(measure: Measure) -> None:
    assert measure.meaning.endswith(".")
    assert len(measure.meaning.split()) >= 3
    assert measure.head
    assert measure.label
    parts = measure.name.split("_")
    unit = "mm/s" if parts[-2:] == ["mm", "s"] else UNITS.get(parts[-1], "")
    assert measure.unit in (unit, *(["s", "1/s"] if measure.name in ("period", "gain") else []))
    assert measure.column.endswith(f"[{measure.unit}]") == bool(measure.unit)


def test_titles_are_unique_so_that_a_meaning_belongs_to_one_column() -> None:
    for measures in (TRIALS, HANDS):
        columns = [measure.column for measure in measures.values()]
        assert len(set(columns)) == len(columns)


def test_every_column_of_a_comparison_is_explained() -> None:
    short = load_scenario("conical_helix", "ur5", duration=0.02)
    run = simulate(short, make_controller("damped", short.insertion(), short.period))
    text = columns_explained()
    for table in tables([row_of(run), dataclasses.replace(row_of(run), controller="other")]):
        for head in table.heads:
            assert f"- **{head}**: " in text


def test_every_row_of_a_page_is_explained() -> None:
    short = load_scenario("conical_helix", "ur5", duration=0.02)
    law, other = "dual_quaternion", {"objective": "joint_centring"}
    run = simulate(short, make_controller(law, short.insertion(), short.period, **other))
    explained = metrics_meanings()
    assert [row[0] for row in metrics_table([run], ["a"]).rows] == [*explained]
    text = page([run])
    for name, meaning in explained.items():
        assert f"<dt>{html.escape(name)}</dt><dd>{html.escape(meaning)}</dd>" in text


def test_the_page_of_measures_is_written_from_the_vocabulary() -> None:
    made = runpy.run_path(str(ROOT / "benchmarks" / "measures_page.py"))["page"]()
    assert (ROOT / "docs" / "measures.md").read_text(encoding="utf-8") == made


def slider(folder: Path) -> str:
    """A UR5 on a rail of 0.8 m."""
    text = load_arm("ur5").urdf.read_text()  # type: ignore[union-attr]
    rail = (
        '<link name="floor"/><joint name="rail" type="prismatic"><parent link="floor"/>'
        '<child link="world"/><axis xyz="0 1 0"/>'
        '<limit lower="-0.4" upper="0.4" effort="1" velocity="0.5"/></joint>'
    )
    file = folder / "rail.urdf"
    file.write_text(text.replace("</robot>", f"{rail}</robot>"))
    return str(file)


def test_prismatic_joints_are_in_metres(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "out", Console(width=160, emoji=False))
    monkeypatch.setattr(lists, "out", console.out)
    arm = load_arm(slider(tmp_path), "tool0")
    arm.name = "railed"  # short enough for the terminal
    assert arm.joint_units == ("m", *["rad"] * 6)
    lists.print_arms([arm])
    lists.print_arm(arm)
    text = capsys.readouterr().out
    assert "; 0.8 m" in " ".join(text.split())
    assert "; 0.5 m" in " ".join(text.split())
    (rail,) = (line.split() for line in text.splitlines() if line.strip().startswith("rail "))
    assert rail[:5] == ["rail", "m", "-0.4000", "0.4000", "0.5000"]
    assert unit_of(arm.joint_units) == "m or rad"


def test_the_margin_to_limits_has_the_unit_of_the_joints(tmp_path: Path) -> None:
    made = {}
    for arm, flange in (("ur5", None), (slider(tmp_path), "tool0")):
        short = load_scenario("circle", arm, flange=flange, duration=0.02)
        made[arm] = simulate(short, make_controller("damped", short.insertion(), short.period))
    turning, sliding = made.values()
    assert joint_units(sliding.head)[0] == "m"
    for runs, unit in (([turning], "rad"), ([sliding], "m or rad")):
        (_, _, more) = tables([row_of(run) for run in runs])
        assert f"margin to limits [{unit}]" in more.heads
        labels = [row[0] for row in metrics_table(runs, ["a"]).rows]
        assert f"margin to joint limits, least [{unit}]" in labels
    gone = dataclasses.replace(sliding.head.scenario, arm="/nowhere/rail.urdf", carried_arm=None)
    assert set(joint_units(dataclasses.replace(sliding.head, scenario=gone))) == {"rad"}
