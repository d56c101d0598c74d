"""The operator model's hands beside recorded ones: speed spectra and smoothness.

All hands are treated alike: resampled at one rate, that of the slowest recording and at most
RATE; low-passed at one frequency; cut into movements at one speed. What is compared is how a hand
moves, not how long a task takes: the tasks of a recording and of the model differ as a rule.

SPARC and LDLJ are those of rcmqp.runs.behaviour, of each movement, because both depend on how
long a hand pauses. The 95 % frequency is after "Motion smoothness-based assessment of surgical
expertise" (Sensors 2023, 23, 3146), who find that it and LDLJ tell skill levels apart.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.experiments.study.outcome import SLOW
from rcmqp.experiments.study.vocabulary import HANDS
from rcmqp.files import make_folder, write_text
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.operators import GROUPS, CameraTrial, Learning, operator_of_study
from rcmqp.references.paths import HandTrace
from rcmqp.references.view import view_pose
from rcmqp.runs.behaviour import log_dimensionless_jerk, sparc
from rcmqp.runs.loading import load_scenario
from rcmqp.show.labels import colour
from rcmqp.show.table import Table, definitions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RATE = 100.0
"""Samples a second of the model's hands, and the most of a recording that count [Hz]."""

CUTOFF = 20.0
"""Of the low-pass [Hz]: above tremor, below the noise of a tracker."""

SHORTEST = 0.2
"""A hand that is faster than SLOW for this long makes a movement [s]."""

WINDOW = 4.0
"""Of the spectrum, Welch's [s]."""

TREMOR_BAND = (8.0, 12.0)
"""[Hz]."""


@dataclass(frozen=True, slots=True)
class HandMeasures:
    """How a hand moves; NaN where it makes no movement.

    ``label`` says whose hand it is; ``spectrum`` (2, m) is frequency [Hz] and power density of the
    speed over its integral [1/Hz]. What each number means is said in HANDS of the vocabulary; a
    movement is SHORTEST or longer and faster than SLOW.
    """

    label: str
    movements_per_min: float
    movement_s: float
    slow_share: float
    speed_mean_mm_s: float
    speed_max_mm_s: float
    sparc: float
    ldlj: float
    half_power_hz: float
    most_power_hz: float
    tremor_share: float
    spectrum: Array = dataclasses.field(repr=False)


Column = tuple[str, Sequence[HandMeasures]]
"""Title of a column of a table, and whose hands it has."""

Asked = tuple[str, Sequence[Mapping[str, Array]]]
"""Title of a column, and the traces of its trials, see TRACES."""


@dataclass(frozen=True)
class HandComparison:
    """Recorded hands beside the model's.

    Attributes:
        recorded: of each recording.
        model: of each simulated operator, its group as the label.
        table: Markdown.
        figure: spectra, SPARC and LDLJ.
        files: what was written.
    """

    recorded: list[HandMeasures]
    model: list[HandMeasures]
    table: str
    figure: Figure
    files: list[Path]


def compare_hands(
    recordings: Sequence[HandTrace | str | os.PathLike[str]],
    out: str | os.PathLike[str] | None = None,
    *,
    scale: float = 1.0,
    operators: int = 20,
    seed: int = 0,
    learning: Learning | None = None,
) -> HandComparison:
    """Set recorded hands, or tools, beside those of simulated operators at the camera task.

    Args:
        recordings: traces, or CSV files for HandTrace.read_csv().
        out: folder for hands.md, hands.png and hands.pdf; without it nothing is written.
        scale: metres in the files' unit of length.
        operators: how many people of the model; see Study.
        seed: of everything random.
        learning: of the novices.

    Raises:
        OptionError: no recording, two of one name, or one that cannot be read or is too short.
        RunFileError: a file cannot be written.
    """
    if not recordings:
        raise OptionError("no recording to compare with; give one CSV file or more")
    traces = [
        each if isinstance(each, HandTrace) else HandTrace.read_csv(each, scale=scale)
        for each in recordings
    ]
    labels = [
        f"recording {i}" if isinstance(each, HandTrace) else Path(each).stem
        for i, each in enumerate(recordings, start=1)
    ]
    if len(set(labels)) < len(labels):
        names = ", ".join(str(each) for each in recordings if not isinstance(each, HandTrace))
        raise OptionError(f"recorded hands {names}: two have the same name; rename one")
    rate = slowest(trace.times for trace in traces)
    recorded = [measure_hand(t, rate, label) for t, label in zip(traces, labels, strict=True)]
    people = [operator_of_study(i, seed) for i in range(operators)]
    trials = [(CameraTrial(person, learning=learning), chance) for person, chance in people]
    model = [
        measure_hand(model_hand(trial, chance), rate, trial.operator.group)
        for trial, chance in trials
    ]
    columns, models = [(m.label, [m]) for m in recorded], by_group(model, "model")
    table, figure = hand_table([*columns, *models], rate), hand_figure(columns, models)
    files = [] if out is None else _write(make_folder(out), table, figure)
    return HandComparison(recorded, model, table, figure, files)


def model_hand(trial: CameraTrial, seed: int) -> HandTrace:
    """The way of a simulated operator's hand, whose arm is where it is asked to be at once."""
    period = 1.0 / RATE
    insertion = load_scenario("camera_task").insertion()
    asking, x = trial.start(insertion, period, seed), insertion.x_rcm
    times, positions = [], []
    for k in range(round(trial.duration / period) + 1):
        times.append(k * period)
        positions.append(asking.hand)
        view = asking.command(times[-1], x)
        if view is None:
            break
        x = view_pose(insertion.x_rcm, view).x_d
    return HandTrace(tuple(times), tuple(positions), mapping=trial.mapping)


def slowest(times: Iterable[Sequence[float] | Array]) -> float:
    """The rate at which hands are compared [Hz]: that of the slowest, and at most RATE.

    Args:
        times: (n,) of each hand [s].
    """
    return min([RATE, *(1.0 / float(np.median(np.diff(t))) for t in times)])


def compare_asked(
    asked: Sequence[Asked], model: Sequence[Asked], rate: float = RATE
) -> tuple[str, Figure] | None:
    """Compare the ways that the tip was asked to go: of people, of recordings, of the model.

    What a page's hand did itself is not kept; what it asked for is, after the viscosity. So it is
    the asked tip that counts of all of them.

    Args:
        asked: of each column, its title and the traces of its trials, see TRACES. Trials of less
            than a second or 32 samples do not count.
        model: columns of the model likewise.
        rate: at which recordings were sampled [Hz]; slower trials make it less, see slowest().

    Returns:
        Markdown, and a figure as compare_hands() makes it; None if no trial counts.
    """
    trials = [each for _, of in (*asked, *model) for each in of if len(each["time"]) > 1]
    rate = min(rate, slowest(each["time"] for each in trials))

    def measured(columns: Sequence[Asked]) -> list[Column]:
        found = list[Column]()
        for title, of in columns:
            ways = [(each["time"] - each["time"][0], each["tip_d"]) for each in of]
            traces = [
                HandTrace(tuple(t.tolist()), tuple(p.tolist()))
                for t, p in ways
                if t[-1] >= max(1.0, 32.0 / rate)
            ]
            if traces:
                found.append((title, [measure_hand(trace, rate, title) for trace in traces]))
        return found

    columns, models = measured(asked), measured(model)
    if not columns and not models:
        return None
    return hand_table([*columns, *models], rate), hand_figure(columns, models)


def measure_hand(trace: HandTrace, rate: float = RATE, label: str = "hand") -> HandMeasures:
    """Spectrum and smoothness of one hand.

    Args:
        trace: what counts of it, see HandTrace.way.
        rate: at which it is resampled [Hz].
        label: whose hand.

    Raises:
        OptionError: it is shorter than a second.
    """
    from scipy import signal  # SciPy takes long to import

    count = math.floor(trace.duration * rate + 1e-9) + 1
    if trace.duration < 1.0 or count < 32:
        raise OptionError(
            f"{label} lasts {trace.duration:g} s and has {count} samples at {rate:g} Hz; a "
            "spectrum needs a second or more, and 32 samples"
        )
    points = np.array([trace.way.position(k / rate) for k in range(count)])
    low_pass = signal.butter(4, min(CUTOFF, 0.4 * rate), fs=rate, output="sos")
    smooth = signal.sosfiltfilt(low_pass, points, axis=0)
    speed = np.linalg.norm(np.gradient(smooth, 1.0 / rate, axis=0), axis=1)
    parts = _movements(speed, rate)
    moving = speed >= SLOW
    window = min(count, round(WINDOW * rate))
    frequency, power = signal.welch(speed, rate, nperseg=window, detrend="constant")
    steps = 0.5 * (power[1:] + power[:-1]) * frequency[1]
    total = float(steps.sum()) or 1.0  # a hand that never moves has no power
    below = np.concatenate([[0.0], np.cumsum(steps)]) / total
    low, high = np.interp(TREMOR_BAND, frequency, below)
    return HandMeasures(
        label,
        movements_per_min=60.0 * len(parts) / trace.duration,
        movement_s=_median([len(part) / rate for part in parts]),
        slow_share=float(1.0 - moving.mean()),
        speed_mean_mm_s=1e3 * float(speed[moving].mean()) if moving.any() else math.nan,
        speed_max_mm_s=1e3 * float(speed.max()),
        sparc=_median([sparc(part, 1.0 / rate) for part in parts]),
        ldlj=_median([log_dimensionless_jerk(part, 1.0 / rate) for part in parts]),
        half_power_hz=float(np.interp(0.5, below, frequency)),
        most_power_hz=float(np.interp(0.95, below, frequency)),
        tremor_share=float(high - low),
        spectrum=np.array([frequency, power / total]),
    )


def by_group(hands: Sequence[HandMeasures], whose: str) -> list[Column]:
    """Hands whose labels are groups, by group; the titles say whose they are, and how many."""
    groups = {group: [m for m in hands if m.label == group] for group in GROUPS}
    return [(f"{whose}, {len(of)} {group}", of) for group, of in groups.items() if of]


def hand_table(columns: Sequence[Column], rate: float) -> str:
    """Markdown: a column for each recording or group."""
    rows = [
        [
            measure.row,
            *(_cell([getattr(m, name) for m in of], measure.fixed) for _, of in columns),
        ]
        for name, measure in HANDS.items()
    ]
    note = (
        f"All hands at {rate:.3g} Hz, low-passed at {min(CUTOFF, 0.4 * rate):.3g} Hz. A movement "
        f"is {SHORTEST:g} s or more above {1e3 * SLOW:g} mm/s. Of several hands: median, and [ ] "
        "the least and the largest. Nothing of the model was fitted to these numbers."
    )
    explained = {measure.row: measure.meaning for measure in HANDS.values()}
    text = Table(["", *(title for title, _ in columns)], rows).markdown()
    return f"{text}\n{note}\n\n{definitions(explained)}"


def hand_figure(hands: Sequence[Column], model: Sequence[Column]) -> Figure:
    """Spectra of the speed, and SPARC over LDLJ: hands in colour, the model in grey."""
    from matplotlib.figure import Figure  # Matplotlib takes long to import

    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    drawn = [
        (column, grey, marker, 0.7)
        for column, (grey, marker) in zip(model, (("0.45", "x"), ("0.75", "+")), strict=False)
    ]
    drawn += [
        (column, colour(i), "o", 1.8 if len(column[1]) == 1 else 1.0)
        for i, column in enumerate(hands)
    ]
    for (title, of), shade, marker, width in drawn:
        for i, m in enumerate(of):
            label = None if i else title
            left.loglog(*m.spectrum[:, 1:], color=shade, linewidth=width, label=label)
            right.plot([m.ldlj], [m.sparc], marker, color=shade, label=label)
    left.set(xlabel="frequency [Hz]", ylabel="power of the speed over all of it [1/Hz]")
    left.axvspan(*TREMOR_BAND, color="0.93", zorder=0)
    last = max((m.spectrum[0, -1] for (_, of), *_ in drawn for m in of), default=CUTOFF)
    left.set_xlim(right=min(CUTOFF, 0.8 * last))  # beyond it there is the low-pass alone
    left.set_ylim(bottom=1e-7)
    right.set(xlabel="LDLJ of a movement, median", ylabel="SPARC of a movement, median")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    left.legend(fontsize=8)
    return figure


def _movements(speed: Array, rate: float) -> list[Array]:
    """The parts of a speed (n,) [m/s] that are movements."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], speed >= SLOW, [0]]).astype(int)))
    spans = zip(edges[::2], edges[1::2], strict=True)
    return [speed[a:b] for a, b in spans if b - a >= max(3.0, SHORTEST * rate)]


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else math.nan


def _cell(values: Sequence[float], style: str) -> str:
    some = [value for value in values if not math.isnan(value)]
    if not some:
        return ""
    middle = f"{np.median(some):{style}}"
    return middle if len(values) == 1 else f"{middle} [{min(some):{style}}, {max(some):{style}}]"


def _write(folder: Path, table: str, figure: Figure) -> list[Path]:
    from rcmqp.show import plots  # Matplotlib takes long to import

    file = folder / "hands.md"
    write_text(file, f"# Recorded hands beside the operator model's\n\n{table}")
    return [file, *plots.save_figure(figure, folder / "hands")]
