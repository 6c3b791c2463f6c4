"""Solve equations inside CasADi expressions, with exact derivatives of every order."""

from __future__ import annotations

import casadi as ca

from oed.kernel.dynamics.expression import Expression

SOLVED = 1e-10
"""Largest residual of a solved equation, as a share of the terms of its linearisation."""


class RootSolver:
    """Newton's method for equations r(x, p) = 0, by CasADi's root finder.

    The units of equations and unknowns make no difference. Derivatives follow from the implicit function
    theorem. What does not depend on an argument by the structure of the equations has a derivative of
    exactly 0, so that rounding never makes a parameter look identifiable.
    """

    def __init__(self, residual: ca.Function, iterations: int) -> None:
        """Prepare the method for some equations.

        Args:
            residual: function (unknowns (n,), arguments) -> residual (n,).
            iterations: number of Newton steps; as many are always taken, because no tolerance fits the
                unknown units of the equations.
        """
        unknowns, arguments = (ca.SX.sym("any", residual.size1_in(place)) for place in range(2))
        rows, weights = residual(unknowns, arguments), ca.SX.sym("weights", unknowns.shape[0])
        terms = ca.fabs(ca.jacobian(rows, unknowns)) @ ca.fabs(unknowns)
        terms += ca.fabs(ca.jacobian(rows, arguments)) @ ca.fabs(arguments)
        solved = ca.sum1(ca.fabs(rows) <= SOLVED * terms) == rows.shape[0]
        weighted = ca.Function("weighted", [unknowns, ca.vertcat(arguments, weights)], [weights * rows])
        # Equations that are not solved give NaN here, not an exception in the middle of a search.
        options = {"abstol": 0.0, "abstolStep": 0.0, "max_iter": iterations, "error_on_fail": False}
        self._root = ca.rootfinder("root", "fast_newton", weighted, options)
        # Neither depends on anything as far as derivatives are concerned.
        still = {"never_inline": True, "is_diff_in": [False, False]}
        largest = ca.vertcat(*(ca.norm_inf(row) for row in ca.vertsplit(ca.jacobian(rows, unknowns))))
        inverse = ca.densify(1 / ca.if_else(largest > 0, largest, 1))
        self._weights = ca.Function("weights", [unknowns, arguments], [inverse], still)
        factor = ca.if_else(solved, 1, ca.SX.nan())
        self._factor = ca.Function("factor", [unknowns, arguments], [factor], still)

    def root(self, guess: Expression, arguments: Expression) -> Expression:
        """Return the unknowns (n,) that solve the equations; NaN where Newton's method does not solve them.

        Args:
            guess: unknowns to begin at, (n,); derivatives do not depend on it.
            arguments: arguments of the equations.
        """
        root = self._root(guess, ca.vertcat(arguments, self._weights(guess, arguments)))
        # A factor makes the derivatives NaN too; those of a branch would be 0.
        return root * self._factor(root, arguments)
