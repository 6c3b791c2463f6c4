"""Initial values of states, as studies have them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, PlainSerializer, Tag

from oed.equations.dimensions import Dimension, Quantity, expect_quantity, quantity, rising
from oed.equations.issues import Issues
from oed.foundation.component import Component
from oed.foundation.shown import written

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
class InitialValue:
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


def written_value(start: Any) -> Quantity:
    """Return a nominal initial value as the study has it; the largest of those to choose from."""
    if isinstance(start, DesignedStart):
        return start.design[1]
    return start.unknown if isinstance(start, UnknownStart) else start


def read_initial_values(states: Iterable[tuple[str, Any]], key: str) -> dict[str, InitialValue]:
    """Read initial values.

    Args:
        states: names, and initial values as a study has them.
        key: key of the system that has them.

    Raises:
        ProblemError: no quantities, different units, or bounds that do not rise.
    """
    initial_values, issues = dict[str, InitialValue](), Issues("system", key)
    for name, start in states:
        with issues.at(name):
            initial_values[name] = _read(start)
    issues.check()
    return initial_values


def _read(start: Any) -> InitialValue:
    if isinstance(start, DesignedStart):
        _, dimension = quantity(start.design[0])
        expect_quantity(start.design[1], dimension, "bounds are of different units: {expected}, and {got}")
        return InitialValue(*rising(start.design), False, None, dimension)
    value, dimension = quantity(written_value(start))
    if not isinstance(start, UnknownStart) or start.deviation is None:
        return InitialValue(value, value, isinstance(start, UnknownStart), None, dimension)
    units = "value and deviation are of different units: {expected}, and {got}"
    deviation = expect_quantity(start.deviation, dimension, units)
    if not deviation > 0:
        raise ValueError(f"expected a deviation above 0, got {start.deviation}")
    return InitialValue(value, value, True, deviation, dimension)
