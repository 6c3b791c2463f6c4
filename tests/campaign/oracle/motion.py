"""How a robot moves: its pose from its twists, by quadrature and by a fine integration of its own.

All arrays have a first axis of copies: the nominal robot, and one copy for every derivative, displaced by an
imaginary step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from .robots import Robot, Twist

Array = npt.NDArray[Any]

ORDERS = (2, 4, 6, 8, 10, 12)
"""Substeps of the extrapolated midpoint rule: an order of 12."""
PIECE = 0.3
"""Angle [rad] a trailer may turn at most in one extrapolated step."""


@dataclass(frozen=True)
class Motion:
    """A run of all copies.

    Attributes:
        states: x, y, heading, and what follows, each (copies, N + 1).
        asked: what the inputs ask for, in each period, (copies, N).
        mean: the twist that stands for each period, (copies, N).
    """

    states: tuple[Array, ...]
    asked: Twist
    mean: Twist


def drive(
    robot: Robot,
    held: Array,
    start: Sequence[Array],
    p: Sequence[Array],
    period: float,
    rule: str,
    errors: Twist | None = None,
) -> Motion:
    """The run that holds `held` (N, inputs), for start states and parameters (copies, 1); `errors` of the way
    ahead, to the left and of the turn in each period, (copies, N), are even in it.
    """
    asked = robot.asked(held, p)
    copies = np.broadcast(*p, *start).shape[0] if p else len(start[0])
    asked = tuple(np.broadcast_to(one, (copies, len(held))) for one in asked)  # type: ignore[assignment]
    rates = None
    mean = asked
    if robot.lag is not None:
        mean, rates = _lagging(robot, asked, start[3], p, period)
    if errors is not None:
        mean = tuple(one + error / period for one, error in zip(mean, errors, strict=True))  # type: ignore[assignment]
    heading = _summed(start[2], period * mean[2])
    along, across = chords(heading[:, :-1], mean[2], period, rule)
    x = _summed(start[0], mean[0] * along - mean[1] * across)
    y = _summed(start[1], mean[0] * across + mean[1] * along)
    states = (x, y, heading)
    if rates is not None:
        states = (*states, rates)
    elif robot.trailer is not None:
        states = (*states, _trailer_angles(robot, mean, start[3], p, period))
    return Motion(states, asked, mean)


def chords(heading: Array, yaw_rate: Array, period: float, rule: str) -> tuple[Array, Array]:
    """Integrals of cosine and sine of the heading over a period [s]: by Gauss and Legendre for exact arcs, by
    the middle's heading for the midpoint rule [Choi, eq. 8].
    """
    if rule == "midpoint":
        middle = heading + period * yaw_rate / 2
        return period * np.cos(middle), period * np.sin(middle)
    turn = float(np.abs(np.real(yaw_rate)).max(initial=0.0)) * period
    nodes, weights = _gauss(12 + 4 * int(turn / 4) + int(turn))
    angles = heading[..., None] + period * yaw_rate[..., None] * nodes
    return period * (np.cos(angles) @ weights), period * (np.sin(angles) @ weights)


@lru_cache(maxsize=64)
def _gauss(count: int) -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2, weights / 2


def _summed(start: Array, steps: Array) -> Array:
    begun = np.broadcast_to(start, (len(steps), 1))
    return np.concatenate([begun, begun + np.cumsum(steps, axis=1)], axis=1)


def lag_shares(lag: Array, time: Array | float) -> tuple[Array, Array]:
    """Mean and end of e^(-t / tau) over a time."""
    ratio = time / lag
    return -np.expm1(-ratio) / ratio, np.exp(-ratio)


def _lagging(
    robot: Robot, asked: Twist, begun: Array, p: Sequence[Array], period: float
) -> tuple[Twist, Array]:
    # A first-order lag of the yaw rate: exact at the periods' ends, its mean in between.
    assert robot.lag is not None
    assert robot.slides is not None
    share, left = lag_shares(robot.lag(p), period)
    rates = [np.broadcast_to(begun, (len(asked[2]), 1))]
    for k in range(asked[2].shape[1]):
        wanted = asked[2][:, k : k + 1]
        rates.append(wanted + (rates[-1] - wanted) * left)
    all_rates = np.concatenate(rates, axis=1)
    mean = asked[2] + (all_rates[:, :-1] - asked[2]) * share
    return robot.slides(rolled(robot, asked, p), mean, p), all_rates


def rolled(robot: Robot, asked: Twist, p: Sequence[Array]) -> Array:
    """The wheels' mean speed of a robot that slides, without what turning adds to it [m/s]."""
    assert robot.slides is not None
    ahead, _, _ = robot.slides(0.0 * asked[0], asked[2], p)
    return asked[0] - ahead


def trailer_rate(robot: Robot, angle: Array, twist: Twist, p: Sequence[Array]) -> Array:
    """Rate of a trailer's angle [rad/s]: its axle does not slip sideways [Altafini, 2001]."""
    assert robot.trailer is not None
    offset, length = robot.trailer(p)
    speed, _, yaw = twist
    return -yaw - (speed * np.sin(angle) + offset * yaw * np.cos(angle)) / length


def _trailer_angles(robot: Robot, mean: Twist, begun: Array, p: Sequence[Array], period: float) -> Array:
    assert robot.trailer is not None
    offset, length = (float(np.real(one.flat[0])) for one in robot.trailer(p))
    fastest = np.abs(np.real(mean[2][0])) * (1 + abs(offset / length)) + np.abs(np.real(mean[0][0] / length))
    angles = [np.broadcast_to(begun, (len(mean[2]), 1))]
    for k, rate in enumerate(fastest):
        twist: Twist = tuple(one[:, k : k + 1] for one in mean)  # type: ignore[assignment]
        pieces = 1 + int(rate * period / PIECE)
        angle = angles[-1]
        for _ in range(pieces):
            angle = extrapolated(lambda a, t=twist: trailer_rate(robot, a, t, p), angle, period / pieces)
        angles.append(angle)
    return np.concatenate(angles, axis=1)


def extrapolated(rate: Callable[[Array], Array], begun: Array, time: float) -> Array:
    """One step by Gragg's midpoint rule, extrapolated in the square of the substep [Hairer, Norsett, Wanner,
    Solving Ordinary Differential Equations I, II.9].
    """
    table: list[Array] = []
    for row, substeps in enumerate(ORDERS):
        below, step = begun, time / substeps
        now = begun + step * rate(begun)
        for _ in range(substeps - 1):
            below, now = now, below + 2 * step * rate(now)
        fresh = [(below + now + step * rate(now)) / 2]
        for column in range(row):
            ratio = (substeps / ORDERS[row - column - 1]) ** 2
            fresh.append(fresh[column] + (fresh[column] - table[column]) / (ratio - 1))
        table = fresh
    return table[-1]
