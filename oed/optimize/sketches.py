"""Sketches: one cheap solve from a start, for where that leads."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.errors import NotFinite
from oed.kernel.results import TOLERANCE
from oed.optimize.exchange import Exchange
from oed.optimize.local import LocalSearch
from oed.optimize.local_results import Sketch
from oed.optimize.lower_level import Instants
from oed.optimize.transcription.program import Outcome


class Sketches:
    """Those of a search, on its grid and without tightening limits.

    A coarse grid's samples are few. There limits hold at the ends of all of them at once, as the grid sees
    drives: that leads to better drives than limits that come by and by do, and what lies between samples is
    of no concern yet.
    """

    def __init__(self, search: LocalSearch) -> None:
        """Take the search."""
        self._search = search
        grid, terms = search.grid, search.design.terms
        self._exchange = Exchange(terms.problem, terms) if grid.coarse else search.exchange
        self._at_once = grid.coarse and self._exchange.needed

    @cached_property
    def _known(self) -> Instants:
        # At which limits hold from the beginning.
        return self._exchange.at_samples() if self._at_once else self._exchange.begun()

    def __call__(self, unknowns: Array, barrier: float, tolerance: float) -> Sketch:
        """One.

        Args:
            unknowns: z to begin at.
            barrier: as of `Program.solve`.
            tolerance: of Ipopt, at least.
        """
        search = self._search
        try:
            outcome = self._solved(unknowns, barrier, max(tolerance, search.settings.tolerance))
        except NotFinite:
            return Sketch(unknowns, -np.inf, 1)
        _, violations = search.design.score_many(outcome.unknowns[None, :])
        excess = max(violations.max(initial=0.0), self._excess(outcome))
        value = float(search.design.objective(search.grid.matrices_of(outcome.unknowns, self._nothing)))
        kept = excess <= TOLERANCE and np.isfinite(value)
        return Sketch(outcome.unknowns, value if kept else -np.inf, max(outcome.iterations, 1))

    def _solved(self, unknowns: Array, barrier: float, tolerance: float) -> Outcome:
        search = self._search
        how: dict[str, Any] = {"floors": search.no_floors, "barrier": barrier, "tolerance": tolerance}
        if not self._at_once:
            how["until"] = search.settings.until
            return search.exchanged(search.program, unknowns, self._nothing, self._known, **how)[0]
        chosen = self._exchange.chosen(self._known, search.design.trajectory(unknowns))
        return search.solved(search.program, unknowns, self._nothing, chosen=chosen, **how)

    def _excess(self, outcome: Outcome) -> float:
        # Share of a limit's size by which an instant is exceeded at which limits were to hold.
        if not self._at_once:
            return 0.0
        drive = self._search.design.trajectory(outcome.unknowns)
        return float(self._exchange.lower_level.violations(self._known, drive).max())

    @property
    def _nothing(self) -> Array:
        return self._search.grid.no_correction

    def compile(self, spared: float) -> tuple[int, Path | None]:
        """As of `LocalSearch`."""
        return self._search.compile(spared, self._known)
