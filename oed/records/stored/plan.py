"""What plan.json holds."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from oed.records.stored.parts import Count, Number, Positive, Stored


class PlannedAim(Stored):
    """A standard error that is wanted of a parameter; SI."""

    name: str
    unit: str
    nominal: Number
    wanted: Positive


class PlannedPoint(Stored):
    """A drive that was designed for the plan.

    `value` is what was varied, in the axis's unit; `errors` are standard errors of one such drive, SI;
    `worst` is the largest of them in units of what is wanted, `drives` how many such drives are needed.
    """

    value: Number
    text: str
    folder: str
    status: str
    errors: dict[str, Positive]
    worst: Positive | None
    drives: Count | None


class PlannedAxis(Stored):
    """What was varied alone: the duration, the room or the noise; `base` is the study's own value."""

    name: str
    unit: str
    base: Number
    points: Annotated[list[PlannedPoint], Field(min_length=1)]


class StoredPlan(Stored):
    """How long, or how many drives, for the precision that is wanted.

    `duration` is that of the study's drives [s], `drives` how many of them are needed, `one_drive` about how
    long a single one would have to be [s].
    """

    format: Literal[1]
    oed_version: str
    study: str
    name: str
    aims: Annotated[list[PlannedAim], Field(min_length=1)]
    axes: list[PlannedAxis]
    duration: Positive
    one_drive: Positive | None
    drives: Count | None
    answer: str
    interrupted: bool

    @property
    def own(self) -> PlannedPoint | None:
        """The study's own drive; None where there is none."""
        points = (one for one in self.axes[0].points if one.value == self.axes[0].base) if self.axes else ()
        return next((one for one in points if one.errors), None)
