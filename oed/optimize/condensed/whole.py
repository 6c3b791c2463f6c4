"""Rows of limits on whole runs, around the states and inputs at all samples, as arrays."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.direct_call import mapped
from oed.optimize.terms.whole_rows import WholeRows


class WholeRuns:
    """The rows of limits on whole runs and their derivatives.

    Slopes are found by as many directions as there are unknowns, or backwards from each row where these are
    fewer; second derivatives by directions too, of which columns without a common row share one [Gebremedhin,
    Manne and Pothen, "What color is your Jacobian?", SIAM Review 47, 2005].
    """

    def __init__(self, rows: WholeRows, size: int) -> None:
        """Take the rows, of drives of so many unknowns."""
        self._rows, self._formulas, self.size = rows, rows.formulas, size
        needed = np.array(self._formulas.needed, dtype=int)
        others = needed[needed >= self._formulas.states] - self._formulas.states
        self.affine = np.array(ca.DM(self._formulas.affine))[others]
        self.kept: Places = np.array(rows.kept, dtype=int)
        self.pattern = (
            ca.DM(rows.pattern, 1.0)[rows.kept, :].sparsity() if rows.kept else ca.Sparsity(0, size)
        )

    @property
    def states(self) -> tuple[Places, Places]:
        """Which samples' states the rows need, through all runs, and which of the states, (n,) each."""
        state, place = self._formulas.of_states
        return self._formulas.samples[place], state

    def given(self, states: Array, others: Array) -> Array:
        """Return what the rows are functions of, (K, needed).

        Args:
            states: those that they need, (K, n).
            others: inputs and unknowns that they need, (K, m).
        """
        return np.hstack([states, others])

    def given_slopes(self, states: Array) -> Array:
        """Return derivatives (needed, size) of that, from those of the states (n, size)."""
        return np.vstack([states, self.affine])

    def values(self, given: Array) -> Array:
        """Return the rows (K, rows)."""
        (found,) = mapped(self._formulas.values, len(given))(given)
        return found.reshape(len(given), -1)[:, self.kept]

    def slopes(self, given: Array, slopes: Array) -> Array:
        """Return derivatives (rows, size) of the rows by z.

        Args:
            given: what they are functions of, (needed,).
            slopes: derivatives of that, (needed, size).
        """
        found = [np.zeros((0, self.size))]
        # Limit by limit: a slope that is infinite in one is not to spread to the others.
        for along, backwards, count in self._differentiated:
            if along is not None:
                (rows,) = mapped(along, self.size, 0)(given, slopes.T)
                found.append(rows.reshape(self.size, count).T)
            elif backwards is not None:
                (rows,) = mapped(backwards, count, 0)(given, np.eye(count))
                found.append(rows.reshape(count, -1) @ slopes)
        return np.concatenate(found)[self.kept]

    @cached_property
    def _differentiated(self) -> list[tuple[ca.Function | None, ca.Function | None, int]]:
        # Of every limit: derivatives along a direction, or of weighted rows by all that is given.
        formulas, functions = self._formulas, list[tuple[ca.Function | None, ca.Function | None, int]]()
        for limit in formulas.rows:
            rows = ca.densify(limit.expression)
            count = int(rows.shape[0])
            if count >= self.size:
                direction = ca.SX.sym("direction", len(formulas.needed))
                slope = ca.densify(ca.jtimes(rows, formulas.given, direction))
                along = ca.Function("whole_along", [formulas.given, direction], [slope])
                functions.append((along, None, count))
            elif count:
                weights = ca.SX.sym("weights", count)
                slope = ca.densify(ca.jtimes(rows, formulas.given, weights, True))
                functions.append((None, ca.Function("whole_back", [formulas.given, weights], [slope]), count))
        return functions

    def weights(self, given: Array, weights: Array) -> Array:
        """Return weights (n,) of the states, of weighted rows."""
        (found,) = mapped(self._formulas.gradient, 1)(given, self._spread(weights))
        return found[: len(self._formulas.of_states[0])]

    def curvature(self, given: Array, slopes: Array, weights: Array) -> Array:
        """Return second derivatives (size, size) by z of weighted rows, but for those of the states.

        Args:
            given: what the rows are functions of, (needed,).
            slopes: derivatives of that, (needed, size).
            weights: of the rows, (rows,).
        """
        inner = self._formulas.inner
        if not inner.nnz():
            return np.zeros((self.size, self.size))
        directions = self._colours if self._few else slopes.T
        bend = mapped(self._formulas.bent, len(directions), 0, 1)
        (found,) = bend(given, self._spread(weights), np.ascontiguousarray(directions))
        found = found.reshape(len(directions), -1)
        if not self._few:
            return slopes.T @ found.T
        rows, columns = (np.array(part, dtype=int) for part in inner.get_triplet())
        entries = found[self._colour[columns], rows]
        bent = np.zeros_like(slopes)
        np.add.at(bent, rows, entries[:, None] * slopes[columns])
        return np.asarray(slopes.T @ bent)

    @cached_property
    def _few(self) -> bool:
        # Colours are as many as a row has entries, at least, and take long to find where these are many.
        most = np.bincount(self._formulas.inner.row()).max()
        return bool(most < self.size and self._formulas.colours.size2() < self.size)

    @property
    def _colours(self) -> Array:
        return np.array(ca.DM(self._formulas.colours, 1.0)).T

    @cached_property
    def _colour(self) -> Places:
        colours = self._formulas.colours
        found = np.empty(self._formulas.inner.size2(), dtype=np.int64)
        found[colours.row()] = colours.get_col()
        return found

    def _spread(self, weights: Array) -> Array:
        # Rows that no unknown moves have weights as well.
        found = np.zeros(self._rows.pattern.size1())
        found[self.kept] = weights
        return found
