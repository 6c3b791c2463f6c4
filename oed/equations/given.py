"""What a study says of any system: the system, and how its states begin."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Annotated, Any

from pydantic import Discriminator, PlainSerializer, Tag

from oed.equations.dimensions import Dimension, quantity
from oed.foundation.component import Component
from oed.foundation.errors import Issue, ProblemError
from oed.foundation.shown import written
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System

EXACTLY = 1e-8
"""Share of a known initial value that is its deviation beside unknown ones: its square is rounding."""
Quantity = float | str
"""A number, or text with a unit."""


def pairs(given: Any) -> Any:
    """What is given by name as pairs, which can be hashed; pairs as they are.

    Raises:
        ValueError: a word or a number.
    """
    if isinstance(given, str | int | float):
        raise ValueError(f"expected names, each with its value, got {written(given)}")
    return tuple(given.items()) if isinstance(given, Mapping) else given


def _by_name(given: Any) -> Any:
    return dict(given) if isinstance(given, tuple) else given


AS_DATA = PlainSerializer(_by_name, when_used="json")
"""Has pairs saved by name, as a study has them."""


class DesignedStart(Component):
    """An initial value that every trial chooses for itself.

    Attributes:
        design: least and largest value.
    """

    design: tuple[Quantity, Quantity]


class UnknownStart(Component):
    """An initial value that is not known exactly.

    Attributes:
        unknown: its nominal value.
        deviation: its standard deviation; nothing is known of it by default.
    """

    unknown: Quantity
    deviation: Quantity | None = None


def _start_form(value: Any) -> str:
    # By what is given, so that mistakes are those of the form that was meant.
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
    """How a state begins, SI.

    Attributes:
        low, high: between which trials choose; both the value itself where they do not.
        unknown: whether the value is nominal only.
        deviation: of what is not known exactly; None where nothing is known.
        dimension: of the state.
    """

    low: float
    high: float
    unknown: bool
    deviation: float | None
    dimension: Dimension

    @property
    def spread(self) -> float:
        """Standard deviation of the initial value, SI: infinite where nothing is known, next to none where it
        is known.
        """
        if self.unknown:
            return inf if self.deviation is None else self.deviation
        return EXACTLY * (max(abs(self.low), abs(self.high)) or 1.0)


class Readable(System, ABC):
    """A system with outputs that can be read; they are among its signals."""

    @property
    @abstractmethod
    def output_dimensions(self) -> Mapping[str, Dimension]:
        """Of the outputs, by name."""

    @property
    @abstractmethod
    def dimensions(self) -> Mapping[str, Dimension]:
        """Of states, inputs, parameters, outputs and whatever else has a name."""

    @abstractmethod
    def values_at(self, state: Expression, inputs: Expression, parameters: Expression) -> Mapping[str, Any]:
        """Expressions of all that `dimensions` names, SI.

        Args:
            state: (states,), SI.
            inputs: held, (inputs,), SI.
            parameters: values, (p,), SI.
        """


class SystemKeys(Component, ABC):
    """A study's key `system`."""

    kind: str

    @property
    @abstractmethod
    def system(self) -> Readable:
        """The system.

        Raises:
            ProblemError: it is none, by key and column.
        """

    @property
    @abstractmethod
    def begins(self) -> Mapping[str, Begin]:
        """How every state begins, by name.

        Raises:
            ProblemError: values that are none, of different units, or that do not rise.
        """

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """Parameters and initial values as they are written, where they are, by name."""
        return {}


def largest(start: Start) -> Quantity:
    """A nominal initial value as it is written; the largest that may be chosen."""
    if isinstance(start, DesignedStart):
        return start.design[1]
    return start.unknown if isinstance(start, UnknownStart) else start


def begins_of(states: Iterable[tuple[str, Any]], key: str) -> dict[str, Begin]:
    """How states begin.

    Args:
        states: names, and starts as they are given.
        key: of the system's key that has them.

    Raises:
        ProblemError: values that are none, of different units, or that do not rise.
    """
    found, issues = dict[str, Begin](), list[Issue]()
    for name, start in states:
        try:
            found[name] = _begin(start)
        except ValueError as error:
            issues.append(Issue(("system", key, name), str(error)))
    if issues:
        raise ProblemError(issues)
    return found


def _begin(start: Quantity | DesignedStart | UnknownStart) -> Begin:
    if isinstance(start, DesignedStart):
        (low, dimension), (high, other) = map(quantity, start.design)
        _require_alike(dimension, other, "bounds")
        if not low < high:
            raise ValueError(f"expected [least, largest], got {list(start.design)}")
        return Begin(low, high, False, None, dimension)
    if isinstance(start, UnknownStart):
        value, dimension = quantity(start.unknown)
        size, other = (None, dimension) if start.deviation is None else quantity(start.deviation)
        _require_alike(dimension, other, "value and deviation")
        if size is not None and not size > 0:
            raise ValueError(f"expected a deviation above 0, got {start.deviation}")
        return Begin(value, value, True, size, dimension)
    value, dimension = quantity(start)
    return Begin(value, value, False, None, dimension)


def _require_alike(one: Dimension, other: Dimension, what: str) -> None:
    if not one.fits(other):
        raise ValueError(f"{what} are of different units: {one.words}, and {other.words}")
