"""Selection of readings, and how often each is taken: weights of readings within a budget."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from oed.foundation.component import Component
from oed.foundation.errors import UserMistake
from oed.foundation.quantities import parse_quantity
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.parts import Budget, Parts, budgets_of, laid_out, taken_of
from oed.kernel.results import Margin


def _amounts(value: Any) -> Any:
    # Seconds of what is read all the time, or numbers.
    return (
        {name: parse_quantity(amount, "s") for name, amount in value.items()}
        if isinstance(value, Mapping)
        else parse_quantity(value, "s")
    )


Totals = Annotated[float | dict[str, float], BeforeValidator(_amounts)]
Counts = int | dict[str, int]


class Selection(Component):
    """Weights of readings, from 0 to `most` each, within a budget.

    Attributes:
        total: total of all weights, or by sensor; of continuous readings the time that they may take [s].
        readings: instead, how many whole readings, or trials, are taken, in all or by sensor.
        most: weight of one; more than 1 where a reading, or a trial, may be repeated.
        of: unit that has a weight of its own: every reading, or every trial as a whole.
        pieces: into how many parts each trial's readings of a sensor are divided, each with one weight.
    """

    total: Totals | None = None
    readings: Annotated[Counts, Field(union_mode="left_to_right")] | None = None
    most: Annotated[float, Field(gt=0)] = 1.0
    of: Literal["readings", "trials"] = "readings"
    pieces: Annotated[int, Field(ge=1)] | None = None

    @model_validator(mode="after")
    def _one_budget(self) -> Selection:
        if (self.total is None) == (self.readings is None):
            raise ValueError("expected either total (of weights) or readings (how many whole ones)")
        if self.of == "trials" and self.pieces is not None:
            raise ValueError("pieces are parts of trials; with `of: trials` there are none")
        return self

    @property
    def whole(self) -> bool:
        """True if whole readings are taken."""
        return self.readings is not None

    def parts(self, parts: Parts) -> Parts:
        """Return the parts that have weights, from those of all readings.

        Raises:
            UserMistake: pieces of unequal length.
        """
        if self.of == "trials":
            return parts.by_run()
        return parts if self.pieces is None else parts.divided(self.pieces)

    def budgets(self, parts: Parts) -> tuple[Budget, ...]:
        """The budgets of what has weights.

        Raises:
            UserMistake: totals that no weights have.
        """
        amounts = self.total if self.readings is None else self.readings
        assert amounts is not None
        totals = (
            {name: float(amount) for name, amount in amounts.items()}
            if isinstance(amounts, dict)
            else float(amounts)
        )
        return budgets_of(parts, totals, self.most)

    def parts_of(self, sensors: Sequence[Sensor], system: System, space: Space) -> Parts:
        """Return what has weights in a design, before anything is known of what it says.

        Args:
            sensors: sensors that read.
            system: system that is driven.
            space: space of the designs.

        Raises:
            UserMistake: pieces of unequal length.
        """
        return self.parts(laid_out(sensors, system, space.samples, space.runs, space.period))

    def require_whole(self, budgets: Sequence[Budget]) -> None:
        """Refuse budgets that whole readings cannot spend.

        Args:
            budgets: budgets of the weights.

        Raises:
            UserMistake: readings of a budget differ in size, or are repeated a broken number of times.
        """
        if self.whole and any(budget.whole is None for budget in budgets):
            raise UserMistake("whole readings are of one size and repeated whole times: change `most`")

    def margins(self, sensors: Sequence[Sensor], system: System, trajectory: Trajectory) -> list[Margin]:
        """Return how much of the budget a trajectory leaves, and of the weights' bounds.

        Readings without weights are taken in full.

        Args:
            sensors: sensors that read.
            system: system that is driven.
            trajectory: the design, with its weights.
        """
        single = taken_of(sensors, system, trajectory)
        single_weights = np.ones(len(single.readings)) if trajectory.weights is None else trajectory.weights
        parts = self.parts(single)
        weights = np.array([single_weights[list(places)].mean() for places in parts.members])
        spare = [(budget.total - budget.spent(weights), budget.total) for budget in self.budgets(parts)]
        least, size = min(spare, key=lambda pair: pair[0] / pair[1])
        beyond = max(float(weights.max()) - self.most, -float(weights.min()))
        return [Margin("weights", least, size, ""), Margin("weight of a reading", -beyond, self.most, "")]
