"""The filter of a log whose robot and reference err: likelihood of the errors' sizes, information, smoothed
path.

The state is what the pose is off a path, and beside it what passes and what lasts. All of it is linear: the
filter is that of Kalman, its sensitivities those of generalised least squares on all readings together
[Kailath, Sayed, Hassibi: Linear estimation, 2000, chapter 9].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from oed.estimation.methods.log_errors import DRIFT, SECONDS, SIZES
from oed.estimation.methods.smoothing import Passed
from oed.estimation.prediction.log_steps import Stretch
from oed.foundation.arrays import Array
from oed.kernel.dynamics.direct_call import DirectCall

POSE, STATES = 3, 9
"""Entries of the pose, and of the state: pose; ahead, sideways and heading that pass; x, y, heading that
last."""
CHUNK = 50
"""Steps that one call takes."""
STEP = ("onward", "moved", "effect", "amounts", "seconds", "seen", "read", "within", "weights", "direction")


class NormalEquations(NamedTuple):
    """Of a stretch's n unknowns, at given sizes of the errors.

    Attributes:
        square: sum of e'e / s of all innovations by (unknowns, start, 1), (n + 4, n + 4).
        volume: logarithm of the determinant of the innovations' variances.
    """

    square: Array
    volume: float


@dataclass(frozen=True)
class LogFilter:
    """Of one stretch.

    Attributes:
        stretch: its steps.
        columns: which of the unknowns it depends on, n of them.
        quantities: which of x, y and heading are read.
        weights: of what is read, in units of white noise of a deviation of 1, (K, k).
    """

    stretch: Stretch
    columns: tuple[int, ...]
    quantities: tuple[str, ...]
    weights: Array

    def normal_equations(self, logs: Array) -> NormalEquations:
        """At logarithms of sizes (13,)."""
        _, square, volume = self._forward(logs)
        return NormalEquations(square, volume)

    def alone(self, logs: Array) -> tuple[Array, Array]:
        """Square (n + 1, n + 1) of the unknowns and 1 where the start is what fits best, and innovations
        (K, k) in units of their deviations, whatever the unknowns' part in them.
        """
        square, first = self.normal_equations(logs).square, len(self.columns)
        start = slice(first, first + POSE)
        rest = [*range(first), self._width - 1]
        across = square[start][:, rest]
        gain = np.linalg.solve(square[start, start], across)
        passed = self.passed(logs)
        # At the smoothed path the start is off it by what fits best.
        step = np.zeros(self._width)
        step[start], step[-1] = -gain[:, -1], 1.0
        return square[np.ix_(rest, rest)] - across.T @ gain, passed.rows[0] @ step

    def slope(self, logs: Array, by_square: Array) -> Array:
        """Derivative (13,) by the logarithms of what has derivatives `by_square` (n + 4, n + 4) by the square
        of the normal equations, and 1 by their volume.
        """
        before, function, width = self._forward(logs)[0], self._functions[1], self._width
        adjoint, total = (np.zeros((width, STATES)), np.zeros((STATES, STATES))), np.zeros(len(SIZES))
        for states, given in zip(reversed(before), reversed(self._chunks), strict=True):
            found = function(*adjoint, logs, by_square, *(one[::-1] for one in (*states, *given)))
            adjoint = found[0].reshape(width, STATES), found[1].reshape(STATES, STATES)
            total += found[2]
        # What is there before the first reading has sizes, too.
        total += self._begin_slope(logs, adjoint[1])
        return total

    def passed(self, logs: Array) -> Passed:
        """The filter's way along the stretch, for one experiment, in which it goes back."""
        function, width = self._functions[2], self._width
        slopes, spreads, rows, onward, seen = [], [], [], [], []
        state = self._begin(logs)
        count, high = len(self.quantities), self._width
        for given in self._chunks:
            found = function(*state, logs, *given)
            after = found[0].reshape(CHUNK, width, STATES), found[1].reshape(CHUNK, STATES, STATES)
            slopes.append(_delayed(state[0], after[0]).swapaxes(1, 2))
            spreads.append(_delayed(state[1], after[1]))
            state = after[0][-1], after[1][-1]
            rows.append(found[2].reshape(CHUNK, high, count).swapaxes(1, 2))
            onward.append(found[3].reshape(CHUNK, STATES, STATES).swapaxes(1, 2))
            seen.append(found[4].reshape(CHUNK, STATES, count).swapaxes(1, 2))
        steps = len(self.stretch.headings)
        each = (np.concatenate(one)[:steps][None] for one in (slopes, spreads, rows, onward, seen))
        one, two, three, four, five = each
        return Passed(one, two, three, four[:, :-1], five)

    @property
    def _width(self) -> int:
        return len(self.columns) + POSE + 1

    def _forward(self, logs: Array) -> tuple[list[tuple[Array, Array]], Array, float]:
        key = logs.tobytes()
        if key not in self._remembered:
            self._remembered.clear()
            self._remembered[key] = self._followed(logs)
        return self._remembered[key]

    @cached_property
    def _remembered(self) -> dict[bytes, tuple[list[tuple[Array, Array]], Array, float]]:
        # At the last sizes asked for: the states before all steps, and what is summed.
        return {}

    def _followed(self, logs: Array) -> tuple[list[tuple[Array, Array]], Array, float]:
        function, width, state = self._functions[0], self._width, self._begin(logs)
        before, square, volume = [], np.zeros((width, width)), 0.0
        for given in self._chunks:
            found = function(*state, logs, *given)
            after = found[0].reshape(CHUNK, width, STATES), found[1].reshape(CHUNK, STATES, STATES)
            before.append((_delayed(state[0], after[0]), _delayed(state[1], after[1])))
            state = after[0][-1], after[1][-1]
            square += found[2].reshape(width, width)
            volume += float(found[3][0])
        return before, square, volume

    def _begin(self, logs: Array) -> tuple[Array, Array]:
        # Columns of the start, and what there is of errors before the first reading; as rows are columns.
        slopes = np.zeros((self._width, STATES))
        first = len(self.columns)
        slopes[first : first + POSE, :POSE] = np.eye(POSE)
        return slopes, np.diag(_at_begin(logs))

    def _begin_slope(self, logs: Array, by_spread: Array) -> Array:
        found, each = np.zeros(len(SIZES)), 2 * _at_begin(logs) * np.diag(by_spread)
        for place, name in _BEGIN.items():
            found[SIZES.index(name)] += each[place]
        return found

    @property
    def _functions(self) -> tuple[DirectCall, DirectCall, DirectCall]:
        return _chunk(self._width, self.quantities, bool(self.stretch.within.any()))

    @cached_property
    def _chunks(self) -> list[list[Array]]:
        # Numbers of so many steps each, as the functions take them: rows are their columns.
        one = self.stretch
        columns = [*self.columns, one.moved.shape[-1] - 1]
        start = np.zeros(POSE)

        def placed(values: Array) -> Array:
            # Columns of the unknowns, none of the start's, and the last.
            chosen = values[..., columns]
            none = np.broadcast_to(start, (*values.shape[:-1], POSE))
            return np.concatenate([chosen[..., :-1], none, chosen[..., -1:]], axis=-1)

        table = {
            "onward": one.onward,
            "moved": placed(one.moved),
            "effect": one.effect,
            "amounts": one.amounts[:, None, :2].swapaxes(1, 2),
            "seconds": one.amounts[:, 2, None, None],
            "seen": one.seen,
            "read": placed(one.read),
            "within": one.within,
            "weights": self.weights[:, :, None],
            "direction": np.stack([np.cos(one.headings), np.sin(one.headings)], axis=-1)[..., None],
        }
        steps = len(one.headings)
        missing = -steps % CHUNK
        each = {name: np.pad(table[name], [(0, missing), (0, 0), (0, 0)]) for name in STEP}
        # Steps that are none leave all as it is.
        each["onward"][steps:] = np.eye(POSE)
        parts = range(0, steps + missing, CHUNK)
        return [
            [np.ascontiguousarray(each[name][first : first + CHUNK].swapaxes(1, 2)) for name in STEP]
            for first in parts
        ]


_BEGIN = {
    3: "passing_ahead",
    4: "passing_sideways",
    6: "lasting_position",
    7: "lasting_position",
    8: "lasting_heading",
}
"""Sizes of what there is before the first reading, by its place in the state."""


def _delayed(begin: Array, after: Array) -> Array:
    # What is before each step, of what is after it.
    return np.concatenate([begin[None], after[:-1]])


def _at_begin(logs: Array) -> Array:
    found = np.zeros(STATES)
    for place, name in _BEGIN.items():
        found[place] = np.exp(2 * logs[SIZES.index(name)])
    return found


@lru_cache(maxsize=8)
def _chunk(
    width: int, quantities: tuple[str, ...], within: bool
) -> tuple[DirectCall, DirectCall, DirectCall]:
    # (D, P, logarithms of sizes, steps' numbers) -> D and P after each, square, volume; slopes, from the last
    # step to the first; all on the way.
    count = len(quantities)
    step = _step(width, quantities, within)
    slopes, spreads = ca.MX.sym("D", STATES, width), ca.MX.sym("P", STATES, STATES)
    logs = ca.MX.sym("logs", len(SIZES))
    shapes = _shapes(width, count)
    given = [ca.MX.sym(name, shapes[name][0], shapes[name][1] * CHUNK) for name in STEP]
    along = step.mapaccum("along", CHUNK, 2)
    every = along(slopes, spreads, ca.repmat(logs, 1, CHUNK), *given)
    rows = ca.vertcat(*ca.horzsplit(every[2], width))
    inputs = [slopes, spreads, logs, *given]
    forward = ca.Function("forward", inputs, [*every[:2], rows.T @ rows, ca.sum2(every[3])])
    # Of a column of the state: what becomes of it, and of what is read.
    unity = _step(STATES, quantities, within).map(CHUNK)
    before = ca.horzcat(spreads, every[1][:, :-STATES])
    eyes = ca.DM(np.tile(np.eye(STATES), CHUNK))
    nothing = {name: ca.DM.zeros(shapes[name][0], STATES * CHUNK) for name in ("moved", "read")}
    filled = [nothing.get(name, one) for name, one in zip(STEP, given, strict=True)]
    onward, _, seen, _ = unity(eyes, before, ca.repmat(logs, 1, CHUNK), *filled)
    whole = ca.Function("whole", inputs, [*map(ca.densify, (every[0], every[1], every[2], onward, seen))])
    back = _back(width, quantities, within)
    return DirectCall(_dense(forward)), DirectCall(_dense(back)), DirectCall(whole)


def _back(width: int, quantities: tuple[str, ...], within: bool) -> ca.Function:
    # (slopes by D and P after the last step, logarithms, slopes by the square, D and P before steps, steps'
    # numbers) -> slopes by D and P before the first step, and by the logarithms; all from the last step on.
    shapes = _shapes(width, len(quantities))
    given = [ca.MX.sym(name, shapes[name][0], shapes[name][1] * CHUNK) for name in STEP]
    slopes, spreads = ca.MX.sym("D", STATES, width * CHUNK), ca.MX.sym("P", STATES, STATES * CHUNK)
    begin = ca.MX.sym("by_D", STATES, width), ca.MX.sym("by_P", STATES, STATES)
    logs, square = ca.MX.sym("logs", len(SIZES)), ca.MX.sym("by_square", width, width)
    along = _step_back(width, quantities, within).mapaccum("along", CHUNK, 2)
    common = ca.repmat(logs, 1, CHUNK), ca.repmat(square, 1, CHUNK)
    by_slopes, by_spreads, by_logs = along(*begin, *common, slopes, spreads, *given)
    results = [by_slopes[:, -width:], by_spreads[:, -STATES:], ca.sum2(by_logs)]
    return ca.Function("back", [*begin, logs, square, slopes, spreads, *given], results)


@lru_cache(maxsize=8)
def _step_back(width: int, quantities: tuple[str, ...], within: bool) -> ca.Function:
    # Of one step, without what the slopes do not need of the way forward.
    step = _step(width, quantities, within)
    slopes, spread, logs, *given = step.sx_in()
    by_slopes, by_spread = ca.SX.sym("by_D", STATES, width), ca.SX.sym("by_P", STATES, STATES)
    square = ca.SX.sym("by_square", width, width)
    after, covariance, rows, volume = step(slopes, spread, logs, *given)
    total = ca.dot(by_slopes, after) + ca.dot(by_spread, covariance) + ca.dot(square, rows.T @ rows) + volume
    found = [ca.densify(ca.gradient(total, one)) for one in (slopes, spread, logs)]
    return ca.Function("back", [by_slopes, by_spread, logs, square, slopes, spread, *given], ca.cse(found))


def _dense(function: ca.Function) -> ca.Function:
    given = [ca.MX.sym(function.name_in(place), *function.size_in(place)) for place in range(function.n_in())]
    return ca.Function(function.name(), given, [ca.densify(one) for one in function.call(given)])


def _shapes(width: int, count: int) -> dict[str, tuple[int, int]]:
    return {
        "onward": (POSE, POSE),
        "moved": (POSE, width),
        "effect": (POSE, POSE),
        "amounts": (2, 1),
        "seconds": (1, 1),
        "seen": (count, POSE),
        "read": (count, width),
        "within": (count, 2),
        "weights": (count, 1),
        "direction": (2, 1),
    }


@lru_cache(maxsize=8)
def _step(width: int, quantities: tuple[str, ...], within: bool) -> ca.Function:
    # (D, P, logarithms of sizes, a step's numbers) -> D, P at the next one, whitened innovations, log s.
    # Means of readings within a step see its drift: a share of it, and besides what wanders to and fro.
    shapes = _shapes(width, len(quantities))
    begin, spread = ca.SX.sym("D", STATES, width), ca.SX.sym("P", STATES, STATES)
    logs, given = ca.SX.sym("logs", len(SIZES)), {name: ca.SX.sym(name, *shapes[name]) for name in STEP}
    slopes, covariance, rows, volume = begin, _symmetric(spread), [], ca.SX(0)
    if within:
        drift = _drift(logs, given)
        slopes = ca.vertcat(slopes, ca.SX(2 * POSE, width))
        covariance = ca.diagcat(covariance, drift, drift)
    cosine, sine = ca.vertsplit(given["direction"])
    beside = {
        "x": (cosine, -sine, 0, 1, 0, 0),
        "y": (sine, cosine, 0, 0, 1, 0),
        "heading": (0, 0, 1, 0, 0, 1),
    }
    for place, name in enumerate(quantities):
        size = logs[SIZES.index("heading" if name == "heading" else "position")]
        weight = given["weights"][place] / ca.exp(size)
        through = weight * ca.horzcat(given["seen"][place, :], *beside[name])
        if within:
            drifted = weight * given["seen"][place, :] @ given["effect"]
            through = ca.horzcat(through, *(one * drifted for one in ca.horzsplit(given["within"][place, :])))
        gained = covariance @ through.T
        variance = 1 + through @ gained
        root = ca.sqrt(variance)
        white, gain = (through @ slopes + weight * given["read"][place, :]) / root, gained / root
        slopes, covariance = slopes - gain @ white, _symmetric(covariance - gain @ gain.T)
        rows.append(white)
        volume += ca.log(variance) + ca.if_else(given["weights"][place] > 0, 2 * size, 0)
    moved = _moved(slopes, covariance, logs, given)
    results = [*map(ca.densify, (*moved, ca.vertcat(*rows), volume))]
    return ca.Function("step", [begin, spread, logs, *given.values()], [*map(ca.cse, results)])


def _drift(logs: ca.SX, given: dict[str, ca.SX]) -> ca.SX:
    # Variances of the motion's errors in the step.
    ahead, sideways, by_path, by_turning = (ca.exp(2 * logs[SIZES.index(name)]) for name in DRIFT)
    length, turning = ca.vertsplit(given["amounts"])
    return ca.diag(ca.vertcat(ahead * length, sideways * length, by_path * length + by_turning * turning))


def _moved(slopes: ca.SX, covariance: ca.SX, logs: ca.SX, given: dict[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    # After the step, of whose drift the state may have what readings say.
    square = {name: ca.exp(2 * logs[place]) for place, name in enumerate(SIZES)}
    time = {name: ca.exp(logs[SIZES.index(name)]) for name in SECONDS}
    turning = given["amounts"][1]
    passing, lasting = (ca.exp(-given["seconds"] / time[name]) for name in SECONDS)
    left = ca.vertcat(passing, passing, passing, lasting, lasting, lasting)
    onward = ca.diagcat(given["onward"], ca.diag(left))
    stays, lasts = 1 - passing**2, 1 - lasting**2
    added = ca.vertcat(
        stays * square["passing_ahead"],
        stays * square["passing_sideways"],
        square["passing_heading"] * turning,
        lasts * square["lasting_position"],
        lasts * square["lasting_position"],
        lasts * square["lasting_heading"],
    )
    noise = ca.diagcat(ca.SX(POSE, POSE), ca.diag(added))
    effect = ca.vertcat(given["effect"], ca.SX(STATES - POSE, POSE))
    if slopes.shape[0] > STATES:
        onward = ca.horzcat(onward, effect, ca.SX(STATES, POSE))
    else:
        noise += effect @ _drift(logs, given) @ effect.T
    through = ca.vertcat(given["moved"], ca.SX(STATES - POSE, slopes.shape[1]))
    return onward @ slopes + through, _symmetric(onward @ covariance @ onward.T + noise)


def _symmetric(matrix: ca.SX) -> ca.SX:
    # By its upper half, lest rounding bend it; the other one need not be computed.
    return ca.triu2symm(ca.triu(matrix))
