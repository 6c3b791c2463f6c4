"""Systems of the user's own: a class with the derivatives of its states and its outputs, in CasADi."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from functools import cached_property, lru_cache
from typing import Annotated, Any, ClassVar, Literal, Self

import casadi as ca
from pydantic import BeforeValidator, Field, PrivateAttr

from oed.equations.dimensions import Dimension, parse_unit
from oed.equations.given import AS_DATA, Begin, Readable, Start, SystemKeys, begins_of, pairs
from oed.equations.reading import INTEGRATORS
from oed.foundation.errors import Issue, ProblemError
from oed.foundation.own.part import OwnDescription, OwnPart
from oed.foundation.shown import written
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.integration import Radau, runge_kutta
from oed.kernel.dynamics.system import Input, Parameter, signaller, stepper


class ContinuousSystem(SystemKeys, Readable):
    """A system by its class: `states`, `state_units`, `inputs`, `parameters`, `derivative`, `outputs`.

    Without states its outputs follow from the inputs at once.

    Attributes:
        output_units: SI units of the outputs, by name.
        start: initial values with their units, as a study's `system.states` has them.
        integrator: "runge_kutta", or "radau" for stiff systems.
        substeps: its steps in a period.
    """

    noun: ClassVar[str] = "system"
    output_units: ClassVar[Mapping[str, str]]
    start: Annotated[tuple[tuple[str, Start], ...], BeforeValidator(pairs), AS_DATA] = ()
    integrator: Literal["runge_kutta", "radau"] = "runge_kutta"
    substeps: Annotated[int, Field(ge=1, le=10_000)] | None = None
    _finer: int = PrivateAttr(1)

    @abstractmethod
    def derivative(self, state: Expression, inputs: Expression, parameters: Expression) -> Expression:
        """Of every state by time, (states,), SI.

        Args:
            state: (states,), SI.
            inputs: (inputs,), SI.
            parameters: (p,), SI.
        """

    @abstractmethod
    def outputs(
        self, state: Expression, inputs: Expression, parameters: Expression
    ) -> Mapping[str, Expression]:
        """What can be read, by name, SI.

        Args:
            state: (states,), SI.
            inputs: (inputs,), SI.
            parameters: (p,), SI.
        """

    @property
    def integrates(self) -> bool:
        """Whether it has states."""
        return bool(self.states)

    def refined(self, times: int) -> Self:
        """The system with so many times more substeps."""
        other = self.model_copy()
        other._finer = times * self._finer
        return other

    @property
    def refinement(self) -> tuple[Self, int]:
        """The system with its own substeps, and how many times more there are."""
        coarse = self.model_copy()
        coarse._finer = 1
        return coarse, self._finer

    @property
    def system(self) -> ContinuousSystem:
        """The system itself."""
        return self

    @property
    def begins(self) -> Mapping[str, Begin]:
        """How every state begins.

        Raises:
            ProblemError: states of which nothing is said, or others, or values in another unit.
        """
        given = dict(self.start)
        issues = [
            Issue(("system", "start"), f"missing: how {name} begins")
            for name in self.states
            if name not in given
        ]
        issues += [
            Issue(("system", "start", name), f"the system has no such state; it has {', '.join(self.states)}")
            for name in given
            if name not in self.states
        ]
        if issues:
            raise ProblemError(issues)
        found = begins_of([(name, given[name]) for name in self.states], "start")
        for (name, one), unit in zip(found.items(), self.state_units, strict=True):
            expected = parse_unit(unit)[1]
            if not one.dimension.fits(expected):
                issues.append(
                    Issue(
                        ("system", "start", name),
                        f"expected a value {expected.words}, got one {one.dimension.words}",
                    )
                )
        if issues:
            raise ProblemError(issues)
        return found

    @cached_property
    def output_dimensions(self) -> Mapping[str, Dimension]:
        """Of the outputs, by name."""
        return {name: parse_unit(unit)[1] for name, unit in self.output_units.items()}

    @cached_property
    def dimensions(self) -> Mapping[str, Dimension]:
        """Of states, inputs, parameters and outputs."""
        units = dict(zip(self.states, self.state_units, strict=True))
        units |= {one.name: one.unit for one in self.inputs}
        units |= {one.name: one.unit for one in self.parameters}
        return {**{name: parse_unit(unit)[1] for name, unit in units.items()}, **self.output_dimensions}

    def values_at(self, state: Expression, inputs: Expression, parameters: Expression) -> Mapping[str, Any]:
        """Expressions of these, SI."""
        columns = (state, inputs, parameters)
        names = (self.states, self.input_names, [one.name for one in self.parameters])
        found: dict[str, Any] = {
            name: column[place]
            for own, column in zip(names, columns, strict=True)
            for place, name in enumerate(own)
        }
        return {**found, **self.outputs(state, inputs, parameters)}

    def step(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """By the integrator, in `substeps` steps."""
        if not self.states:
            return state
        steps = self._finer * (self.substeps or INTEGRATORS[self.integrator])
        if self.integrator == "runge_kutta":
            return runge_kutta(lambda now: self.derivative(now, inputs, parameters), state, period, steps)
        method, held = _radau(self), ca.vertcat(inputs, parameters)
        algebraic: Expression = ca.SX(0, 1)
        for _ in range(steps):
            state, algebraic = method.step(state, algebraic, held, period / steps)
        return state

    def signals(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Mapping[str, Expression]:
        """The outputs in a state; as means of a period those in its middle, right to the second order."""
        instant = not self.states or (not isinstance(period, ca.MX) and ca.SX(period).is_zero())
        at = state if instant else self.step(state, inputs, parameters, period / 2)
        return self.outputs(at, inputs, parameters)


@lru_cache(maxsize=32)
def _radau(system: ContinuousSystem) -> Radau:
    states, width = len(system.states), len(system.inputs)
    state, none = ca.SX.sym("state", states), ca.SX.sym("algebraic", 0)
    given = ca.SX.sym("given", width + len(system.parameters))
    rates = ca.densify(ca.SX(system.derivative(state, given[:width], given[width:])))
    return Radau(
        ca.Function("rates", [state, none, given], [rates]),
        ca.Function("constraints", [state, none, given], [ca.SX(0, 1)]),
    )


class PythonSystem(OwnPart, SystemKeys, extra="allow"):
    """The system that `object` ("my_module:MySystem") makes of all further keys."""

    noun = "system"
    kind: Literal["python"] = "python"
    described: OwnDescription | None = None

    def try_out(self, part: Any) -> None:
        """Ask the system for everything.

        Raises:
            ValueError: what it says of itself is not what it is to be, or does not fit together.
            BaseException: whatever its own methods raise.
        """
        if not isinstance(part, ContinuousSystem):
            raise ValueError("expected a subclass of oed.ContinuousSystem")
        _require("inputs", part.inputs, Input)
        _require("parameters", part.parameters, Parameter)
        if not part.parameters:
            raise ValueError("parameters: expected at least one")
        if len(part.state_units) != len(part.states):
            text = f"expected {len(part.states)}, one of each state, got {len(part.state_units)}"
            raise ValueError(f"state_units: {text}")
        for unit in (*part.state_units, *part.output_units.values()):
            parse_unit(unit)
        found = signaller(part).name_out()
        if sorted(found) != sorted(part.output_units):
            text = f"expected those of output_units ({', '.join(part.output_units)}), got {', '.join(found)}"
            raise ValueError(f"outputs: {text}")
        stepper(part)(len(part.states) * [0.1], len(part.inputs) * [0.1], part.nominal, 0.1)


def _require(what: str, given: Any, kind: type) -> None:
    if not isinstance(given, tuple | list) or not all(isinstance(one, kind) for one in given):
        raise ValueError(f"{what}: expected a tuple of oed.{kind.__name__}, got {written(given)}")
