"""What a study says of a system given by equations: its equations, and how its states begin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from oed.equations.dimensions import Dimension, quantity
from oed.equations.system import Equations
from oed.foundation.component import Component
from oed.foundation.errors import Flaw, ProblemError

EXACTLY = 1e-8
"""Share of a known initial value that is its deviation beside unknown ones: its square is rounding."""
Quantity = float | str
"""A number, or text with a unit."""


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


class EquationKeys(Component):
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
    def begins(self) -> dict[str, Begin]:
        """How every state begins.

        Raises:
            ProblemError: values that are none, of different units, or that do not rise.
        """
        found, flaws = dict[str, Begin](), list[Flaw]()
        for name, start in self.states.items():
            try:
                found[name] = _begin(start)
            except ValueError as error:
                flaws.append(Flaw(("system", "states", name), str(error)))
        if flaws:
            raise ProblemError(flaws)
        return found

    @cached_property
    def system(self) -> Equations:
        """The system.

        Raises:
            ProblemError: every name, expression or unit that does not fit, by its key and column.
        """
        given: Mapping[str, Any] = {name: getattr(self, name) for name in type(self).model_fields}
        states = {name: one.dimension.text for name, one in self.begins.items()}
        return Equations(**{**{name: one for name, one in given.items() if name != "kind"}, "states": states})


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
