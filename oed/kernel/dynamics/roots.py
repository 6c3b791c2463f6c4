"""Roots of equations, as expressions with the root's own derivatives.

Newton's method is written out, so that expressions of any kind can take it. It runs on arguments that are
held still: derivatives do not go through it. A few steps with its last Jacobian follow, on the arguments
themselves. Each gains one order in what the arguments differ by from those held still, and so makes one more
derivative that of the root.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import log

import casadi as ca

from oed.kernel.dynamics.expression import Expression

ORDERS = 3
"""Derivatives that are exact: of a search by Newton's method those of sensitivities' gradients."""
KEPT_BITS = 45
"""Of an argument that is held still: the steps that follow square the rest away."""
SMALLEST = 1e-250
"""Magnitude below which arguments that are held still count as 0."""
SOLVED = 1e-10
"""Residual of a root, as a share of what its terms may be."""
NEAR = 1e-6
"""Share of every unknown by which the last iteration changes it: the next would by about the square."""
DAMPING = (1.0, 0.5, 0.125, 0.015625)
"""Shares of a Newton step that are tried where its start may be far from the root."""


def held_still(expression: Expression) -> Expression:
    """An expression's value to `KEPT_BITS` bits, with derivatives of 0."""
    exponent = ca.floor(ca.log(ca.fabs(expression) + SMALLEST) / log(2.0))
    # CasADi's SX knows no other operation that stops derivatives: those of `floor` are 0.
    last = 2 ** (exponent - KEPT_BITS)
    return ca.floor(expression / last) * last


class RootFinder:
    """Newton's method for a residual.

    Its linear systems are solved by Householder's reflections, with rows in units of what their terms may be:
    the units of equations and unknowns make no difference.

    Attributes:
        step: one of its steps, as a function (unknowns, arguments) -> unknowns.
    """

    def __init__(
        self,
        residual: ca.Function,
        start: ca.Function,
        *,
        iterations: int,
        damping: Sequence[float] = (1.0,),
    ) -> None:
        """Of a function (unknowns (n,), arguments) -> residual (n,).

        Args:
            residual: whose root is wanted.
            start: function (arguments, hint) -> (n,), at which the iterations start.
            iterations: so many.
            damping: shares of a step, descending; of several that which leaves the smallest further step
                [Deuflhard: Newton Methods for Nonlinear Problems, 2004, sec. 3.3] is taken.
        """
        self._residual, self._iterations = residual, iterations
        self._unknowns = ca.SX.sym("unknowns", residual.size1_in(0))
        self._given = ca.SX.sym("given", residual.size1_in(1))
        self._factors, self._solve = self._linear()
        self.step = self._step(damping)
        self._search = self._searching(start)

    def root(self, given: Expression, hint: Expression) -> Expression:
        """The unknowns (n,) for which the residual is 0; not a number where no iteration leads to any.

        Args:
            given: the arguments.
            hint: what else the start is made of, of which derivatives make no difference.
        """
        still = held_still(given)
        # What a call that is not written out has as derivatives is held still as well: none.
        found = held_still(self._search(still, held_still(hint)))
        *factors, sizes = self._factors.call([found, still])
        solved = ca.fabs(self._residual(found, still)) <= SOLVED * sizes
        for _ in range(ORDERS):
            found = found - self._solve(self._residual(found, given), *factors, sizes)
        # A factor: derivatives of what is no number are none either, where those of a branch would be 0.
        return found * ca.if_else(ca.sum1(solved) == solved.shape[0], 1, ca.SX.nan())

    def _searching(self, start: ca.Function) -> ca.Function:
        # The iterations, as a call that is not written out: so expressions stay small, and no more iterations
        # are made than are needed.
        given, hint = (ca.MX.sym("any", start.size1_in(place)) for place in range(2))
        found = self._continued(self._iterations)(start(given, hint), given)
        options = {"never_inline": True, "is_diff_in": [False, False], "is_diff_out": [False]}
        return ca.Function("search", [given, hint], [found], options)

    def _continued(self, iterations: int) -> ca.Function:
        # At most so many.
        unknowns = ca.MX.sym("unknowns", self._unknowns.shape[0])
        given = ca.MX.sym("given", self._given.shape[0])
        found = self.step(unknowns, given)
        if iterations > 1:
            near = ca.fabs(found - unknowns) <= NEAR * ca.fabs(found)
            further = self._continued(iterations - 1)(found, given)
            found = ca.if_else(ca.sum1(near) == near.shape[0], found, further, True)
        return ca.Function("continued", [unknowns, given], [found])

    def _linear(self) -> tuple[ca.Function, ca.Function]:
        # Factors of the Jacobian with the sizes of its rows, and what solves with them.
        unknowns, given = self._unknowns, self._given
        residual = self._residual(unknowns, given)
        jacobian, direct = ca.jacobian(residual, unknowns), ca.jacobian(residual, given)
        sizes = ca.fabs(jacobian) @ ca.fabs(unknowns) + ca.fabs(direct) @ ca.fabs(given)
        blocks = _Blocks(ca.diag(_inverse(sizes)) @ jacobian)
        function = ca.Function("factors", [unknowns, given], [*blocks.factors, sizes])
        symbols = [ca.SX.sym("any", one.sparsity()) for one in (*blocks.factors, sizes)]
        right = ca.SX.sym("right", unknowns.shape[0])
        solution = blocks.solution(_inverse(symbols[-1]) * right, symbols[:-1])
        return function, ca.Function("solve", [right, *symbols], [solution])

    def _step(self, damping: Sequence[float]) -> ca.Function:
        unknowns, given = self._unknowns, self._given
        factors = self._factors.call([unknowns, given])
        step = self._solve(self._residual(unknowns, given), *factors)
        sizes = _inverse(ca.fabs(unknowns) + ca.fabs(step))

        def left(there: ca.SX) -> ca.SX:
            size = ca.sumsqr(self._solve(self._residual(there, given), *factors) * sizes)
            # What is no number is farther than all that is one.
            return ca.if_else(size < ca.inf, size, ca.inf)

        best = unknowns - damping[-1] * step
        least = left(best) if damping[1:] else None
        for share in reversed(damping[:-1]):
            there = unknowns - share * step
            now = left(there)
            better = now < least
            best, least = ca.if_else(better, there, best), ca.if_else(better, now, least)
        return ca.Function("newton", [unknowns, given], [ca.densify(best)])


class _Blocks:
    # A linear system, block by block where unknowns follow from each other in one direction only: what does
    # not depend on something depends on it by exactly 0, where reflections of all rows would leave rounding.

    def __init__(self, matrix: ca.SX) -> None:
        count, rows, columns, *ends, _, _ = matrix.sparsity().btf()
        if ends[0] != ends[1]:
            # Of which no block by itself can be solved.
            count, ends = 1, [[0, matrix.shape[0]]]
        each = [slice(ends[0][place], ends[0][place + 1]) for place in range(count)]
        # Rows of a block have no columns of later ones.
        self._parts = [(rows[own], columns[own], columns[: own.start]) for own in each]
        self._order = columns
        self._reflected = [ca.qr_sparse(matrix[own, others]) for own, others, _ in self._parts]
        self.factors = [
            factor
            for (own, _, before), found in zip(self._parts, self._reflected, strict=True)
            for factor in (*found[:3], matrix[own, before])
        ]

    def solution(self, right: ca.SX, factors: Sequence[ca.SX]) -> ca.SX:
        found = ca.SX(0, 1)
        for place, (own, *_) in enumerate(self._parts):
            *reflected, across = factors[4 * place : 4 * place + 4]
            left = right[own] - across @ found
            found = ca.vertcat(found, ca.qr_solve(left, *reflected, *self._reflected[place][3:]))
        return found[[self._order.index(place) for place in range(len(self._order))]]


def newton_step(residual: ca.Function) -> ca.Function:
    """One step of Newton's method, as a function (unknowns, arguments) -> unknowns; see `RootFinder`."""
    unknowns, given = (ca.SX.sym("any", residual.size1_in(place)) for place in range(2))
    start = ca.Function("start", [given, unknowns], [unknowns])
    return RootFinder(residual, start, iterations=1).step


def _inverse(sizes: ca.SX) -> ca.SX:
    # 1 where there is none.
    return 1 / ca.if_else(sizes > 0, sizes, 1)
