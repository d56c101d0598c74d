"""Experiment B run again: the device jump, the factors, and what is written."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rcmqp import compute_metrics, load_scenario, make_controller, simulate
from rcmqp.cli import main
from rcmqp.experiments.study.experiment_b import (
    EFFECTS,
    MEASURES,
    device_jump,
    factor_table,
    factors,
    reproduce_b,
)
from rcmqp.experiments.study.outcome import Outcome
from rcmqp.experiments.study.perform import perform
from rcmqp.experiments.study.plan import Law, Study
from rcmqp.experiments.study.report import JUMP
from rcmqp.references.operators import Learning

HANDBOOK = (Path(__file__).parents[1] / "docs" / "handbook.md").read_text(encoding="utf-8")


def cells_of(text: str) -> list[list[str]]:
    lines = (line for line in text.splitlines() if line.startswith("|"))
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]


# The device jump ---------------------------------------------------------------------------


def test_one_device_jump_gives_both_of_the_papers_largest_errors() -> None:
    found = compute_metrics(device_jump(Law()))
    assert found.rcm_max_mm == pytest.approx(0.37, abs=0.005)
    assert found.effector_max_mm == pytest.approx(4.82, abs=0.005)
    scenario = load_scenario("device_jump", period=8e-3)
    law = make_controller("dual_quaternion", scenario.insertion(), scenario.period)
    assert simulate(scenario, law).digest == device_jump(Law()).digest


def test_the_period_makes_the_jumps_rcm_error_and_the_hierarchy_has_none() -> None:
    fast = compute_metrics(device_jump(Law(period=1e-3)))
    assert fast.rcm_max_mm == pytest.approx(0.055, abs=0.005)
    qp = compute_metrics(device_jump(Law("hierarchical_qp")))
    assert qp.rcm_max_mm < 1e-3
    assert fast.effector_max_mm == pytest.approx(qp.effector_max_mm) == pytest.approx(4.82)


def test_the_handbooks_people_are_those_of_the_study(tmp_path: Path) -> None:
    """Loosely: the person steers by what the camera shows, and machines differ in a last bit."""
    found = perform(Study(), tmp_path).outcomes
    start = HANDBOOK.index("rcmqp reproduce --experiment b -->")
    rows = [cells for cells in cells_of(HANDBOOK[start:]) if len(cells) == 5]
    shown = {cells[0]: cells for cells in reversed(rows)}  # of those of one name, the first
    for label, name in (
        ("completion time [s]", "completion_s"),
        ("effector error, rms [mm]", "effector_rms_mm"),
        ("tip error, rms [mm]", "tip_rms_mm"),
        ("RCM error, rms [mm]", "rcm_rms_mm"),
        ("least distance, camera to obstacle [mm]", "obstacle_tip_mm"),
    ):
        mean, deviation = map(float, shown[label][2].partition(" [")[0].split(" ± "))
        values = [getattr(o, name) for o in found]
        assert mean == pytest.approx(np.mean(values), rel=0.1), label
        assert deviation == pytest.approx(np.std(values, ddof=1), rel=0.3), label
    for label, name in (
        ("effector error, largest [mm]", "effector_max_mm"),
        ("tip error, largest [mm]", "tip_max_mm"),
        ("RCM error, largest [mm]", "rcm_max_mm"),
    ):
        most = max(getattr(o, name) for o in found)
        assert float(shown[label][2]) == pytest.approx(most, rel=0.2), label


# The factors -------------------------------------------------------------------------------


def test_every_combination_that_can_be_had_is_there_once() -> None:
    found = factors()
    assert len(found) == len(set(found.values())) == 12
    law = [levels[1:] for levels in found if levels[0] == "dual_quaternion"]
    assert law == list(itertools.product((8e-3, 1e-3), ("off", "on"), ("off", "on")))
    for (name, period, ahead, kept), made in found.items():
        assert (made.name, made.period) == (name, period)
        options = dict(made.options)
        if name == "dual_quaternion":
            assert options.get("feed_forward", False) == (ahead == "on")
            assert options.get("velocity_limit", "none") == ("scale" if kept == "on" else "none")
        else:
            assert ahead == "on"
            assert ("limits" in options) == (kept == "off")


def made_up(seed: int, people: int = 6) -> list[Outcome]:
    """Errors of which each factor's effect is known: 1/2, 1/3, 2 and 1/10, times a little luck."""
    rng, found = np.random.default_rng(seed), []
    for (name, period, ahead, kept), law in factors().items():
        size = (0.5 if period == 1e-3 else 1.0) * (1 / 3 if ahead == "on" else 1.0)
        size *= (2.0 if kept == "on" else 1.0) * (0.1 if name == "hierarchical_qp" else 1.0)
        for i in range(people):
            error = (1.0 + i) * size * math.exp(0.1 * rng.normal())
            blank = Outcome(i, "novice", "lwa3", str(law), period)
            errors: dict[str, Any] = {field: error for field, _, _ in MEASURES}
            found.append(dataclasses.replace(blank, **errors))
    return found


def test_the_effect_of_each_factor_is_found_whatever_the_others_are() -> None:
    outcomes = made_up(7)
    cells = cells_of(factor_table(outcomes))
    assert [len(row) for row in cells[:14]] == [4 + len(MEASURES)] * 14
    first = [o for o in outcomes if o.controller == "dual_quaternion, 8 ms"]
    assert cells[2][:4] == ["dual_quaternion", "8 ms", "off", "off"]
    assert cells[2][4] == f"{np.mean([o.rcm_rms_mm for o in first]):.2g}"
    assert cells[2][5] == f"{max(o.rcm_max_mm for o in first):.2g}"
    effects = {(row[0], row[1]): row[2:] for row in cells[16:]}
    expected = {
        ("period, 8 to 1 ms", "dual_quaternion"): 0.5,
        ("feed-forward, off to on", "dual_quaternion"): 1 / 3,
        ("limits, off to on", "dual_quaternion"): 2.0,
        ("period, 8 to 1 ms", "hierarchical_qp"): 0.5,
        ("limits, off to on", "hierarchical_qp"): 2.0,
        ("law, limits off", "both"): 0.1,
        ("law, limits on", "both"): 0.1,
    }
    assert effects.keys() == expected.keys()
    for key, ratio in expected.items():
        assert len(effects[key]) == len(EFFECTS)
        mean, error = map(float, effects[key][0].split(" ± "))
        assert abs(mean - ratio) < 4.0 * error < 0.4 * ratio, key


def test_the_effects_errors_are_those_of_new_draws() -> None:
    found = []
    for seed in range(200):
        rows = cells_of(factor_table(made_up(seed)))
        (law,) = [row for row in rows if row[0] == "law, limits on"]
        found.append([float(x) for x in law[2].split(" ± ")])
    means, errors = np.array(found).T
    assert np.mean(errors) == pytest.approx(np.std(means), rel=0.2)


def test_one_person_has_effects_without_errors() -> None:
    cells = cells_of(factor_table(made_up(7, people=1)))
    assert not any("±" in cell or "nan" in cell for row in cells for cell in row)


# What is written ---------------------------------------------------------------------------


def test_experiment_b_leaves_the_jump_beside_the_people(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One operator, to the end: a novice with a quick eye, after the paper's practice."""
    found = reproduce_b(tmp_path / "b", operators=1, seed=46, learning=Learning())
    assert found.factorial is None
    (mine,) = [row for row in cells_of(found.table) if row[0] == JUMP]
    assert mine[2] == "4.82; 0.372"
    assert (tmp_path / "b" / "device_jump.h5") in found.files
    assert all(file.stat().st_size for file in found.files)
    call = ["reproduce", "-e", "b", "--operators", "1", "--seed", "46", "--practice", "120"]
    with pytest.raises(SystemExit):
        main([*call, "--out", str(tmp_path / "again"), "--json"])
    (trial,) = json.loads(capsys.readouterr().out)
    assert trial["digest"] == found.performed.outcomes[0].digest


def test_the_factors_are_asked_for_by_one_option(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two of the twelve, so that the test is short."""
    two = dict(itertools.islice(factors().items(), 0, 2))
    monkeypatch.setattr("rcmqp.experiments.study.experiment_b.factors", lambda: two)
    monkeypatch.setattr("rcmqp.experiments.study.experiment_b.factors", lambda: two)
    call = ["reproduce", "-e", "b", "--operators", "1", "--seed", "46", "--factors"]
    with pytest.raises(SystemExit) as ended:
        main([*call, "--out", str(tmp_path)])
    assert ended.value.code == 0
    printed = capsys.readouterr().out
    assert "| limits, off to on | dual_quaternion |" in printed
    assert "| dual_quaternion | 8 ms | off | on |" in printed
    assert (tmp_path / "factors.md").read_text("utf-8").splitlines()[2] in printed
    with pytest.raises(SystemExit) as ended:
        main(["reproduce", "--factors"])
    assert ended.value.code == 1
    assert "--factors is not for experiment a" in capsys.readouterr().err


def test_the_handbooks_factors_are_the_rows_of_the_table() -> None:
    start = HANDBOOK.index("rcmqp reproduce -e b --factors")
    shown = cells_of(HANDBOOK[start:])
    expected = cells_of(factor_table(made_up(7)))
    assert [row[:4] for row in shown[:14]] == [row[:4] for row in expected[:14]]
    assert [row[:2] for row in shown[14 : len(expected)]] == [row[:2] for row in expected[14:]]
