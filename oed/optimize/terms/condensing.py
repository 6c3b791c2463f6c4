"""Condensing: from what pieces do by their own few unknowns to what the runs do by all of theirs.

States and their sensitivities go from piece to piece, information adds up. Their first derivatives follow by
the chain rule forwards, weights (adjoints) backwards; second derivatives are those of the pieces, each
weighted, between the first ones [Bock and Plitt, "A multiple shooting algorithm for direct solution of
optimal control problems", IFAC 1984]. Matrices of pieces stand side by side; those by a run's unknowns are
transposed, unknowns down the rows, so that pieces add up in one product.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import block_columns
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.blocks import backwards, begins
from oed.optimize.terms.layout import PieceLayout
from oed.optimize.terms.link import Link
from oed.optimize.terms.run_unknowns import RunUnknowns, summed


class Condensing:
    """The functions that one piece after the other goes through.

    Args:
        link: a piece and what it hands on.
        layout: the pieces.
        unknowns: of every run.

    Attributes:
        size: how many unknowns a run has.
    """

    def __init__(self, link: Link, layout: PieceLayout, unknowns: RunUnknowns) -> None:
        """Take the parts."""
        self.link, self.unknowns, self.size = link, unknowns, unknowns.per_run
        self.layout, self.each, self.runs, self.count = layout, layout.each, layout.space.runs, layout.count

    def spread(self, own: Expression, width: int) -> Expression:
        """Matrices (own, width) by each piece's own unknowns, as (size, width) by the run's (sparse)."""
        if width == 0:
            return ca.MX(self.size, 0)
        rows = np.tile(np.repeat(self.layout.within, width, axis=0), (self.runs, 1))
        starts = np.arange(0, rows.size + 1, rows.shape[1])
        pattern = ca.Sparsity(self.size, len(rows), starts.tolist(), rows.ravel().tolist())
        return ca.sparsity_cast(ca.densify(own), pattern)

    def gathered(self, own: Expression) -> Expression:
        """The sum, by z, of matrices (own, own) of all pieces."""
        return summed(self.layout.places, self.unknowns.size, own)

    def slopes(self, begin: Expression, onward: Expression, own: Expression) -> Expression:
        """Derivatives (size, states) of every piece's begin, and those of the runs' ends behind them.

        Args:
            begin: of the runs' begins, (size, states * runs).
            onward: entries of the derivatives of each piece's end by its begin.
            own: derivatives (own, states) of each piece's end by its own unknowns.
        """
        width = self.link.width
        ends = self._forward(begin, onward, ca.densify(self.spread(own, width)))
        last = block_columns(np.arange(1, self.runs + 1) * self.each - 1, width)
        return ca.horzcat(begins(begin, ends, self.each, width), ends[:, last])

    @cached_property
    def _forward(self) -> ca.Function:
        slope = ca.MX.sym("slope", self.size, self.link.width)
        moved = ca.MX.sym("moved", self.size, self.link.width)
        onward = self.link.onward
        entries = ca.MX.sym("onward", onward.pattern.nnz())
        step = ca.Function("forward", [slope, entries, moved], [slope @ onward.matrix(entries).T + moved])
        return step.mapaccum(self.each).map(self.runs)

    def weights(self, last: Expression, onward: Expression, added: Expression) -> Expression:
        """Weights (states,) of every piece's end: those of the runs' ends `last`, and what later pieces add.

        `added` are the weights that each piece's own outputs give its begin.

        Args:
            last: of the runs' ends.
            onward: derivatives of what is handed on.
            added: by each piece itself.
        """
        back = self.link.onward.back().mapaccum(self.each).map(self.runs)
        begun = back(last, backwards(onward, self.each), backwards(added, self.each))
        return backwards(begins(last, begun, self.each), self.each)

    def curvature(
        self, slopes: Expression, inner: Expression, mixed: Expression, own: Expression
    ) -> Expression:
        """Second derivatives by z.

        Args:
            slopes: of every piece's begin, (size, states) each.
            inner: entries of second derivatives by its begin.
            mixed: by its own unknowns and its bent begin, (own, bent states) each.
            own: by its own unknowns, (own, own) each.
        """
        bent = self.link.bent
        slope = ca.MX.sym("slope", self.size, self.link.width)
        within = ca.MX.sym("inner", self.link.inner.pattern.nnz())
        moved = ca.MX.sym("moved", self.size, len(bent))
        chosen = slope[:, list(bent)]
        half = ca.Function(
            "half", [slope, within, moved], [chosen, chosen @ self.link.inner.matrix(within / 2) + moved]
        )
        shifted = ca.densify(self.spread(mixed, len(bent)))
        halves = half.map(self.count)(slopes, inner, shifted)
        left, right = (ca.MX.sym(name, self.size, len(bent) * self.each) for name in ("left", "right"))
        product = left @ right.T
        both = ca.Function("both", [left, right], [product + product.T]).map(self.runs)
        return self.unknowns.square(both(*halves)) + self.gathered(own)
