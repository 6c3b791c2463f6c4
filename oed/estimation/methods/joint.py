"""Joint nonlinear least squares over segments: parameters, sensor's place, clocks, every start.

Each segment's start is eliminated by projection, so that a step costs in proportion to their number only.
Of a designed drive, of whose starts something may be known, they are unknowns like others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from oed.estimation.methods.fit import Fit
from oed.estimation.methods.gauss_markov import GaussMarkov
from oed.estimation.methods.gauss_newton import (
    FLAT,
    Found,
    LeastSquares,
    Rows,
    loss_moments,
    projected,
    robust_loss,
)
from oed.estimation.prediction.drive_readings import DriveReadings
from oed.estimation.prediction.layout import SegmentLayout, without_turns
from oed.estimation.prediction.logged_readings import POSE, LoggedReadings
from oed.estimation.setup.noise import (
    LEAST,
    estimated,
    group_of,
    groups,
    jumps,
    of_readings,
    places_of,
    sensor_noise,
    step_of_grid,
)
from oed.estimation.setup.options import Loss
from oed.estimation.setup.unknowns import Knowledge, Unknowns, inverse_of_sum
from oed.foundation.arrays import Array
from oed.kernel.measurement.square_root import SquareRoot
from oed.robots.sensors.logged import Noise

CLOSE = 1e-6
"""Change of the unknowns, in units of their size, at which the search has arrived."""
EXACT = 1e-12
"""The same where readings are simulated, to judge errors by."""
ROUGH = 0.01
"""Noise that the search begins with [m, rad]."""


@dataclass(frozen=True)
class _Linearised:
    # Readings less their prediction (S, K, k), derivatives of the prediction by the unknowns (S, K, k, q) and
    # by the segments' own starts (S, K, k, c), SI.

    residuals: Array
    slopes: Array
    own: Array
    moving: Callable[[], tuple[Array, Array]]

    @cached_property
    def rates(self) -> tuple[Array, Array]:
        # Speeds and yaw rates at logged readings, (S, K), which few noises depend on.
        return self.moving()


class _Left(NamedTuple):
    # What least squares would leave: residuals in units of the noise, their weights with the roots of these
    # (S, K, k), bend and swing of the loss; weighted rows less what the starts explain (S, m, q), rows by the
    # starts (S, m, c), information by segment (S, q, q), redundancy (S, K, k).

    white: Array
    weights: Array
    root: Array
    bend: float
    swing: float
    rows: Array
    own: Array
    information: Array
    redundancy: Array


@dataclass(frozen=True)
class JointSearch:
    """The search for the least squares.

    Attributes:
        layout: the segments.
        unknowns: what to estimate.
        offsets: of the clocks, as far as known, (clocks,) [s].
        known: of the unknowns from before.
        loss: of a residual in units of the noise.
        grows: whether noise may grow with speed and yaw rate.
        specified: noise that is not to be estimated.
        drive: what sensors read of a designed drive, whose noise is specified; None of logs.
        correlated: noise of logs that lasts, whose white part is `specified`.
    """

    layout: SegmentLayout
    unknowns: Unknowns
    offsets: Array
    known: Knowledge
    loss: Loss = "linear"
    grows: bool = True
    specified: Mapping[str, Noise] | None = None
    drive: DriveReadings | None = None
    correlated: GaussMarkov | None = None

    def fit(self, values: Array | None = None) -> Fit:
        """The solution, from the nominal values or those given."""
        found = self.found(values)
        assert isinstance(found.rows, _Weighted)
        return replace(found.rows.fit(found.values, found.starts), converged=found.arrived)

    def found(self, values: Array | None = None) -> Found:
        """Where the search ends that begins at the nominal values or those given."""
        begin = self.unknowns.nominal if values is None else np.array(values, dtype=float)
        # Noise and weights follow the residuals, so they converge along with the unknowns.
        fixed = self.drive is not None or self.specified is not None
        renewed = None if fixed else _Weighted.renewed
        return self.least_squares.solved(self.at_first, begin, self.first_starts(begin), renewed)

    @property
    def least_squares(self) -> LeastSquares:
        """How the least squares are searched for."""
        close, flat = (CLOSE, 1.0) if self.drive is None else (EXACT, FLAT)
        unknowns = self.unknowns
        return LeastSquares(unknowns.scale, self.known, self.loss, unknowns.clocks, close, flat)

    @property
    def at_first(self) -> _Weighted:
        """Readings in units of the noise that is specified, or that the search begins with."""
        # Only their ratio matters at first: 1 cm to 0.01 rad.
        rough = dict.fromkeys(groups(self.layout.quantities), Noise(ROUGH)) | sensor_noise(
            self.layout.sensors
        )
        return _Weighted(self, dict(rough if self.specified is None else self.specified))

    @cached_property
    def _predicted(self) -> LoggedReadings | DriveReadings:
        return self.drive or LoggedReadings.of(self.layout, self.unknowns, self.offsets)

    def first_starts(self, values: Array) -> Array:
        """Where the segments begin, (S, c), near enough for a search, at unknowns (q,)."""
        return self._predicted.first_starts(values)

    def linearised(self, values: Array, starts: Array) -> _Linearised:
        """Residuals and derivatives at unknowns (q,) and the segments' own (S, c)."""
        key = values.tobytes() + starts.tobytes()
        if key not in self._remembered:
            self._remembered.clear()
            found, slopes, own = self._predicted.derivatives(values, starts)
            self._remembered[key] = self._compared(values, starts, found, slopes, own)
        return self._remembered[key]

    def at(self, values: Array, starts: Array) -> _Linearised:
        """Residuals there, and no derivatives where these are not known already."""
        known = self._remembered.get(values.tobytes() + starts.tobytes())
        if known is not None:
            return known
        found = self._predicted(values, starts)
        none = np.zeros((*found.shape, 0))
        return self._compared(values, starts, found, none, none)

    def _compared(self, values: Array, starts: Array, found: Array, slopes: Array, own: Array) -> _Linearised:
        rates = partial(self._predicted.rates, values, starts, found)
        left = without_turns(self.layout.readings - found, self._predicted.wrapping)
        return _Linearised(left, slopes, own, rates)

    @cached_property
    def _remembered(self) -> dict[bytes, _Linearised]:
        # The last point asked for: with another noise the drive is as it was.
        return {}


@dataclass(frozen=True)
class _Weighted:
    # A search's rows in units of a noise, and the least noise by group: the step of a grid met on the way.
    # With less a loss would hold on to the parameters that make most residuals 0.
    search: JointSearch
    noises: Mapping[str, Noise]
    least: Mapping[str, float] = field(default_factory=dict)

    def __call__(self, values: Array, starts: Array) -> Rows:
        found = self.search.linearised(values, starts)
        every = np.concatenate([found.residuals[..., None], found.slopes, found.own], axis=-1)
        white = _flat(self._white(every, found))
        first = 1 + found.slopes.shape[-1]
        return Rows(white[..., 0], white[..., 1:first], white[..., first:])

    def residuals(self, values: Array, starts: Array) -> Array:
        found = self.search.at(values, starts)
        return _flat(self._white(found.residuals[..., None], found))[..., 0]

    def _white(self, values: Array, at: _Linearised) -> Array:
        # Residuals (S, K, k) or their derivatives (S, K, k, q).
        layout, drive = self.search.layout, self.search.drive
        if not values.size:
            return values
        if drive is not None:
            return np.asarray((drive.whitener @ values.reshape(drive.order.size, -1)).reshape(values.shape))
        further = (1,) * (values.ndim - 3)
        size = self._constant if self._constant is not None else self._sizes(at.rates)
        present = layout.valid.reshape(*layout.valid.shape, *further)
        white = np.where(present, values / size.reshape(*size.shape, *further), 0.0)
        if layout.whitener is not None:
            white[:, -1] = np.einsum("sij,sj...->si...", layout.whitener, white[:, -1])
        lasting = self.search.correlated
        return white if lasting is None else lasting.whitened(layout, white)

    @cached_property
    def _constant(self) -> Array | None:
        # Sizes of errors (S, K, k) where they are the same at all rates.
        if any(one.per_speed or one.per_yaw_rate for one in self.noises.values()):
            return None
        still = np.zeros(self.search.layout.valid.shape[:2])
        return self._sizes((still, still))

    def _sizes(self, rates: tuple[Array, Array]) -> Array:
        # Of errors, (S, K, k).
        sizes = self.search.layout.sizes
        return np.asarray(self._deviations(rates) * (1.0 if sizes is None else sizes) / self._roots)

    def _deviations(self, rates: tuple[Array, Array]) -> Array:
        # Of readings (S, K, k), SI; where covariances are given those of typical ones.
        names = self.search.layout.quantities
        return np.stack([self.noises[group_of(name)].deviation(*rates) for name in names], axis=-1)

    @property
    def _roots(self) -> Array | float:
        # By how much the noise of a mean of several readings is smaller.
        return 1.0 if self.search.layout.averaged is None else np.sqrt(self.search.layout.averaged)

    def renewed(self, values: Array, starts: Array) -> _Weighted:
        """In units of the noise that residuals show."""
        at, layout = self.search.linearised(values, starts), self.search.layout
        valid, quantities, found = layout.valid, layout.quantities, dict[str, Noise]()
        rates, alike, left = np.stack(at.rates), layout.sizes is None, self._left(at)
        residuals = at.residuals if alike else left.white * self._deviations(at.rates)
        single, least = residuals * self._roots, dict(self.least)
        for group in groups(quantities):
            own = places_of(group, quantities)
            group_residuals = single[..., own][valid[..., own]]
            least[group] = max(least.get(group, LEAST), step_of_grid(group_residuals))
            found[group] = estimated(
                group_residuals,
                left.redundancy[..., own][valid[..., own]],
                of_readings(rates, valid[..., own]),
                robust=self.search.loss != "linear",
                grows=self.search.grows and alike,
                jumps=None if layout.relative else jumps(single[..., own], rates, valid[..., own]),
                least=least[group],
            )
        return replace(self, noises=found, least=least)

    def fit(self, values: Array, starts: Array) -> Fit:
        """The solution, if these are the least squares."""
        search, found = self.search, self.search.linearised(values, starts)
        left = self._left(found)
        pulls = left.weights * left.white / np.where(left.root > 0, left.root, 1.0)
        weighted = left.rows.reshape(found.slopes.shape) * left.root[..., None]
        by_start, by_errors = self._by_poses(values, starts, weighted)
        return Fit(
            unknowns=search.unknowns,
            values=values,
            offsets=search.offsets,
            starts=starts,
            layout=search.layout,
            residuals=found.residuals,
            white=left.white,
            weights=left.weights,
            redundancy=left.redundancy,
            noises=self.noises,
            speeds=found.rates[0],
            yaw_rates=found.rates[1],
            information=left.information,
            scores=(left.rows.transpose(0, 2, 1) @ _flat(pulls[..., None]))[..., 0],
            knowledge=search.known.information,
            converged=False,
            motions=search.layout.relative,
            bend=left.bend,
            swing=left.swing,
            by_start=by_start,
            by_errors=by_errors,
            correlated=search.correlated,
            volumes=self._volumes(left.own),
        )

    def _left(self, found: _Linearised) -> _Left:
        search = self.search
        white, weights, bend, swing = self._weights(self._white(found.residuals, found))
        root = np.ones_like(weights) if search.drive else np.sqrt(weights)
        wide = root[..., None]
        slopes, own = (_flat(self._white(columns, found) * wide) for columns in (found.slopes, found.own))
        rows, taken = projected(slopes, own)
        information = rows.transpose(0, 2, 1) @ rows
        inverse = inverse_of_sum(information.sum(axis=0), search.known.information)
        share = taken + np.einsum("sia,sia->si", rows @ inverse, rows)
        redundancy = np.where(search.layout.valid, 1 - share.reshape(white.shape), 0.0)
        return _Left(white, weights, root, bend, swing, rows, own, information, redundancy)

    def _by_poses(self, values: Array, starts: Array, weighted: Array) -> tuple[Array | None, Array | None]:
        # What errors of poses do to the scores, through readings that each have a noise of their own.
        search, predicted = self.search, self.search._predicted
        if isinstance(predicted, DriveReadings) or search.correlated or search.layout.relative:
            return None, None
        found, errors = search.linearised(values, starts), predicted.by_errors(values, starts)
        by_reading = self._white(weighted, found)

        def through(slopes: Array) -> Array:
            return np.asarray(np.einsum("skic,skiq->skcq", slopes, by_reading))

        return through(found.own[..., :POSE]), None if errors is None else through(errors)

    def _volumes(self, own: Array) -> Array | None:
        # Of correlated noise, with what starts take out of the readings.
        noise = self.search.correlated
        if noise is None:
            return None
        taken = SquareRoot.of_matrix(own.transpose(0, 2, 1) @ own).log_determinant
        return noise.volumes(self.search.layout) + taken

    def _weights(self, white: Array) -> tuple[Array, Array, float, float]:
        # Residuals (S, K, k) in units of the noise, their weights, bend and swing of the loss. Of specified
        # noise it is known how much a loss makes of it; other noise shows in the residuals.
        search, squares = self.search, white**2
        losses = robust_loss(search.loss, squares.ravel()).reshape(3, *white.shape)
        _, slope, second = np.where(search.layout.valid, losses, 0.0)
        if search.drive or search.loss == "linear":
            return white, slope, *loss_moments(search.loss)
        total = max(float(slope.sum()), 1e-300)
        bend, swing = slope + 2 * squares * second, (slope * white) ** 2
        return white, slope, float(bend.sum()) / total, float(swing.sum()) / total


def _flat(rows: Array) -> Array:
    # Times and quantities of a segment below each other.
    count, times, quantities, columns = rows.shape
    return rows.reshape(count, times * quantities, columns)
