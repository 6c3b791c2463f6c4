"""The most likely unknowns and paths of whole logs, and the most likely sizes of what errs in them.

About paths, steps and readings are linear: a Kalman filter gives the unknowns, and going back the paths that
are most likely with them. About these it begins anew, an iterated smoother as that of designs is. The sizes
of errors are those of restricted likelihood [Harville: Maximum likelihood approaches to variance component
estimation, 1977], beside what is known of robots in general.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import scipy

from oed.estimation.methods.fit import Fit, combinations, degrees_of
from oed.estimation.methods.log_errors import DRIFT, FARTHEST, NONE, SIZES, WHITE, ErrorSizes, drift_shows
from oed.estimation.methods.log_filter import POSE, LogFilter
from oed.estimation.methods.smoothing import smoothed
from oed.estimation.prediction.layout import FULL_TURN, SegmentLayout, cut
from oed.estimation.prediction.log_steps import LogSteps
from oed.estimation.prediction.logged_readings import LoggedReadings
from oed.estimation.setup.noise import LEAST
from oed.foundation.arrays import Array, Places
from oed.robots.sensors.logged import Noise

READ = ("x", "y", "heading")
"""What poses are made up of."""
MOST = 400
"""Steps of all logs together: of more readings several are taken together."""
ROUNDS = 12
"""How often paths, unknowns and sizes are found in turn at most."""
NEAR, CLOSE = 0.1, 1e-3
"""Change of the unknowns, in standard errors, at which sizes are as good as found, and at which they have
arrived."""
ENOUGH = 0.02
"""Change of -2 times the likelihood's logarithm at which a search for sizes has arrived."""
STEP = 0.05
"""Of logarithms of sizes, for second derivatives of the likelihood."""
LINEAR = 1e-6
"""How much a loss may bend to count as least squares."""


class Likeliest(NamedTuple):
    """What whole logs say.

    Attributes:
        fit: the solution: its segments are the logs' stretches, its residuals off the smoothed path, those in
            units of the noise innovations.
        covariance: F^-1 of the unknowns under errors of these sizes, (q, q), SI.
        logs: logarithms of the sizes, by their names.
        spread: covariance of these, (13, 13).
        degrees: of freedom, for how unsure the sizes leave the standard errors of parameters.
        least_degrees: the same of combinations of them.
        drifts: whether drift shows; False where none is likelier beyond doubt, None where logs leave it open.
    """

    fit: Fit
    covariance: Array
    logs: Array
    spread: Array
    degrees: float
    least_degrees: float
    drifts: bool | None

    @property
    def sizes(self) -> dict[str, float]:
        """Sizes of the errors by their names, SI; 0 of none."""
        sizes = np.where(self.logs > NONE, np.exp(self.logs), 0.0)
        return {name: float(one) for name, one in zip(SIZES, sizes, strict=True)}


def whole_issue(fit: Fit) -> str | None:
    """Why the errors of a fit's logs cannot be separated; None where they may.

    They can of poses that are read whole, of a robot that is moved by its inputs alone.
    """
    layout = fit.layout
    if layout.sensors or layout.relative or set(layout.quantities) != set(READ):
        return f"likelihood is of x, y and heading; the logs hold {', '.join(layout.quantities)}"
    if len(fit.unknowns.system.states) != POSE:
        return f"likelihood is of robots without states beside their pose; {fit.unknowns.robot.kind} has some"
    if abs(fit.bend - 1) + abs(fit.swing - 1) > LINEAR:
        return "likelihood takes every reading for what it is, not a loss that bounds it"
    return "likelihood looks for errors that last itself, not noise: correlated" if fit.correlated else None


@dataclass(frozen=True)
class WholeLogs:
    """The search.

    Attributes:
        fit: to segments, from which it begins.
        errors: what is thought of their sizes; None for what a first look has.
        together: how many readings a step takes together; None for as many as it has to.
    """

    fit: Fit
    errors: ErrorSizes | None = None
    together: int | None = None

    def found(self) -> Likeliest:
        """Where it ends."""
        values, paths, errors = self.fit.values.copy(), self._first_paths, self._errors
        logs, near, arrived = errors.guess.copy(), False, False
        for _ in range(ROUNDS):
            linear = self._about(values, paths)
            # Sizes hardly depend on where it is linear, and would lead the unknowns to and fro.
            logs = logs if near else linear.likeliest(errors, logs)
            step, covariance = linear.step(logs)
            values = values + step[: len(values)]
            paths = linear.smoothed(logs, step, paths)
            change = np.abs(step[: len(values)]) / np.sqrt(np.diag(covariance))
            near, arrived = near or bool(change.max() <= NEAR), bool(change.max() <= CLOSE)
            if arrived:
                break
        last = self._about(values, paths)
        spread = last.spread(errors, logs)
        degrees, least = last.degrees(logs, spread)
        fit = replace(self._as_fit(last, logs, values, paths), converged=arrived)
        drifts = last.drifts(errors, logs)
        return Likeliest(fit, last.step(logs)[1], logs, spread, degrees, least, drifts)

    def planned(self, sizes: Mapping[str, float]) -> Array:
        """F^-1 (q, q) where the fit is of a planned drive, under errors of these sizes."""
        logs = self._errors.known(sizes).guess
        return self._about(self.fit.values, self._first_paths).step(logs)[1]

    @cached_property
    def _errors(self) -> ErrorSizes:
        if self.errors is not None:
            return self.errors
        noises = self.fit.noises
        white = {name: max(noises[name].at_rest, LEAST) for name in WHITE}
        times = self._steps.whole.times
        return ErrorSizes.of(white, float((times[:, -1] - times[:, 0]).max()))

    @cached_property
    def _steps(self) -> LogSteps:
        fit = self.fit
        layout = cut(fit.layout.logs, np.inf, fit.clocks_of(fit.layout.logs))
        count = self.together or max(1, -(-int(layout.last.sum()) // MOST))
        return LogSteps(layout, count, fit.unknowns, fit.offsets)

    @cached_property
    def _first_paths(self) -> list[Array]:
        # As the segments have them.
        fit, steps = self.fit, self._steps
        readings = LoggedReadings.of(fit.layout, fit.unknowns, fit.offsets)
        known = _continued(fit.layout, readings.path(fit.values, fit.starts)[..., :POSE])
        found = []
        for row, begins in enumerate(steps.begins):
            own = fit.layout.owner == steps.whole.owner[row]
            times, first = np.unique(fit.layout.times[own], return_index=True)
            poses = known[own].reshape(-1, POSE)[first]
            at = steps.whole.times[row, begins]
            found.append(np.column_stack([np.interp(at, times, column) for column in poses.T]))
        return found

    def _about(self, values: Array, paths: list[Array]) -> _Linear:
        unknowns, quantities = self.fit.unknowns, self.fit.layout.quantities
        common, filters = range(unknowns.size - unknowns.clocks), []
        for stretch in self._steps.about(values, paths):
            clock = () if stretch.clock < 0 else (len(common) + stretch.clock,)
            filters.append(LogFilter(stretch, (*common, *clock), quantities, np.sqrt(stretch.counts)))
        # At the segments' solution what was known before pulls as hard as all scores together.
        begun = self.fit
        pull = begun.scores.sum(axis=0) + begun.knowledge @ (values - begun.values)
        none = np.zeros_like(pull)
        return _Linear(tuple(filters), begun, begun.knowledge, pull if np.any(begun.knowledge) else none)

    def _as_fit(self, linear: _Linear, logs: Array, values: Array, paths: list[Array]) -> Fit:
        steps, plain = self._steps, self.fit
        whole = steps.whole
        stretches = [one.stretch for one in linear.filters]
        counts = _padded([one.counts for one in stretches])
        # What is read is the mean of a step's readings, at its begin.
        off = _padded([-one.read[..., -1] for one in stretches])
        times = _padded([whole.times[row, begins] for row, begins in enumerate(steps.begins)], edge=True)
        path = _padded([np.asarray(one) for one in paths], edge=True)
        layout = replace(
            whole,
            times=times,
            readings=off + self._read_of(path, values),
            valid=counts > 0,
            seconds=np.inf,
            averaged=np.maximum(counts, 1.0),
            cut_at=(),
        )
        information, scores, white = self._alone(linear, logs)
        rates = zip(*steps.rates(values, paths), strict=True)
        speeds, yaw_rates = (_padded([np.asarray(one) for one in part]) for part in rates)
        sizes = dict(zip(SIZES, np.exp(logs), strict=True))
        return replace(
            plain,
            values=values,
            starts=np.stack([one[0] for one in paths]),
            layout=layout,
            residuals=off,
            white=white,
            weights=np.ones(white.shape),
            redundancy=(counts > 0).astype(float),
            noises={name: Noise(float(sizes[name])) for name in WHITE},
            speeds=speeds,
            yaw_rates=yaw_rates,
            information=information,
            scores=scores,
            bend=1.0,
            swing=1.0,
            by_start=None,
            by_errors=None,
            innovations=True,
        )

    def _alone(self, linear: _Linear, logs: Array) -> tuple[Array, Array, Array]:
        # Of each stretch by itself: information (S, n, n), scores (S, n), and innovations over their errors.
        each, size = [one.alone(logs) for one in linear.filters], self.fit.unknowns.size
        information, scores = np.zeros((len(each), size, size)), np.zeros((len(each), size))
        for row, (one, (square, _)) in enumerate(zip(linear.filters, each, strict=True)):
            own = list(one.columns)
            information[row][np.ix_(own, own)] = square[:-1, :-1]
            scores[row, own] = -square[:-1, -1]
        return information, scores, _padded([-innovations for _, innovations in each])

    def _read_of(self, path: Array, values: Array) -> Array:
        # Poses of the sensor where the robot is at poses (S, K, 3).
        place = self.fit.unknowns.parts(values)[1]
        arm = complex(*place[:2]) * np.exp(1j * path[..., 2])
        pose = np.stack([path[..., 0] + arm.real, path[..., 1] + arm.imag, path[..., 2] + place[2]], axis=-1)
        known = dict(zip(READ, np.moveaxis(pose, -1, 0), strict=True))
        return np.stack([known[name] for name in self.fit.layout.quantities], axis=-1)


def _padded(each: Sequence[Array], edge: bool = False) -> Array:
    # Stretches of equal length, filled up with 0, or with what they end with.
    longest = max(map(len, each))
    filled = [[(0, longest - len(one)), *[(0, 0)] * (one.ndim - 1)] for one in each]
    mode: Literal["edge", "constant"] = "edge" if edge else "constant"
    return np.stack([np.pad(one, widths, mode=mode) for one, widths in zip(each, filled, strict=True)])


def _continued(layout: SegmentLayout, paths: Array) -> Array:
    # Paths (S, n + 1, 3) of segments with the headings at which those before end, where these are the same:
    # within a segment a robot may turn by more than half a turn between times.
    found = paths.copy()
    for row in range(1, layout.count):
        end = layout.last[row - 1]
        if layout.owner[row] == layout.owner[row - 1] and layout.times[row, 0] == layout.times[row - 1, end]:
            turns = (found[row - 1, end, 2] - found[row, 0, 2]) / FULL_TURN
            found[row, :, 2] += FULL_TURN * np.rint(turns)
    return found


@dataclass(frozen=True)
class _Linear:
    # All stretches, linear about paths.
    filters: tuple[LogFilter, ...]
    fit: Fit
    known: Array
    pull: Array

    @property
    def size(self) -> int:
        return len(self.pull)

    def likeliest(self, errors: ErrorSizes, begin: Array) -> Array:
        # Logarithms of sizes.
        free = np.flatnonzero(errors.free)
        if not len(free):
            return begin

        def surprise(some: Array) -> tuple[float, Array]:
            logs = begin.copy()
            logs[free] = some
            value, slope = self.surprise(errors, logs)
            return value, slope[free]

        bounds = np.column_stack([errors.guess - FARTHEST, errors.guess + FARTHEST])[free]
        options = {"maxiter": 100, "ftol": ENOUGH / max(abs(surprise(begin[free])[0]), 1.0)}
        found = scipy.optimize.minimize(
            surprise, begin[free], jac=True, method="L-BFGS-B", bounds=bounds, options=options
        )
        logs = begin.copy()
        logs[free] = found.x
        return logs

    def surprise(self, errors: ErrorSizes, logs: Array) -> tuple[float, Array]:
        # Twice the negative logarithm of the restricted likelihood, but for a constant, and its slope.
        square, volume = self._square(logs)
        inverse, more = self._inverse(square)
        pull = square[:-1, -1]
        best = inverse @ pull
        before, slope = errors.surprise(logs)
        value = volume + more + float(square[-1, -1] - pull @ best) + before
        by_square = np.zeros_like(square)
        by_square[:-1, :-1] = inverse + np.outer(best, best)
        by_square[:-1, -1] = by_square[-1, :-1] = -best
        by_square[-1, -1] = 1.0
        for one, places in zip(self.filters, self._places, strict=True):
            slope = slope + one.slope(logs, by_square[np.ix_(places, places)])
        return value, slope

    def step(self, logs: Array) -> tuple[Array, Array]:
        # Of the unknowns and all starts; and the covariance of the unknowns.
        square, _ = self._square(logs)
        inverse, _ = self._inverse(square)
        return np.asarray(-inverse @ square[:-1, -1]), inverse[: self.size, : self.size]

    def _inverse(self, square: Array) -> tuple[Array, float]:
        # Of the normal matrix, in units in which unknowns and starts compare; and the logarithm of its
        # determinant in these.
        units = np.append(self.fit.unknowns.scale, np.ones(POSE * len(self.filters)))
        scale = np.outer(units, units)
        scaled = square[:-1, :-1] * scale
        return np.linalg.inv(scaled) * scale, float(np.linalg.slogdet(scaled)[1])

    def smoothed(self, logs: Array, step: Array, paths: Sequence[Array]) -> list[Array]:
        found, whole = [], np.append(step, 1.0)
        for one, places, path in zip(self.filters, self._places, paths, strict=True):
            found.append(path + smoothed(one.passed(logs), whole[places][None])[0, :, :POSE])
        return found

    def spread(self, errors: ErrorSizes, logs: Array) -> Array:
        # Covariance of the logarithms, by differences of slopes.
        free = np.flatnonzero(errors.free)
        found = np.zeros((len(logs),) * 2)
        if not len(free):
            return found
        second, here = np.empty((len(free), len(free))), self.surprise(errors, logs)[1][free]
        for column, place in enumerate(free):
            off = np.zeros(len(logs))
            off[place] = STEP
            second[:, column] = (self.surprise(errors, logs + off)[1][free] - here) / STEP
        # Of twice the logarithm; never surer than the prior alone would be of what curves the wrong way.
        values, vectors = np.linalg.eigh((second + second.T) / 4)
        least = 1 / errors.spread[free].max() ** 2
        inverse = (vectors / np.maximum(values, least)) @ vectors.T
        found[np.ix_(free, free)] = inverse
        return found

    def drifts(self, errors: ErrorSizes, logs: Array) -> bool | None:
        # Against the most likely sizes of all else without it.
        places = [SIZES.index(name) for name in DRIFT]
        if not np.any(errors.free[places]):
            return None
        none = errors.without(DRIFT)
        begin = np.where(none.free, logs, none.guess)
        odds = self.surprise(errors, logs)[0] - self.surprise(none, self.likeliest(none, begin))[0]
        return drift_shows(odds)

    def degrees(self, logs: Array, spread: Array) -> tuple[float, float]:
        # Of intervals, by how unsure the sizes leave the variances: of parameters, of combinations of them.
        own = slice(len(self.fit.unknowns.parameters))
        ways = np.hstack([np.eye(own.stop), combinations(self.step(logs)[1][own, own])])
        slopes = np.zeros((len(logs), ways.shape[1]))
        for place in np.flatnonzero(np.diag(spread)):
            off = np.zeros(len(logs))
            off[place] = STEP
            each = (self.step(logs + way * off)[1][own, own] for way in (1, -1))
            sizes = [np.log(np.einsum("au,ab,bu->u", ways, one, ways)) for one in each]
            slopes[place] = np.subtract(*sizes) / (2 * STEP)
        unsure = np.einsum("ku,kl,lu->u", slopes, spread, slopes)
        return degrees_of(unsure[own].max(initial=0.0)), degrees_of(unsure.max(initial=0.0))

    def _square(self, logs: Array) -> tuple[Array, float]:
        # Of all unknowns, starts and 1; what is known from before included.
        width = self.size + POSE * len(self.filters) + 1
        total, volume = np.zeros((width, width)), 0.0
        for one, places in zip(self.filters, self._places, strict=True):
            equations = one.normal_equations(logs)
            total[np.ix_(places, places)] += equations.square
            volume += equations.volume
        total[: self.size, : self.size] += self.known
        total[: self.size, -1] += self.pull
        total[-1, : self.size] += self.pull
        return total, volume

    @cached_property
    def _places(self) -> list[Places]:
        found = []
        for number, one in enumerate(self.filters):
            first = self.size + POSE * number
            last = self.size + POSE * len(self.filters)
            found.append(np.array([*one.columns, *range(first, first + POSE), last]))
        return found
