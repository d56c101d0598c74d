"""Pivot calibration: where trocar and tip are, from poses of the flange that were recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rcmqp.errors import CalibrationError
from rcmqp.maths.dualquaternion import Array

FEWEST = 6
"""Poses that a calibration needs."""

BLIND = 1e-6
"""Least singular value over the largest, below which a direction is not shown at all."""

WEAK = 0.1
"""The same, below which a direction is shown only weakly: tilts of less than some 8 degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What poses say of a pivot.

    Attributes:
        pivot: (3,) in the world [m].
        covariance: (3, 3) of the pivot [m^2], out of the residuals: the poses' errors are taken
            for independent, of mean zero, and alike in all directions.
        tip: (3,) of a tool whose tip was held on the pivot, in the flange's frame [m]; None where
            the shaft was moved through a trocar.
        tip_covariance: (3, 3) of the tip [m^2]; None likewise.
        residuals: (n,) distance of the tip, or of the shaft's axis, from the pivot [m].
        weak: (3,) unit vector in the world along which the motion shows the pivot only weakly;
            None where it shows it in all directions.
    """

    pivot: Array
    covariance: Array
    tip: Array | None
    tip_covariance: Array | None
    residuals: Array
    weak: Array | None

    @property
    def uncertainty(self) -> float:
        """Standard deviation of the pivot in the direction where it is largest [m]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance)[-1]))

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residuals [m]."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def calibrate_tool(oMf: Sequence[pin.SE3]) -> Calibration:
    """Tip and pivot, of poses of the flange with the tip held on one point.

    The tip t in the flange's frame and the pivot c in the world have R t + p = c in every pose
    (R, p): least squares over the 3 n rows [R, -I] (t, c) = -p.

    Args:
        oMf: placements of the flange in the world.

    Raises:
        CalibrationError: there are too few poses, or they do not show tip and pivot.
    """
    _check_number(oMf)
    A = np.vstack([np.hstack([each.rotation, -np.eye(3)]) for each in oMf])
    b = -np.concatenate([each.translation for each in oMf])
    found, covariance, weak = _least_squares(A, b, 3)
    tip, pivot = found[:3], found[3:]
    ends = np.array([each.act(tip) for each in oMf])
    residuals = np.linalg.norm(ends - pivot, axis=1)
    return Calibration(pivot, covariance[3:, 3:], tip, covariance[:3, :3], residuals, weak)


def calibrate_trocar(oMf: Sequence[pin.SE3]) -> Calibration:
    """The trocar, of poses of the flange with the shaft, its z axis, moved through the trocar.

    The pivot c lies on the shaft in every pose (R, p), at any depth: with the first two rows of
    R^T, R_xy^T (c - p) = 0. Least squares over these 2 n rows.

    Args:
        oMf: placements of the flange in the world, z along the shaft.

    Raises:
        CalibrationError: there are too few poses, or they do not show the trocar.
    """
    _check_number(oMf)
    A = np.vstack([each.rotation[:, :2].T for each in oMf])
    b = np.concatenate([each.rotation[:, :2].T @ each.translation for each in oMf])
    pivot, covariance, weak = _least_squares(A, b, 0)
    seen = np.array([each.actInv(pivot)[:2] for each in oMf])
    return Calibration(pivot, covariance, None, None, np.linalg.norm(seen, axis=1), weak)


def _least_squares(A: Array, b: Array, first: int) -> tuple[Array, Array, Array | None]:
    """Solution, covariance, and the direction of the pivot that is weak.

    Args:
        A: (rows, n).
        b: (rows,).
        first: index of the pivot's first coordinate.
    """
    _, values, directions = np.linalg.svd(A, full_matrices=False)
    worst = directions[-1, first : first + 3]
    worst = worst / max(float(np.linalg.norm(worst)), 1e-12)
    ratio = float(values[-1] / values[0])
    if ratio < BLIND:
        raise CalibrationError(
            f"the motion does not show where the pivot is along {_words(worst)}: {REMEDY}"
        )
    found: Array = np.asarray(np.linalg.lstsq(A, b, rcond=None)[0])
    variance = float(np.sum((A @ found - b) ** 2)) / (len(b) - len(found))
    covariance = np.asarray(variance * np.linalg.inv(A.T @ A), dtype=float)
    return found, covariance, worst if ratio < WEAK else None


REMEDY = "tilt the shaft about two axes, by 20 degrees and more to each side"
"""What to do about a motion that does not show the pivot."""


def weakness(calibration: Calibration) -> str:
    """A sentence where the motion shows the pivot only weakly in a direction; else empty."""
    if calibration.weak is None:
        return ""
    return (
        f"the motion hardly shows where the pivot is along {_words(calibration.weak)}, +-"
        f"{1e3 * calibration.uncertainty:.2g} mm there; {REMEDY}"
    )


def _check_number(oMf: Sequence[pin.SE3]) -> None:
    if len(oMf) < FEWEST:
        raise CalibrationError(f"{len(oMf)} poses are too few; record at least {FEWEST}")


def _words(direction: Array) -> str:
    return f"({', '.join(f'{x + 0.0:.2f}' for x in direction)})"
