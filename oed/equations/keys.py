"""Keys of a study that give a system by equations."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Literal

from pydantic import Field

from oed.equations.dimensions import Quantity
from oed.equations.initial_values import InitialValue, Start, read_initial_values, written_value
from oed.equations.output_system import SystemKeys
from oed.equations.system import Equations


class EquationKeys(SystemKeys):
    """A system given by equations, with the keys that `oed.Equations` takes.

    Attributes:
        states: initial values with their units: fixed, `{design: [low, high]}`, or
            `{unknown: value, deviation: size}`.
        inputs: SI units of the inputs.
        parameters: nominal values with their units.
        define: names for parts of expressions.
        derivatives: derivatives of all states by time.
        algebraic_states: guesses, with their units, of what follows from `algebraic`.
        algebraic: equations of all algebraic states, each as an expression that is 0.
        outputs: quantities that can be read.
        integrator: method that integrates the states: runge_kutta, or radau for stiff systems and those with
            algebraic states.
        substeps: steps of the integration in a period; 10 of runge_kutta and 4 of radau by default.
    """

    kind: Literal["equations"] = "equations"
    states: dict[str, Start] = Field(default_factory=dict)
    inputs: dict[str, str] = Field(default_factory=dict)
    parameters: dict[str, Quantity]
    define: dict[str, str] = Field(default_factory=dict)
    derivatives: dict[str, str] = Field(default_factory=dict)
    algebraic_states: dict[str, Quantity] = Field(default_factory=dict)
    algebraic: dict[str, str] = Field(default_factory=dict)
    outputs: dict[str, str]
    integrator: Literal["runge_kutta", "radau"] = "runge_kutta"
    substeps: Annotated[int, Field(ge=1, le=10_000)] | None = None

    @cached_property
    def initial_values(self) -> Mapping[str, InitialValue]:
        """Initial values of all states.

        Raises:
            ProblemError: no quantities, different units, or bounds that do not rise.
        """
        return read_initial_values(self.states.items(), "states")

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """Parameters and initial values; the largest of those to choose from."""
        return {**self.parameters, **{name: written_value(start) for name, start in self.states.items()}}

    @cached_property
    def system(self) -> Equations:
        """The system.

        Raises:
            ProblemError: every name, expression or unit that does not fit, by its key and column.
        """
        keys = {
            **dict(self),
            "states": {name: value.dimension.text for name, value in self.initial_values.items()},
        }
        del keys["kind"]
        return Equations(**keys)
