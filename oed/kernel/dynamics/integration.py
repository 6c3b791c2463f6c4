"""How states follow their derivatives over a period: rules that expressions of any kind can take."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.roots import RootFinder, newton_step

NODES = (0.4 - np.sqrt(6) / 10, 0.4 + np.sqrt(6) / 10, 1.0)
"""Where in a step the stages of Radau's method lie."""
ITERATIONS = 12
"""Of Newton's method in a step, at most: 1 to 6 of them lead to 1e-12 where steps are fine enough to be
accurate, and no more are made than are needed.
"""
PREDICTIONS, GROWTH = 10, 3.0
"""Steps of linearised Euler that go before a step's first stage, and how each is longer than the one before:
fast parts are over before long steps are taken.
"""


def runge_kutta(
    derivative: Callable[[Expression], Expression], state: Expression, period: Expression, steps: int
) -> Expression:
    """The state after a period, by the classical Runge-Kutta method of fourth order [Kutta, Beitrag zur
    näherungsweisen Integration totaler Differentialgleichungen, 1901].

    Args:
        derivative: of a state by time, inputs held.
        state: at the period's begin.
        period: its duration [s].
        steps: of equal length.
    """
    length = period / steps
    for _ in range(steps):
        first = derivative(state)
        second = derivative(state + length / 2 * first)
        third = derivative(state + length / 2 * second)
        fourth = derivative(state + length * third)
        state = state + length / 6 * (first + 2 * second + 2 * third + fourth)
    return state


def rodas3(
    derivative: Callable[[ca.SX], ca.SX],
    jacobian: Callable[[ca.SX], ca.SX],
    state: ca.SX,
    period: ca.SX,
    steps: int,
) -> tuple[ca.SX, ca.SX]:
    """The state after a period, and its mean derivative in it, by the L-stable Rosenbrock method RODAS3.

    Of third order, and stable however fast the state settles [Sandu and others: Benchmarking stiff ODE
    solvers for atmospheric chemistry problems II, 1997]. A period of no time changes nothing and has the
    derivative at its begin.

    Args:
        derivative: of a state by time, inputs held, (states,).
        jacobian: of that by the state, (states, states).
        state: at the period's begin, (states,).
        period: its duration [s].
        steps: of equal length.
    """
    length, mean = period / steps, 0 * state
    for _ in range(steps):
        solved = _eliminated(2 * ca.SX.eye(state.shape[0]) - length * jacobian(state))
        slope = derivative(state)
        first = solved(slope)
        second = solved(slope + 4 * first)
        state += length * 2 * first
        third = solved(derivative(state) + first - second)
        state += length * third
        fourth = solved(derivative(state) + first - second - 8 / 3 * third)
        state += length * fourth
        mean += (2 * first + third + fourth) / steps
    return state, mean


class Radau:
    """The three-stage Radau IIA method of order 5 for x' = f(x, y, u), 0 = g(x, y, u): stiffly accurate, so
    that the last stage is the state after a step [Hairer, Wanner: Solving Ordinary Differential Equations II,
    1996, sec. IV.5 and VI.1].
    """

    def __init__(self, rates: ca.Function, constraints: ca.Function) -> None:
        """Of a differential-algebraic system of index 1.

        Args:
            rates: function (x (n,), y (m,), given) -> f (n,).
            constraints: function of the same -> g (m,).
        """
        self._states, self._algebraic = rates.size1_in(0), rates.size1_in(1)
        stages, euler = self._stages(rates, constraints), newton_step(self._euler(rates, constraints))
        self._solver = RootFinder(stages, self._predicted(euler), iterations=ITERATIONS)

    def step(
        self, state: Expression, algebraic: Expression, given: Expression, length: Expression
    ) -> tuple[Expression, Expression]:
        """The states and the algebraic ones after a step, (n,) and (m,).

        Args:
            state: at its begin, (n,).
            algebraic: about there, (m,).
            given: further arguments, held.
            length: of the step [s].
        """
        found = self._solver.root(ca.vertcat(state, given, length), algebraic)
        size = self._states + self._algebraic
        _, state, algebraic = ca.vertsplit(found, [0, 2 * size, 2 * size + self._states, 3 * size])
        return state, algebraic

    def _predicted(self, euler: ca.Function) -> ca.Function:
        # The stages, about, of (their equations' arguments, algebraic states about the begin).
        arguments = ca.MX.sym("arguments", euler.size1_in(1))
        algebraic = ca.MX.sym("algebraic", self._algebraic)
        now, length = ca.vertcat(arguments[: self._states], algebraic), arguments[-1]
        given = arguments[self._states : -1]
        geometric = [NODES[0] * GROWTH**-power for power in range(PREDICTIONS, 0, -1)]
        stages, reached = [], 0.0
        for fraction in (*geometric, *NODES):
            at = ca.vertcat(now[: self._states], given, (fraction - reached) * length)
            now, reached = euler(now, at), fraction
            stages.append(now)
        return ca.Function("predicted", [arguments, algebraic], [ca.vertcat(*stages[-len(NODES) :])])

    def _euler(self, rates: ca.Function, constraints: ca.Function) -> ca.Function:
        # The equations of a step by the implicit Euler method.
        unknowns = ca.SX.sym("end", self._states + self._algebraic)
        state, given = ca.SX.sym("state", self._states), ca.SX.sym("given", rates.size1_in(2))
        length = ca.SX.sym("length")
        at = (unknowns[: self._states], unknowns[self._states :], given)
        residual = ca.vertcat(at[0] - state - length * rates(*at), constraints(*at))
        return ca.Function("euler", [unknowns, ca.vertcat(state, given, length)], [residual])

    def _stages(self, rates: ca.Function, constraints: ca.Function) -> ca.Function:
        # Their equations, multiplied by the inverse of the method's matrix, so that stages meet in the state
        # alone.
        count, size = len(NODES), self._states + self._algebraic
        unknowns = ca.SX.sym("stages", count * size)
        state, given = ca.SX.sym("state", self._states), ca.SX.sym("given", rates.size1_in(2))
        length, inverse = ca.SX.sym("length"), np.linalg.inv(collocation(NODES))
        each = [unknowns[place * size : (place + 1) * size] for place in range(count)]
        moved = [one[: self._states] - state for one in each]
        residuals = []
        for place, one in enumerate(each):
            at = (one[: self._states], one[self._states :], given)
            reached = sum(float(inverse[place, other]) * moved[other] for other in range(count))
            residuals += [reached - length * rates(*at), constraints(*at)]
        arguments = ca.vertcat(state, given, length)
        return ca.Function("stages", [unknowns, arguments], [ca.vertcat(*residuals)])


def collocation(nodes: Sequence[float]) -> Array:
    """The matrix A of the collocation method with these nodes c (s,): the integrals of Lagrange's polynomials
    up to each, (s, s), from A c^(k - 1) = c^k / k for k = 1 .. s.
    """
    powers = np.vander(nodes, increasing=True)
    return np.asarray(
        powers * np.array(nodes)[:, None] / np.arange(1, len(nodes) + 1) @ np.linalg.inv(powers)
    )


def _eliminated(matrix: ca.SX) -> Callable[[ca.SX], ca.SX]:
    # What solves matrix @ x = b for x, by elimination without pivots, which skips what is 0 by structure.
    count = matrix.shape[0]
    rows = [[matrix[row, column] for column in range(count)] for row in range(count)]
    for place, pivot in enumerate(rows):
        for row in rows[place + 1 :]:
            if not row[place].is_zero():
                row[place] /= pivot[place]
                for column in range(place + 1, count):
                    row[column] -= row[place] * pivot[column]

    def solved(wanted: ca.SX) -> ca.SX:
        found = ca.vertsplit(wanted)
        for place, row in enumerate(rows):
            found[place] -= sum((row[other] * found[other] for other in range(place)), ca.SX(0))
        for place in reversed(range(count)):
            later = (rows[place][other] * found[other] for other in range(place + 1, count))
            found[place] = (found[place] - sum(later, ca.SX(0))) / rows[place][place]
        return ca.vertcat(*found)

    return solved
