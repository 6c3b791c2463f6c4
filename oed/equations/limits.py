"""Limits on inputs of systems that are given by equations, each input by its name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import model_validator

from oed.equations.dimensions import TIME, Dimension, parse_unit, quantity
from oed.foundation.errors import Issue
from oed.foundation.text import did_you_mean
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System
from oed.kernel.limit import BOTH_ENDS, Limit, Rows, rest_issues

Quantity = str | float


class OneInput(Limit, ABC):
    """One input, or how fast it changes, between two values.

    Attributes:
        input: its name.
    """

    looks_at: ClassVar[Literal["inputs"]] = "inputs"
    loosened: ClassVar[str] = BOTH_ENDS
    input: str

    @property
    @abstractmethod
    def given(self) -> tuple[Quantity, Quantity]:
        """Least and largest value, with their units."""

    @abstractmethod
    def of(self, dimension: Dimension) -> Dimension:
        """The dimension of what is limited, of an input of that dimension."""

    @abstractmethod
    def table(self, drive: Drive) -> Expression:
        """What is limited of every input, (K, inputs)."""

    @model_validator(mode="after")
    def _rising(self) -> OneInput:
        require_rising(self.given, self.bounds)
        return self

    @property
    def bounds(self) -> tuple[float, float]:
        """SI."""
        low, high = (quantity(one)[0] for one in self.given)
        return low, high

    def issues(self, system: System, space: Space) -> list[Issue]:
        """No such input, or bounds in another unit."""
        units = {one.name: parse_unit(one.unit)[1] for one in system.inputs}
        if self.input not in units:
            known = ", ".join(system.input_names) or "none"
            meant = did_you_mean(self.input, system.input_names)
            return [Issue(("limits", self.name), f"there is no such input; the inputs are {known}{meant}")]
        expected = self.of(units[self.input])
        wrong = {quantity(one)[1] for one in self.given if not quantity(one)[1].fits(expected)}
        text = f"expected bounds {expected.words}, got some {{}}"
        return [Issue(("limits", self.name), text.format(one.words)) for one in wrong]

    def rows(self, drive: Drive) -> Rows:
        """At all times."""
        place = drive.system.input_names.index(self.input)
        column = self.table(drive)[:, place]
        low, high = self.bounds
        count, size = column.shape[0], max(abs(low), abs(high))
        unit = self.of(parse_unit(drive.system.inputs[place].unit)[1]).text
        return Rows(column, np.full(count, low), np.full(count, high), size, unit)


def require_rising(given: Sequence[Quantity], bounds: tuple[float, float]) -> None:
    """Refuse bounds that do not rise.

    Args:
        given: as they are written.
        bounds: SI.

    Raises:
        ValueError: the second is not larger.
    """
    if not bounds[0] < bounds[1]:
        raise ValueError(f"expected [least, largest], got {list(given)}")


def both_ways(rate: Quantity | tuple[Quantity, Quantity]) -> tuple[float, float]:
    """Bounds of a rate, SI: one for both directions, or two.

    Raises:
        ValueError: no quantities, or bounds that do not rise.
    """
    low, high = rate if isinstance(rate, tuple) else (rate, rate)
    least, most = quantity(low)[0], quantity(high)[0]
    bounds = (least if isinstance(rate, tuple) else -most, most)
    require_rising([low, high], bounds)
    return bounds


class InputRange(OneInput):
    """One input between two values.

    Attributes:
        range: least and largest value, with their units.
    """

    range: tuple[Quantity, Quantity]

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the input."""
        return self.input

    @property
    def given(self) -> tuple[Quantity, Quantity]:
        """The range."""
        return self.range

    def of(self, dimension: Dimension) -> Dimension:
        """The input's own."""
        return dimension

    def table(self, drive: Drive) -> Expression:
        """The inputs."""
        return drive.input_values

    def issues(self, system: System, space: Space) -> list[Issue]:
        """No such input, bounds in another unit, or that exclude a rest that is asked for."""
        issues = super().issues(system, space)
        return issues or rest_issues(self, [self.bounds], _unit(system, self.input), space)

    def input_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """Of this input alone."""
        return {self.input: self.bounds} if self.input in system.input_names else {}


class InputRate(OneInput):
    """How fast one input changes.

    Attributes:
        rate: the most, either way, or least and largest.
    """

    rate: Quantity | tuple[Quantity, Quantity]

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the input, and what of it."""
        return f"rate_of_{self.input}"

    @property
    def given(self) -> tuple[Quantity, Quantity]:
        """Both ends."""
        return self.rate if isinstance(self.rate, tuple) else (self.rate, self.rate)

    @property
    def bounds(self) -> tuple[float, float]:
        """SI."""
        return both_ways(self.rate)

    def of(self, dimension: Dimension) -> Dimension:
        """The input's own a second."""
        return dimension / TIME

    def table(self, drive: Drive) -> Expression:
        """Their rates."""
        return drive.input_rates

    def rate_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """Of this input alone."""
        return {self.input: self.bounds} if self.input in system.input_names else {}


def _unit(system: System, name: str) -> str:
    return next(one.unit for one in system.inputs if one.name == name)
