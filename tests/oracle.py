"""Independent NumPy oracles: plain loops over samples, written from the papers' formulas.

Nothing here uses the package. Arcs come from the turning radius, with a straight-line case of their own.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from scipy.interpolate import BSpline

STRAIGHT = 1e-12
"""Yaw rate [rad/s] below which an arc is driven as a straight line."""
SLIGHT = 1e-4
"""Turn [rad] below which an arc is a series in it."""


def arc_displacement(heading: float, yaw_rate: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacements (2,) of a unit forward and of a unit lateral speed during one period, by the radius."""
    if abs(yaw_rate) < STRAIGHT:
        ahead = period * np.array([math.cos(heading), math.sin(heading)])
    elif abs(turn := period * yaw_rate) < SLIGHT:
        # Differences of nearly the same sines are rounding.
        cosine, sine, along, across = math.cos(heading), math.sin(heading), 1 - turn**2 / 6, turn / 2
        ahead = period * np.array([along * cosine - across * sine, along * sine + across * cosine])
    else:
        end = heading + turn
        ahead = np.array([math.sin(end) - math.sin(heading), math.cos(heading) - math.cos(end)]) / yaw_rate
    return ahead, np.array([-ahead[1], ahead[0]])


def midpoint_displacement(heading: float, yaw_rate: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    """The same by the midpoint heading [Choi, eq. 8]."""
    middle = heading + period * yaw_rate / 2
    ahead = period * np.array([math.cos(middle), math.sin(middle)])
    return ahead, np.array([-ahead[1], ahead[0]])


DISPLACEMENTS = {"arc": arc_displacement, "midpoint": midpoint_displacement}


def advance(pose: Sequence[float], twist: Sequence[float], period: float, rule: str) -> np.ndarray:
    """The next pose (3,) for a body twist (forward, lateral, yaw rate) held for one period."""
    x, y, heading = pose[:3]
    forward, lateral, yaw_rate = twist
    ahead, left = DISPLACEMENTS[rule](heading, yaw_rate, period)
    moved = forward * ahead + lateral * left
    return np.array([x + moved[0], y + moved[1], heading + period * yaw_rate])


def roll_out(twists: np.ndarray, start: Sequence[float], period: float, rule: str) -> np.ndarray:
    """Poses (N + 1, 3) of twists (N, 3) held one period each."""
    poses = [np.array(start[:3], dtype=float)]
    for twist in twists:
        poses.append(advance(poses[-1], twist, period, rule))
    return np.array(poses)


def fine_path(
    twists: np.ndarray, start: Sequence[float], period: float, rule: str, refine: int
) -> np.ndarray:
    """Poses (refine * N + 1, 3): within each period every fraction is driven from the sample's pose."""
    poses = roll_out(twists, start, period, rule)
    path = [poses[0]]
    for pose, twist in zip(poses, twists, strict=False):
        for part in range(1, refine + 1):
            path.append(advance(pose, twist, period * part / refine, rule))
    return np.array(path)


def differential_twist(
    speeds: Sequence[float], radius_right: float, radius_left: float, track: float
) -> np.ndarray:
    """Twist (3,) of two driven wheels [Choi, eqs 2, 4 without slip]."""
    right, left = radius_right * speeds[0], radius_left * speeds[1]
    return np.array([(right + left) / 2, 0.0, (right - left) / track])


def skid_speeds(speeds: Sequence[float], slip_outer: float, slip_inner: float) -> np.ndarray:
    """Speeds (right, left) less slip; the outer side is the one whose wheels turn faster."""
    right_slip, left_slip = (
        (slip_outer, slip_inner) if abs(speeds[0]) > abs(speeds[1]) else (slip_inner, slip_outer)
    )
    return np.array([speeds[0] * (1 - right_slip), speeds[1] * (1 - left_slip)])


def segment_regressors(
    speeds: np.ndarray,
    headings: np.ndarray,
    yaw_rates: np.ndarray,
    period: float,
    edges: Sequence[int],
    rule: str,
) -> tuple[np.ndarray, np.ndarray]:
    """Phi-bar_theta (P, 2) and Phi-bar_xy (2 P, 2) [Choi, eqs 10, 14], with exact chords for arcs.

    Args:
        speeds: as they act on the ground, (N, 2).
        headings: at the start of each period, (N,).
        yaw_rates: in each period, (N,).
        period: sample period T [s].
        edges: sample indices (P + 1,) of the segments' ends.
        rule: "arc" or "midpoint".
    """
    turns, moves = [], []
    for begin, end in pairwise(edges):
        turn, move = np.zeros(2), np.zeros((2, 2))
        for k in range(begin, end):
            ahead, _ = DISPLACEMENTS[rule](headings[k], yaw_rates[k], period)
            turn += period * speeds[k]
            move += np.outer(ahead, speeds[k])
        turns.append(turn)
        moves.append(move)
    return np.array(turns), np.vstack(moves)


def segment_information(
    poses: np.ndarray, edges: Sequence[int], radius: float, track: float
) -> tuple[float, float, float]:
    """F++, F--, F+- of the position regressor from the poses at the segments' ends alone."""
    ends = poses[list(edges)]
    plus = minus = cross = 0.0
    for begin, end in pairwise(ends):
        moved = complex(end[0] - begin[0], end[1] - begin[1])
        chi = (cmath.exp(1j * end[2]) - cmath.exp(1j * begin[2])) / 1j
        plus += 2 / radius**2 * abs(moved) ** 2
        minus += 2 * (track / radius) ** 2 * math.sin((end[2] - begin[2]) / 2) ** 2
        cross += track / radius**2 * (moved.conjugate() * chi).real
    return plus, minus, cross


def central_difference(function: Callable[[np.ndarray], np.ndarray], point: np.ndarray, step: float = 1e-6):
    """Jacobian (outputs, inputs) of `function` at `point` by central differences, of a step times each number
    beyond 1.
    """
    columns = []
    for index in range(len(point)):
        shift, own = np.zeros(len(point)), step * max(1.0, abs(float(point[index])))
        shift[index] = own
        columns.append((np.ravel(function(point + shift)) - np.ravel(function(point - shift))) / (2 * own))
    return np.array(columns).T


def spline_values(trajectory, times: np.ndarray, order: int = 0) -> np.ndarray:
    """Values (order 0) or derivatives of a trajectory's splines at `times`, by SciPy's own B-splines."""
    curve = BSpline(trajectory.knots, trajectory.coefficients, trajectory.degree)
    return curve.derivative(order)(times) if order else curve(times)


def schur(matrix: np.ndarray, kept: int) -> np.ndarray:
    """What is left on the first `kept` rows when the others are unknown too; rows without any information
    are passed over.
    """
    cross, rest = matrix[:kept, kept:], matrix[kept:, kept:]
    sizes = np.sqrt(np.diag(rest))
    sizes = np.where(sizes > 0, sizes, 1.0)
    inverse = np.linalg.pinv(rest / np.outer(sizes, sizes), rcond=1e-10, hermitian=True)
    return matrix[:kept, :kept] - cross / sizes @ inverse @ (cross / sizes).T
