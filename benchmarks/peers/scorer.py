"""Judges a drive of robot-40 in plain NumPy: exact arcs, derivatives by complex steps, nothing borrowed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from benchmarks.peers import task

Array = npt.NDArray[np.float64]

TINY = 1e-30
"""The complex step, as a share of a coefficient: so small that the derivative has no error but rounding."""


def readings(inputs: npt.ArrayLike, coefficients: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """Poses (READINGS, 3) at the reading times for wheel speeds (INTERVALS, 2) and c11, c12, c21, c22."""
    c11, c12, c21, c22 = np.asarray(coefficients, dtype=complex)
    period, each = task.DURATION / task.READINGS, task.READINGS // task.INTERVALS
    pose, poses = np.zeros(3, dtype=complex), []
    for right, left in np.repeat(np.asarray(inputs, dtype=float), each, axis=0):
        half = (c11 * right + c12 * left) * period / 2
        chord = (c21 * right + c22 * left) * period * _sinc(half)
        course = pose[2] + half
        pose = pose + np.array([chord * np.cos(course), chord * np.sin(course), 2 * half])
        poses.append(pose)
    return np.array(poses)


def information(inputs: npt.ArrayLike) -> Array:
    """Information (4, 4) on the coefficients, relative to their sizes."""
    nominal = np.array(list(task.COEFFICIENTS.values()))
    columns = []
    for index in range(len(nominal)):
        shifted = nominal.astype(complex)
        shifted[index] += 1j * TINY * abs(nominal[index])
        columns.append(readings(inputs, shifted).imag.ravel() / TINY)
    sensitivities = np.stack(columns, axis=1) / task.DEVIATION
    return np.asarray(sensitivities.T @ sensitivities)


def value(criterion: str, inputs: npt.ArrayLike) -> float:
    """The measure of a criterion: log det F (D), tr F^-1 (A) or the smallest eigenvalue of F (E)."""
    matrix = information(inputs)
    if criterion == "D":
        return float(np.linalg.slogdet(matrix)[1])
    eigenvalues = np.linalg.eigvalsh(matrix)
    return float(np.sum(1 / eigenvalues)) if criterion == "A" else float(eigenvalues[0])


def share(criterion: str, found: float) -> float:
    """A value as a share of the best known: 1 is as good.

    Of D the fourth root of det F counts, which is in units of information as the others are.
    """
    best = task.BEST_KNOWN[criterion]
    if criterion == "D":
        return float(np.exp((found - best) / len(task.COEFFICIENTS)))
    return best / found if criterion == "A" else found / best


def excess(inputs: npt.ArrayLike) -> float:
    """How far the wheel speeds leave their bounds [rad/s]; 0 for a drive that keeps them."""
    speeds = np.asarray(inputs, dtype=float)
    if speeds.shape != (task.INTERVALS, 2) or not np.isfinite(speeds).all():
        return np.inf
    return float(max(0.0, -speeds.min(), speeds.max() - task.FASTEST))


def _sinc(angle: complex) -> complex:
    # sin(a)/a, whose series is exact to rounding where the quotient is not.
    if abs(angle) > 1e-3:
        return complex(np.sin(angle) / angle)
    return 1 - angle**2 / 6 + angle**4 / 120
