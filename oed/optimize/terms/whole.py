"""Rows that need whole drives, around x and the inputs of all samples, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.direct_call import mapped
from oed.kernel.limit import Rows
from oed.optimize.terms.row_bounds import RowBounds
from oed.optimize.terms.runs import Rolled, RunWeights
from oed.optimize.terms.whole_rows import Formulas, picked


class WholeDrive:
    """Rows of formulas of a whole drive, with their derivatives by all unknowns.

    Slopes are found by as many directions as there are unknowns, or backwards from each row where these are
    fewer; second derivatives by directions too, of which columns without a common row share one [Gebremedhin,
    Manne and Pothen, "What color is your Jacobian?", SIAM Review 47, 2005].

    Args:
        formulas: formulas of the rows.
        rolled: runs of the drive.
        first: place of the first run of the system that the rows are of.
        further: variables that are not of x, (m,).
    """

    def __init__(self, formulas: Formulas, rolled: Rolled, first: int, further: Array) -> None:
        """Take the parts."""
        self._formulas, self._rolled = formulas, rolled
        self._constants = rolled.runs.parameters[first, : formulas.constants.shape[0]]
        entries, samples = formulas.x
        run, sample = np.divmod(samples, rolled.runs.samples)
        self._places: tuple[Places, Places, Places] = first + run, sample, entries
        self._variables = np.concatenate([rolled.points[self._places], further])

    @cached_property
    def _variable_slopes(self) -> Array:
        # By all unknowns, (variables, size).
        runs = self._rolled.runs
        slopes = np.zeros((len(self._places[0]), self._rolled.runs.size))
        if len(slopes):
            rows = self._rolled.slopes[self._places]
            slopes[np.arange(len(slopes))[:, None], runs.places[self._places[0]]] = rows
        return np.vstack([slopes, self._formulas.affine])

    @cached_property
    def values(self) -> Array:
        """The rows."""
        (rows,) = mapped(self._formulas.values, 1)(self._variables, self._constants)
        return np.asarray(rows)

    @cached_property
    def slopes(self) -> Array:
        """Derivatives (rows, size) of the rows by all unknowns."""
        slopes_by_group, slopes = [np.zeros((0, self._rolled.runs.size))], self._variable_slopes
        # Group by group: a slope that is infinite in one is not to spread to the others.
        for (function, is_along), rows in zip(self._formulas.by_group, self._formulas.groups, strict=True):
            count = int(rows.shape[0])
            directions = np.ascontiguousarray(slopes.T) if is_along else np.eye(count)
            if not count:
                continue
            call = mapped(function, len(directions), 0, 1)
            (flat,) = call(self._variables, self._constants, directions)
            table = flat.reshape(len(directions), -1)
            slopes_by_group.append(table.T if is_along else table @ slopes)
        return np.concatenate(slopes_by_group)

    def weigh(self, weights: Array, on_runs: RunWeights) -> Array:
        """Add what weighted rows weigh of x; return second derivatives besides, (size, size).

        Args:
            weights: weights of the rows.
            on_runs: weights of what the runs do.
        """
        gradient = mapped(self._formulas.gradient, 1)
        (on_variables,) = gradient(self._variables, self._constants, weights)
        np.add.at(on_runs.points, self._places, on_variables[: len(self._places[0])])
        formulas, slopes, inner = self._formulas, self._variable_slopes, self._formulas.inner
        if not inner.nnz():
            return np.zeros((self._rolled.runs.size, self._rolled.runs.size))
        directions = slopes.T if formulas.colours is None else formulas.colours
        bend = mapped(formulas.bent, len(directions), 0, 1, 2)
        arguments = self._variables, self._constants, weights
        (flat,) = bend(*arguments, np.ascontiguousarray(directions))
        bent_gradient = flat.reshape(len(directions), -1)
        if formulas.colours is None:
            return slopes.T @ bent_gradient.T
        rows, columns = (np.array(part, dtype=int) for part in inner.get_triplet())
        entries = bent_gradient[formulas.colours.argmax(axis=0)[columns], rows]
        bent = np.zeros_like(slopes)
        np.add.at(bent, rows, entries[:, None] * slopes[columns])
        return np.asarray(slopes.T @ bent)


class LimitsOnRuns:
    """Limits on whole runs: their formulas, without rows that no unknown moves.

    Attributes:
        formulas: formulas of all rows, a group for each limit.
        moved: places of the rows that some unknown moves.
        pattern: pattern of these by the unknowns.
        bounds: bounds of every limit's rows.
    """

    def __init__(self, formulas: Formulas, rows: Sequence[Rows], moved: Bools) -> None:
        """Leave out rows that no unknown moves.

        Args:
            formulas: formulas of the rows.
            rows: rows of each limit, with their bounds.
            moved: True where an unknown moves a state at a sample's begin, (samples, states, size).
        """
        self.formulas = formulas
        states, samples = formulas.x
        by_x = moved[samples, states]
        variables = np.vstack([by_x, formulas.affine != 0])
        pattern = ca.DM(formulas.pattern, 1.0) @ ca.sparsify(ca.DM(variables.astype(float)))
        self._count = int(pattern.shape[0])
        self.moved: Places = np.unique(np.array(pattern.sparsity().row(), dtype=int))
        self.pattern: ca.Sparsity = picked(pattern, self.moved.tolist()).sparsity()
        is_moved = np.isin(np.arange(self._count), self.moved)
        edges = np.cumsum([len(limit.lower) for limit in rows[:-1]], dtype=int)
        self.bounds = [
            RowBounds(limit.lower[chosen], limit.upper[chosen], limit.size, limit.unit)
            for limit, chosen in zip(rows, np.split(is_moved, edges), strict=True)
        ]

    def spread(self, weights: Array) -> Array:
        """Return weights of all rows, of those of the rows that are moved."""
        spread = np.zeros(self._count)
        spread[self.moved] = weights
        return spread
