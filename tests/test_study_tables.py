"""What a study's numbers come to: statistics, tables, figures."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import re
from pathlib import Path

import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp.experiments.study.comparisons import comparison_table, side_by_side
from rcmqp.experiments.study.experiment_b import device_jump
from rcmqp.experiments.study.figures import groups_figure, trial_figure
from rcmqp.experiments.study.outcome import TRACES, Outcome
from rcmqp.experiments.study.perform import Performed
from rcmqp.experiments.study.plan import Law, Study
from rcmqp.experiments.study.report import JUMP, outcomes_csv, table
from rcmqp.experiments.study.statistics import Effect, effect, summary
from rcmqp.experiments.study.trial_file import TrialFile
from rcmqp.runs.metrics import compute_metrics


def test_intervals_are_students() -> None:
    """The textbook's: t(0.975, 4) = 2.7764."""
    found = summary([1.0, 2.0, 3.0, 4.0, 5.0, math.nan])
    half = 2.776445 * math.sqrt(2.5 / 5.0)
    assert (found.count, found.mean, found.least, found.largest) == (5, 3.0, 1.0, 5.0)
    assert_allclose([found.deviation, found.low, found.high], [2.5**0.5, 3 - half, 3 + half], 1e-6)
    assert math.isnan(summary([1.0]).low)
    assert math.isnan(summary([1.0, 2.0, 3.0, 4.0]).low)
    assert summary([]).count == 0


def test_effects_are_paired_and_their_errors_are_those_of_new_draws() -> None:
    """Draw the same study many times: the errors given by one are how far the others lie."""
    rng = np.random.default_rng(7)

    def drawn(people: int) -> Effect:
        first = rng.normal(0.0, 10.0, people)
        return effect(first, first + 4.0 + rng.normal(0.0, 3.0, people))

    many = [drawn(30) for _ in range(400)]
    for values, errors, expected in (
        ([e.change.mean for e in many], [e.change.error for e in many], 4.0),
        ([e.size for e in many], [e.size_error for e in many], 4.0 / math.sqrt(104.5)),
    ):
        assert np.mean(values) == pytest.approx(expected, rel=0.06)
        assert np.mean(errors) == pytest.approx(np.std(values), rel=0.15)
    one, large = drawn(30), drawn(3000)
    assert large.size_error < 0.2 * one.size_error  # more draws: a smaller error,
    assert large.size == pytest.approx(one.size, abs=0.25)  # and no larger effect


def test_effects_of_few_people_and_of_nan_are_left_out() -> None:
    lost = effect([1.0, 2.0, 4.0, math.nan, 7.0], [2.0, 2.0, 6.0, 8.0, math.nan])
    assert str(lost) == str(effect([1.0, 2.0, 4.0], [2.0, 2.0, 6.0]))
    assert lost.change.mean == 1.0
    assert lost.size == pytest.approx(1.0 / math.sqrt((7.0 / 3.0 + 16.0 / 3.0) / 2.0))
    two, one = effect([1.0, 2.0], [2.0, 4.0]), effect([1.0], [2.0])
    assert math.isnan(two.size_error)
    assert not math.isnan(two.size)
    assert math.isnan(one.size)
    assert math.isnan(effect([1.0, 1.0], [2.0, 2.0]).size)


def test_there_is_no_p_value_anywhere(tmp_path: Path) -> None:
    """People who are drawn can be had in any number: p says how many there were."""
    both = [*outcomes("a", 0.0), *outcomes("b", 0.2)]
    text = table(Performed(Study(), tmp_path, both))
    readme = (Path(__file__).parents[1] / "docs" / "handbook.md").read_text(encoding="utf-8")
    of_b = readme[readme.index("## Experiment B") : readme.index("## Limits")]
    for written in (text, of_b):
        assert not re.search(r"Holm|signed-rank|p, rank|\bp [<=]|significan", written)
    assert "effect size" in text


def outcomes(law: str, shift: float, arm: str = "lwa3", people: int = 4) -> list[Outcome]:
    return [
        Outcome(
            i,
            ("novice", "experienced")[i % 2],
            arm,
            law,
            8e-3,
            finished=True,
            completion_s=60.0 + i,
            reached_s=(1.0, 2.0, 3.0, 60.0 + i),
            looking_s=30.0,
            tip_rms_mm=0.3 + 0.01 * i**2 + shift,
            tip_max_mm=1.0 + i,
            effector_rms_mm=0.1,
            effector_max_mm=0.5,
            rcm_rms_mm=0.004,
            rcm_max_mm=0.02,
            obstacle_tip_mm=12.0,
            obstacle_shaft_mm=7.0 - 8.0 * (i == 3),
            collided=i == 3,
            tip_speed_rms_mm_s=20.0,
            speed_ratio_max=0.9,
            limit_margin_min_rad=0.1,
        )
        for i in range(people)
    ]


def rows_of(text: str) -> dict[str, list[str]]:
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    return {cells[0]: cells[1:] for cells in lines if len(cells) == 5}


def test_the_table_holds_the_outcomes_beside_the_papers(tmp_path: Path) -> None:
    mine = outcomes("dual_quaternion, 8 ms", 0.0)
    rows = rows_of(table(Performed(Study(), tmp_path, mine)))
    time = rows["completion time [s]"]
    assert time[0] == "68.03 ± 30.58; 84 and 52"
    assert time[1].startswith("61.5 ± 1.3")
    assert all("[" not in cell for cell in time)  # of so few people
    assert time[2].startswith("61.0 ± 1.4")
    assert time[3].startswith("62.0 ± 1.4")
    assert rows["tip error, largest [mm]"] == ["4.82 (†)", "4.000", "3.000", "4.000"]
    collisions = rows["collisions: the shaft touched the obstacle"]
    assert collisions == ["0", "1 of 4", "0 of 2", "1 of 2"]
    for label, paper in (  # its Table I
        ("RCM error, rms [mm]", "0.00710 ± 0.00706"),
        ("tip error, rms [mm]", "0.3398 ± 0.0163 (†)"),
        ("least distance, camera to obstacle [mm]", "12.52 ± 5.03 (‡)"),
    ):
        assert rows[label][0] == paper


def cells_of(text: str, start: str) -> list[list[str]]:
    """The cells of every line of a Markdown table that begins so."""
    lines = (line for line in text.splitlines() if line.startswith(start))
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_what_rests_on_fewer_people_says_on_how_many(tmp_path: Path) -> None:
    half = [dataclasses.replace(o, completion_s=math.nan) for o in outcomes("a", 0.0)[:2]]
    rows = rows_of(table(Performed(Study(), tmp_path, [*half, *outcomes("a", 0.0)[2:]])))
    assert rows["completion time [s]"][1].endswith(" (2 of 4)")
    assert rows["completion time [s]"][2] == "62.0 (1 of 2)"
    assert " of " not in rows["RCM error, rms [mm]"][1]


def test_an_interval_ends_where_its_measure_can_be_no_less_or_no_more(tmp_path: Path) -> None:
    """Five people of whom one differs much: Student's interval alone would reach beyond."""
    (first, *_) = outcomes("a", 0.0)
    shares, distances = (1.0, 1.0, 1.0, 1.0, 0.2), (-3.0, 1.0, 1.0, 1.0, 1.0)
    mine = [
        dataclasses.replace(
            first, operator=i, looking_s=100.0 * (i == 0), slow_share=share, obstacle_shaft_mm=far
        )
        for i, (share, far) in enumerate(zip(shares, distances, strict=True))
    ]
    rows = rows_of(table(Performed(Study(), tmp_path, mine)))
    assert rows["of which looking [s]"][1] == "20.0 ± 44.7 [0.0, 75.5]"
    assert rows["share of time at less than 10 mm/s"][1] == "0.84 ± 0.36 [0.40, 1.00]"
    assert rows["least distance, shaft to obstacle [mm]"][1] == "0.20 ± 1.79 [-2.02, 2.42]"


def test_one_person_has_differences_and_neither_intervals_nor_tests(tmp_path: Path) -> None:
    two = [outcomes(law, shift)[0] for law, shift in (("a", 0.0), ("b", 0.25))]
    text = table(Performed(Study(), tmp_path, two))
    assert "nan" not in text
    (cells, *_) = cells_of(text, "| tip error, rms [mm] |")  # side by side comes first
    assert cells[1:] == ["0.3", "0.55", "0.25", ""]  # mean change, and no effect size
    (cells,) = cells_of(text, "| a | b | Schunk LWA3 | tip")
    assert cells[4:] == ["1", "0.25", ""]


def test_controllers_are_compared_operator_by_operator(tmp_path: Path) -> None:
    first, second = (
        outcomes(law, shift, people=5) for law, shift in (("a, 8 ms", 0.0), ("b, 1 ms", -0.25))
    )
    text = table(Performed(Study(), tmp_path, [*first, *reversed(second)]))
    (cells,) = cells_of(text, "| a, 8 ms | b, 1 ms | Schunk LWA3 | tip")
    assert cells[4:] == ["5", "-0.25 ± 0", "-3.8 ± 2.1"]
    (cells,) = cells_of(text, "| a, 8 ms | b, 1 ms | Schunk LWA3 | completion time")
    assert cells[4:] == ["5", "0 ± 0", "0 ± 0"]


def test_fewer_than_five_people_have_a_change_and_no_effect_size(tmp_path: Path) -> None:
    text = table(Performed(Study(), tmp_path, [*outcomes("a", 0.0), *outcomes("b", 0.25)]))
    (cells,) = cells_of(text, "| a | b | Schunk LWA3 | tip")
    assert (cells[4], cells[5][:4], cells[6]) == ("4", "0.25", "")
    assert "given for 5 people or more" in text


def test_a_trial_whose_loop_fell_behind_the_clock_is_named(tmp_path: Path) -> None:
    first, *rest = outcomes("a", 0.0)
    behind = dataclasses.replace(first, late_share=0.25, behind_s=6.0, behind_share=0.1)
    text = table(Performed(Study(), tmp_path, [behind, *rest]))
    assert "**Behind the clock** by more than 1 % of the time: 0 by 10 %." in text
    assert rows_of(text)["share of cycles late"][1] == "0.250 (1 of 4)"
    assert rows_of(text)["loop behind the clock [s]"][2] == "6.00 (1 of 2)"
    for on_time in (rest, [dataclasses.replace(behind, behind_share=0.009), *rest]):
        assert "Behind the clock" not in table(Performed(Study(), tmp_path, on_time))


def test_a_comparison_says_on_which_arm_or_with_which_controller(tmp_path: Path) -> None:
    """Two arms, two controllers: the difference of the arms is another with each controller."""
    all_four = [
        *outcomes("a", 0.0),
        *outcomes("b", 1.0),
        *outcomes("a", 0.5, "panda"),
        *outcomes("b", 3.5, "panda"),
    ]
    text = comparison_table(all_four)
    lwa3, panda = "Schunk LWA3", "Franka Emika Panda"
    for ends, change in (
        (f"| a | b | {lwa3}", "1"),
        (f"| a | b | {panda}", "3"),
        (f"| {lwa3} | {panda} | a", "0.5"),
        (f"| {lwa3} | {panda} | b", "2.5"),
    ):
        (cells,) = cells_of(text, f"{ends} | tip error, rms [mm] |")
        assert cells[5].split(" ± ")[0] == change
    assert side_by_side(all_four).splitlines()[0].count(f"{panda}, b") == 1


def test_side_by_side_holds_what_speaks_against_the_second_controller_too() -> None:
    first = outcomes("a", 0.0, people=5)
    second = outcomes("b", 0.25, people=5)
    nearer = dataclasses.replace(first[3], obstacle_shaft_mm=-1.25, tip_max_mm=9.0)
    second[3] = dataclasses.replace(nearer, controller="b")
    text = side_by_side([*first, *second])
    for start, expected in (
        ("| the same, worst trial", ["-1", "-1.2", "", ""]),
        ("| tip error, largest", ["5", "9", "", ""]),
        ("| least distance, shaft", ["5.4", "5.3", "-0.05 ± 0.05", "-0.014"]),
        ("| finished; touched", ["5; 1", "5; 1", "", ""]),
    ):
        (cells,) = cells_of(text, start)
        assert cells[1:] == expected
    assert not side_by_side(first)


def test_side_by_side_says_what_each_controller_was_given() -> None:
    first, second = (
        [
            dataclasses.replace(
                o, feed_forward=forward, limits_enforced="none", gain="60", assumed="jerk"
            )
            for o in outcomes(law, 0.0)
        ]
        for law, forward in (("a", "no"), ("b", "yes"))
    )
    text = side_by_side([*first, *second])
    for start, expected in (
        ("| feed-forward", ["no", "yes", "", ""]),
        ("| joint limits enforced", ["none", "none", "", ""]),
        ("| T [ms]", ["8", "8", "", ""]),
        ("| K [1/s]", ["60", "60", "", ""]),
        ("| limits assumed", ["jerk", "jerk", "", ""]),
    ):
        (cells,) = cells_of(text, start)
        assert cells[1:] == expected


def test_a_device_jump_has_a_row_of_its_own_where_there_was_one(tmp_path: Path) -> None:
    mine, jump = Performed(Study(), tmp_path, outcomes("a", 0.0)), device_jump(Law())
    rows = rows_of(table(mine, compute_metrics(jump)))
    assert rows[JUMP] == ["4.82 (†); 0.37", "4.82; 0.372", "", ""]
    assert JUMP not in table(mine)


def test_a_limit_reached_to_rounding_is_kept(tmp_path: Path) -> None:
    at = [
        dataclasses.replace(o, speed_ratio_max=1.0 + 2e-16, limit_margin_min_rad=-2e-16)
        for o in outcomes("a", 0.0)
    ]
    over = [
        dataclasses.replace(o, speed_ratio_max=1.0 + 1e-6, limit_margin_min_rad=-1e-6) for o in at
    ]
    for group, count in ((at, "0 of 4"), (over, "4 of 4")):
        rows = rows_of(table(Performed(Study(), tmp_path, group)))
        assert rows["above a joint's speed limit"][1] == count
        assert rows["beyond a joint's position limit"][1] == count


def test_every_trial_is_a_row_of_the_csv() -> None:
    rows = list(csv.DictReader(io.StringIO(outcomes_csv(outcomes("a", 0.0)))))
    assert [float(row["reached_4_s"]) for row in rows] == [60.0, 61.0, 62.0, 63.0]
    assert rows[3]["collided"] == "True"


def test_the_figures_draw_the_numbers_beside_the_papers() -> None:
    traces = {name: np.linspace(0.0, k + 1.0, 5) for k, name in enumerate(TRACES)}
    above, below = trial_figure(TrialFile(outcomes("a", 0.0)[0], "", "", "", traces)).axes
    for axes, index, name in ((above, 0, "tip"), (above, 1, "effector"), (below, 0, "rcm")):
        assert_allclose(np.asarray(axes.lines[index].get_ydata()), 1e3 * traces[f"{name}_error"])
    figure = groups_figure(outcomes("a", 0.0))
    _, _, (bars,) = figure.axes[1].containers[0]
    lengths = [np.ptp(path.vertices[:, 1]) for path in bars.get_paths()]
    assert_allclose(lengths, [0.0, 0.0, 0.0, 2.0 * math.sqrt(2.0)], atol=1e-12)  # +- 1 deviation
    whole, _, errors = figure.axes
    papers = [line for line in whole.lines if line.get_linestyle() == "--"]
    assert [line.get_ydata()[0] for line in papers] == [84.0, 52.0]  # type: ignore[index]
    assert [line.get_ydata()[0] for line in errors.lines if line.get_linestyle() == "--"] == [0.34]  # type: ignore[index]
    assert figure.get_suptitle().startswith("lwa3, a: 2 novice, 2 experienced")
