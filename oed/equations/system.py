"""A system given by its equations: differential ones of its states, algebraic ones, or a response alone."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca

from oed.equations.dimensions import Dimension, unit_of
from oed.equations.given import Readable
from oed.equations.grammar import Expression
from oed.equations.implicit import algebraic_solver, index_issues, radau_stepper
from oed.equations.reading import INTEGRATORS, Reader
from oed.foundation.errors import ProblemError
from oed.foundation.text import Unit
from oed.kernel.dynamics import expression as kernel
from oed.kernel.dynamics.integration import runge_kutta
from oed.kernel.dynamics.system import Input, Parameter


@dataclass(frozen=True, init=False)
class Equations(Readable):
    """States that follow their derivatives, and outputs that can be read; expressions are texts.

    Attributes:
        states: names.
        input_units: of the inputs held in each period, by name.
        values: nominal values of the parameters with their SI units, by name.
        rates: derivatives of the states by time, of states, inputs, parameters and `definitions`.
        guesses: of the algebraic states, with their SI units, by name: what solving for them begins at.
        constraints: of each the equation: what is 0, alike.
        definitions: names for parts of these, in an order in which each needs only those before it.
        responses: outputs, alike, by name.
        integrator: "runge_kutta", of fourth order and explicit, or "radau", of fifth order and implicit.
        substeps: its steps in a period.
        finer: number of times that these are more than the study's.
        written: quantities of the parameters as they were given, by name.
    """

    noun: ClassVar[str] = "system"
    states: tuple[str, ...]  # type: ignore[misc]  # Of each system its own.
    state_dimensions: tuple[Dimension, ...]
    input_units: tuple[tuple[str, Dimension], ...]
    values: tuple[tuple[str, float, Dimension], ...]
    rates: tuple[Expression, ...]
    guesses: tuple[tuple[str, float, Dimension], ...]
    constraints: tuple[Expression, ...]
    definitions: tuple[tuple[str, Expression], ...]
    responses: tuple[tuple[str, Expression], ...]
    integrator: str
    substeps: int
    finer: int = field(default=1, init=False)
    kind: str = field(default="equations", init=False)
    written: tuple[tuple[str, str], ...] = field(default=(), init=False, compare=False, repr=False)

    def __init__(
        self,
        *,
        parameters: Mapping[str, str | float],
        outputs: Mapping[str, str],
        states: Mapping[str, str] | None = None,
        derivatives: Mapping[str, str] | None = None,
        inputs: Mapping[str, str] | None = None,
        define: Mapping[str, str] | None = None,
        algebraic_states: Mapping[str, str | float] | None = None,
        algebraic: Mapping[str, str] | None = None,
        integrator: str = "runge_kutta",
        substeps: int | None = None,
    ) -> None:
        """Read the expressions, and check the units of all their terms.

        Args:
            parameters: nominal values with their units: {"k": "0.7 1/min"}.
            outputs: what can be read: {"y": "x / volume"}.
            states: their units: {"x": "mol"}; none where outputs follow from the inputs at once.
            derivatives: of every state by time: {"x": "-k * x + u"}.
            inputs: their units: {"u": "mol/s"}.
            define: names for parts of the expressions, in any order.
            algebraic_states: guesses with their units of what follows from `algebraic`: {"z": "1 mol"}.
            algebraic: for every algebraic state an equation, by what is 0: {"z": "z^2 - x * y"}. They have to
                be solvable for the algebraic states (a differential-algebraic system of index 1).
            integrator: "runge_kutta", or "radau" for stiff and differential-algebraic systems.
            substeps: steps of the integration in a period; 10 of runge_kutta and 4 of radau by default.

        Raises:
            ProblemError: every name, expression or unit that does not fit, by its key and column.
        """
        keys: dict[str, Mapping[str, Any]] = {
            "states": states or {},
            "inputs": inputs or {},
            "parameters": parameters,
            "define": define or {},
            "derivatives": derivatives or {},
            "algebraic_states": algebraic_states or {},
            "algebraic": algebraic or {},
            "outputs": outputs,
        }
        read = Reader(keys, integrator, substeps)
        dimensions, expressions = read.dimensions, read.expressions
        attributes = {
            "states": tuple(keys["states"]),
            "state_dimensions": tuple(dimensions[name] for name in keys["states"]),
            "input_units": tuple((name, dimensions[name]) for name in keys["inputs"]),
            "values": tuple((name, *value) for name, value in read.parameters.items()),
            "rates": tuple(expressions["derivatives"][name] for name in keys["states"]),
            "guesses": tuple((name, *value) for name, value in read.guesses.items()),
            "constraints": tuple(expressions["algebraic"][name] for name in keys["algebraic_states"]),
            "definitions": tuple((name, expressions["define"][name]) for name in read.order),
            "responses": tuple(expressions["outputs"].items()),
            "integrator": integrator,
            "substeps": INTEGRATORS[integrator] if substeps is None else substeps,
            "kind": "equations",
            "written": tuple((name, text) for name, text in parameters.items() if isinstance(text, str)),
        }
        for name, value in attributes.items():
            object.__setattr__(self, name, value)
        if issues := index_issues(self):
            raise ProblemError(issues)

    @cached_property
    def inputs(self) -> tuple[Input, ...]:  # type: ignore[override]
        """Each is a quantity of its own."""
        return tuple(Input(name, name, unit.text) for name, unit in self.input_units)

    @cached_property
    def state_units(self) -> tuple[str, ...]:  # type: ignore[override]
        """SI."""
        return tuple(one.text for one in self.state_dimensions)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """As given, SI."""
        return tuple(Parameter(name, value, unit.text) for name, value, unit in self.values)

    @cached_property
    def shown_units(self) -> Mapping[str, Unit]:
        """As parameters were given."""
        return {name: unit_of(text) for name, text in self.written}

    @property
    def when_not_finite(self) -> str:
        """Equations that are not solved have no value; steps that are too long lead astray."""
        if self.states and self.integrator == "runge_kutta":
            return "if the equations are stiff, take more `substeps` or `integrator: radau`"
        ways = ["take more substeps"] * bool(self.states) + ["guess algebraic_states better"] * bool(
            self.guesses
        )
        return f"if equations of it are not solved there, {' or '.join(ways)}" if ways else ""

    @cached_property
    def output_dimensions(self) -> dict[str, Dimension]:
        """Of the outputs, by name."""
        return {name: self.dimensions[name] for name, _ in self.responses}

    @cached_property
    def dimensions(self) -> dict[str, Dimension]:
        """Of all names; of an output that is called like something else the output's."""
        known = dict(zip(self.states, self.state_dimensions, strict=True))
        known |= dict(self.input_units) | {name: unit for name, _, unit in (*self.values, *self.guesses)}
        for name, one in self.definitions:
            known[name] = one.dimension(known) or Dimension()
        return {**known, **{name: one.dimension(known) or Dimension() for name, one in self.responses}}

    def values_at(
        self, state: kernel.Expression, inputs: kernel.Expression, parameters: kernel.Expression
    ) -> Mapping[str, Any]:
        """Expressions of all names, SI."""
        algebraic = algebraic_solver(self)(state, inputs, parameters) if self.guesses else ()
        values = self.named(state, inputs, parameters, algebraic)
        return {**values, **{name: one.casadi(values) for name, one in self.responses}}

    @property
    def integrates(self) -> bool:
        """Whether it has states."""
        return bool(self.states)

    def refined(self, times: int) -> Equations:
        """The system with so many times more substeps."""
        return self._changed(substeps=times * self.substeps, finer=times * self.finer)

    @property
    def refinement(self) -> tuple[Equations, int]:
        """The system with the study's substeps, and how many times more there are."""
        return self._changed(substeps=self.substeps // self.finer, finer=1), self.finer

    def _changed(self, **attributes: Any) -> Equations:
        other = copy(self)
        for name, value in attributes.items():
            object.__setattr__(other, name, value)
        return other

    def step(
        self,
        state: kernel.Expression,
        inputs: kernel.Expression,
        parameters: kernel.Expression,
        period: kernel.Expression,
    ) -> kernel.Expression:
        """By the integrator, in `substeps` steps."""
        if not self.states:
            return state
        if self.integrator == "radau":
            return radau_stepper(self)(state, inputs, parameters, period)

        def derivative(now: kernel.Expression) -> kernel.Expression:
            values = self.named(now, inputs, parameters)
            return ca.vertcat(*(one.casadi(values) for one in self.rates))

        return runge_kutta(derivative, state, period, self.substeps)

    def signals(
        self,
        state: kernel.Expression,
        inputs: kernel.Expression,
        parameters: kernel.Expression,
        period: kernel.Expression,
    ) -> Mapping[str, kernel.Expression]:
        """The outputs in a state; as means of a period those in its middle, right to the second order."""
        instant = not self.states or (not isinstance(period, ca.MX) and ca.SX(period).is_zero())
        at = state if instant else self.step(state, inputs, parameters, period / 2)
        values = self.values_at(at, inputs, parameters)
        return {name: values[name] for name, _ in self.responses}

    def named(self, state: Any, inputs: Any, parameters: Any, algebraic: Any = ()) -> dict[str, Any]:
        """The values of all names; expressions.

        Args:
            state: of the states, (states,), SI.
            inputs: of the inputs, (inputs,), SI.
            parameters: of the parameters, (p,), SI.
            algebraic: of the algebraic states, (a,), SI.
        """
        parameter_names, algebraic_names = ([name for name, *_ in one] for one in (self.values, self.guesses))
        names = (self.states, self.input_names, parameter_names, algebraic_names)
        found = {
            name: column[place]
            for own, column in zip(names, (state, inputs, parameters, algebraic), strict=True)
            for place, name in enumerate(own)
        }
        for name, one in self.definitions:
            found[name] = one.casadi(found)
        return found
