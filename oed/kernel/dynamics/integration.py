"""Integration of states over a period: rules that expressions of any kind can take."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.roots import RootSolver

POINTS = ca.collocation_points(3, "radau")
"""Points of a step, as shares of its length, at which the equations hold."""
NEWTON_STEPS = 30
"""Newton steps for the equations of a step: 6 do where steps are short enough to be accurate, 25 for one step
from the begin of Robertson's reactions to far behind their fast part.
"""


def runge_kutta(
    derivative: Callable[[Expression], Expression], state: Expression, period: Expression, steps: int
) -> Expression:
    """The state after a period, by the classical Runge-Kutta method of fourth order [Kutta, Beitrag zur
    näherungsweisen Integration totaler Differentialgleichungen, 1901].

    Args:
        derivative: time derivative of a state, inputs held.
        state: state at the period's begin.
        period: duration of the period [s].
        steps: number of steps of equal length.
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
        derivative: time derivative of a state, inputs held, (states,).
        jacobian: Jacobian of the derivative by the state, (states, states).
        state: state at the period's begin, (states,).
        period: duration of the period [s].
        steps: number of steps of equal length.
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
    """The Radau IIA method of fifth order for x' = f(x, y, u), 0 = g(x, y, u): collocation at three points
    with the last one at the step's end [Hairer, Wanner: Solving Ordinary Differential Equations II, 1996,
    sec. IV.5 and VI.1].
    """

    def __init__(self, rates: ca.Function, constraints: ca.Function) -> None:
        """Prepare the method for a differential-algebraic system of index 1.

        Args:
            rates: function (x (n,), y (m,), u) -> f (n,).
            constraints: function of the same arguments -> g (m,).
        """
        self._states, self._stages = rates.size1_in(0), len(POINTS)
        self._solver = RootSolver(_collocation_equations(rates, constraints), NEWTON_STEPS)

    def step(
        self, state: Expression, algebraic: Expression, held: Expression, length: Expression
    ) -> tuple[Expression, Expression]:
        """Return the states (n,) and the algebraic states (m,) after a step.

        Args:
            state: states at the step's begin, (n,).
            algebraic: algebraic states about there, (m,).
            held: further arguments u of the system.
            length: duration of the step [s].
        """
        begin = ca.vertcat(state, algebraic)
        stages = self._solver.root(ca.repmat(begin, self._stages, 1), ca.vertcat(state, held, length))
        # Two indices: with one, CasADi makes the empty rest of a single number a row.
        end = stages[-begin.shape[0] :, :]
        return end[: self._states, :], end[self._states :, :]


def _collocation_equations(rates: ca.Function, constraints: ca.Function) -> ca.Function:
    """Return the function ((x, y) at all points, (x at the begin, u, length)) -> residual."""
    states, size = rates.size1_in(0), rates.size1_in(0) + rates.size1_in(1)
    stages = ca.SX.sym("stages", len(POINTS) * size)
    begin, held = ca.SX.sym("begin", states), ca.SX.sym("held", rates.size1_in(2))
    length = ca.SX.sym("length")
    points = ca.vertsplit(stages, size)
    derivatives, _, _ = ca.collocation_coeff(POINTS)
    # A polynomial through the begin and all points has these derivatives, multiplied by the step's length.
    slopes = ca.horzcat(begin, *(point[:states, :] for point in points)) @ derivatives
    residual = []
    for place, point in enumerate(points):
        values = point[:states, :], point[states:, :], held
        residual += [slopes[:, place] - length * rates(*values), constraints(*values)]
    return ca.Function("stages", [stages, ca.vertcat(begin, held, length)], [ca.vertcat(*residual)])


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
        solution = ca.vertsplit(wanted)
        for place, row in enumerate(rows):
            solution[place] -= sum((row[column] * solution[column] for column in range(place)), ca.SX(0))
        for place in reversed(range(count)):
            later = (rows[place][column] * solution[column] for column in range(place + 1, count))
            solution[place] = (solution[place] - sum(later, ca.SX(0))) / rows[place][place]
        return ca.vertcat(*solution)

    return solved
