"""Joint nonlinear least squares over segments of logs: parameters, sensor's place, clocks, every start.

Each segment's start is eliminated by projection, so that a step costs in proportion to their number only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from oed.estimation.methods.fit import Fit
from oed.estimation.methods.gauss_newton import NEAR, STEPS, downhill
from oed.estimation.methods.knowledge import Knowledge, inverse_of_sum, inverse_of_told
from oed.estimation.methods.losses import robust_loss
from oed.estimation.prediction.layout import Layout
from oed.estimation.prediction.logged_states import LoggedStates
from oed.estimation.prediction.segments import SegmentReadings
from oed.estimation.prediction.starts import first_starts, further_starts
from oed.estimation.setup.noise import deviations, estimated, groups, jumps, places_of
from oed.estimation.setup.options import Loss
from oed.estimation.setup.unknowns import Unknowns
from oed.robots.sensors.logged import Noise

Array = npt.NDArray[np.float64]

SETTLING = 15
"""Steps after which the noise is held: whether it grows with speed may be undecided for ever."""
CLOSE = 1e-6
"""Change of the unknowns, in units of their size, at which the search has arrived."""
ROUGH = 0.01
"""Noise that the search begins with [m, rad]."""


@dataclass(frozen=True)
class _State:
    """A fit on the way, with derivatives of the readings by the unknowns and by the segments' own starts."""

    fit: Fit
    slopes: Array
    own: Array
    misfit: float


@dataclass(frozen=True)
class JointSearch:
    """The search for the least squares.

    Attributes:
        layout: the segments.
        unknowns: what to estimate.
        offsets: of the clocks, as far as known, (clocks,) [s].
        loss: of a residual in units of the noise.
        grows: whether noise may grow with speed and yaw rate.
        known: of the unknowns from before.
        stated: noise that is not to be estimated.
    """

    layout: Layout
    unknowns: Unknowns
    offsets: Array
    loss: Loss = "linear"
    grows: bool = True
    known: Knowledge | None = None
    stated: Mapping[str, Noise] | None = None

    def fit(self, values: Array | None = None) -> Fit:
        """The solution, from the nominal values or those given."""
        begin = self.unknowns.nominal if values is None else np.array(values, dtype=float)
        state = self._state(begin, self._first_starts(begin), self._first_noises())
        converged = False
        # Noise and weights follow the residuals, so they settle along with the unknowns.
        for step in range(STEPS):
            if step < SETTLING:
                state = self._weighed(state, self._noises(state.fit))
            following = self._advanced(state)
            # A step that cannot be made shorter any more is no arrival, but the end all the same.
            stuck = following is state
            change = np.abs((following.fit.values - state.fit.values) / self.unknowns.scale).max(initial=0.0)
            state = following
            if change < CLOSE and step > 1:
                converged = not stuck or self._near(state)
                break
        return replace(state.fit, converged=converged)

    @cached_property
    def _known(self) -> Knowledge:
        return self.known or Knowledge.nothing(self.unknowns.size)

    @cached_property
    def _readings(self) -> SegmentReadings:
        layout = self.layout
        return SegmentReadings.logged(self.unknowns.robot, layout.quantities, layout.count, layout.periods)

    @cached_property
    def _headings(self) -> SegmentReadings:
        # Of robots whose headings are not read.
        return replace(self._readings, sensor=LoggedStates.of(self.unknowns.robot, ["heading"]))

    def _first_starts(self, values: Array) -> Array:
        parameters, place, clocks = self.unknowns.parts(values)
        offsets = self._offsets(clocks)
        inputs = self.layout.inputs(offsets)

        def paths(starts: Array) -> Array:
            return self._readings(starts, inputs, self.layout.steps, parameters, place)

        robot = self.unknowns.robot
        further = further_starts(robot, self.layout, offsets, parameters)
        return first_starts(robot, self.layout, paths, place, further)

    def _offsets(self, clocks: Array) -> Array:
        return self.offsets + clocks if len(clocks) else self.offsets

    def _first_noises(self) -> dict[str, Noise]:
        # Only their ratio matters at first: 1 cm to 0.01 rad.
        return dict.fromkeys(groups(self.layout.quantities), Noise(ROUGH))

    def _state(self, values: Array, starts: Array, noises: Mapping[str, Noise]) -> _State:
        residuals, slopes, own, rates = self._linearised(values, starts)
        fit = self._fit(values, starts, noises, residuals, slopes, own, rates)
        return _State(fit, slopes, own, self._misfit(fit))

    def _weighed(self, state: _State, noises: Mapping[str, Noise]) -> _State:
        # The same with another noise: the drive is as it was.
        fit = state.fit
        rates = fit.speeds, fit.yaw_rates
        found = self._fit(fit.values, fit.starts, noises, fit.residuals, state.slopes, state.own, rates)
        return replace(state, fit=found, misfit=self._misfit(found))

    def _fit(
        self,
        values: Array,
        starts: Array,
        noises: Mapping[str, Noise],
        residuals: Array,
        slopes: Array,
        own: Array,
        rates: tuple[Array, Array],
    ) -> Fit:
        present = self.layout.valid[..., None]
        size = deviations(noises, self.layout.quantities, *rates)
        white = np.where(present, residuals / size, 0.0)
        squares = (white**2).ravel()
        _, slope, second = robust_loss(self.loss, squares)
        weights = slope.reshape(white.shape)
        bends = (slope + 2 * squares * second).reshape(white.shape)
        root = np.where(present, np.sqrt(weights), 0.0) / size
        rows, beside, misfit = (
            _flat(slopes * root[..., None]),
            _flat(own * root[..., None]),
            (residuals * root).reshape(len(residuals), -1),
        )
        projected, taken = _projected(rows, beside)
        across = projected.transpose(0, 2, 1)
        information = across @ projected
        scores = (across @ misfit[..., None])[..., 0]
        inverse = inverse_of_sum(information.sum(axis=0), self._known.information)
        leverage = taken + np.einsum("sia,sia->si", projected @ inverse, projected)
        return Fit(
            unknowns=self.unknowns,
            values=values,
            offsets=self.offsets,
            starts=starts,
            layout=self.layout,
            residuals=residuals,
            white=white,
            weights=np.where(present, weights, 0.0),
            freedom=np.where(present, 1 - leverage.reshape(white.shape), 0.0),
            noises=dict(noises),
            speeds=rates[0],
            yaw_rates=rates[1],
            information=information,
            scores=scores,
            knowledge=self._known.information,
            converged=False,
            bend=float((bends * present).sum() / max((weights * present).sum(), 1e-300)),
            swing=1.0 if self.loss == "linear" else _mean_square(weights * white, weights, present),
        )

    def _linearised(self, values: Array, starts: Array) -> tuple[Array, Array, Array, tuple[Array, Array]]:
        # Residuals, derivatives of the readings by the unknowns and by the own start, speeds and yaw rates.
        parameters, place, clocks = self.unknowns.parts(values)
        offsets, steps = self._offsets(clocks), self.layout.steps
        inputs = self.layout.inputs(offsets)
        found, slopes = self._readings.derivatives(starts, inputs, steps, parameters, place)
        size, states = len(parameters), starts.shape[1]
        columns = [slopes[..., self.unknowns.columns]]
        if len(clocks):
            columns.append(self._clock_slopes(starts, parameters, place, offsets))
        own = slopes[..., size : size + states]
        residuals = self.layout.readings - found
        turned = found[..., [index for index, name in enumerate(self.layout.quantities) if name == "heading"]]
        if not turned.size:
            turned = self._headings(starts, inputs, steps, parameters, place)
        rates = self._speeds(found), self.layout.rates(turned)
        return residuals, np.concatenate(columns, axis=-1), own, rates

    def _clock_slopes(self, starts: Array, parameters: Array, place: Array, offsets: Array) -> Array:
        def read(moved: Array) -> Array:
            return self._readings(starts, self.layout.inputs(moved), self.layout.steps, parameters, place)

        return self.layout.clock_slopes(read, offsets)

    def _speeds(self, found: Array) -> Array:
        # Of the predicted readings; 0 where positions are not read.
        quantities = self.layout.quantities
        if "x" not in quantities or "y" not in quantities:
            return np.zeros(found.shape[:2])
        return self.layout.rates(found[..., [quantities.index("x"), quantities.index("y")]])

    def _noises(self, state: Fit) -> Mapping[str, Noise]:
        if self.stated is not None:
            return self.stated
        valid, quantities, found = self.layout.valid, self.layout.quantities, {}
        for group in groups(quantities):
            own = places_of(group, quantities)
            found[group] = estimated(
                state.residuals[valid][:, own].ravel(),
                state.freedom[valid][:, own].ravel(),
                np.repeat(state.speeds[valid], len(own)),
                np.repeat(state.yaw_rates[valid], len(own)),
                robust=self.loss != "linear",
                grows=self.grows,
                jumps=jumps(state.residuals[..., own], state.speeds, state.yaw_rates, valid),
            )
        return found

    def _near(self, state: _State) -> bool:
        # Whether the step left to go is a small share of the standard errors.
        step = self._step(state)[0]
        errors = np.sqrt(np.diag(state.fit.inverse))
        return bool(np.all(np.abs(step) <= NEAR * errors))

    def _advanced(self, state: _State) -> _State:
        (step, starts), fit = self._step(state), state.fit

        def after(share: float) -> _State:
            return self._state(fit.values + share * step, fit.starts + share * starts, fit.noises)

        return downhill(state, after)

    def _step(self, state: _State) -> tuple[Array, Array]:
        # Of the unknowns, and of the starts that go along with it.
        fit = state.fit
        step = fit.inverse @ (fit.scores.sum(axis=0) + self._known.score(fit.values))
        size = deviations(fit.noises, self.layout.quantities, fit.speeds, fit.yaw_rates)
        root = (np.sqrt(fit.weights) / size)[..., None]
        rest = (fit.residuals - state.slopes @ step)[..., None]
        beside, misfit = _flat(state.own * root), _flat(rest * root)[..., 0]
        normal = inverse_of_told(beside.transpose(0, 2, 1) @ beside)
        return step, (normal @ (beside.transpose(0, 2, 1) @ misfit[..., None]))[..., 0]

    def _misfit(self, state: Fit) -> float:
        losses = robust_loss(self.loss, (state.white**2).ravel())[0]
        return float(losses.sum()) + self._known.misfit(state.values)


def _mean_square(pulls: Array, weights: Array, present: npt.NDArray[np.bool_]) -> float:
    # Of what residuals pull with, in units of their mean weight.
    return float((pulls**2 * present).sum() / max((weights * present).sum(), 1e-300))


def _flat(rows: Array) -> Array:
    # Times and quantities of a segment below each other.
    return rows.reshape(len(rows), -1, rows.shape[-1])


def _projected(rows: Array, beside: Array) -> tuple[Array, Array]:
    # Rows with what their segment's start explains taken out, and how much of each that is.
    normal = inverse_of_told(beside.transpose(0, 2, 1) @ beside)
    across = beside @ normal
    explained = across @ (beside.transpose(0, 2, 1) @ rows)
    return rows - explained, np.einsum("sia,sia->si", across, beside)
