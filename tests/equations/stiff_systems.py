"""Stiff systems for tests: as texts, and once more as plain formulas for independent integrators."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

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


def sundials(
    rates: Rates, start: Sequence[float], inputs: Sequence[float], parameters: Sequence[float], seconds: float
) -> tuple[np.ndarray, np.ndarray]:
    """The state and its derivatives by (parameters, start) after a time, by CVODES: the variational equations
    in units of what they come to.
    """
    n, width = len(start), len(parameters) + len(start)
    x, s, p = ca.SX.sym("x", n), ca.SX.sym("S", n, width), ca.SX.sym("p", len(parameters))
    right = rates(x, ca.SX(ca.DM(inputs)), p)
    direct = ca.horzcat(ca.jacobian(right, p), ca.SX(n, n))
    whole = ca.vertcat(x, ca.vec(s))
    derivative = ca.vertcat(right, ca.vec(ca.jacobian(right, x) @ s + direct))
    begin = np.concatenate([start, np.hstack([np.zeros((n, len(parameters))), np.eye(n)]).ravel(order="F")])
    units = np.ones(len(begin))
    for tolerance in (1e-8, 1e-13):
        scaled = ca.SX.sym("scaled", len(begin))
        own = ca.substitute(derivative, whole, units * scaled) / units
        options = {"reltol": tolerance, "abstol": 1e-2 * tolerance, "max_num_steps": 1_000_000}
        dae = {"x": scaled, "p": p, "ode": own}
        found = ca.integrator("exact", "cvodes", dae, 0.0, seconds, options)(x0=begin / units, p=parameters)
        end = np.array(found["xf"]).ravel() * units
        units = np.where(end == 0, 1.0, np.abs(end))
    return end[:n], end[n:].reshape(width, n).T
