"""Single trials of a study: their outcomes, their files, and those that fail."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from helpers import assert_allclose
from matplotlib.figure import Figure
from short_study import study

from rcmqp import Run, compute_metrics, simulate
from rcmqp.cli import main
from rcmqp.controllers import CONTROLLERS, Command, DualQuaternion
from rcmqp.errors import OptionError, RunFileError, UnknownName
from rcmqp.experiments.study.outcome import outcome_of
from rcmqp.experiments.study.perform import (
    perform,
    run_trial,
    trial_file,
)
from rcmqp.experiments.study.plan import Law
from rcmqp.experiments.study.report import table, write_figures
from rcmqp.experiments.study.trial_file import TrialFile
from rcmqp.references.operators import CameraTrial, operator_of_study, recognition_times
from rcmqp.references.operators.camera_task import CameraTask
from rcmqp.references.view import Reference
from rcmqp.world.arm import ArmState


def test_the_figures_are_of_the_trial_of_median_time(
    short: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done, drawn = perform(study(short, 3), tmp_path), []

    def drawing(record: TrialFile) -> Figure:
        drawn.append(record.outcome.operator)
        return Figure()

    monkeypatch.setattr("rcmqp.experiments.study.figures.trial_figure", drawing)
    timed = [
        dataclasses.replace(o, finished=True, completion_s=t, reached_s=(1.0, 2.0, 3.0, t))
        for o, t in zip(done.outcomes, (60.0, 80.0, 70.0), strict=True)
    ]
    write_figures(dataclasses.replace(done, outcomes=timed))
    assert drawn == [2]


@dataclasses.dataclass(frozen=True, eq=False)
class Fragile(DualQuaternion):
    """Fails where a file says so."""

    def _step(self, state: ArmState, reference: Reference) -> Command:
        if Path(os.environ["FRAGILE"]).exists():
            raise OptionError("as it was told to")
        return super()._step(state, reference)


def test_failed_trials_are_told_of_and_run_again(
    short: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flag = tmp_path / "flag"
    monkeypatch.setenv("FRAGILE", str(flag))
    monkeypatch.setitem(CONTROLLERS, "fragile", Fragile)
    call = ["study", short, "--operators", "1", "-c", "fragile", "--period", "0.02"]
    flag.touch()
    for code, note in ((1, "1 of 1 trials failed, the first, operator 0"), (0, "")):
        with pytest.raises(SystemExit) as ended:
            main([*call, "--json", "--out", str(tmp_path / "out")])
        printed = capsys.readouterr()
        assert ended.value.code == code
        assert note in printed.err
        (outcome,) = json.loads(printed.out)
        assert bool(outcome["failure"]) is bool(code)
        flag.unlink(missing_ok=True)


def test_a_controller_that_cannot_be_made_is_an_error_and_no_outcome(
    short: str, tmp_path: Path
) -> None:
    trial = study(short, 1).trials()[0]
    broken = dataclasses.replace(trial, law=Law(period=0.02, options=(("gane", 1.0),)))
    with pytest.raises(UnknownName, match="did you mean gain"):
        run_trial(broken, tmp_path, CONTROLLERS["dual_quaternion"], "")


def test_a_trial_can_be_looked_at(
    short: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its file is no run, and says what makes one of it: the same to the bit."""
    chosen = study(short, 2)
    performed = perform(chosen, tmp_path / "out")
    file = trial_file(tmp_path / "out", chosen.trials()[1])
    with pytest.raises(RunFileError, match=r"rcmqp study .*operator0001.h5 --out again"):
        Run.load(file)
    with pytest.raises(SystemExit) as ended:
        main(["study", str(file), "--out", str(tmp_path / "again")])
    assert ended.value.code == 0
    assert "rcmqp view" in capsys.readouterr().out
    assert Run.load(tmp_path / "again" / file.name).digest == performed.outcomes[1].digest


FAR = """
from rcmqp import Instrument, Scenario, load_arm
from rcmqp.world.insertion import Insertion
from rcmqp.references.operators import CameraTrial

def scenario(arm="panda", *, flange=None):
    inside = Insertion.on_shaft(load_arm(arm), Instrument(length=0.11), depth=0.10)
    return Scenario.of("far", inside, CameraTrial(duration=60.0))
"""


def test_a_trial_that_fails_is_an_outcome_with_its_reason(tmp_path: Path) -> None:
    """A shaft of 11 cm, and objectives 14 cm inside."""
    (tmp_path / "far.py").write_text(FAR, encoding="utf-8")
    chosen = study(str(tmp_path / "far.py"), 1, seed=46)
    performed = perform(chosen, tmp_path / "out")
    (outcome,) = performed.outcomes
    assert "the instrument is only 110.0 mm long" in outcome.failure
    assert math.isnan(outcome.rcm_rms_mm)
    assert not outcome.finished
    assert "1 trials failed; the first, operator 0: " in table(performed)
    assert not write_figures(performed)


def test_an_outcome_has_the_runs_own_numbers_and_the_traces_fit_them(short: str) -> None:
    (trial,) = study(short, 1).trials()
    scenario = trial.made()
    run = simulate(scenario, trial.law.controller(scenario))
    outcome, traces = outcome_of(trial, run)
    metrics = compute_metrics(run)
    for name in ("tip_rms_mm", "effector_max_mm", "rcm_max_mm", "speed_ratio_max"):
        assert getattr(outcome, name) == getattr(metrics, name)
    assert outcome.digest == run.digest
    assert not outcome.finished
    assert math.isnan(outcome.completion_s)
    assert_allclose(1e3 * traces["rcm_error"].max(), outcome.rcm_max_mm, rtol=1e-6)
    assert_allclose(1e3 * traces["obstacle"].min(), outcome.obstacle_shaft_mm, rtol=1e-6)
    shaft = outcome.obstacle_shaft_mm + 1e3 * scenario.instrument.radius
    assert shaft == pytest.approx(outcome.obstacle_tip_mm)  # the tip is the nearest
    assert_allclose(traces["tip"][0], [0.0, 0.0, 0.10], rtol=0, atol=1e-7)


def test_standing_and_moving_are_told_apart(short: str) -> None:
    """Somebody who need not look moves at once."""
    (trial,) = study(short, 1).trials()
    made = trial.made()
    assert isinstance(made.path, CameraTrial)
    quick = dataclasses.replace(made.path.operator, recognition=0.0, delay=0.0)
    path = dataclasses.replace(made.path, operator=quick)
    scenario = dataclasses.replace(made, path=path, duration=3.0)
    run = simulate(scenario, trial.law.controller(scenario))
    outcome, _ = outcome_of(trial, run)
    speed = np.linalg.norm(np.diff(run.tip, axis=0), axis=1) / run.period
    moving = run.rcm_error[1:][speed >= 0.01]
    assert 0.2 < outcome.slow_share < 0.8
    assert outcome.slow_share == pytest.approx(1.0 - len(moving) / len(run.time))
    assert outcome.rcm_rms_moving_mm == pytest.approx(1e3 * np.sqrt(np.mean(moving**2)))
    assert outcome.rcm_rms_moving_mm > outcome.rcm_rms_mm


def test_a_shaft_that_touches_the_obstacle_with_its_side_collides(short: str) -> None:
    """The tip is 4 cm beyond an obstacle that the shaft's side is 1.5 mm inside of."""
    (trial,) = study(short, 1).trials()
    made = trial.made()
    assert isinstance(made.path, CameraTrial)
    task = CameraTask(target_depth=0.06, obstacle_radius=0.0215)
    scenario = dataclasses.replace(made, path=dataclasses.replace(made.path, task=task))
    outcome, _ = outcome_of(trial, simulate(scenario, trial.law.controller(scenario)))
    assert made.instrument.radius == 0.005
    assert outcome.obstacle_shaft_mm == pytest.approx(25.0 - 21.5 - 5.0, abs=0.2)
    assert outcome.obstacle_tip_mm == pytest.approx(math.hypot(25.0, 40.0) - 21.5, abs=0.2)
    assert outcome.collided
    assert outcome.looking_s == 0.0  # no objective was reached


def test_a_record_survives_its_file(short: str, tmp_path: Path) -> None:
    chosen = study(short, 1)
    perform(chosen, tmp_path)
    record = TrialFile.load(trial_file(tmp_path, chosen.trials()[0]))
    record.save(tmp_path / "again.h5")
    assert TrialFile.load(tmp_path / "again.h5").digest == record.digest
    assert record.scenario == chosen.trials()[0].made().to_json()
    assert json.loads(record.scenario)["path"]["operator"]["group"] == "novice"


def test_experiment_b_is_reproduced_and_others_are_unknown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One operator, to the end: a novice with a quick eye."""
    call = ["reproduce", "-e", "b", "--operators", "1", "--seed", "46", "--out", str(tmp_path)]
    with pytest.raises(SystemExit):
        main([*call, "--json"])
    (trial,) = json.loads(capsys.readouterr().out)
    assert trial["finished"]
    assert trial["arm"] == "lwa3"
    assert trial["controller"] == "dual_quaternion, 8 ms"
    assert 0.1 < trial["tip_rms_mm"] < 0.6
    person, seed = operator_of_study(0, 46)
    assert trial["looking_s"] == pytest.approx(sum(recognition_times(person, 4, seed)))
    assert trial["rcm_max_mm"] < 0.37
    with pytest.raises(SystemExit) as ended:
        main(["reproduce", "-e", "c"])
    assert ended.value.code == 1
    assert "known: a, b" in capsys.readouterr().err
