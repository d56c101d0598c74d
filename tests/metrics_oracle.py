"""The metrics of a run's file again, by loops over its numbers, with nothing of rcmqp."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Any

import h5py
import numpy as np


def path_duration(path: dict[str, Any]) -> float:
    """How long a path takes [s], by what its numbers mean."""
    if path["kind"] == "view_moves":
        return float(len(path["views"]) * (path["move"] + path["dwell"]))
    if path["kind"] == "view_steps":
        return float(len(path["views"]) * path["dwell"])
    return float(path["duration"])


def hamilton(a: Any, b: Any) -> Any:
    w = a[0] * b[0] - a[1:] @ b[1:]
    return np.concatenate([[w], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


def conjugate(a: Any) -> Any:
    return a * np.array([1.0, -1.0, -1.0, -1.0])


def place(x: Any) -> Any:
    return 2.0 * hamilton(x[4:], conjugate(x[:4]))[1:]


def shaft(x: Any) -> Any:
    z = np.array([0.0, 0.0, 0.0, 1.0])
    return hamilton(hamilton(x[:4], z), conjugate(x[:4]))[1:]


def turn(x: Any, y: Any) -> float:
    between = hamilton(conjugate(x[:4]), y[:4])
    return float(2.0 * math.atan2(np.linalg.norm(between[1:]), abs(between[0])))


def metrics_of(file: Path) -> dict[str, float]:
    with h5py.File(file) as data:
        run = {name: np.array(data[name]) for name in data if isinstance(data[name], h5py.Dataset)}
        scenario = json.loads(data.attrs["scenario"])
        began = data["diagnostics"].get("began_late")
        waited = None if began is None else np.array(began)
    return {
        **lateness(run["time"], waited, scenario["period"]),
        **errors(run, scenario),
        **contour(run, scenario),
        **limits(run, scenario),
        **over_time(run, scenario),
        "obstacle_distance_min_mm": 1e3 * obstacle_distance(run, scenario),
        "singular_value_min": run["singular_value"].min(),
        "solve_time_median_us": 1e6 * percentile(run["solve_time"], 0.5),
        "solve_time_p99_us": 1e6 * percentile(run["solve_time"], 0.99),
    }


def lateness(time: Any, waited: Any, period: float) -> dict[str, float]:
    """How late a real-time loop was; NaN for a run that no clock drove, where nothing waited."""
    if waited is None:
        return {"late_share": math.nan, "behind_s": math.nan}
    late = [float(each) / period >= 0.5 for each in waited]
    lost = [b - a - period for a, b in itertools.pairwise(time)]
    return {"late_share": sum(late) / len(late), "behind_s": max(0.0, sum(lost))}


def percentile(values: Any, share: float) -> float:
    ordered = sorted(values)
    place_of_it = share * (len(ordered) - 1)
    low = math.floor(place_of_it)
    high = min(low + 1, len(ordered) - 1)
    return float(ordered[low] + (place_of_it - low) * (ordered[high] - ordered[low]))


def last_asked(run: dict[str, Any], scenario: dict[str, Any]) -> int:
    """The last row in which the path, the reference or the trocar still moves."""
    ends = round(path_duration(scenario["path"]) / scenario["period"])
    return int(min(len(run["time"]) - 1, max(ends, *stops(run))))


def contour(run: dict[str, Any], scenario: dict[str, Any]) -> dict[str, float]:
    """Distance of the tip from every piece of its path, and how late it is there."""
    curve, tips = run["tip_d"] - run["pivot"], run["tip"] - run["pivot"]
    start, along = curve[:-1], np.diff(curve, axis=0)
    square = np.sum(along**2, axis=1)
    distances, lags, reached = [], [], 0
    for k, tip in enumerate(tips):
        share = np.sum((tip - start) * along, axis=1) / np.where(square > 0.0, square, 1.0)
        nearest = start + np.clip(share, 0.0, 1.0)[:, None] * along
        distances.append(1e3 * np.linalg.norm(nearest - tip, axis=1).min())
        gone = np.linalg.norm(curve[reached : k + 1] - tip, axis=1)
        reached += int(np.flatnonzero(gone < gone.min() + 1e-12)[-1])
        lags.append(run["time"][k] - run["path_time"][reached])
    asked = distances[: last_asked(run, scenario) + 1]
    return {
        "contour_rms_mm": math.sqrt(sum(value**2 for value in asked) / len(asked)),
        "contour_max_mm": max(distances),
        "lag_max_s": max(lags),
    }


def obstacle_distance(run: dict[str, Any], scenario: dict[str, Any]) -> float:
    """From the shaft's surface to the nearest ball's [m], of which the shaft is a capsule."""
    tool, least = scenario["instrument"], math.inf
    for ball in scenario.get("obstacles", []):
        for x, tip in zip(run["x"], run["tip"], strict=True):
            mount = tip - tool["length"] * shaft(x)
            way = np.clip((np.array(ball["centre"]) - mount) @ shaft(x), 0.0, tool["length"])
            gap = np.linalg.norm(mount + way * shaft(x) - np.array(ball["centre"]))
            least = min(least, gap - ball["radius"] - tool["radius"])
    return least


def stops(run: dict[str, Any]) -> tuple[int, int]:
    """Rows from which on the reference stands still seen from the trocar, and the trocar does."""
    n = len(run["time"])
    seen = [place(x) - p for x, p in zip(run["x_d"], run["pivot"], strict=True)]
    reference = trocar = n - 1
    while reference and (
        np.linalg.norm(seen[reference - 1] - seen[-1]) < 1e-12
        and turn(run["x_d"][reference - 1], run["x_d"][-1]) < 1e-12
    ):
        reference -= 1
    while trocar and np.linalg.norm(run["pivot"][trocar - 1] - run["pivot"][-1]) < 1e-12:
        trocar -= 1
    return reference, trocar


def errors(run: dict[str, Any], scenario: dict[str, Any]) -> dict[str, float]:
    """rms and 95th percentile while the path lasts, and the largest of all."""
    T = scenario["period"]
    last = last_asked(run, scenario)
    rows = list(zip(run["x"], run["x_d"], run["pivot"], run["tip"], run["tip_d"], strict=True))
    channels: dict[str, list[Any]] = {
        "tip_{}_mm": [1e3 * np.linalg.norm(tip - tip_d) for _, _, _, tip, tip_d in rows],
        "effector_{}_mm": [1e3 * np.linalg.norm(place(x) - place(y)) for x, y, _, _, _ in rows],
        "rcm_{}_mm": [
            1e3 * np.linalg.norm(np.cross(pivot - place(x), shaft(x)))
            for x, _, pivot, _, _ in rows
        ],
        "orientation_{}_mrad": [1e3 * turn(x, y) for x, y, _, _, _ in rows],
    }
    found = {"errors_until_s": run["time"][last], "duration_s": run["time"][-1]}
    for name, values in channels.items():
        asked = values[: last + 1]
        found[name.format("rms")] = math.sqrt(sum(value**2 for value in asked) / (last + 1))
        found[name.format("max")] = max(values)
        found[name.format("p95")] = percentile(asked, 0.95)
    tips = run["tip_d"]
    speeds = [1e3 * np.linalg.norm(tips[k + 1] - tips[k]) / T for k in range(last)]
    found["tip_speed_rms_mm_s"] = math.sqrt(sum(speed**2 for speed in speeds) / last)
    depths = [1e3 * (tip - pivot) @ shaft(x) for x, _, pivot, tip, _ in rows]
    axis = np.array(scenario["trocar"]["axis"])
    tilts: list[float] = [
        math.atan2(np.linalg.norm(np.cross(axis, shaft(x))), axis @ shaft(x)) for x in run["x"]
    ]
    found |= {"depth_min_mm": min(depths), "depth_max_mm": max(depths)}
    return found | {"tilt_max_mrad": 1e3 * max(tilts)}


def limits(run: dict[str, Any], scenario: dict[str, Any]) -> dict[str, float]:
    """Speeds, accelerations and positions against their limits."""
    v, T = run["v"], scenario["period"]
    before = np.vstack([0.0 * v[:1], v[:-1]])
    change = np.abs(v - before)
    has = np.isfinite(run["acceleration_limit"]).any()
    acceleration = (change / T / run["acceleration_limit"]).max() if has else math.nan
    speed = (np.abs(v) / run["velocity_limit"]).max(axis=1)
    loaded = np.maximum(speed, (change / T / run["acceleration_limit"]).max(axis=1))
    earlier = np.vstack([0.0 * v[:1], before[:-1]])
    jerk = np.abs((v - before) - (before - earlier)) / T**2
    has_jerk = np.isfinite(run["jerk_limit"]).any()
    margins = np.minimum(run["angles"] - run["lower"], run["upper"] - run["angles"])
    return {
        "speed_ratio_max": speed.max(),
        "acceleration_ratio_max": acceleration,
        "jerk_ratio_max": (jerk / run["jerk_limit"]).max() if has_jerk else math.nan,
        "saturated_share": sum(value >= 1.0 - 1e-6 for value in loaded) / len(v),
        "limit_margin_min_rad": margins.min(),
        "step_ratio_max": (change / run["velocity_limit"]).max(),
    }


def over_time(run: dict[str, Any], scenario: dict[str, Any]) -> dict[str, float]:
    """Reversals, and how the run comes to rest."""
    v, limit, T, n = run["v"], run["velocity_limit"], scenario["period"], len(run["time"])
    most, cycles = 0, set()
    for joint in range(v.shape[1]):
        in_a_row = 0
        for k in range(1, n):
            now, before = v[k, joint], v[k - 1, joint]
            slow = min(abs(now), abs(before)) <= 0.01 * limit[joint]
            in_a_row = 0 if slow or now * before >= 0.0 else in_a_row + 1
            most = max(most, in_a_row)
            if in_a_row:
                cycles.add(k)
    reference, trocar = stops(run)
    both = max(reference, trocar)
    found = {
        "reversals_in_a_row": most,
        "reversals": len(cycles),
        "swing_ratio_end": math.nan,
        "overshoot_max_mm": math.nan,
        "settling_time_s": math.nan,
        "reference_end_s": math.nan,
    }
    error = run["tip"] - run["tip_d"]
    far = np.linalg.norm(error, axis=1)
    if (n - 1 - reference) * T > 0.1 - 1e-9:
        settled = n
        while settled > reference and far[settled - 1] < 1e-3:
            settled -= 1
        found["settling_time_s"] = math.inf if settled == n else (settled - reference) * T
        found["reference_end_s"] = reference * T
    if (n - 1 - both) * T > 0.1 - 1e-9:
        last = v[max(both, n - 1 - round(1.0 / T)) :]
        found["swing_ratio_end"] = ((last.max(axis=0) - last.min(axis=0)) / limit).max()
        past = away = 0.0
        direction = -error[both] / far[both] if far[both] else np.zeros(3)
        arrived = [k for k in range(both, n) if far[k] < 1e-3]
        for k in range(both, n):
            past = max(past, float(error[k] @ direction))
            if arrived and k >= arrived[0]:
                away = max(away, far[k] - far[arrived[0] : k + 1].min())
        found["overshoot_max_mm"] = 1e3 * max(past, away)
    return found
