"""Systems that a user's class gives: the derivatives of its states and its outputs, in CasADi."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, PrivateAttr

from oed.equations.dimensions import Dimension, expect_quantity, parse_unit
from oed.equations.initial_values import (
    AS_DATA,
    InitialValue,
    Start,
    pairs,
    read_initial_values,
    written_value,
)
from oed.equations.issues import Issues, no_such
from oed.equations.output_system import OutputSystem, SystemKeys, by_name
from oed.equations.reading import INTEGRATORS
from oed.foundation.own.part import OwnDescription, OwnPart
from oed.foundation.shown import written
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input, Parameter, signaller, stepper


class ContinuousSystem(SystemKeys, OutputSystem):
    """A system given by a class: `states`, `state_units`, `inputs`, `parameters`, `derivative`, `outputs`.

    Without states its outputs follow from the inputs at once.

    Attributes:
        output_units: SI units of the outputs, by name.
        start: initial values with their units, as a study's `system.states` has them.
        integrator: "runge_kutta", or "radau" for stiff systems.
        substeps: steps of the integrator in a period.
    """

    output_units: ClassVar[Mapping[str, str]]
    start: Annotated[tuple[tuple[str, Start], ...], BeforeValidator(pairs), AS_DATA] = ()
    integrator: Literal["runge_kutta", "radau"] = "runge_kutta"
    substeps: Annotated[int, Field(ge=1, le=10_000)] | None = None
    _finer: int = PrivateAttr(1)

    @abstractmethod
    def derivative(self, state: Expression, inputs: Expression, parameters: Expression) -> Expression:
        """Return the derivatives of all states by time, (states,), SI.

        Args:
            state: states, (states,), SI.
            inputs: inputs, (inputs,), SI.
            parameters: parameters, (p,), SI.
        """

    def refined(self, times: int) -> Self:
        """Return the system with so many times more substeps."""
        finer = self.model_copy()
        finer._finer = times * self._finer
        return finer

    @property
    def refinement(self) -> tuple[Self, int]:
        """System with the study's substeps, and the factor by which there are more."""
        coarse = self.model_copy()
        coarse._finer = 1
        return coarse, self._finer

    @property
    def system(self) -> ContinuousSystem:
        """The system itself."""
        return self

    @property
    def initial_values(self) -> Mapping[str, InitialValue]:
        """Initial values of all states.

        Raises:
            ProblemError: states without an initial value, unknown ones, or values in another unit.
        """
        issues, starts = Issues("system", "start"), dict(self.start)
        issues.compare(starts, self.states, "missing: how {} begins", no_such("state", self.states))
        issues.check()
        initial_values = read_initial_values([(name, starts[name]) for name in self.states], "start")
        for name, unit in zip(self.states, self.state_units, strict=True):
            with issues.at(name):
                message = "expected a value {expected}, got one {got}"
                expect_quantity(written_value(starts[name]), parse_unit(unit)[1], message)
        issues.check()
        return initial_values

    @cached_property
    def output_dimensions(self) -> Mapping[str, Dimension]:  # type: ignore[override]
        """Dimensions of the outputs, by name."""
        return {name: parse_unit(unit)[1] for name, unit in self.output_units.items()}

    @cached_property
    def dimensions(self) -> Mapping[str, Dimension]:  # type: ignore[override]
        """Dimensions of states, inputs, parameters and outputs, by name."""
        units = dict(zip(self.states, self.state_units, strict=True))
        units |= {entry.name: entry.unit for entry in self.inputs}
        units |= {parameter.name: parameter.unit for parameter in self.parameters}
        return {name: parse_unit(unit)[1] for name, unit in {**units, **self.output_units}.items()}

    def values_at(self, state: Expression, inputs: Expression, parameters: Expression) -> Mapping[str, Any]:
        """Return the values of states, inputs, parameters and outputs, SI."""
        names = (*self.states, *self.input_names, *(parameter.name for parameter in self.parameters))
        values = by_name(names, state, inputs, parameters)
        return {**values, **self.outputs(state, inputs, parameters)}

    @property
    def scheme(self) -> tuple[str, int]:
        """Integrator, and number of its steps in a period."""
        return self.integrator, self._finer * (self.substeps or INTEGRATORS[self.integrator])

    def rates_at(
        self, state: Expression, algebraic: Expression, inputs: Expression, parameters: Expression
    ) -> Expression:
        """Return the derivatives of all states by time, SI."""
        return self.derivative(state, inputs, parameters)


class PythonSystem(OwnPart, SystemKeys, extra="allow"):
    """The system that the class `object` ("my_module:MySystem") makes of all further keys."""

    noun = "system"
    kind: Literal["python"] = "python"
    described: OwnDescription | None = None

    def try_out(self, part: Any) -> None:
        """Call every method of the system.

        Raises:
            ValueError: attributes of the wrong kind, or that do not fit together.
            BaseException: any error of the system's own methods.
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
        names = signaller(part).name_out()
        if sorted(names) != sorted(part.output_units):
            text = f"expected those of output_units ({', '.join(part.output_units)}), got {', '.join(names)}"
            raise ValueError(f"outputs: {text}")
        stepper(part)(len(part.states) * [0.1], len(part.inputs) * [0.1], part.nominal, 0.1)


def _require(attribute: str, entries: Any, kind: type) -> None:
    if not isinstance(entries, tuple | list) or not all(isinstance(entry, kind) for entry in entries):
        raise ValueError(f"{attribute}: expected a tuple of oed.{kind.__name__}, got {written(entries)}")
