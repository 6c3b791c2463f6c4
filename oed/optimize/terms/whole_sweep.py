"""One evaluation of pieces and, around them, of the limits that need whole runs."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.needs import Needs
from oed.optimize.terms.passes import Sweep
from oed.optimize.terms.whole_rows import WholeRows


class WholeSweep:
    """A sweep through the pieces whose states go into the limits on whole runs: rows of all limits.

    Attributes:
        z: the unknowns.
    """

    def __init__(self, sweep: Sweep, whole: WholeRows, needs: Needs) -> None:
        """Take the parts; needs are those of the limits."""
        self._sweep, self._whole, self.z = sweep, whole, sweep.z
        bounds = sweep.plan.rows.bounds
        counts = [len(one.lower) for one in (*bounds, *whole.bounds)]
        self._own = sum(len(one.lower) for one in bounds)
        places = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
        # Where the rows of all limits, in their order, stand among those of the pieces and of whole runs.
        order = needs.in_order(places[: len(bounds)], places[len(bounds) :])
        self._order = np.concatenate(order).tolist()

    @property
    def entries(self) -> Expression:
        """The matrices' entries."""
        return self._sweep.entries

    @property
    def entry_slopes(self) -> Expression:
        """Derivatives of the entries by z."""
        return self._sweep.entry_slopes

    @cached_property
    def _parts(self) -> list[Expression]:
        # Rows of the pieces' limits, states.
        return self._split(self._sweep.rows)

    @cached_property
    def _slopes(self) -> list[Expression]:
        return self._split(self._sweep.row_slopes)

    def _split(self, rows: Expression) -> list[Expression]:
        return list(ca.vertsplit(rows, [0, self._own, rows.shape[0]]))

    @property
    def rows(self) -> Expression:
        """The limits' rows."""
        own, states = self._parts
        return ca.vertcat(own, self._whole.values(self.z, states))[self._order]

    @property
    def row_slopes(self) -> Expression:
        """Derivatives of the rows by z."""
        whole = self._whole.slopes(self.z, self._parts[1], self._slopes[1])
        return ca.vertcat(self._slopes[0], whole)[self._order, :]

    def curvature(self, entries: Expression, rows: Expression) -> Expression:
        """Second derivatives by z of the weighted sum of entries and rows."""
        back = np.argsort(self._order).tolist()
        own, whole = self._split(rows[back])
        states = self._parts[1]
        weights = ca.vertcat(own, self._whole.weights(self.z, states, whole))
        around = self._whole.curvature(self.z, states, self._slopes[1], whole)
        return self._sweep.curvature(entries, weights) + around
