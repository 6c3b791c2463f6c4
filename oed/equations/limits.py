"""Limits between quantities with units, and those on single inputs of systems with equations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator

from oed.equations.dimensions import (
    PLAIN,
    TIME,
    Dimension,
    Quantity,
    expect_quantity,
    parse_unit,
    quantity,
    rising,
)
from oed.equations.issues import Issues, no_such
from oed.foundation.errors import Issue
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System
from oed.kernel.limit import BOTH_ENDS, Limit, Rows, rest_issues


def _check(sides: Any) -> Any:
    rising(sides)
    return sides


Range = Annotated[tuple[Quantity, Quantity], AfterValidator(_check)]
"""Least and largest value."""
Rate = Annotated[Quantity | tuple[Quantity, Quantity], AfterValidator(_check)]
"""Largest rate of change in either direction, or the least and the largest."""


class QuantityLimit(Limit, ABC):
    """A limit between quantities."""

    @property
    @abstractmethod
    def sides(self) -> tuple[Quantity | None, Quantity]:
        """Least and largest value, with their units; None where there is no least."""

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest value, SI."""
        low, high = self.sides
        return -np.inf if low is None else quantity(low)[0], quantity(high)[0]

    def unit_issues(self, expected: Dimension, noun: str) -> list[Issue]:
        """Return the mistake in the sides' units.

        Args:
            expected: dimension of the values that are limited.
            noun: name of the sides in the message.
        """
        issues = Issues("limits", self.name)
        with issues.at():
            for side in self.sides:
                if side is not None:
                    expect_quantity(side, expected, f"expected {noun} {{expected}}, got some {{got}}")
        return issues

    def between(self, values: Expression, unit: str = "") -> Rows:
        """Return rows that keep values between the bounds.

        Args:
            values: the values (n,), SI.
            unit: SI unit of the values; that of the bounds by default.
        """
        low, high = self.bounds
        size = max(abs(bound) for bound in self.bounds if np.isfinite(bound)) or 1.0
        count = values.shape[0]
        unit = unit or quantity(self.sides[1])[1].text
        return Rows(values, np.full(count, low), np.full(count, high), size, unit)


class OneInput(QuantityLimit):
    """A limit on one input, or on its rate of change.

    Attributes:
        input: name of the input.
        per: dimension that the input's is divided by.
    """

    looks_at: ClassVar[Literal["inputs"]] = "inputs"
    loosened: ClassVar[str] = BOTH_ENDS
    per: ClassVar[Dimension] = PLAIN
    input: str

    @abstractmethod
    def table(self, drive: Drive) -> Expression:
        """Return the values of all inputs that are limited, (K, inputs)."""

    def issues(self, system: System, space: Space) -> list[Issue]:
        """Refuse an input that does not exist, or bounds in another unit."""
        dimensions = input_dimensions(system)
        if self.input in dimensions:
            return self.unit_issues(dimensions[self.input] / self.per, "bounds")
        text = no_such("input", dimensions, self.input)
        return [Issue(("limits", self.name), text)]

    def rows(self, drive: Drive) -> Rows:
        """Keep the input between the bounds at all times."""
        column = self.table(drive)[:, drive.system.input_names.index(self.input)]
        return self.between(column, (input_dimensions(drive.system)[self.input] / self.per).text)

    def _bounds_by_name(self, system: System) -> dict[str, tuple[float, float]]:
        return {self.input: self.bounds} if self.input in system.input_names else {}


class InputRange(OneInput):
    """One input between two values.

    Attributes:
        range: least and largest value, with their units.
    """

    range: Range

    @property
    def name(self) -> str:  # type: ignore[override]
        """Name of the input."""
        return self.input

    @property
    def sides(self) -> tuple[Quantity, Quantity]:
        """Least and largest value, with their units."""
        return self.range

    def table(self, drive: Drive) -> Expression:
        """Return the inputs."""
        return drive.input_values

    def issues(self, system: System, space: Space) -> list[Issue]:
        """Refuse also bounds that exclude a rest that is asked for."""
        issues = super().issues(system, space)
        if issues:
            return issues
        return rest_issues(self, [self.bounds], input_dimensions(system)[self.input].text, space)

    def input_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """Return the bounds of this input alone."""
        return self._bounds_by_name(system)


class InputRate(OneInput):
    """Rate of change of one input.

    Attributes:
        rate: largest rate in either direction, or the least and the largest.
    """

    per: ClassVar[Dimension] = TIME
    rate: Rate

    @property
    def name(self) -> str:  # type: ignore[override]
        """Name of the limit."""
        return f"rate_of_{self.input}"

    @property
    def sides(self) -> tuple[Quantity, Quantity]:
        """Least and largest rate, with their units."""
        return self.rate if isinstance(self.rate, tuple) else (self.rate, self.rate)

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest rate, SI."""
        return rising(self.rate)

    def table(self, drive: Drive) -> Expression:
        """Return the rates of all inputs."""
        return drive.input_rates

    def rate_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """Return the bounds of this input alone."""
        return self._bounds_by_name(system)


def input_dimensions(system: System) -> dict[str, Dimension]:
    """Return the dimensions of a system's inputs, by name."""
    return {entry.name: parse_unit(entry.unit)[1] for entry in system.inputs}
