"""Systems given by equations: differential and algebraic ones, or responses alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca

from oed.equations.dimensions import Dimension, unit_of
from oed.equations.grammar import Expression
from oed.equations.output_system import OutputSystem, by_name, equation_function
from oed.equations.reading import INTEGRATORS, Reader
from oed.foundation.errors import Issue, ProblemError
from oed.foundation.text import Unit, listing
from oed.kernel.dynamics import expression as kernel
from oed.kernel.dynamics.system import Input, Parameter


@dataclass(frozen=True, init=False)
class Equations(OutputSystem):
    """A system given by equations: texts of its derivatives and outputs.

    Attributes:
        states: names of the states.
        state_units: SI units of the states.
        inputs: inputs, held in each period.
        parameters: parameters with their nominal values.
        rates: derivatives of the states by time, of states, inputs, parameters and `definitions`.
        guesses: name, value (SI) and dimension of each algebraic state, where solving for them begins.
        constraints: equation of each algebraic state, as an expression that is 0.
        definitions: names for parts of these, in an order in which each needs only those before it.
        responses: outputs by name.
        integrator: "runge_kutta", of fourth order and explicit, or "radau", of fifth order and implicit.
        substeps: steps of the integrator in a period.
        finer: factor by which these are more than the study's.
        written: quantities of the parameters as the user wrote them, by name.
    """

    states: tuple[str, ...]  # type: ignore[misc]  # Of each system its own.
    state_units: tuple[str, ...]  # type: ignore[misc]
    inputs: tuple[Input, ...]  # type: ignore[misc]
    rates: tuple[Expression, ...]
    guesses: tuple[tuple[str, float, Dimension], ...]
    constraints: tuple[Expression, ...]
    definitions: tuple[tuple[str, Expression], ...]
    responses: tuple[tuple[str, Expression], ...]
    integrator: str
    substeps: int
    parameters: tuple[Parameter, ...] = field(default=(), init=False)
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
            outputs: quantities that can be read: {"y": "x / volume"}.
            states: SI units of the states: {"x": "mol"}; none where outputs follow from the inputs at once.
            derivatives: derivatives of all states by time: {"x": "-k * x + u"}.
            inputs: SI units of the inputs: {"u": "mol/s"}.
            define: names for parts of the expressions, in any order.
            algebraic_states: guesses, with their units, of what follows from `algebraic`: {"z": "1 mol"}.
            algebraic: equations of all algebraic states, as expressions that are 0: {"z": "z^2 - x * y"};
                they must be solvable for the algebraic states (a differential-algebraic system of index 1).
            integrator: "runge_kutta", or "radau" for stiff and differential-algebraic systems.
            substeps: steps of the integrator in a period; by default 10 of runge_kutta and 4 of radau.

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
            "dimensions": dimensions | read.output_dimensions,
            "output_dimensions": read.output_dimensions,
            "states": tuple(keys["states"]),
            "state_units": tuple(dimensions[name].text for name in keys["states"]),
            "inputs": tuple(Input(name, name, dimensions[name].text) for name in keys["inputs"]),
            "parameters": tuple(
                Parameter(name, value, dimension.text) for name, (value, dimension) in read.parameters.items()
            ),
            "rates": tuple(expressions["derivatives"][name] for name in keys["states"]),
            "guesses": tuple((name, *value) for name, value in read.guesses.items()),
            "constraints": tuple(expressions["algebraic"][name] for name in keys["algebraic_states"]),
            "definitions": tuple((name, expressions["define"][name]) for name in read.order),
            "responses": tuple(expressions["outputs"].items()),
            "integrator": integrator,
            "substeps": INTEGRATORS[integrator] if substeps is None else substeps,
            "written": tuple((name, text) for name, text in parameters.items() if isinstance(text, str)),
        }
        for name, value in attributes.items():
            object.__setattr__(self, name, value)
        if issues := _index_issues(self):
            raise ProblemError(issues)

    @cached_property
    def shown_units(self) -> Mapping[str, Unit]:
        """Units in which the user wrote the parameters."""
        return {name: unit_of(text) for name, text in self.written}

    @property
    def when_not_finite(self) -> str:
        """Remedy for values that are not finite: unsolved equations have none, long steps lead astray."""
        if self.states and self.integrator == "runge_kutta":
            return "if the equations are stiff, take more `substeps` or `integrator: radau`"
        ways = ["take more substeps"] * bool(self.states) + ["guess algebraic_states better"] * bool(
            self.guesses
        )
        return f"if equations of it are not solved there, {' or '.join(ways)}" if ways else ""

    def values_at(
        self, state: kernel.Expression, inputs: kernel.Expression, parameters: kernel.Expression
    ) -> Mapping[str, Any]:
        """Return the values of all names, SI."""
        values = self.named(state, inputs, parameters, self.solve_algebraic(state, inputs, parameters))
        return {**values, **{name: output.casadi(values) for name, output in self.responses}}

    def outputs(
        self, state: kernel.Expression, inputs: kernel.Expression, parameters: kernel.Expression
    ) -> Mapping[str, kernel.Expression]:
        """Return the outputs by name, SI."""
        values = self.values_at(state, inputs, parameters)
        return {name: values[name] for name in self.output_dimensions}

    def refined(self, times: int) -> Equations:
        """Return the system with so many times more substeps."""
        return self._changed(substeps=times * self.substeps, finer=times * self.finer)

    @property
    def refinement(self) -> tuple[Equations, int]:
        """System with the study's substeps, and the factor by which there are more."""
        return self._changed(substeps=self.substeps // self.finer, finer=1), self.finer

    def _changed(self, **attributes: Any) -> Equations:
        system = copy(self)
        for name, value in attributes.items():
            object.__setattr__(system, name, value)
        return system

    @property
    def scheme(self) -> tuple[str, int]:
        """Integrator, and number of its steps in a period."""
        return self.integrator, self.substeps

    @property
    def algebraic_guesses(self) -> Sequence[float]:
        """Values of the algebraic states at which solving for them begins, SI."""
        return [value for _, value, _ in self.guesses]

    def rates_at(self, state: Any, algebraic: Any, inputs: Any, parameters: Any) -> kernel.Expression:
        """Return the derivatives of all states by time, SI."""
        return self._column(self.rates, state, inputs, parameters, algebraic)

    def constraints_at(self, state: Any, algebraic: Any, inputs: Any, parameters: Any) -> kernel.Expression:
        """Return the equations of the algebraic states, as expressions that are 0."""
        return self._column(self.constraints, state, inputs, parameters, algebraic)

    def _column(self, expressions: Sequence[Expression], *columns: Any) -> kernel.Expression:
        values = self.named(*columns)
        return ca.vertcat(ca.SX(0, 1), *(expression.casadi(values) for expression in expressions))

    def named(self, *columns: Any) -> dict[str, Any]:
        """Return the values of all names but the outputs', SI.

        Args:
            columns: states, inputs, parameters and algebraic states, SI.
        """
        constants = [parameter.name for parameter in self.parameters]
        names = [*self.states, *self.input_names, *constants, *(name for name, *_ in self.guesses)]
        values: dict[str, Any] = by_name(names, *columns)
        for name, definition in self.definitions:
            values[name] = definition.casadi(values)
        return values


def _index_issues(system: Equations) -> list[Issue]:
    """Return why the algebraic equations cannot be solved for the algebraic states; [] if they may."""
    names = [name for name, *_ in system.guesses]
    slopes = equation_function(system, "constraints_at").jac_sparsity(0, 1)
    if ca.sprank(ca.DM(slopes)) == len(names):
        return []
    rows, columns = map(set, slopes.get_triplet())
    key = ("system", "algebraic")
    issues = [
        Issue((*key, name), f"there is no algebraic state in it; they are {listing(names)}")
        for place, name in enumerate(names)
        if place not in rows
    ]
    absent = [name for place, name in enumerate(names) if place not in columns]
    reason = (
        f"{listing(absent)} is in none of them" if absent else f"they cannot be solved for {listing(names)}"
    )
    return issues or [Issue(key, f"{reason}: the index would not be 1")]
