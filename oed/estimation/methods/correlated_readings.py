"""Generalised least squares of all readings: the joint search with noise that is correlated in time.

Unknowns and the noise are found in turn: the latter by restricted maximum likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from oed.estimation.methods.fit import Fit
from oed.estimation.methods.gauss_markov import GaussMarkov
from oed.estimation.methods.gls import CLOSE
from oed.estimation.methods.joint import JointSearch
from oed.estimation.methods.noise_selection import Lasting, Remainder
from oed.foundation.arrays import Array

ROUNDS = 10
"""How often unknowns and noise are found in turn at most."""


@dataclass(frozen=True)
class CorrelatedReadings:
    """The search.

    Attributes:
        search: with noise that is to be estimated.
    """

    search: JointSearch

    def fit(self, values: Array | None = None, noise: GaussMarkov | None = None) -> Fit:
        """The solution.

        Args:
            values: of the unknowns, where the search begins; nominal by default.
            noise: of the first round; that of the least squares by default.
        """
        fit = self._round(values, noise) if noise else self.search.fit(values)
        names = None if noise is None else tuple(noise.lasting)
        for _ in range(ROUNDS):
            before = fit
            fit = self._round(fit.values, self._noise(fit, names))
            change = fit.values - before.values
            if before.correlated is not None and change @ fit.total @ change < CLOSE**2:
                return fit
        return replace(fit, converged=False)

    def _round(self, values: Array | None, noise: GaussMarkov) -> Fit:
        known = replace(self.search, correlated=noise, specified=noise.noises, grows=False)
        return replace(known.fit(values), notes=(noise.note(),))

    def _noise(self, fit: Fit, names: Sequence[str] | None) -> GaussMarkov:
        # From where the round before ended: from elsewhere a search ends a little elsewhere, and the rounds
        # would follow it to and fro.
        lasting = Lasting(Remainder.of(self.search, fit.values, fit.starts, fit.noises), names)
        after = None if fit.correlated is None else fit.correlated.sizes
        return lasting.noise(lasting.greatest(after)[1])
