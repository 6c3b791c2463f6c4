"""Limits on inputs of systems that are given by equations, each input by its name."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import model_validator

from oed.equations.dimensions import quantity
from oed.equations.system import Equations
from oed.foundation.errors import Flaw
from oed.foundation.text import did_you_mean
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System
from oed.kernel.limit import Limit, Rows, rest_flaws


class InputRange(Limit):
    """One input between two values.

    Attributes:
        input: its name.
        range: least and largest value, with their units.
    """

    looks_at: ClassVar[Literal["inputs"]] = "inputs"
    input: str
    range: tuple[str | float, str | float]

    @model_validator(mode="after")
    def _rising(self) -> InputRange:
        low, high = self.bounds
        if not low < high:
            raise ValueError(f"expected [least, largest], got {list(self.range)}")
        return self

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the input."""
        return self.input

    @property
    def bounds(self) -> tuple[float, float]:
        """SI."""
        low, high = (quantity(one)[0] for one in self.range)
        return low, high

    def flaws(self, system: System, space: Space) -> list[Flaw]:
        """No such input, bounds in another unit, or that exclude a rest that is asked for."""
        units = dict(system.input_units) if isinstance(system, Equations) else {}
        if self.input not in units:
            known = ", ".join(system.input_names) or "none"
            meant = did_you_mean(self.input, system.input_names)
            return [Flaw(("limits", self.input), f"there is no such input; the inputs are {known}{meant}")]
        dimensions = {quantity(one)[1] for one in self.range}
        wrong = [one for one in dimensions if not one.fits(units[self.input])]
        flaws = [
            Flaw(("limits", self.input), f"{self.input} is {units[self.input].words}, its bound {one.words}")
            for one in wrong
        ]
        return flaws or rest_flaws(self, [self.bounds], units[self.input].text, space)

    def input_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """Of this input alone."""
        return {self.input: self.bounds} if self.input in system.input_names else {}

    def rows(self, drive: Drive) -> Rows:
        """The input at all times."""
        column = drive.input_values[:, drive.system.input_names.index(self.input)]
        low, high = self.bounds
        count = column.shape[0]
        size = max(abs(low), abs(high))
        unit = next(one.unit for one in drive.system.inputs if one.name == self.input)
        return Rows(column, np.full(count, low), np.full(count, high), size, unit)
