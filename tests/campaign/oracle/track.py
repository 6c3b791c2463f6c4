"""Where the nominal robot is at every time of a run, and what it does there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from .motion import drive, lag_shares, rolled, trailer_rate
from .robots import Robot, Twist
from .splines import Run

Array = npt.NDArray[Any]

ROUNDS = 40
"""Times that intervals which may come too close are cut in two."""
CLOSE = 1e-7
"""Share of the way per sample below which a distance is known well enough."""


class Track:
    """A run of a robot at its nominal parameters."""

    def __init__(self, robot: Robot, run: Run, rule: str) -> None:
        self.robot, self.run, self.rule = robot, run, rule
        self._p = [np.array([[value]]) for value in robot.values]
        start = [np.array([[value]]) for value in [*run.start, *[0.0] * (len(robot.states) - 3)]]
        motion = drive(robot, run.held, start, self._p, run.period, rule)
        self.states = np.array([one[0] for one in motion.states])
        self.asked: Twist = tuple(one[0] for one in motion.asked)  # type: ignore[assignment]
        self.mean: Twist = tuple(one[0] for one in motion.mean)  # type: ignore[assignment]

    def places(self, periods: Array, share: Array) -> tuple[Array, Array]:
        """Positions [m] a share of a period after the beginnings of some periods, (K,) each."""
        time = share * self.run.period
        x, y, heading = (self.states[row, periods] for row in range(3))
        forward, lateral, yaw = self._mean_until(periods, time)
        turn = yaw * time
        if self.rule == "midpoint":
            along, across = time * np.cos(heading + turn / 2), time * np.sin(heading + turn / 2)
        else:
            along, across = _arc(heading, yaw, time)
        return x + forward * along - lateral * across, y + forward * across + lateral * along

    def _mean_until(self, periods: Array, time: Array) -> Twist:
        if self.robot.lag is None:
            return tuple(one[periods] for one in self.mean)  # type: ignore[return-value]
        assert self.robot.slides is not None
        asked: Twist = tuple(one[periods] for one in self.asked)  # type: ignore[assignment]
        share, _ = lag_shares(self.robot.lag(self._p)[0, 0], np.maximum(time, 1e-300))
        wanted = asked[2]
        mean = wanted + (self.states[3, periods] - wanted) * share
        return self._slid(asked, mean)

    def _slid(self, asked: Twist, yaw: Array) -> Twist:
        assert self.robot.slides is not None
        flat = [value[0] for value in self._p]
        return self.robot.slides(rolled(self.robot, asked, flat), yaw, flat)

    def lagging(self, points: int) -> Twist:
        """What a robot whose yaw rate lags does, from the beginning to the end of every period."""
        assert self.robot.lag is not None
        periods = np.repeat(np.arange(self.run.samples), points + 1)
        time = np.tile(np.linspace(0.0, self.run.period, points + 1), self.run.samples)
        asked: Twist = tuple(one[periods] for one in self.asked)  # type: ignore[assignment]
        left = np.exp(-time / self.robot.lag(self._p)[0, 0])
        return self._slid(asked, asked[2] + (self.states[3, periods] - asked[2]) * left)

    def trailer(self, points: int) -> Array:
        """The trailer's angles, all periods side by side, by Runge and Kutta's classical rule."""
        flat = [value[0] for value in self._p]
        angle, step = self.states[3, :-1], self.run.period / points
        found = [self.states[3]]
        for _ in range(points - 1):
            slopes = [trailer_rate(self.robot, angle, self.mean, flat)]
            for part in (0.5, 0.5, 1.0):
                slopes.append(trailer_rate(self.robot, angle + part * step * slopes[-1], self.mean, flat))
            angle = angle + step / 6 * (slopes[0] + 2 * slopes[1] + 2 * slopes[2] + slopes[3])
            found.append(angle)
        return np.concatenate(found)

    def least(self, distance: Callable[[Array, Array], Array], points: int, wanted: float) -> float:
        """The least distance along the path, wherever it is below `wanted`; else some larger one.

        A distance changes by no more than the robot moves. Between two points that are d1 and d2 away and a
        way w apart it is at least (d1 + d2 - w) / 2: intervals that may fall below what is known are halved.
        """
        speeds = self._fastest()
        periods = np.repeat(np.arange(self.run.samples), points)
        begin = np.tile(np.arange(points) / points, self.run.samples)
        width, close = 1.0 / points, CLOSE * float(speeds.max(initial=0.0)) * self.run.period
        first, last = distance(*self.places(periods, begin)), distance(*self.places(periods, begin + width))
        least = float(min(first.min(), last.min()))
        if points < 20:
            return least
        for _ in range(ROUNDS):
            lowest = (first + last - speeds[periods] * self.run.period * width) / 2
            open_ = lowest < min(least, wanted) - close
            if not open_.any():
                break
            # The most promising ones, lest a robot that follows a wall costs too much.
            chosen = np.flatnonzero(open_)
            chosen = chosen[np.argsort(lowest[chosen])[:2000]]
            periods, begin, first, last = (one[chosen] for one in (periods, begin, first, last))
            width /= 2
            middle = distance(*self.places(periods, begin + width))
            least = min(least, float(middle.min()))
            periods, begin = np.tile(periods, 2), np.concatenate([begin, begin + width])
            first, last = np.concatenate([first, middle]), np.concatenate([middle, last])
        return least

    def _fastest(self) -> Array:
        # Speeds (N,) that no fraction of a period exceeds: of arcs their own; the midpoint rule and a lag
        # turn the way to a fraction's end as the fraction grows.
        turns = np.abs(self.asked[2]) * self.run.period
        if self.robot.lag is not None:
            turns = turns + np.abs(self.states[3, :-1]) * self.run.period
        elif self.rule == "arc":
            turns = 0.0 * turns
        return np.asarray(np.hypot(self.mean[0], self.mean[1]) * (1 + turns))


def _arc(heading: Array, yaw: Array, time: Array) -> tuple[Array, Array]:
    # By the turning radius, and where that is large by a chord's series.
    turn = yaw * time
    small = np.abs(turn) < 1e-3
    radius = 1 / np.where(small, 1.0, yaw)
    along = radius * (np.sin(heading + turn) - np.sin(heading))
    across = radius * (np.cos(heading) - np.cos(heading + turn))
    chord, middle = time * (1 - turn**2 / 24 + turn**4 / 1920), heading + turn / 2
    return np.where(small, chord * np.cos(middle), along), np.where(small, chord * np.sin(middle), across)
