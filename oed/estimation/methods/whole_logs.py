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
from typing import NamedTuple

import numpy as np
import scipy

from oed.estimation.methods.fit import Fit
from oed.estimation.methods.log_errors import BEYOND_DOUBT, DRIFT, FARTHEST, NONE, SIZES, WHITE, ErrorSizes
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
SUREST = 1e6
"""Degrees of freedom of what is as good as known."""


class Likeliest(NamedTuple):
    """What whole logs say.

    Attributes:
        fit: the solution: its segments are the logs' stretches, its residuals innovations.
        covariance: F^-1 of the unknowns under errors of these sizes, (q, q), SI.
        logs: logarithms of the sizes, by their names.
        spread: covariance of these, (13, 13).
        degrees: of freedom, for how unsure the sizes leave the standard errors.
        drifts: whether drift shows; False where none is likelier beyond doubt, None where logs leave it open.
    """

    fit: Fit
    covariance: Array
    logs: Array
    spread: Array
    degrees: float
    drifts: bool | None

    @property
    def sizes(self) -> dict[str, float]:
        """Sizes of the errors by their names, SI; 0 of none."""
        sizes = np.where(self.logs > NONE, np.exp(self.logs), 0.0)
        return {name: float(one) for name, one in zip(SIZES, sizes, strict=True)}


def whole_flaw(fit: Fit) -> str | None:
    """Why the errors of a fit's logs may not be told apart; None where they may.

    They may of poses that are read whole, of a robot that is moved by its inputs alone.
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
            told = self._about(values, paths)
            # Sizes hardly depend on where it is linear, and would lead the unknowns to and fro.
            logs = logs if near else told.likeliest(errors, logs)
            step, covariance = told.step(logs)
            values = values + step[: len(values)]
            paths = told.smoothed(logs, step, paths)
            change = np.abs(step[: len(values)]) / np.sqrt(np.diag(covariance))
            near, arrived = near or bool(change.max() <= NEAR), bool(change.max() <= CLOSE)
            if arrived:
                break
        last = self._about(values, paths)
        spread = last.spread(errors, logs)
        degrees = last.degrees(logs, spread)
        fit = replace(self._as_fit(last, logs, values, paths), converged=arrived)
        return Likeliest(fit, last.step(logs)[1], logs, spread, degrees, last.drifts(errors, logs))

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

    def _about(self, values: Array, paths: list[Array]) -> _Told:
        unknowns, quantities = self.fit.unknowns, self.fit.layout.quantities
        common, filters = range(unknowns.size - unknowns.clocks), []
        for stretch in self._steps.about(values, paths):
            clock = () if stretch.clock < 0 else (len(common) + stretch.clock,)
            filters.append(LogFilter(stretch, (*common, *clock), quantities, np.sqrt(stretch.counts)))
        # At the segments' solution what was known before pulls as hard as all scores together.
        begun = self.fit
        pull = begun.scores.sum(axis=0) + begun.knowledge @ (values - begun.values)
        none = np.zeros_like(pull)
        return _Told(tuple(filters), begun, begun.knowledge, pull if np.any(begun.knowledge) else none)

    def _as_fit(self, told: _Told, logs: Array, values: Array, paths: list[Array]) -> Fit:
        steps, plain = self._steps, self.fit
        whole, longest = steps.whole, max(map(len, paths))

        def padded(each: Sequence[Array], edge: bool = False) -> Array:
            further = [(0, 0)] * (each[0].ndim - 1)
            return np.stack(
                [
                    np.pad(one, [(0, longest - len(one)), *further], mode="edge" if edge else "constant")
                    for one in each
                ]
            )

        stretches = [one.stretch for one in told.filters]
        counts = padded([one.counts for one in stretches])
        # What is read is the mean of a step's readings, at its begin.
        off = padded([-one.read[..., -1] for one in stretches])
        times = padded([whole.times[row, begins] for row, begins in enumerate(steps.begins)], edge=True)
        path = padded([np.asarray(one) for one in paths], edge=True)
        layout = replace(
            whole,
            times=times,
            readings=off + self._read_of(path, values),
            valid=counts > 0,
            seconds=np.inf,
            averaged=np.maximum(counts, 1.0),
            cut_at=(),
        )
        each = [one.alone(logs) for one in told.filters]
        rates = zip(*steps.rates(values, paths), strict=True)
        speeds, yaw_rates = (padded([np.asarray(one) for one in part]) for part in rates)
        size, sizes = plain.unknowns.size, dict(zip(SIZES, np.exp(logs), strict=True))
        information, scores = np.zeros((len(each), size, size)), np.zeros((len(each), size))
        for row, (one, (square, _)) in enumerate(zip(told.filters, each, strict=True)):
            own = list(one.columns)
            information[row][np.ix_(own, own)] = square[:-1, :-1]
            scores[row, own] = -square[:-1, -1]
        white = padded([-innovations for _, innovations in each])
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

    def _read_of(self, path: Array, values: Array) -> Array:
        # Poses of the sensor where the robot is at poses (S, K, 3).
        place = self.fit.unknowns.parts(values)[1]
        arm = complex(*place[:2]) * np.exp(1j * path[..., 2])
        pose = np.stack([path[..., 0] + arm.real, path[..., 1] + arm.imag, path[..., 2] + place[2]], axis=-1)
        known = dict(zip(("x", "y", "heading"), np.moveaxis(pose, -1, 0), strict=True))
        return np.stack([known[name] for name in self.fit.layout.quantities], axis=-1)


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
class _Told:
    # What all stretches tell, about paths.
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
        matrix, pull = square[:-1, :-1], square[:-1, -1]
        inverse = (
            np.linalg.inv(matrix * self._scale[:, None] * self._scale) * self._scale[:, None] * self._scale
        )
        best = inverse @ pull
        scaled = np.linalg.slogdet(matrix * self._scale[:, None] * self._scale)[1]
        before, slope = errors.surprise(logs)
        value = volume + float(square[-1, -1] - pull @ best) + scaled + before
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
        inverse = np.linalg.inv(square[:-1, :-1] * self._scale[:, None] * self._scale)
        inverse *= self._scale[:, None] * self._scale
        return np.asarray(-inverse @ square[:-1, -1]), np.asarray(inverse[: self.size, : self.size])

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
        return None if 0 < odds < BEYOND_DOUBT else bool(odds <= 0)

    def degrees(self, logs: Array, spread: Array) -> float:
        # Student's, with the kurtosis that errors have whose variance is as unsure as the sizes make it.
        parameters = len(self.fit.unknowns.parameters)
        slopes = np.zeros((len(logs), parameters))
        for place in np.flatnonzero(np.diag(spread)):
            off = np.zeros(len(logs))
            off[place] = STEP
            each = (np.log(np.diag(self.step(logs + way * off)[1])[:parameters]) for way in (1, -1))
            slopes[place] = np.subtract(*each) / (2 * STEP)
        unsure = float(np.einsum("ku,kl,lu->u", slopes, spread, slopes).max(initial=0.0))
        return float(4 + 2 / max(np.expm1(min(unsure, 50.0)), 2 / SUREST))

    def _square(self, logs: Array) -> tuple[Array, float]:
        # Of all unknowns, starts and 1; what is known from before included.
        width = self.size + POSE * len(self.filters) + 1
        total, volume = np.zeros((width, width)), 0.0
        for one, places in zip(self.filters, self._places, strict=True):
            told = one.told(logs)
            total[np.ix_(places, places)] += told.square
            volume += told.volume
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

    @cached_property
    def _scale(self) -> Array:
        # What makes unknowns and starts comparable.
        return np.append(self.fit.unknowns.scale, np.ones(POSE * len(self.filters)))
