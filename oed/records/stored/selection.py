"""Readings of a design that were chosen, and how good the choice is."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from oed.records.stored.parts import Count, Number, Positive, Stored


class StoredBudget(Stored):
    """Weights of some readings in a row, by their places: what of them is taken together, and the most of
    each.
    """

    readings: Annotated[list[Count], Field(min_length=1)]
    total: Positive
    most: Positive


class StoredReading(Stored):
    """A reading, or a group of them, with its weight.

    Attributes:
        sensor: label; "" of several together.
        run: of the design, from 0.
        time: of that run [s]; of a group the mean.
        size: how much of a budget it is at a weight of 1.
        weight: that it has.
        relaxed: that it has where weights need not be whole.
        derivative: of the criterion, linearised at the relaxed weights, by its weight.
    """

    sensor: str
    run: Count
    time: Number
    size: Positive
    weight: Positive
    relaxed: Positive
    derivative: Number


class StoredSelection(Stored):
    """Chosen readings of one design.

    Attributes:
        whole: whether whole readings were to be chosen.
        budgets: of the weights.
        readings: what has weights.
        value: of the criterion with the chosen weights.
        relaxed: of the criterion with the best weights, whole or not.
        bound: no weights of these readings within the budgets have more.
        efficiency: how many designs like the best bound allows inform as one of this does; None where a
            repetition does not change the criterion.
    """

    whole: bool
    budgets: Annotated[list[StoredBudget], Field(min_length=1)]
    readings: Annotated[list[StoredReading], Field(min_length=1)]
    value: Number
    relaxed: Number
    bound: Number
    efficiency: Positive | None

    @property
    def of_runs(self) -> bool:
        """Whether runs are chosen among as a whole: there is one reading of each."""
        return len(self.readings) == len({one.run for one in self.readings}) > 1
