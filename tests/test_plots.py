"""The figures of any run: a moving trocar, several runs of one controller, missing numbers."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import assert_allclose
from mpl_toolkits.mplot3d.art3d import Line3D
from mpl_toolkits.mplot3d.axes3d import Axes3D

from rcmqp import Run, load_scenario, make_controller, plots, simulate
from rcmqp import dualquaternion as dq
from rcmqp.dualquaternion import Array


@pytest.fixture(scope="module")
def moving() -> Run:
    """A view held while the trocar goes to and fro by 2 cm."""
    scenario = load_scenario("trocar_2cm_05hz", "lwa3", duration=3.0, period=0.01)
    return simulate(
        scenario, make_controller("hierarchical_qp", scenario.insertion(), scenario.period)
    )


def drawn(axes: object) -> list[tuple[str, Array]]:
    """Label and points (n, 3) of each line."""
    assert isinstance(axes, Axes3D)
    lines = [line for line in axes.get_lines() if isinstance(line, Line3D)]
    return [(str(line.get_label()), np.column_stack(line.get_data_3d())) for line in lines]


def test_shafts_of_a_moving_trocar_point_as_the_shaft_does(moving: Run) -> None:
    assert np.ptp(moving.pivot, axis=0).max() > 0.015
    lines = drawn(plots.trajectory_figure([moving]).axes[1])
    shafts = [points for label, points in lines if label.startswith("_")]
    rows = np.linspace(0, len(moving.time) - 1, plots.SHAFTS).astype(int)
    start = dq.quaternion_conj(dq.P(moving.x[0]))
    for k, (trocar, tip) in zip(rows, shafts, strict=True):
        z = dq.rotate(start, dq.rotate(dq.P(moving.x[k]), [0.0, 0.0, 1.0]))
        assert np.array_equal(trocar, np.zeros(3))
        assert_allclose(tip, 1e3 * moving.depth[k] * z, rtol=0, atol=0.05)
    curves = {label: points for label, points in lines if not label.startswith("_")}
    for label, points in (("tip", moving.tip), ("desired tip", moving.tip_d)):
        far = np.linalg.norm(points - moving.pivot, axis=1)
        assert_allclose(np.linalg.norm(curves[label], axis=1), 1e3 * far, rtol=0, atol=1e-6)
