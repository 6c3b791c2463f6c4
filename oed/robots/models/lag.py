"""A first-order lag: what follows what is asked for, exactly over any period."""

from __future__ import annotations

import casadi as ca

from oed.kernel.dynamics.expression import Expression

INSTANT = 0.8
"""Periods per lag below which series stand for exponentials."""
TERMS = 16
"""Of these series: their rest is below rounding."""
LONG = 500.0
"""Lags after which nothing is left of how a period began."""


def mean_of_lag(begin: Expression, asked: Expression, lag: Expression, period: Expression) -> Expression:
    """Mean of W + (Omega - W) e^(-t / tau) over a period: W + (Omega - W) (1 - e^-r) / r with r = T / tau.

    Args:
        begin: Omega, what it is when the period begins.
        asked: W, what it tends to.
        lag: tau [s].
        period: T [s]; 0 for the instant.
    """
    return asked + (begin - asked) * lag_shares(lag, period)[0]


def after_lag(begin: Expression, mean: Expression, lag: Expression, period: Expression) -> Expression:
    """What it is at a period's end, W + (Omega - W) e^-r, from its mean over the period.

    Args:
        begin: Omega, what it is when the period begins.
        mean: over the period.
        lag: tau [s].
        period: T [s].
    """
    return begin + (mean - begin) * lag_shares(lag, period)[1]


def lag_shares(lag: Expression, period: Expression) -> tuple[Expression, Expression]:
    """Mean p of e^(-t / tau) over a period, and by how many times the mean's change the end has changed.

    With r = T / tau these are (1 - e^-r) / r and (1 - e^-r) / (1 - p); by series for a period of little time
    or none. For lags down to and below 0, where a search may stray, p = tau / T: what it tends to.
    """
    lasting = LONG * lag > period
    gone = ca.logic_and(ca.logic_not(lasting), period > 0)
    ratio = period / ca.if_else(lasting, lag, 1.0)
    short = ratio < INSTANT
    # 1 - p = r / 2 (1 - r / 3 (1 - r / 4 ...)), with products: quotients take several times as long.
    small, half = ca.if_else(short, ratio, 0.0), 1.0
    for term in range(TERMS, 2, -1):
        half = 1 - small * (1 / term) * half
    series = 1 - 0.5 * small * half
    inside = ca.if_else(short, 1.0, ratio)
    whole = -ca.expm1(-inside) / inside
    mean = ca.if_else(short, series, whole)
    change = ca.if_else(short, 2 * series / half, inside * whole / (1 - whole))
    left = ca.if_else(gone, lag, 0.0) / ca.if_else(gone, period, 1.0)
    return ca.if_else(gone, left, mean), ca.if_else(gone, 1 / (1 - left), change)
