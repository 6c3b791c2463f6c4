"""The inputs that make a robot move as asked: speeds, and the steering angles held meanwhile."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.direct_call import DirectCall
from oed.robots.baselines.patterns import Move
from oed.robots.models.model import Model

SPEED_STEPS = 8
"""Newton steps on a move's speeds; without slip the first one is exact."""
BEYOND = 1e3
"""How many times the speeds that would do without slip are the most that are tried."""
SETTLED = 1e-15
"""Share of these that the last step changes speeds by at most: the next would change the rounding alone."""
SLOWER = 12
"""Halvings of a move's speeds after which it counts as impossible."""
SEARCH_STEPS = 40
"""Damped Newton steps for steering angles at most."""
STARTS = 9
"""Steering angles from which a move's is searched, per steered wheel."""
LARGEST_STEP = 0.5
"""Change of a steering angle [rad] in one step of the search."""
FOUND = 1e-9
"""Change of the steering angles [rad] at which they are found."""
MADE = 1e-4
"""Share of a move's speeds by which the inputs found may miss them."""


class Kinematics:
    """The inverse of one robot's twist.

    Attributes:
        drives: places of the inputs that move the robot in proportion.
        steers: places of the others.
        sideways: whether the lateral speed can be chosen freely.
        rows: of the twist (3,) that the inputs choose.
        free: whether speeds alone give any of those.
    """

    def __init__(self, model: Model) -> None:
        """Compile the robot's twist and its derivatives."""
        self.drives = [place for place, entry in enumerate(model.inputs) if entry.drives]
        self.steers = [place for place, entry in enumerate(model.inputs) if not entry.drives]
        self.reach = np.array([min(0.999 * model.inputs[place].below, math.pi) for place in self.steers])
        inputs = ca.SX.sym("inputs", len(model.inputs))
        twist = model.twist(inputs, ca.DM(model.nominal))
        # How much the inputs choose independently shows where they have no symmetries.
        slopes = ca.Function("slopes", [inputs], [ca.densify(ca.jacobian(twist, inputs))])
        typical = np.array(slopes(np.linspace(0.5, 0.9, len(model.inputs))))
        self.sideways = _rank(typical) == 3
        self.rows = [0, 1, 2] if self.sideways else [0, 2]
        self.free = not self.steers and _rank(typical[self.rows]) == len(self.rows)
        twist = ca.vertcat(*(twist[row] for row in self.rows))
        wanted, speeds = ca.SX.sym("wanted", len(self.rows)), ca.SX.sym("speeds", len(self.drives))
        angles = ca.SX.sym("angles", len(self.steers))
        entries = dict(zip(self.drives, ca.vertsplit(speeds), strict=True))
        entries |= dict(zip(self.steers, ca.vertsplit(angles) if self.steers else [], strict=True))
        whole = ca.vertcat(*(entries[place] for place in range(len(model.inputs))))
        residual = ca.substitute(twist, inputs, whole) - wanted
        newton = speeds - ca.pinv(ca.jacobian(residual, speeds)) @ residual
        slope = ca.vec(ca.densify(ca.jacobian(twist, inputs)))
        self._newton = _mapped(ca.Function("newton", [speeds, angles, wanted], [newton]))
        self._twist = _mapped(ca.Function("twist", [inputs], [twist, slope]))

    def wanted(self, moves: Sequence[Move]) -> Array:
        """The parts of the moves (moves, rows) that the robot's inputs choose."""
        columns = np.array([[move.forward, move.sideways, move.turn] for move in moves])
        return columns[:, self.rows]

    def inputs(self, twists: Array, angles: Array) -> Array:
        """Inputs (K, inputs) that give `twists` (K, rows) at steering `angles` (K, steers), by Newton's
        method on the speeds; far too fast ones where a robot that slips can make no such twist.
        """
        shape, step = (len(twists), len(self.drives)), self._newton(len(twists))
        (first,) = step(np.zeros(shape), angles, twists)
        speeds = np.nan_to_num(first.reshape(shape))
        most = BEYOND * np.abs(speeds).max(axis=1, keepdims=True)
        for _ in range(SPEED_STEPS - 1):
            following, before = step(speeds, angles, twists)[0].reshape(shape), speeds
            speeds = np.where(np.isfinite(following), following.clip(-most, most), before)
            if (np.abs(speeds - before) <= SETTLED * most).all():
                # Every further step would end there, too.
                break
        values = np.zeros((len(twists), len(self.drives) + len(self.steers)))
        values[:, self.drives], values[:, self.steers] = speeds, angles
        return values

    def twists(self, speeds: Array, angles: Array) -> Array:
        """Twists (K, rows) of a robot of one driven and one steered wheel, of `speeds` and `angles` (K,)."""
        values = np.zeros((len(speeds), 2))
        values[:, self.drives[0]], values[:, self.steers[0]] = speeds, angles
        return self._linear(values)[0]

    def directions(self, moves: Sequence[Move], bounds: Array) -> tuple[Array, Bools]:
        """Inputs (moves, inputs) that make each move in one second, and whether the robot can make it.

        Steering angles keep to their `bounds` (inputs, 2) where some within them make the move; beyond them
        the move counts as one that the robot can make, except in place, which no size makes easier.
        """
        distinct = list(dict.fromkeys(moves))
        wanted = self.wanted(distinct)
        angles, within = np.zeros((len(distinct), 0)), np.ones(len(distinct), dtype=bool)
        if self.steers:
            angles, within = self._steering(wanted, bounds)
        values, made = self._unhurried(wanted, angles)
        # Slips that hinder Newton's method are no reason to refuse a move.
        made |= self.free & values.any(axis=1) & np.isfinite(self._linear(values)[0]).all(axis=1)
        made &= within | ~np.array([move.in_place for move in distinct])
        made &= np.array([self.sideways or move.sideways == 0 for move in distinct])
        order = [distinct.index(move) for move in moves]
        return values[order], made[order]

    def _unhurried(self, wanted: Array, angles: Array) -> tuple[Array, Bools]:
        # Inputs that make each move in one second, and whether they do. A robot that slips may turn no faster
        # than so: from the fraction of the speed that it can make, as if it slipped no more.
        values = self.inputs(wanted, angles)
        made = self._makes(values, wanted)
        for slower in 0.5 ** np.arange(1, SLOWER + 1):
            left = np.flatnonzero(~made)
            if not len(left):
                break
            found = self.inputs(slower * wanted[left], angles[left])
            made[left] = self._makes(found, slower * wanted[left])
            found[:, self.drives] /= slower
            values[left[made[left]]] = found[made[left]]
        return values, made

    def _makes(self, values: Array, wanted: Array) -> Bools:
        missed = np.abs(self._linear(values)[0] - wanted).max(axis=1)
        return np.asarray(missed <= MADE * np.abs(wanted).max(axis=1))

    def _linear(self, values: Array) -> tuple[Array, Array]:
        # Twists (K, rows) and their derivatives (K, rows, inputs).
        count = len(values)
        twists, slopes = self._twist(count)(values)
        return twists.reshape(count, -1), slopes.reshape(count, values.shape[1], -1).transpose(0, 2, 1)

    def _steering(self, wanted: Array, bounds: Array) -> tuple[Array, Bools]:
        # Angles (moves, steers) that allow each move, within their bounds where possible.
        far = np.stack([-self.reach, self.reach], axis=1)
        near = np.clip(bounds[self.steers], far[:, :1], far[:, 1:])
        angles, found = self._searched(wanted, near, bounds)
        if not found.all():
            others, solved = self._searched(wanted[~found], far, bounds)
            angles[~found] = np.where(solved[:, None], others, angles[~found])
        return angles, found

    def _searched(self, wanted: Array, box: Array, bounds: Array) -> tuple[Array, Bools]:
        # Angles in `box` (steers, 2) by a damped Newton method from many starts, and whether they fit.
        scale = np.abs(wanted).max(axis=1, keepdims=True)
        scale[scale == 0] = 1.0
        starts = _spread(box)
        targets = np.repeat(wanted / scale, len(starts), axis=0)
        values = np.zeros((len(targets), len(bounds)))
        values[:, self.steers] = np.tile(starts, (len(wanted), 1))
        for _ in range(SEARCH_STEPS):
            twists, slopes = self._linear(values)
            step = _damped(slopes, targets - twists)
            step[:, self.steers] = np.clip(step[:, self.steers], -LARGEST_STEP, LARGEST_STEP)
            before = values.copy()
            values += step
            values[:, self.steers] = np.clip(values[:, self.steers], box[:, 0], box[:, 1])
            if np.abs(values - before).max() < FOUND:
                break
        missed = np.abs(self._linear(values)[0] - targets).max(axis=1)
        shape = (len(wanted), len(starts))
        best = self._preferred(values.reshape(*shape, -1), missed.reshape(shape), bounds)
        chosen = np.arange(len(wanted)), best
        return values.reshape(*shape, -1)[chosen][:, self.steers], missed.reshape(shape)[chosen] < MADE

    def _preferred(self, values: Array, missed: Array, bounds: Array) -> Places:
        # For each move: what makes it, drives in no forbidden direction, steers least, drives forwards.
        speeds = values[:, :, self.drives]
        low, high = bounds[self.drives].T
        forbidden = ((speeds < -1e-6) & (low >= 0) | (speeds > 1e-6) & (high <= 0)).sum(axis=2)
        steered = np.round(np.abs(values[:, :, self.steers]).sum(axis=2), 6)
        # Where none makes it, the one that misses least.
        shortfall = np.where(missed < MADE, 0.0, missed)
        return np.lexsort(((speeds < 0).sum(axis=2), steered, forbidden, shortfall), axis=-1)[:, 0]


@lru_cache(maxsize=16)
def kinematics(model: Model) -> Kinematics:
    """The inverse of a robot's twist at its nominal parameters."""
    return Kinematics(model)


def _mapped(function: ca.Function) -> Callable[[int], DirectCall]:
    # For so many moves, or periods, at once.
    return lru_cache(maxsize=64)(lambda count: DirectCall(function.map(count)))


def _rank(matrix: Array) -> int:
    return int(np.linalg.matrix_rank(matrix, tol=1e-6 * np.abs(matrix).max()))


def _spread(box: Array) -> Array:
    # Points (K, steers) in a box: a line for one angle, the same along every angle and drawn for more.
    low, high = box.T
    if len(box) == 1:
        return np.linspace(low, high, STARTS)
    shares = np.random.default_rng(0).uniform(size=(STARTS * len(box), len(box)))
    return np.asarray(low + shares * (high - low))


def _damped(slopes: Array, residual: Array) -> Array:
    # The Newton step (K, inputs), shortened where the derivatives lose rank; no damping at the solution.
    square = slopes @ slopes.transpose(0, 2, 1)
    size = np.trace(square, axis1=1, axis2=2) + 1e-30
    damping = size * (1e-10 + 1e-3 * np.minimum(1.0, (residual**2).sum(axis=1)))
    square += damping[:, None, None] * np.eye(square.shape[1])
    return np.asarray((slopes.transpose(0, 2, 1) @ np.linalg.solve(square, residual[:, :, None]))[:, :, 0])
