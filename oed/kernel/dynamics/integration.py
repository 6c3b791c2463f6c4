"""How states follow their derivatives over a period: rules that expressions of any kind can take."""

from __future__ import annotations

from collections.abc import Callable

from oed.kernel.dynamics.expression import Expression


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
