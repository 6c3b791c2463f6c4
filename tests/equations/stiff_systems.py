"""Stiff systems for tests: as texts, and once more as plain formulas for independent integrators."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from oed.equations.system import Equations

ROBERTSON: dict[str, Any] = {
    "states": {"a": "", "b": "", "c": ""},
    "derivatives": {"a": "-slow + back", "b": "slow - back - fast", "c": "fast"},
    "define": {"slow": "k1 * a", "back": "k3 * b * c", "fast": "k2 * b^2"},
    "parameters": {"k1": "0.04 1/s", "k2": "3e7 1/s", "k3": "1e4 1/s"},
    "outputs": {"heavy": "a", "light": "b"},
    "integrator": "radau",
}
"""Three reactions [Robertson, The solution of a set of reaction rate equations, 1966]."""
CONSERVED: dict[str, Any] = {
    **ROBERTSON,
    "states": {"a": "", "b": ""},
    "derivatives": {name: ROBERTSON["derivatives"][name] for name in "ab"},
    "algebraic_states": {"c": "0.5"},
    "algebraic": {"c": "a + b + c - 1"},
    "outputs": {"rest": "c"},
}
"""The same: what is neither a nor b is c."""
CSTR: dict[str, Any] = {
    "states": {"c": "mol/m^3", "T": "K"},
    "derivatives": {
        "c": "flow / volume * (c_feed - c) - rate",
        "T": "flow / volume * (T_feed - T) + heat / capacity * rate + cooling / volume * (T_jacket - T)",
    },
    "define": {"rate": "k0 * exp(-activation / T) * c"},
    "inputs": {"T_feed": "K"},
    "parameters": {
        "k0": "7.2e10 1/min",
        "activation": "8750 K",
        "heat": "5e4 J/mol",
        "capacity": "239 kJ/m^3/K",
        "cooling": "209.2 l/min",
        "flow": "100 l/min",
        "volume": "100 l",
        "c_feed": "1 mol/l",
        "T_jacket": "300 K",
    },
    "outputs": {"temperature": "T"},
    "integrator": "radau",
}
"""A stirred tank with a reaction that heats it; numbers of the usual example [Seborg, Edgar, Mellichamp,
Doyle: Process Dynamics and Control, 2011, example 2.5]."""


def system(keys: dict[str, Any], **changes: Any) -> Equations:
    return Equations(**{**keys, **changes})


def robertson(x: ca.SX, _: ca.SX, p: ca.SX) -> ca.SX:
    slow, back, fast = p[0] * x[0], p[2] * x[1] * x[2], p[1] * x[1] ** 2
    return ca.vertcat(back - slow, slow - back - fast, fast)


def cstr(x: ca.SX, u: ca.SX, p: ca.SX) -> ca.SX:
    k0, activation, heat, capacity, cooling, flow, volume, feed, jacket = ca.vertsplit(p)
    rate = k0 * ca.exp(-activation / x[1]) * x[0]
    warmed = flow * (u - x[1]) + cooling * (jacket - x[1])
    return ca.vertcat(flow / volume * (feed - x[0]) - rate, warmed / volume + heat / capacity * rate)


Rates = Callable[[ca.SX, ca.SX, ca.SX], ca.SX]


def reference(
    rates: Rates, start: Sequence[float], inputs: Sequence[float], parameters: Sequence[float], seconds: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the state after a time and its derivatives by (parameters, start), by SciPy's `solve_ivp`."""
    n, width = len(start), len(parameters) + len(start)
    x, s, p = ca.SX.sym("x", n), ca.SX.sym("S", n, width), ca.SX.sym("p", len(parameters))
    right = rates(x, ca.SX(ca.DM(inputs)), p)
    direct = ca.horzcat(ca.jacobian(right, p), ca.SX(n, n))
    whole = ca.vertcat(x, ca.vec(s))
    derivative = ca.vertcat(right, ca.vec(ca.jacobian(right, x) @ s + direct))
    slope = ca.Function("slope", [whole, p], [derivative])
    bend = ca.Function("bend", [whole, p], [ca.densify(ca.jacobian(derivative, whole))])
    begin = np.concatenate([start, np.hstack([np.zeros((n, len(parameters))), np.eye(n)]).ravel(order="F")])
    sizes = np.ones(len(begin))
    # The first solution says how large everything becomes.
    for tolerance in (1e-6, 1e-9):
        solution = solve_ivp(
            lambda _, y: np.array(slope(y, parameters)).ravel(),
            (0.0, seconds),
            begin,
            method="Radau",
            jac=lambda _, y: np.array(bend(y, parameters)),
            rtol=tolerance,
            atol=1e-2 * tolerance * sizes,
        )
        end = solution.y[:, -1]
        sizes = np.where(end == 0, 1.0, np.abs(end))
    return end[:n], end[n:].reshape(width, n).T
