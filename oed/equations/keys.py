"""What a study says of a system given by equations."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import Field

from oed.equations.given import Begin, Quantity, Start, SystemKeys, begins_of, largest
from oed.equations.system import Equations


class EquationKeys(SystemKeys):
    """A system given by equations, as `oed.Equations` has it.

    Attributes:
        states: initial values with their units: fixed, `{design: [low, high]}`, or
            `{unknown: value, deviation: size}`.
        inputs: their SI units.
        parameters: nominal values with their units.
        define: names for parts of expressions.
        derivatives: of every state by time.
        algebraic_states: guesses with their units of what follows from `algebraic`.
        algebraic: for every algebraic state an equation, by what is 0.
        outputs: what can be read.
        integrator: by which states are followed: runge_kutta, or radau for stiff systems and those with
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
    def begins(self) -> Mapping[str, Begin]:
        """How every state begins.

        Raises:
            ProblemError: values that are none, of different units, or that do not rise.
        """
        return begins_of(self.states.items(), "states")

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """Of parameters and initial values; the largest that may be chosen."""
        return {**self.parameters, **{name: largest(one) for name, one in self.states.items()}}

    @cached_property
    def system(self) -> Equations:
        """The system.

        Raises:
            ProblemError: every name, expression or unit that does not fit, by its key and column.
        """
        given: Mapping[str, Any] = {name: getattr(self, name) for name in type(self).model_fields}
        states = {name: one.dimension.text for name, one in self.begins.items()}
        return Equations(**{**{name: one for name, one in given.items() if name != "kind"}, "states": states})
