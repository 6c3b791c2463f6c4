"""Motions that a sensor read of itself against those of the wheels, one by one and whatever went wrong with
some of them: which are far off, and how far the clocks are apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from oed.estimation.prediction.layout import SegmentLayout, without_turns
from oed.estimation.prediction.logged_readings import LoggedReadings
from oed.estimation.prediction.motion_layout import motion_segments
from oed.estimation.preprocessing.moves import CLEAR, COARSE, FEWEST, FINE, REACH
from oed.estimation.setup.noise import step_of_grid
from oed.estimation.setup.unknowns import PLACE, Unknowns
from oed.foundation.arrays import Array, Bools, Places
from oed.logs.log import Log
from oed.robots.models.model import Model

STRAY = 8.0
"""Robust standard deviations off the wheels' motion from which on one that a sensor read is a stray."""
FINEST = 1e-4
"""Least deviation that strays are judged by [m, rad]."""
ROUNDS, STEPS = 30, 10
"""Of reweighting; of the search for sizes and mounting."""
SETTLED = 1e-6
"""Change of weights that ends reweighting."""
SOME, MORE = 100, 1000
"""Motions that the search for the clocks' offset begins with, and ends with, about."""


class Off(NamedTuple):
    """How far motions are off the wheels'.

    Attributes:
        by: of the heading [rad] and the position [m], (2, m).
        sizes: robust standard deviations of these, (2,).
    """

    by: Array
    sizes: Array

    @classmethod
    def of(cls, turned: Array, moved: Array) -> Off:
        """Of what is left of turns and of moves, (m,)."""
        by = np.abs(np.stack([turned, moved]))
        return cls(by, np.array([_size(one) for one in by]))

    @property
    def steps(self) -> Array:
        """Steps of the grids that headings and positions are off by, (2,), SI; 0 where there is no grid."""
        return np.array([step_of_grid(by) for by in self.by])

    def at_least(self, sizes: Array) -> Off:
        """Return the same with robust standard deviations of at least those, (2,)."""
        return self._replace(sizes=np.maximum(self.sizes, sizes))

    @property
    def strays(self) -> Bools:
        """Which are plainly wrong, (m,)."""
        return np.asarray((self.by > STRAY * self.sizes[:, None]).any(axis=0))


@dataclass(frozen=True)
class MotionComparison:
    """Motions of logs on one clock, and the wheels'.

    Attributes:
        robot: at its nominal parameters.
        layout: the motions, of one file.
    """

    robot: Model
    layout: SegmentLayout

    @classmethod
    def of(cls, robot: Model, logs: Sequence[Log], offset: float) -> MotionComparison:
        """Of one file's logs, of motions during which wheels are logged at the clocks' offset [s]."""
        return cls(robot, motion_segments(logs, [offset] * len(logs)))

    def strays(self, offset: float) -> Bools:
        """Motions (m,) far off the wheels', with any sizes and mounting, at the clocks' offset [s]."""
        begin, plain = self._regressed(self._unknowns.nominal, offset)
        found = self._off(self._fitted(begin, offset), offset)
        best = min(plain, found, key=lambda off: float(off.sizes.prod()))
        return best.at_least(self._off(self._unknowns.nominal, offset).steps).strays

    def offset(self) -> float:
        """What the inputs' clock shows when the poses' shows 0 [s]; 0 where no motion shows it."""
        if self.layout.count < FEWEST:
            return 0.0
        nominal, more = self._unknowns.nominal, self._some(MORE)
        some = more._some(SOME)
        best = some._best(nominal, np.arange(-REACH, REACH + COARSE / 2, COARSE))
        # Sizes and mounting matter less there.
        values = more._fitted(more._regressed(nominal, best)[0], best)
        best = more._best(values, best + np.arange(-COARSE, COARSE + FINE / 2, FINE))
        none = more._fitted(more._regressed(nominal, 0.0)[0], 0.0)
        found, other = (
            more._off(values, best),
            min((more._off(one, 0.0) for one in (none, values)), key=lambda one: float(one.sizes.prod())),
        )
        return best if _left(found, found) < CLEAR * _left(other, found) else 0.0

    def _some(self, most: int) -> MotionComparison:
        # With about so many of the motions, spread over all.
        rows = np.arange(0, self.layout.count, max(1, self.layout.count // most))
        return replace(self, layout=_rows(self.layout, rows))

    def _best(self, values: Array, tried: Array) -> float:
        each = [self._regressed(values, one)[1].sizes for one in tried.tolist()]
        return float(tried[np.argmin([np.prod(one) for one in each])])

    def _regressed(self, values: Array, offset: float) -> tuple[Array, Off]:
        # Unknowns with the mounting that robust regression on the motion by them gives, and what it leaves.
        parameters = len(self.robot.parameters)
        bare = np.concatenate([values[:parameters], np.zeros(len(PLACE))])
        rolled, measured = self._readings(offset)(bare, self._starts(offset, bare))[:, -1], self._measured
        moved, by_wheels = (one[:, 0] + 1j * one[:, 1] for one in (measured, rolled))
        turns = rolled[:, 2] + without_turns(measured[:, 2] - rolled[:, 2], wrapping=np.ones(1, dtype=bool))
        swing = np.exp(1j * measured[:, 2]) - 1
        turned, _ = _left_of(turns, rolled[:, 2:])
        rest, (factor, swung) = _left_of(moved, np.column_stack([by_wheels, swing]))
        arm = swung / factor if factor != 0 else 0j
        place = [arm.real, arm.imag, -np.angle(factor)]
        return np.concatenate([values[:parameters], place]), Off.of(turned, rest)

    def _fitted(self, values: Array, offset: float) -> Array:
        # Robust least squares of sizes and mounting from there.
        readings, scale = self._readings(offset), self._unknowns.scale
        for _ in range(STEPS):
            found, slopes, _ = readings.derivatives(values, self._starts(offset, values))
            left = self._left(found)
            off = Off.of(left[:, 2], left[:, 0] + 1j * left[:, 1])
            weights = 1 / np.sqrt(off.sizes[:, None] ** 2 + off.by**2)
            root = weights[[1, 1, 0]].T
            rows = slopes[:, -1, :, : len(scale)] * root[..., None] * scale
            step = np.linalg.lstsq(rows.reshape(-1, len(scale)), (left * root).ravel(), rcond=1e-9)[0]
            values = values + scale * step
            if float(np.abs(step).max()) < SETTLED:
                break
        return values

    def _off(self, values: Array, offset: float) -> Off:
        left = self._left(self._readings(offset)(values, self._starts(offset, values)))
        return Off.of(left[:, 2], left[:, 0] + 1j * left[:, 1])

    def _left(self, found: Array) -> Array:
        # Of the measured motions, (m, 3).
        return without_turns(self._measured - found[:, -1], np.array([False, False, True]))

    def _readings(self, offset: float) -> LoggedReadings:
        return LoggedReadings.of(self.layout, self._unknowns, np.array([offset]))

    def _starts(self, offset: float, values: Array) -> Array:
        return self._readings(offset).first_starts(values)

    @property
    def _measured(self) -> Array:
        return self.layout.readings[:, -1]

    @cached_property
    def _unknowns(self) -> Unknowns:
        return Unknowns(self.robot, tuple(one.name for one in self.robot.parameters), PLACE, 0)


def _rows(layout: SegmentLayout, rows: Places) -> SegmentLayout:
    # Some of the motions; how sure each is does not matter here.
    assert layout.parts is not None
    return replace(
        layout,
        owner=layout.owner[rows],
        times=layout.times[rows],
        readings=layout.readings[rows],
        valid=layout.valid[rows],
        parts=layout.parts[rows],
        sizes=None,
        whitener=None,
    )


def _left(off: Off, best: Off) -> float:
    # What is left of motions that are no strays at best, of turns times moves; what is far off counts alike.
    most = STRAY * best.sizes[:, None]
    return float((np.minimum(off.by, most)[:, ~best.strays] ** 2).mean(axis=1).clip(FINEST**2).prod())


def _left_of(values: Array, columns: Array) -> tuple[Array, Array]:
    # What robust regression on columns leaves, with Cauchy's weights, and the factors; real or complex.
    weights = np.ones(len(values))
    for _ in range(ROUNDS):
        root = np.sqrt(weights)
        factors = np.linalg.lstsq(columns * root[:, None], values * root, rcond=None)[0]
        left = values - columns @ factors
        before, weights = weights, 1 / (1 + (np.abs(left) / _size(left)) ** 2)
        if float(np.abs(weights - before).max()) < SETTLED:
            break
    return np.asarray(left), np.asarray(factors)


def _size(left: Array) -> float:
    # The robust standard deviation.
    return max(float(np.median(np.abs(left))) / 0.6745, FINEST)
