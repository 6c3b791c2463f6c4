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

from oed.estimation.methods.fit import Fit
from oed.estimation.methods.linear_logs import LinearLogs
from oed.estimation.methods.log_errors import NONE, SIZES, WHITE, ErrorSizes
from oed.estimation.methods.log_filter import POSE, LogFilter
from oed.estimation.prediction.layout import FULL_TURN, SegmentLayout, cut
from oed.estimation.prediction.log_steps import LogSteps
from oed.estimation.prediction.logged_readings import LoggedReadings
from oed.estimation.setup.noise import LEAST
from oed.foundation.arrays import Array
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
SHARES = (1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125)
"""Shares of a step that are tried in turn."""
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
class _Iterate:
    # Unknowns (q,), paths of the stretches, and the logs linear about them.
    values: Array
    paths: list[Array]
    linear: LinearLogs


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
        """Return where the search ends, which is never less likely than the fit that it begins from."""
        errors, log_sizes = self._errors, self._errors.guess
        here, is_near, has_arrived = self._iterate(self.fit.values.copy(), self._first_paths), False, False
        hold_clocks = False
        for _ in range(ROUNDS):
            # Sizes hardly depend on where it is linear, and would lead the unknowns to and fro.
            log_sizes = log_sizes if is_near else here.linear.likelier(errors, log_sizes)
            step, covariance = here.linear.step(log_sizes, hold_clocks=hold_clocks)
            change = float((np.abs(step[: len(here.values)]) / np.sqrt(np.diag(covariance))).max())
            here, gain = self._likelier(here, step, log_sizes)
            is_near = is_near or change <= NEAR
            # In a corner of the clocks steps remain that gain next to nothing.
            has_arrived = change <= CLOSE or (change <= NEAR and gain < NEAR**2)
            if change <= CLOSE or (gain == 0 and hold_clocks):
                break
            hold_clocks = hold_clocks or gain == 0
        spread = here.linear.spread(errors, log_sizes)
        degrees, least = here.linear.degrees(log_sizes, spread)
        fit = replace(self._as_fit(here, log_sizes), converged=has_arrived)
        drifts, covariance = here.linear.drifts(errors, log_sizes), here.linear.step(log_sizes)[1]
        return Likeliest(fit, covariance, log_sizes, spread, degrees, least, drifts)

    def _likelier(self, here: _Iterate, step: Array, log_sizes: Array) -> tuple[_Iterate, float]:
        # What the first share of a step that is no less likely leads to, `here` itself if none does; and by
        # how much -2 times the likelihood's logarithm falls.
        before = here.linear.score(self._errors, log_sizes)
        for share in SHARES:
            values = here.values + share * step[: len(here.values)]
            there = self._iterate(values, here.linear.smoothed(log_sizes, share * step, here.paths))
            gain = before - there.linear.score(self._errors, log_sizes)
            if gain > 0:
                return there, gain
        return here, 0.0

    def planned(self, sizes: Mapping[str, float]) -> Array:
        """F^-1 (q, q) where the fit is of a planned drive, under errors of these sizes."""
        logs = self._errors.known(sizes).guess
        return self._iterate(self.fit.values, self._first_paths).linear.step(logs)[1]

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

    def _iterate(self, values: Array, paths: list[Array]) -> _Iterate:
        unknowns, quantities = self.fit.unknowns, self.fit.layout.quantities
        common, filters = range(unknowns.size - unknowns.clocks), []
        for stretch in self._steps.about(values, paths):
            clock = () if stretch.clock < 0 else (len(common) + stretch.clock,)
            filters.append(LogFilter(stretch, (*common, *clock), quantities, np.sqrt(stretch.counts)))
        # At the segments' solution what was known before pulls as hard as all scores together.
        known, moved = self.fit.knowledge, values - self.fit.values
        first = self.fit.scores.sum(axis=0) if np.any(known) else np.zeros_like(moved)
        pull = first + known @ moved
        linear = LinearLogs(tuple(filters), self.fit, known, pull, float(moved @ (first + pull)))
        return _Iterate(values, paths, linear)

    def _as_fit(self, iterate: _Iterate, logs: Array) -> Fit:
        steps, plain = self._steps, self.fit
        values, paths, linear = iterate.values, iterate.paths, iterate.linear
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

    def _alone(self, linear: LinearLogs, logs: Array) -> tuple[Array, Array, Array]:
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
