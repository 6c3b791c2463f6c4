"""Systems with outputs, and the key of a study that gives one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, ClassVar

import casadi as ca

from oed.equations.dimensions import Dimension, Quantity
from oed.equations.initial_values import InitialValue
from oed.foundation.component import Component
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.integration import Radau, runge_kutta
from oed.kernel.dynamics.roots import RootSolver
from oed.kernel.dynamics.system import System, step_symbols

NEWTON_STEPS = 50
"""Newton steps from the guess of algebraic states, which may be far off."""
NONE = ca.SX(0, 1)
"""Algebraic states, or equations of them, of a system without any."""


class OutputSystem(System, ABC):
    """A system with outputs that can be read; they are among its signals.

    Attributes:
        dimensions: dimensions of states, inputs, parameters, outputs and whatever else has a name.
        output_dimensions: dimensions of the outputs, by name.
    """

    dimensions: ClassVar[Mapping[str, Dimension]]
    output_dimensions: ClassVar[Mapping[str, Dimension]]

    @abstractmethod
    def values_at(self, state: Expression, inputs: Expression, parameters: Expression) -> Mapping[str, Any]:
        """Return the values of all that `dimensions` names, SI.

        Args:
            state: states, (states,), SI.
            inputs: inputs, (inputs,), SI.
            parameters: parameters, (p,), SI.
        """

    @abstractmethod
    def outputs(
        self, state: Expression, inputs: Expression, parameters: Expression
    ) -> Mapping[str, Expression]:
        """Return the outputs by name, SI.

        Args:
            state: states, (states,), SI.
            inputs: inputs, (inputs,), SI.
            parameters: parameters, (p,), SI.
        """

    @property
    @abstractmethod
    def scheme(self) -> tuple[str, int]:
        """Integrator ("runge_kutta" or "radau"), and number of its steps in a period."""

    @abstractmethod
    def rates_at(
        self, state: Expression, algebraic: Expression, inputs: Expression, parameters: Expression
    ) -> Expression:
        """Return the derivatives of all states by time, (states,), SI.

        Args:
            state: states, (states,), SI.
            algebraic: algebraic states, (a,), SI.
            inputs: inputs, (inputs,), SI.
            parameters: parameters, (p,), SI.
        """

    @property
    def algebraic_guesses(self) -> Sequence[float]:
        """Values of the algebraic states at which solving for them begins, (a,), SI."""
        return ()

    def constraints_at(
        self, state: Expression, algebraic: Expression, inputs: Expression, parameters: Expression
    ) -> Expression:
        """Return the equations of the algebraic states, as expressions that are 0, (a,).

        Args:
            state: states, (states,), SI.
            algebraic: algebraic states, (a,), SI.
            inputs: inputs, (inputs,), SI.
            parameters: parameters, (p,), SI.
        """
        return NONE

    @property
    def integrates(self) -> bool:
        """True if the system has states, which are integrated."""
        return bool(self.states)

    def step(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """Return the state after a period, by the steps of the system's scheme."""
        integrator, steps = self.scheme
        if not self.states:
            return state
        if integrator == "radau":
            return _radau_stepper(self)(state, inputs, parameters, period)
        return runge_kutta(lambda now: self.rates_at(now, NONE, inputs, parameters), state, period, steps)

    def solve_algebraic(self, state: Expression, inputs: Expression, parameters: Expression) -> Expression:
        """Return the algebraic states (a,) that follow, SI; NaN where their equations are not solved.

        Args:
            state: states, (states,), SI.
            inputs: inputs, (inputs,), SI.
            parameters: parameters, (p,), SI.
        """
        if not self.algebraic_guesses:
            return NONE
        return _algebraic_solver(self)(state, inputs, parameters)

    def signals(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Mapping[str, Expression]:
        """Return the outputs in a state; those in the middle of a period for its means, to second order."""
        instant = not self.states or (not isinstance(period, ca.MX) and ca.SX(period).is_zero())
        at = state if instant else self.step(state, inputs, parameters, period / 2)
        return self.outputs(at, inputs, parameters)


def by_name(names: Iterable[str], *columns: Expression) -> dict[str, Expression]:
    """Return the entries of column vectors, one after the other, by name."""
    return dict(zip(names, ca.vertsplit(ca.vertcat(*columns)), strict=True))


def equation_function(system: OutputSystem, name: str) -> ca.Function:
    """Return `rates_at` or `constraints_at` as a function (states, algebraic, (inputs, parameters))."""
    state, inputs, parameters, _ = step_symbols(system)
    algebraic = ca.SX.sym("algebraic", len(system.algebraic_guesses))
    rows = ca.densify(ca.SX(getattr(system, name)(state, algebraic, inputs, parameters)))
    return ca.Function(name, [state, algebraic, ca.vertcat(inputs, parameters)], [rows])


@lru_cache(maxsize=32)
def _algebraic_solver(system: OutputSystem) -> ca.Function:
    state, inputs, parameters, _ = step_symbols(system)
    arguments = ca.vertcat(state, inputs, parameters)
    unknowns, known = (
        ca.SX.sym("algebraic", len(system.algebraic_guesses)),
        ca.SX.sym("known", arguments.shape),
    )
    split = len(system.states)
    rows = equation_function(system, "constraints_at")(known[:split, :], unknowns, known[split:, :])
    solver = RootSolver(ca.Function("constraints", [unknowns, known], [rows]), NEWTON_STEPS)
    root = solver.root(ca.SX(ca.DM(system.algebraic_guesses)), arguments)
    return ca.Function("algebraic", [state, inputs, parameters], [root])


@lru_cache(maxsize=32)
def _radau_stepper(system: OutputSystem) -> ca.Function:
    state, inputs, parameters, period = symbols = step_symbols(system)
    functions = (equation_function(system, name) for name in ("rates_at", "constraints_at"))
    method, held, steps = Radau(*functions), ca.vertcat(inputs, parameters), system.scheme[1]
    algebraic = system.solve_algebraic(state, inputs, parameters)
    for _ in range(steps):
        state, algebraic = method.step(state, algebraic, held, period / steps)
    return ca.Function("radau", symbols, [state])


class SystemKeys(Component, ABC):
    """A study's key `system`."""

    kind: str

    @property
    @abstractmethod
    def system(self) -> OutputSystem:
        """The system.

        Raises:
            ProblemError: mistakes in it, by key and column.
        """

    @property
    @abstractmethod
    def initial_values(self) -> Mapping[str, InitialValue]:
        """Initial values of all states, by name.

        Raises:
            ProblemError: no quantities, different units, or bounds that do not rise.
        """

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """Parameters and initial values as texts or numbers of the study, by name."""
        return {}
