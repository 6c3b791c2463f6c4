"""Rows of limits on whole runs, around the states and inputs at all samples, as arrays."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.direct_call import mapped
from oed.optimize.terms.row_bounds import RowBounds
from oed.optimize.terms.whole_rows import Formulas, picked


class WholeRuns:
    """Rows of limits on whole runs that some unknown moves, and their derivatives.

    Slopes are found by as many directions as there are unknowns, or backwards from each row where these are
    fewer; second derivatives by directions too, of which columns without a common row share one [Gebremedhin,
    Manne and Pothen, "What color is your Jacobian?", SIAM Review 47, 2005].

    Attributes:
        formulas: formulas of all rows.
        size: number of unknowns.
        affine: derivatives (m, size) by z of the inputs and unknowns that the rows need.
        moved: places of the rows among all.
        pattern: pattern of the rows by z.
        bounds: bounds of every limit's rows.
    """

    def __init__(self, formulas: Formulas, moved: Bools) -> None:
        """Leave out rows that no unknown moves.

        Args:
            formulas: formulas of the rows.
            moved: True where an unknown moves a state at a sample's begin, (samples, states, size).
        """
        self.formulas, self.size = formulas, moved.shape[2]
        needed = np.array(formulas.needed, dtype=int)
        further = needed[needed >= formulas.states] - formulas.states
        self.affine = np.array(ca.DM(formulas.affine))[further]
        affine = ca.DM(formulas.affine.sparsity(), 1.0)
        by_states = moved.transpose(1, 0, 2).reshape(-1, self.size)
        variables = ca.vertcat(ca.sparsify(ca.DM(by_states.astype(float))), affine)
        pattern = ca.DM(formulas.pattern, 1.0) @ picked(variables, formulas.needed)
        self._count = int(pattern.shape[0])
        self.moved: Places = np.unique(np.array(pattern.sparsity().row(), dtype=int))
        self.pattern = picked(pattern, self.moved.tolist()).sparsity()
        is_moved = np.isin(np.arange(self._count), self.moved)
        edges = np.cumsum([len(rows.lower) for rows in formulas.rows[:-1]], dtype=int)
        self.bounds = [
            RowBounds(rows.lower[chosen], rows.upper[chosen], rows.size, rows.unit)
            for rows, chosen in zip(formulas.rows, np.split(is_moved, edges), strict=True)
        ]

    @property
    def states(self) -> tuple[Places, Places]:
        """Samples, counted through all runs, and states at their begins that the rows need, (n,) each."""
        state, place = self.formulas.of_states
        return self.formulas.samples[place], state

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
        (rows,) = mapped(self.formulas.values, len(variables))(variables)
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
        formulas, functions = self.formulas, list[tuple[ca.Function | None, ca.Function | None, int]]()
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
        (gradient,) = mapped(self.formulas.gradient, 1)(variables, self._spread(weights))
        return gradient[: len(self.formulas.of_states[0])]

    def curvature(self, variables: Array, slopes: Array, weights: Array) -> Array:
        """Return second derivatives (size, size) by z of weighted rows, but for those of the states.

        Args:
            variables: variables of the rows, (needed,).
            slopes: derivatives of the variables, (needed, size).
            weights: of the rows, (rows,).
        """
        inner = self.formulas.inner
        if not inner.nnz():
            return np.zeros((self.size, self.size))
        directions = self._colours if self._few else slopes.T
        bend = mapped(self.formulas.bent, len(directions), 0, 1)
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
        most = np.bincount(self.formulas.inner.row()).max()
        return bool(most < self.size and self.formulas.colours.size2() < self.size)

    @property
    def _colours(self) -> Array:
        return np.array(ca.DM(self.formulas.colours, 1.0)).T

    @cached_property
    def _colour(self) -> Places:
        colours = self.formulas.colours
        colour_of = np.empty(self.formulas.inner.size2(), dtype=np.int64)
        colour_of[colours.row()] = colours.get_col()
        return colour_of

    def _spread(self, weights: Array) -> Array:
        # Rows that no unknown moves have weights as well.
        spread = np.zeros(self._count)
        spread[self.moved] = weights
        return spread
