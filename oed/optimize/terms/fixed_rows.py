"""The rows that a program always has: of limits on splines, linear in z, and on whole runs."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.limit import Rows
from oed.optimize.terms.needs import Needs
from oed.optimize.terms.row_bounds import RowBounds, said_once
from oed.optimize.terms.unknowns import Unknowns
from oed.optimize.terms.whole import LimitsOnRuns


class FixedRows:
    """Rows of limits on splines and on whole runs, with their bounds.

    Attributes:
        bounds: bounds of every limit's rows; none of limits on instants.
        linear: linearity in z of each limit's rows.
        slope: derivatives of the linear rows, (rows, size).
        constant: values of the linear rows where z is 0.
        order: places of the rows, limit by limit, among linear rows and those of whole runs behind them.
    """

    def __init__(
        self, terms: Unknowns, needs: Needs, whole: LimitsOnRuns | None, without: Mapping[int, RowBounds]
    ) -> None:
        """Sort them.

        Args:
            terms: terms that say what z is.
            needs: parts of a drive that the limits need.
            whole: rows of limits on whole runs, if there are any.
            without: empty bounds of the other limits.
        """
        tables = {place: self._table(terms, rows) for place, rows in needs.tables.items()}
        self.slope = np.concatenate([np.zeros((0, terms.size)), *(part for part, _, _ in tables.values())])
        self.constant = np.concatenate([np.zeros(0), *(part for _, part, _ in tables.values())])
        sorted_rows = {place: (bounds, True) for place, (_, _, bounds) in tables.items()}
        if whole is not None:
            pairs = zip(whole.bounds, whole.formulas.linear, strict=True)
            sorted_rows |= dict(zip(needs.whole, pairs, strict=True))
        owner = np.repeat(
            np.array(list(sorted_rows), dtype=int), [len(bounds.lower) for bounds, _ in sorted_rows.values()]
        )
        self.order: list[int] = np.argsort(owner, kind="stable").tolist()
        sorted_rows |= {place: (part, True) for place, part in without.items()}
        by_limit = [sorted_rows[place] for place in sorted(sorted_rows)]
        self.bounds, self.linear = [rows for rows, _ in by_limit], [linear for _, linear in by_limit]

    @staticmethod
    def _table(terms: Unknowns, rows: Rows) -> tuple[Array, Array, RowBounds]:
        # Slopes and constants of rows that some unknown moves, each once, and their bounds.
        expression = ca.densify(rows.expression)
        steep = ca.densify(ca.jacobian(expression, terms.unknowns))
        both = ca.Function("rows", [terms.unknowns], [steep, expression])
        slope, constant = map(np.array, both(np.zeros(terms.size)))
        slope, constant = slope.reshape(-1, terms.size), constant.ravel()
        moved = np.array(ca.DM(ca.jacobian_sparsity(expression, terms.unknowns), 1.0)) != 0
        distinct = moved.reshape(-1, terms.size).any(axis=1) & said_once(slope, constant, rows)
        bounds = RowBounds(rows.lower[distinct], rows.upper[distinct], rows.size, rows.unit)
        return slope[distinct], constant[distinct], bounds
