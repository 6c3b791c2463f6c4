"""Descriptions of systems in studies: the system, and the initial values of its states."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Annotated, Any, ClassVar

import casadi as ca
from pydantic import BeforeValidator, Discriminator, PlainSerializer, Tag

from oed.equations.dimensions import Dimension, Quantity, expect_quantity, quantity, rising
from oed.equations.issues import Issues
from oed.foundation.component import Component
from oed.foundation.shown import written
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System

EXACTLY = 1e-8
"""Deviation of an exact initial value beside inexact ones, as a share of it: its square is rounding."""


def pairs(value: Any) -> Any:
    """Return a mapping as pairs, which can be hashed; pairs as they are.

    Raises:
        ValueError: a word or a number.
    """
    if isinstance(value, str | int | float):
        raise ValueError(f"expected names, each with its value, got {written(value)}")
    return tuple(value.items()) if isinstance(value, Mapping) else value


AS_DATA = PlainSerializer(lambda value: dict(value) if isinstance(value, tuple) else value, when_used="json")
"""Saves pairs by name, as a study has them."""
Quantities = Annotated[tuple[tuple[str, Quantity], ...], BeforeValidator(pairs), AS_DATA]
"""Quantities by name."""


class DesignedStart(Component):
    """An initial value that every trial chooses for itself.

    Attributes:
        design: least and largest value.
    """

    design: tuple[Quantity, Quantity]


class UnknownStart(Component):
    """An initial value that is not known exactly.

    Attributes:
        unknown: nominal value.
        deviation: standard deviation; None if nothing is known of the value.
    """

    unknown: Quantity
    deviation: Quantity | None = None


def _start_form(value: Any) -> str:
    # Its keys tell which form is meant, so that mistakes are reported of that form alone.
    if isinstance(value, DesignedStart | UnknownStart):
        return type(value).__name__
    if not isinstance(value, dict):
        return "fixed"
    return "DesignedStart" if "design" in value else "UnknownStart"


Start = Annotated[
    Annotated[Quantity, Tag("fixed")]
    | Annotated[DesignedStart, Tag("DesignedStart")]
    | Annotated[UnknownStart, Tag("UnknownStart")],
    Discriminator(_start_form),
]


@dataclass(frozen=True)
class Begin:
    """Initial value of a state, SI.

    Attributes:
        low, high: least and largest value that trials may choose; both the value itself where it is fixed.
        unknown: True if the value is nominal only.
        deviation: standard deviation of an unknown value; None where nothing is known of it.
        dimension: dimension of the state.
    """

    low: float
    high: float
    unknown: bool
    deviation: float | None
    dimension: Dimension

    @property
    def spread(self) -> float:
        """Standard deviation, SI: infinite if nothing is known of the value, next to none if it is exact."""
        if self.unknown:
            return inf if self.deviation is None else self.deviation
        return EXACTLY * (max(abs(self.low), abs(self.high)) or 1.0)


class Readable(System, ABC):
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


class SystemKeys(Component, ABC):
    """A study's key `system`."""

    kind: str

    @property
    @abstractmethod
    def system(self) -> Readable:
        """The system.

        Raises:
            ProblemError: mistakes in it, by key and column.
        """

    @property
    @abstractmethod
    def begins(self) -> Mapping[str, Begin]:
        """Initial values of all states, by name.

        Raises:
            ProblemError: no quantities, different units, or bounds that do not rise.
        """

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """Parameters and initial values as texts or numbers of the study, by name."""
        return {}


def largest(start: Any) -> Quantity:
    """Return a nominal initial value as the study has it; the largest of those to choose from."""
    if isinstance(start, DesignedStart):
        return start.design[1]
    return start.unknown if isinstance(start, UnknownStart) else start


def begins_of(states: Iterable[tuple[str, Any]], key: str) -> dict[str, Begin]:
    """Read initial values.

    Args:
        states: names, and initial values as a study has them.
        key: key of the system that has them.

    Raises:
        ProblemError: no quantities, different units, or bounds that do not rise.
    """
    begins, issues = dict[str, Begin](), Issues("system", key)
    for name, start in states:
        with issues.at(name):
            begins[name] = _begin(start)
    issues.check()
    return begins


def _begin(start: Any) -> Begin:
    if isinstance(start, DesignedStart):
        _, dimension = quantity(start.design[0])
        expect_quantity(start.design[1], dimension, "bounds are of different units: {expected}, and {got}")
        return Begin(*rising(start.design), False, None, dimension)
    value, dimension = quantity(largest(start))
    if not isinstance(start, UnknownStart) or start.deviation is None:
        return Begin(value, value, isinstance(start, UnknownStart), None, dimension)
    units = "value and deviation are of different units: {expected}, and {got}"
    deviation = expect_quantity(start.deviation, dimension, units)
    if not deviation > 0:
        raise ValueError(f"expected a deviation above 0, got {start.deviation}")
    return Begin(value, value, True, deviation, dimension)
