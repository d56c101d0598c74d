"""Promises of every controller from the literature."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose, inserted, shaft_distance
from literal_laws import PERIOD, follow, helix, made, on_each_arm, quick_helix, stacked

from rcmqp import ViewCommand, compute_metrics, view_pose
from rcmqp.controllers import TaskPriority
from rcmqp.controllers.task_priority import TaskReconstruction
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths import dualquaternion as dq

BASELINES = [
    "pose_error",
    "damped",
    "task_priority",
    "task_reconstruction",
    "aghakhani",
    "vfi_qp",
]


VARIANTS: list[tuple[str, dict[str, Any]]] = [
    *((name, {"feed_forward": True}) for name in BASELINES),
    ("task_priority", {"K_c": 7.0}),
    ("task_priority", {"reconstruct_from": 20.0, "escape": 1e-3}),
    ("task_reconstruction", {"reconstruct_from": 20.0, "escape": 1e-3}),
    ("task_priority", {"rcm_gain": 0.0}),
    ("aghakhani", {"rcm_first": True}),
    ("aghakhani", {"reproject": True}),
    ("aghakhani", {"lambda_gain": 5.0}),
    ("vfi_qp", {"velocity_limits": True}),
    ("vfi_qp", {"solver": "daqp"}),
    ("vfi_qp", {"damping": 0.01, "d_safe": 1e-4}),
    ("vfi_qp", {"gain": 10.0, "damping": 0.01, "joint_gain": 1.0}),  # as its authors' code
]


each_baseline = pytest.mark.parametrize("name", BASELINES)
each_variant = pytest.mark.parametrize(
    ("name", "options"),
    VARIANTS,
    ids=[f"{name}-{'-'.join(options)}" for name, options in VARIANTS],
)


@each_baseline
@on_each_arm
def test_on_the_helix_the_tip_lags_by_speed_over_gain_and_the_rcm_is_kept(
    name: str, arm: str
) -> None:
    metrics = compute_metrics(helix(name, arm))
    assert_allclose(metrics.tip_rms_mm, metrics.tip_speed_rms_mm_s / 60.0, rtol=0.01)
    assert 0.32 < metrics.tip_rms_mm < 0.35
    assert metrics.rcm_max_mm < (0.03 if name == "vfi_qp" else 0.003)
    assert metrics.speed_ratio_max < 1.0
    assert metrics.limit_margin_min_rad > 0.0
    if name == "vfi_qp":
        assert helix(name, arm).diagnostics["safe_stop"].max() == 0.0


@each_baseline
def test_feed_forward_takes_the_lag_away(name: str) -> None:
    metrics = compute_metrics(helix(name, "ur5", feed_forward=True))
    assert metrics.tip_rms_mm < 0.004
    assert metrics.rcm_max_mm < (0.03 if name == "vfi_qp" else 0.003)


@each_baseline
def test_a_breathing_trocar_is_followed_where_its_velocity_is_known(name: str) -> None:
    """1 cm at 0.5 Hz: without the velocity, each law lags by 31 mm/s over K, 0.5 mm."""
    insertion, T, w = inserted("ur5"), 4e-3, math.pi
    across, references = dq.rotate(dq.P(insertion.x_rcm), np.array([0.6, 0.8, 0.0])), []
    for t in T * np.arange(500):
        offset = 0.01 * math.sin(w * t) * across
        x_rcm = dq.mul(dq.from_translation(offset), insertion.x_rcm)
        velocity = 0.01 * w * math.cos(w * t) * across
        references.append(view_pose(x_rcm, ViewCommand(), velocity))

    def worst(feed_forward: bool) -> float:
        law = made(name, insertion, T, feed_forward=feed_forward)
        states, _ = follow(law, references)
        pairs = list(zip(states, references, strict=True))[100:]
        return max(shaft_distance(state.oMe, reference.pivot) for state, reference in pairs)

    assert 4.5e-4 < worst(False) < 5.5e-4
    assert worst(True) < 1e-5


# Promises of every variant -----------------------------------------------------------------


@each_variant
@on_each_arm
def test_variants_are_finite_and_rerun_to_the_bit(
    name: str, options: dict[str, Any], arm: str
) -> None:
    insertion = inserted(arm)
    law, references = made(name, insertion, **options), quick_helix(insertion)
    _, answers = follow(law, references)
    law.reset()
    _, again = follow(law, references)
    _, fresh = follow(made(name, insertion, **options), references)
    for one, two, three in zip(answers, again, fresh, strict=True):
        assert np.isfinite(one.v).all()
        assert all(math.isfinite(value) for value in one.diagnostics.values())
        assert np.array_equal(one.v, two.v)
        assert np.array_equal(one.v, three.v)
        assert one.diagnostics == two.diagnostics == three.diagnostics
        assert one.diagnostics.keys() == answers[0].diagnostics.keys()


@each_variant
def test_variants_take_minus_x_d_for_x_d_and_share_no_memory(
    name: str, options: dict[str, Any]
) -> None:
    insertion = inserted("lwa3")
    references = quick_helix(insertion)
    negative = [dataclasses.replace(r, x_d=-r.x_d, x_d_dot=-r.x_d_dot) for r in references]
    states, answers = follow(made(name, insertion, **options), references)
    _, other = follow(made(name, insertion, **options), negative)
    for one, two in zip(answers, other, strict=True):
        assert_allclose(one.v, two.v, rtol=0, atol=1e-12)
    for before, after in itertools.pairwise(answers):
        assert not np.shares_memory(before.v, after.v)
    for state, reference, answer in zip(states, references, answers, strict=True):
        given = (state.q, state.angles, state.x, state.J_local, insertion.arm.velocity)
        mine = (reference.x_d, reference.x_d_dot, reference.pivot, reference.pivot_dot)
        assert not any(np.shares_memory(answer.v, array) for array in (*given, *mine))


# Refusals ----------------------------------------------------------------------------------


@each_baseline
@pytest.mark.parametrize("gain", [0.0, -1.0, 250.0, math.nan, math.inf])
def test_an_unstable_gain_is_refused_with_the_number(name: str, gain: float) -> None:
    if 0.0 < gain < math.inf:
        message = rf"= {gain * PERIOD:.3g}, it must be below 2, or the law is unstable"
    else:
        message = f"gain = {gain} 1/s, it must be positive and finite"
    with pytest.raises(OptionError, match=message):
        made(name, inserted("lwa3"), gain=gain)


BAD_OPTIONS: Sequence[tuple[str, str, float]] = [
    ("pose_error", "tolerance", 0.0),
    ("pose_error", "tolerance", 1.0),
    ("damped", "lambda_max", 0.0),
    ("damped", "epsilon", -1.0),
    ("damped", "beta", 0.0),
    ("damped", "beta", math.nan),
    ("task_priority", "rcm_gain", -1.0),
    ("task_priority", "rcm_gain", math.nan),
    ("task_priority", "tolerance", math.nan),
    ("task_priority", "K_c", -1.0),
    ("task_priority", "c_d", math.inf),
    ("task_priority", "reconstruct_from", math.inf),
    ("task_priority", "reconstruct_full", 1.0),
    ("task_priority", "escape", -1.0),
    ("aghakhani", "rcm_gain", 0.0),
    ("aghakhani", "lambda_gain", 300.0),
    ("aghakhani", "lambda_rest", 2.0),
    ("aghakhani", "tolerance", 0.0),
    ("vfi_qp", "alpha", 0.0),
    ("vfi_qp", "alpha", 1.0),
    ("vfi_qp", "damping", 0.0),
    ("vfi_qp", "d_safe", math.inf),
    ("vfi_qp", "vfi_gain", 0.0),
    ("vfi_qp", "vfi_gain", 126.0),
    ("vfi_qp", "joint_gain", -1.0),
    ("vfi_qp", "joint_gain", 126.0),
]


@pytest.mark.parametrize(("name", "option", "value"), BAD_OPTIONS)
def test_an_option_out_of_range_is_refused_by_its_name(
    name: str, option: str, value: float
) -> None:
    with pytest.raises(OptionError, match=rf"\b{option}( \* period)? = {value}"):
        made(name, inserted("lwa3"), **{option: value})


@pytest.mark.parametrize(
    ("name", "option", "value", "hint"),
    [
        ("vfi_qp", "solver", "proxpq", "did you mean proxqp"),
        ("task_priority", "objective", "manipulabilty", "did you mean manipulability"),
    ],
)
def test_an_unknown_name_is_answered_with_the_nearest(
    name: str, option: str, value: str, hint: str
) -> None:
    with pytest.raises(UnknownName, match=hint):
        made(name, inserted("lwa3"), **{option: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("numbers", [(1.0, 1.0), (1.0, 0.0), (1.0, 2.0), (math.nan, 0.5)])
def test_thresholds_in_the_wrong_order_are_refused(numbers: tuple[float, float]) -> None:
    with pytest.raises(
        OptionError, match=r"m_1 = nan|m_2 = .*it must be (positive|below m_1 = 1.0)"
    ):
        TaskReconstruction(*numbers)


def test_reconstructions_thresholds_are_shares_of_the_start() -> None:
    insertion = inserted("lwa3")
    law = made("task_priority", insertion, reconstruct_from=0.4, reconstruct_full=0.25)
    assert isinstance(law, TaskPriority)
    kim = law._reconstruction
    assert kim is not None
    state = insertion.state(insertion.q_start)
    J = stacked(insertion, state, np.array(insertion.trocar.pivot))
    m = math.sqrt(np.linalg.det(J @ J.T))
    assert_allclose([kim.m_1, kim.m_2], [0.4 * m, 0.1 * m], rtol=1e-9)
