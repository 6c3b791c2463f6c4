"""The rows that a program always has: of limits on splines, linear in z, and on whole runs."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.limit import Rows
from oed.optimize.terms.base import Terms
from oed.optimize.terms.needs import Needs
from oed.optimize.terms.row_bounds import RowBounds, said_once
from oed.optimize.terms.whole_rows import WholeRows


class FixedRows:
    """Those rows: their bounds, and how they are put together.

    Attributes:
        bounds: of every limit's rows; none of limits on instants.
        linear: whether each limit's rows are linear in z.
        slope: of the linear ones, (rows, size).
        constant: of the same.
        whole: the others; None where there are none.
        order: where the rows, limit by limit, stand among the linear ones and the others behind them.
    """

    def __init__(
        self, terms: Terms, needs: Needs, whole: WholeRows | None, without: Mapping[int, RowBounds]
    ) -> None:
        """Sort them.

        Args:
            terms: what z is.
            needs: of the limits.
            whole: rows of limits on whole runs, if there are any.
            without: what the other limits are, which have none of these rows.
        """
        self.whole = whole
        tables = {place: self._table(terms, rows) for place, rows in needs.tables.items()}
        self.slope = np.concatenate([np.zeros((0, terms.size)), *(one for one, _, _ in tables.values())])
        self.constant = np.concatenate([np.zeros(0), *(one for _, one, _ in tables.values())])
        known = {place: (bounds, True) for place, (_, _, bounds) in tables.items()}
        if whole is not None:
            own = zip(whole.bounds, whole.formulas.linear, strict=True)
            known |= dict(zip(needs.whole, own, strict=True))
        owner = np.repeat(
            np.array(list(known), dtype=int), [len(bounds.lower) for bounds, _ in known.values()]
        )
        self.order: list[int] = np.argsort(owner, kind="stable").tolist()
        known |= {place: (one, True) for place, one in without.items()}
        by_limit = [known[place] for place in sorted(known)]
        self.bounds, self.linear = [rows for rows, _ in by_limit], [linear for _, linear in by_limit]

    @staticmethod
    def _table(terms: Terms, rows: Rows) -> tuple[Array, Array, RowBounds]:
        # Slopes and constants of rows that some unknown moves, each once, and their bounds.
        expression = ca.densify(rows.expression)
        steep = ca.densify(ca.jacobian(expression, terms.unknowns))
        both = ca.Function("rows", [terms.unknowns], [steep, expression])
        slope, constant = map(np.array, both(np.zeros(terms.size)))
        slope, constant = slope.reshape(-1, terms.size), constant.ravel()
        moved = np.array(ca.DM(ca.jacobian_sparsity(expression, terms.unknowns), 1.0)) != 0
        kept = moved.reshape(-1, terms.size).any(axis=1)
        if terms.embedding.repeats:
            kept &= said_once(slope, constant, rows)
        bounds = RowBounds(rows.lower[kept], rows.upper[kept], rows.size, rows.unit)
        return slope[kept], constant[kept], bounds
