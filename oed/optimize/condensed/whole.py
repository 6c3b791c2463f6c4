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
        further = needed[needed >= self._formulas.states] - self._formulas.states
        self.affine = np.array(ca.DM(self._formulas.affine))[further]
        self.moved: Places = np.array(rows.kept, dtype=int)
        self.pattern = (
            ca.DM(rows.pattern, 1.0)[rows.kept, :].sparsity() if rows.kept else ca.Sparsity(0, size)
        )

    @property
    def states(self) -> tuple[Places, Places]:
        """Samples, counted through all runs, and states at their begins that the rows need, (n,) each."""
        state, place = self._formulas.of_states
        return self._formulas.samples[place], state

    def variables(self, states: Array, further: Array) -> Array:
        """Return the variables of the rows, (K, needed).

        Args:
            states: needed states, (K, n).
            further: needed inputs and unknowns, (K, m).
        """
        return np.hstack([states, further])

    def variable_slopes(self, states: Array) -> Array:
        """Return derivatives (needed, size) of the variables, from those of the states (n, size)."""
        return np.vstack([states, self.affine])

    def values(self, variables: Array) -> Array:
        """Return the rows (K, rows)."""
        (rows,) = mapped(self._formulas.values, len(variables))(variables)
        return rows.reshape(len(variables), -1)[:, self.moved]

    def slopes(self, variables: Array, slopes: Array) -> Array:
        """Return derivatives (rows, size) of the rows by z.

        Args:
            variables: variables of the rows, (needed,).
            slopes: derivatives of the variables, (needed, size).
        """
        slopes_by_limit = [np.zeros((0, self.size))]
        # Limit by limit: a slope that is infinite in one is not to spread to the others.
        for along, backwards, count in self._differentiated:
            if along is not None:
                (rows,) = mapped(along, self.size, 0)(variables, slopes.T)
                slopes_by_limit.append(rows.reshape(self.size, count).T)
            elif backwards is not None:
                (rows,) = mapped(backwards, count, 0)(variables, np.eye(count))
                slopes_by_limit.append(rows.reshape(count, -1) @ slopes)
        return np.concatenate(slopes_by_limit)[self.moved]

    @cached_property
    def _differentiated(self) -> list[tuple[ca.Function | None, ca.Function | None, int]]:
        # Of every limit: derivatives along a direction, or of weighted rows by all variables.
        formulas, functions = self._formulas, list[tuple[ca.Function | None, ca.Function | None, int]]()
        for limit in formulas.rows:
            rows = ca.densify(limit.expression)
            count = int(rows.shape[0])
            if count >= self.size:
                direction = ca.SX.sym("direction", len(formulas.needed))
                slope = ca.densify(ca.jtimes(rows, formulas.variables, direction))
                along = ca.Function("whole_along", [formulas.variables, direction], [slope])
                functions.append((along, None, count))
            elif count:
                weights = ca.SX.sym("weights", count)
                slope = ca.densify(ca.jtimes(rows, formulas.variables, weights, True))
                functions.append(
                    (None, ca.Function("whole_back", [formulas.variables, weights], [slope]), count)
                )
        return functions

    def weights(self, variables: Array, weights: Array) -> Array:
        """Return weights (n,) of the states, of weighted rows."""
        (gradient,) = mapped(self._formulas.gradient, 1)(variables, self._spread(weights))
        return gradient[: len(self._formulas.of_states[0])]

    def curvature(self, variables: Array, slopes: Array, weights: Array) -> Array:
        """Return second derivatives (size, size) by z of weighted rows, but for those of the states.

        Args:
            variables: variables of the rows, (needed,).
            slopes: derivatives of the variables, (needed, size).
            weights: of the rows, (rows,).
        """
        inner = self._formulas.inner
        if not inner.nnz():
            return np.zeros((self.size, self.size))
        directions = self._colours if self._few else slopes.T
        bend = mapped(self._formulas.bent, len(directions), 0, 1)
        (bent_gradient,) = bend(variables, self._spread(weights), np.ascontiguousarray(directions))
        bent_gradient = bent_gradient.reshape(len(directions), -1)
        if not self._few:
            return slopes.T @ bent_gradient.T
        rows, columns = (np.array(part, dtype=int) for part in inner.get_triplet())
        entries = bent_gradient[self._colour[columns], rows]
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
        colour_of = np.empty(self._formulas.inner.size2(), dtype=np.int64)
        colour_of[colours.row()] = colours.get_col()
        return colour_of

    def _spread(self, weights: Array) -> Array:
        # Rows that no unknown moves have weights as well.
        spread = np.zeros(self._rows.pattern.size1())
        spread[self.moved] = weights
        return spread
