"""Recorded hands beside the model's.

tests/synthetic_hand.csv is synthetic: minimum-jerk reaches with a tremor of 9 Hz and a tracker's
noise, made by a program. It is no person's hand and shows nothing about the model.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from rcmqp.cli import main
from rcmqp.errors import OptionError
from rcmqp.experiments.study.hands import compare_asked, compare_hands, measure_hand, model_hand
from rcmqp.experiments.study.vocabulary import HANDS
from rcmqp.maths.smooth import step
from rcmqp.references.operators import CameraTrial, Operator, operator_of_study
from rcmqp.references.paths import HandTrace
from rcmqp.runs.behaviour import log_dimensionless_jerk, sparc

RECORDING = Path(__file__).with_name("synthetic_hand.csv")


def reaches(count: int, rate: float = 100.0, tremor: float = 0.0) -> HandTrace:
    """Reaches of 3 cm in 0.8 s, 0.7 s of rest before each, with a tremor of 9 Hz along x [m]."""
    times = np.arange(round(count * 1.5 * rate) + 1) / rate
    way = [sum(0.03 * step((t - 1.5 * k - 0.7) / 0.8)[0] for k in range(count)) for t in times]
    x = np.array(way) + tremor * np.sin(2.0 * math.pi * 9.0 * times)
    return HandTrace(tuple(times), tuple((v, 0.0, 0.0) for v in x))


# Files -------------------------------------------------------------------------------------


def test_a_recording_is_read_in_metres_from_its_first_sample_on() -> None:
    trace = HandTrace.read_csv(RECORDING, scale=1e-3)
    lines = [line.split(",") for line in RECORDING.read_text("utf-8").splitlines()[3:]]
    assert len(trace.times) == len(lines) == 1000
    assert trace.positions[500] == pytest.approx([1e-3 * float(v) for v in lines[500][1:]])
    assert trace.duration == pytest.approx(19.98)
    assert all(trace.engaged) or not trace.engaged


def test_columns_come_in_any_order_and_the_clutch_counts(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text(
        "z, Y ,x,note,time,engaged\n0.3,0.2,0.1,a,7,1\n0.6,0.5,0.4,b,9,0\n", encoding="utf-8"
    )
    trace = HandTrace.read_csv(file)
    assert trace.times == (0.0, 2.0)
    assert trace.positions == ((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))
    assert trace.engaged == (True, False)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "no such file; give the path of a CSV"),
        ("", "has 0 samples"),
        ("t,x,y\n0,1,2\n1,2,3\n", "has no column z"),
        ("t,x,y,z\n0,1,2,3\n1,a,2,3\n", "sample 2, .* is not 4 numbers"),
        ("t,x,y,z\n0,1,2,3\n1,2\n", "is not 4 numbers"),
        ("t,x,y,z\n0,1,2,3\n0,1,2,3\n", "sample 2 is at 0 s"),
        ("t,x,y,z\n0,1,2,nan\n1,1,2,3\n", "sample 1 has a number that is not finite"),
    ],
)
def test_a_file_that_is_no_recording_is_refused(
    text: str | None, message: str, tmp_path: Path
) -> None:
    file = tmp_path / "a.csv"
    if text is not None:
        file.write_text(text, encoding="utf-8")
    with pytest.raises(OptionError, match=message):
        HandTrace.read_csv(file)


# Measures ----------------------------------------------------------------------------------


def test_reaches_are_counted_and_measured_as_they_were_made() -> None:
    found = measure_hand(reaches(8))
    assert found.movements_per_min == pytest.approx(40.0, rel=0.01)
    peak = 1.875 * 30.0 / 0.8
    assert found.speed_max_mm_s == pytest.approx(peak, rel=0.01)
    u = np.linspace(0.0, 1.0, 4001)
    above = peak * 16.0 * (u * (1.0 - u)) ** 2 >= 10.0  # a minimum-jerk speed, in closed form
    assert found.movement_s == pytest.approx(0.8 * np.mean(above), abs=0.02)
    assert found.slow_share == pytest.approx(1.0 - 0.8 * np.mean(above) / 1.5, abs=0.02)
    speed = 1e-3 * peak * 16.0 * (u * (1.0 - u)) ** 2
    part = speed[above][::50]  # every 10 ms
    assert found.sparc == pytest.approx(sparc(part, 0.01), abs=0.03)
    assert found.ldlj == pytest.approx(log_dimensionless_jerk(part, 0.01), abs=0.3)


def test_tremor_shows_in_the_spectrum_and_in_the_smoothness() -> None:
    calm, shaky = (measure_hand(reaches(8, tremor=a)) for a in (0.0, 3e-4))
    assert calm.tremor_share < 1e-4
    assert shaky.tremor_share > 0.05
    assert shaky.most_power_hz > 8.0 > 3.0 > calm.most_power_hz
    assert shaky.sparc < calm.sparc
    assert shaky.ldlj < calm.ldlj - 1.0


def test_the_spectrum_is_welchs_of_the_speed_and_has_unit_area() -> None:
    found, count = measure_hand(reaches(8, tremor=1e-4)), 1201
    x = [p[0] for p in reaches(8, tremor=1e-4).positions]
    smooth = signal.sosfiltfilt(signal.butter(4, 20.0, fs=100.0, output="sos"), x)
    speed = np.abs(np.gradient(smooth, 0.01))
    frequency, power = signal.welch(speed, 100.0, nperseg=400)
    assert len(x) == count
    np.testing.assert_allclose(found.spectrum[0], frequency)
    ratio = found.spectrum[1] / power
    np.testing.assert_allclose(ratio, ratio[5], rtol=1e-6)
    area = 0.25 * (found.spectrum[1].sum() - 0.5 * found.spectrum[1][[0, -1]].sum())
    assert area == pytest.approx(1.0)


def test_a_still_hand_has_no_movement_and_a_short_one_is_refused() -> None:
    still = HandTrace((0.0, 5.0), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    found = measure_hand(still)
    assert found.movements_per_min == found.speed_max_mm_s == 0.0
    assert found.slow_share == 1.0
    assert math.isnan(found.sparc)
    with pytest.raises(OptionError, match="a spectrum needs a second or more"):
        measure_hand(dataclasses.replace(still, times=(0.0, 0.9)))


# The model's -------------------------------------------------------------------------------


def test_the_models_hand_is_the_one_that_steers() -> None:
    trace = model_hand(CameraTrial(Operator(recognition=0.0)), 3)
    assert trace == model_hand(CameraTrial(Operator(recognition=0.0)), 3)
    way = np.array(trace.positions) - np.array(trace.positions[0])
    assert np.abs(way).max() < 0.075
    last = CameraTrial().mapping.view(tuple(way[-1]), (0.0, 0.0, 0.0), 0.10)
    target = CameraTrial().task.targets[-1]
    assert last.t_z == pytest.approx(math.hypot(*target) - 0.10, abs=1.2e-3)


def test_recordings_stand_beside_both_groups(tmp_path: Path) -> None:
    found = compare_hands([RECORDING, reaches(8)], tmp_path, scale=1e-3, operators=2, seed=46)
    assert [m.label for m in found.recorded] == ["synthetic_hand", "recording 2"]
    assert [m.label for m in found.model] == ["novice", "experienced"]
    rows = [[c.strip() for c in line.split("|")[1:-1]] for line in found.table.splitlines()]
    heads = ["", "synthetic_hand", "recording 2", "model, 1 novice", "model, 1 experienced"]
    assert rows[0] == heads
    assert [cells[0] for cells in rows[2 : 2 + len(HANDS)]] == [
        each.row for each in HANDS.values()
    ]
    slowest = measure_hand(HandTrace.read_csv(RECORDING, scale=1e-3), 50.0)
    assert found.recorded[0].sparc == pytest.approx(slowest.sparc)
    person, seed = operator_of_study(0, 46)
    novice = measure_hand(model_hand(CameraTrial(person), seed), 50.0)  # at the recording's rate
    assert found.model[0].ldlj == pytest.approx(novice.ldlj)
    assert {f.name for f in found.files} == {"hands.md", "hands.png", "hands.pdf"}
    assert found.table in (tmp_path / "hands.md").read_text("utf-8")
    drawn = [line.get_label() for line in found.figure.axes[0].lines]
    assert drawn == [*heads[3:], *heads[1:3]]
    with pytest.raises(OptionError, match="no recording"):
        compare_hands([])


def test_a_recording_may_be_named_like_the_model_but_not_like_another(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("model_hand.csv", "model, 1 novice.csv", "model.csv")]
    for file in files:
        file.write_bytes(RECORDING.read_bytes())
    found = compare_hands(files, scale=1e-3, operators=2)
    heads = [cell.strip() for cell in found.table.splitlines()[0].split("|")[2:-1]]
    assert heads == [*(f.stem for f in files), "model, 1 novice", "model, 1 experienced"]
    (tmp_path / "a").mkdir()
    other = tmp_path / "a" / "model.csv"
    other.write_bytes(RECORDING.read_bytes())
    with pytest.raises(OptionError, match=r"a/model\.csv: two have the same name; rename one"):
        compare_hands([files[2], other], scale=1e-3)


def test_asked_ways_are_compared_at_the_rate_of_the_slowest() -> None:
    def asked(rate: float) -> dict[str, np.ndarray]:
        trace = reaches(4, rate)
        return {"time": np.array(trace.times), "tip_d": np.array(trace.positions)}

    for slow, recorded, said in (
        (62.5, 100.0, "62.5"),
        (1000.0, 10.0, "10"),
        (500.0, 200.0, "100"),
    ):
        both = compare_asked([("people", [asked(1000.0)])], [("model", [asked(slow)])], recorded)
        assert both is not None
        assert f"All hands at {said} Hz" in both[0]
    short = {name: values[:150] for name, values in asked(100.0).items()}
    assert compare_asked([("people", [short])], [], 10.0) is None


def test_one_command_makes_table_and_figure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["hands", str(RECORDING), "--scale", "0.001", "--operators", "1", "--seed", "46"]
    with pytest.raises(SystemExit) as ended:
        main([*call, "--out", str(tmp_path / "out")])
    assert ended.value.code == 0
    printed = capsys.readouterr().out
    assert "SPARC of a movement, median" in printed
    assert "hands.png" in printed
    with pytest.raises(SystemExit) as ended:
        main(["hands", str(tmp_path / "none.csv")])
    assert ended.value.code == 1
