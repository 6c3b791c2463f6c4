"""Generalised least squares: motions between windows' ends, weighted by the covariance of their noise.

The parameters and the parts of the variance are found in turn: the latter by restricted maximum likelihood.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from oed.estimation.methods.bands import banded, factor, weighted, whitened
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.gauss_newton import LeastSquares, Rows
from oed.estimation.methods.joint import ROUGH
from oed.estimation.methods.motion_noise import motion_likelihood, score_parts
from oed.estimation.methods.window_noise import OF_POSES, PARTS, Likelihood, drift_in_words
from oed.estimation.methods.windows import Motions, Windows, require_windows
from oed.estimation.setup.unknowns import Knowledge, inverse_of_sum
from oed.foundation.arrays import Array
from oed.robots.sensors.logged import Noise

ROUNDS = 15
"""How often parameters and variances are found in turn at most."""
HELD = 8
"""Rounds after which clocks stay where they are: motion is piecewise linear in their offsets, and these and
the variances may lead each other from one side of a corner to the other for ever."""
CLOSE = 0.01
"""Change of the unknowns, in standard errors, at which they have settled."""


@dataclass(frozen=True)
class WeightedWindows:
    """The search.

    Attributes:
        windows: with what is to be estimated.
        known: of it from before.
        specified: noise of the poses that is not to be estimated; drift always is.
        grows: whether noise of poses may grow with speed and yaw rate.
    """

    windows: Windows
    known: Knowledge
    specified: Mapping[str, Noise] | None = None
    grows: bool = True

    def fit(self) -> Fit:
        """The solution, from the nominal values.

        Raises:
            ProblemError: logs without headings or positions, or too few windows.
        """
        require_windows(self.windows.layout, self.windows.unknowns, "gls")
        rough = banded(np.tile(np.eye(3) * ROUGH**2, (self.windows.layout.count, 1, 1)))
        values, _ = self._solved(self.windows.unknowns.nominal, factor(rough))
        fit, variances = self._round(values, None)
        hold = False
        for number in range(ROUNDS):
            before = fit
            fit, variances = self._round(fit.values, variances, hold_clocks=hold)
            change = fit.values - before.values
            if change @ fit.total @ change < CLOSE**2:
                break
            # A clock that goes on by more than it is uncertain is in no corner.
            near = np.abs(change) <= np.sqrt(np.diag(fit.inverse))
            hold = number >= HELD and bool(near[len(near) - self.windows.unknowns.clocks :].all())
        else:
            fit = replace(fit, converged=False)
        return self._with_parts(fit, variances)

    def _round(
        self, values: Array, variances: Array | None, *, hold_clocks: bool = False
    ) -> tuple[Fit, Array]:
        likelihood = self._likelihood(values)
        found = likelihood.greatest(variances)
        root = factor(likelihood.covariance(found))
        following, arrived = self._solved(values, root, hold_clocks=hold_clocks)
        return self._fit(following, root, found, arrived), found

    def _solved(self, values: Array, root: Array, *, hold_clocks: bool = False) -> tuple[Array, bool]:
        def rows(tried: Array, _: Array) -> Rows:
            motions = self.windows.motions(tried)
            white = whitened(root, np.column_stack([motions.residuals.ravel(), _flat(motions.slopes)]))
            return Rows.of(white[:, 0], white[:, 1:])

        unknowns = self.windows.unknowns
        search = LeastSquares(unknowns.scale, self.known, clocks=unknowns.clocks)
        found = search.solved(rows, values, hold_clocks=hold_clocks)
        return found.values, found.arrived

    def _likelihood(self, values: Array) -> Likelihood:
        return motion_likelihood(self.windows, self.known, values, self.specified, grows=self.grows)

    def _with_parts(self, fit: Fit, variances: Array) -> Fit:
        # A few windows may weight as they like, but not say how sure they are.
        likelihood = self._likelihood(fit.values)
        root = factor(likelihood.covariance(variances))
        pulls = weighted(root, whitened(root, _flat(self.windows.motions(fit.values).slopes)))
        return replace(fit, parts=score_parts(likelihood, pulls))

    def _fit(self, values: Array, root: Array, variances: Array, converged: bool) -> Fit:
        windows, motions = self.windows, self.windows.motions(values)
        size = windows.unknowns.size
        rows = whitened(root, _flat(motions.slopes)).reshape(-1, 3, size)
        white = whitened(root, motions.residuals.reshape(-1, 1)).reshape(-1, 3)
        information = np.einsum("sia,sib->sab", rows, rows)
        inverse = inverse_of_sum(information.sum(axis=0), self.known.information)
        leverage = np.einsum("sia,ab,sib->si", rows, inverse, rows)
        return windows.fit(
            values,
            white=white,
            leverage=leverage,
            noises=self._noises(variances),
            information=information,
            scores=np.einsum("sia,si->sa", rows, white),
            knowledge=self.known.information,
            converged=converged,
            notes=self._drift(variances, motions),
            volumes=2 * np.log(root[0]).reshape(-1, 3).sum(axis=1),
        )

    def _noises(self, variances: Array) -> Mapping[str, Noise]:
        if self.specified is not None:
            return self.specified
        position, heading, timing = map(float, np.sqrt(variances[:OF_POSES]))
        # Jitter of the poses' times moves positions by the speed, and headings by the yaw rate.
        return {"position": Noise(position, timing), "heading": Noise(heading, per_yaw_rate=timing)}

    def _drift(self, variances: Array, motions: Motions) -> tuple[str, ...]:
        rates = variances[-(len(PARTS) - OF_POSES) :]
        length = np.hypot(*np.moveaxis(np.diff(motions.path, axis=1)[..., :2], -1, 0)).sum()
        text = f"drift, as the windows show it beside the noise of poses: {drift_in_words(rates)}"
        return (text,) if length > 0 else ()


def _flat(slopes: Array) -> Array:
    # Motions below each other.
    return slopes.reshape(-1, slopes.shape[-1])
