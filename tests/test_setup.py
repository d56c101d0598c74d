"""What tables say of instrument, path, motion and objective, and why their rows differ."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from rcmqp.cli import main
from rcmqp.controllers import make_controller
from rcmqp.experiments.compare import cases, compare
from rcmqp.runs.loading import load_scenario
from rcmqp.runs.moved import along, moved
from rcmqp.runs.run import Run
from rcmqp.runs.setup import setup_text
from rcmqp.runs.simulate import simulate
from rcmqp.show.labels import FEED_FORWARD, LIMITS, ROLL, remarks, run_labels
from rcmqp.show.report import write_report
from rcmqp.show.tables import as_markdown, metrics_table, row_of, tables
from rcmqp.world.instrument import Camera, Instrument, Mount
from rcmqp.world.instrument_file import load_instrument
from rcmqp.world.recorded import Recorded

DEEPER = tuple((0.0, 0.0, 1e-5 * i) for i in range(3))
RECORDING = Recorded((0.0, 0.01, 0.02), DEEPER, True)


def short(instrument: Instrument | None = None, **changes: Any) -> Any:
    return load_scenario("circle", "panda", duration=0.03, instrument=instrument, **changes)


def ran(scenario: Any, law: str = "hierarchical_qp", **options: Any) -> Run:
    return simulate(
        scenario, make_controller(law, scenario.insertion(), scenario.period, **options)
    )


def test_a_run_of_defaults_says_nothing_of_its_setup() -> None:
    run = ran(short(), "dual_quaternion", objective="manipulability")  # panda's own
    assert setup_text(run.head) == "default"
    assert "set up with" not in as_markdown([row_of(run)])
    assert "set up with" not in metrics_table([run], ["a"]).markdown()


@pytest.mark.parametrize(
    ("instrument", "text"),
    [
        (Instrument(length=0.3), "instrument: length 300 mm"),
        (Instrument(mount=Mount(xyz=(0.0, 0.05, 0.0))), "mounted at 0 50 0 mm, turned by 0 0 0"),
        (Instrument(camera=Camera(angle=0.5236)), "instrument: camera angle 30 deg"),
    ],
)
def test_an_instrument_is_said_by_what_is_other_than_usual(
    instrument: Instrument, text: str
) -> None:
    assert text in setup_text(ran(short(instrument)).head)


def test_a_wrist_says_which_of_its_limits_are_assumed() -> None:
    run = ran(short(load_instrument("large_needle_driver")))
    assert "wrist of 3 joints whose acceleration and jerk limits are assumed" in as_markdown(
        [row_of(run)]
    )


def test_recordings_and_objective_stand_in_tables_labels_and_reports(tmp_path: Path) -> None:
    plain = short()
    recorded = dataclasses.replace(along(plain, RECORDING), duration=0.03)
    runs = [
        ran(plain),
        ran(moved(plain, RECORDING)),
        ran(plain, objective="joint_centring"),
        ran(plain, K_c=0.0),
        ran(recorded),
    ]
    texts = [
        "default",
        "motion: recorded, 3 samples to 0.02 s",
        "objective: joint_centring",
        "objective: none",
        "path: recorded, 3 samples to 0.02 s",
    ]
    assert [setup_text(run.head) for run in runs] == texts
    (row,) = [row for row in metrics_table(runs, "abcde").texts if row[0] == "set up with"]
    assert row[1:] == texts
    first = tables([row_of(run) for run in runs])[0]
    assert [line[first.heads.index("set up with")] for line in first.texts] == texts
    assert "set up with: objective: none" in run_labels(runs)[3]
    runs[1].save(tmp_path / "moved.h5")
    again = Run.load(tmp_path / "moved.h5")
    write_report([again, runs[2]], tmp_path / "report", files=["moved.h5", "other.h5"])
    said = (tmp_path / "report" / "report.md").read_text(encoding="utf-8")
    assert texts[1] in said
    assert texts[2] in said


def test_a_run_says_its_objective_and_that_a_law_does_not_count_a_limit(
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = ["run", "circle", "-a", "lwa3", "--duration", "0.05", "--set"]
    with pytest.raises(SystemExit):
        main([*run, "objective=joint_centring"])
    out, err = capsys.readouterr()
    assert "joint limits enforced: none" in out
    assert "set up with: objective: joint_centring" in out
    assert "jerk limit: dual_quaternion does not count jerk limits" in " ".join(err.split())


def test_the_table_says_below_it_why_its_rows_differ(tmp_path: Path) -> None:
    laws = ["dual_quaternion", "vfi_qp:feed_forward=true", "weighted_qp", "task_priority"]
    todo = cases(["moving_trocar"], [None], laws, {"duration": 0.02})
    rows = compare(todo, tmp_path)
    found = remarks(rows)
    assert found[:3] == [FEED_FORWARD, ROLL, LIMITS]
    assert [text.partition(":")[0] for text in found[3:]] == [
        "dual_quaternion",
        "vfi_qp",
        "weighted_qp",
    ]
    text = (tmp_path / "comparison.md").read_text(encoding="utf-8")
    latex = (tmp_path / "comparison.tex").read_text(encoding="utf-8")
    assert all(text.count(note.partition(" (")[0][:60]) == 1 for note in found)
    assert latex.count(r"\par\footnotesize") == len(found)
    assert remarks(rows[2:3]) == [found[5]]  # one law of limits of all kinds: its own remark
    assert remarks([dataclasses.replace(rows[0], limits_kept=False)]) == [LIMITS, found[3]]
