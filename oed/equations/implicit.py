"""Equations that are solved: algebraic ones at an instant, and those of Radau's steps over a period."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca

from oed.equations.grammar import Expression
from oed.foundation.errors import Issue
from oed.foundation.text import listing
from oed.kernel.dynamics.integration import Radau
from oed.kernel.dynamics.roots import Solver

if TYPE_CHECKING:
    from oed.equations.system import Equations

NEWTON_STEPS = 50
"""Newton steps from the guess of algebraic states, which may be far off."""


@lru_cache(maxsize=32)
def rates_of(system: Equations) -> ca.Function:
    """The derivatives by time (states,), as a function (states, algebraic states, given) with `given` the
    inputs and the parameters.
    """
    return _function(system, system.rates)


@lru_cache(maxsize=32)
def constraints_of(system: Equations) -> ca.Function:
    """What is 0 (algebraic states,), as a function like `rates_of`."""
    return _function(system, system.constraints)


@lru_cache(maxsize=32)
def algebraic_solver(system: Equations) -> ca.Function:
    """The function (states, inputs, parameters) -> algebraic states."""
    state, inputs, parameters, _ = _symbols(system)
    every = ca.vertcat(state, inputs, parameters)
    unknowns, given = ca.SX.sym("algebraic", len(system.guesses)), ca.SX.sym("given", every.shape[0])
    split = len(system.states)
    residual = constraints_of(system)(given[:split], unknowns, given[split:])
    function = ca.Function("constraints", [unknowns, given], [residual])
    guess = ca.SX(ca.DM([value for _, value, _ in system.guesses]))
    root = Solver(function, NEWTON_STEPS).root(guess, every)
    return ca.Function("algebraic", [state, inputs, parameters], [root])


@lru_cache(maxsize=32)
def radau_stepper(system: Equations) -> ca.Function:
    """The function (state, inputs, parameters, period [s]) -> next state, by the Radau IIA method."""
    state, inputs, parameters, period = given = _symbols(system)
    method, held = Radau(rates_of(system), constraints_of(system)), ca.vertcat(inputs, parameters)
    algebraic = algebraic_solver(system)(state, inputs, parameters) if system.guesses else ca.SX(0, 1)
    for _ in range(system.substeps):
        state, algebraic = method.step(state, algebraic, held, period / system.substeps)
    return ca.Function("radau", given, [state])


def index_issues(system: Equations) -> list[Issue]:
    """Why no numbers let the algebraic equations be solved for the algebraic states; [] if some may."""
    names = [name for name, *_ in system.guesses]
    slopes = constraints_of(system).jac_sparsity(0, 1)
    if ca.sprank(ca.DM(slopes)) == len(names):
        return []
    rows, columns = (set(one) for one in slopes.get_triplet())
    key = ("system", "algebraic")
    issues = [
        Issue((*key, name), f"there is no algebraic state in it; they are {listing(names)}")
        for place, name in enumerate(names)
        if place not in rows
    ]
    unknown = [name for place, name in enumerate(names) if place not in columns]
    what = (
        f"{listing(unknown)} is in none of them" if unknown else f"they cannot be solved for {listing(names)}"
    )
    return issues or [Issue(key, f"{what}: the index would not be 1")]


def _function(system: Equations, expressions: Sequence[Expression]) -> ca.Function:
    state, inputs, parameters, _ = _symbols(system)
    algebraic = ca.SX.sym("algebraic", len(system.guesses))
    values = system.named(state, inputs, parameters, algebraic)
    found = ca.vertcat(ca.SX(0, 1), *(one.casadi(values) for one in expressions))
    return ca.Function("equations", [state, algebraic, ca.vertcat(inputs, parameters)], [ca.densify(found)])


def _symbols(system: Equations) -> list[ca.SX]:
    return [
        ca.SX.sym("state", len(system.states)),
        ca.SX.sym("inputs", len(system.inputs)),
        ca.SX.sym("p", len(system.parameters)),
        ca.SX.sym("period"),
    ]
