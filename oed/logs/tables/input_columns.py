"""Columns of the robot's inputs, each with the form in which the log has it: speeds, angles, ticks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from oed.foundation.errors import Flaw
from oed.foundation.text import did_you_mean
from oed.kernel.dynamics.system import Input, System
from oed.logs.integrals import Held, Turned, counted, held_integral, summed
from oed.logs.series import Series
from oed.logs.tables.columns import Column, Short, unit_factor, unit_reason


class InputColumn(Column, ABC):
    """The column of one of the robot's inputs.

    Attributes:
        sign: -1 where the log counts the other way round.
    """

    sign: Literal[1, -1] = 1

    @abstractmethod
    def turned(self, series: Series, place: int, entry: Input) -> Turned:
        """The input's time integral.

        Args:
            series: the logged inputs.
            place: of this column in its values.
            entry: the robot's input that it is.
        """

    @abstractmethod
    def reason_against(self, entry: Input) -> tuple[str, str]:
        """The key for which it cannot be this input of the robot, and why; "" where it can."""

    def ends_needed(self, entry: Input) -> tuple[bool, bool]:
        """Whether the first and the last row of a drive have a say in its integral."""
        return True, True

    @property
    def needs_every_row(self) -> bool:
        """Whether motion is lost with every row that is left out."""
        return False


class SpeedInput(InputColumn):
    """An input's own value: a wheel's speed, a steering angle.

    Attributes:
        form: "speed" of what drives the robot, "value" of an angle; by the input where not given.
        unit: e.g. "deg/s", "rpm"; SI by default.
        held: "next" for a value that holds until the next row (default of speeds), "previous" for a mean
            since the row before, "between" for straight lines between rows (default of angles).
    """

    form: Literal["speed", "value"] | None = None
    unit: str | None = None
    held: Held | None = None

    def turned(self, series: Series, place: int, entry: Input) -> Turned:
        """Integrated as held."""
        factor = self.sign * unit_factor(self.unit, entry.unit)
        values = factor * series.values[:, place]
        return Turned(held_integral(series.times, values, self._held(entry)))

    def reason_against(self, entry: Input) -> tuple[str, str]:
        """The wrong form or unit."""
        fitting = "speed" if entry.drives else "value"
        if self.form not in (None, fitting):
            return "form", f"{entry.name} is in {entry.unit}; its form is {fitting}, got {self.form!r}"
        return "unit", unit_reason(self.unit, entry.unit)

    def ends_needed(self, entry: Input) -> tuple[bool, bool]:
        """A value that holds to the next row is not used in the last one, a mean not in the first."""
        return self._held(entry) != "previous", self._held(entry) != "next"

    def _held(self, entry: Input) -> Held:
        return self.held or ("next" if entry.drives else "between")


class AngleInput(InputColumn):
    """The angle that a wheel has turned, unwrapped or with a range.

    Attributes:
        unit: "deg", "rad", "turn", ...; SI by default (for an input in m/s: of a length).
        wrap: full range in this unit where the angle begins anew, e.g. 360.
    """

    form: Literal["angle"]
    unit: str | None = None
    wrap: Annotated[float, Field(gt=0)] | None = None

    def turned(self, series: Series, place: int, entry: Input) -> Turned:
        """What was turned since the first row."""
        found = counted(series, place, str(self.column), self.wrap)
        factor = self.sign * unit_factor(self.unit, _unit_of_integral(entry))
        return Turned(factor * found.integral, True, found.wraps, found.flaws)

    def reason_against(self, entry: Input) -> tuple[str, str]:
        """Not of a wheel, or the wrong unit."""
        reason = _not_driving(entry, "angle")
        return ("form", reason) if reason else ("unit", unit_reason(self.unit, _unit_of_integral(entry)))


class TicksInput(InputColumn):
    """An encoder's ticks.

    Attributes:
        ticks_per_turn: of the encoder.
        gear: turns of the encoder per turn of the wheel.
        cumulative: whether the ticks add up; else each row has those since the row before.
        wrap: range after which a cumulative counter begins anew, e.g. 65536.
    """

    form: Literal["ticks"]
    ticks_per_turn: Annotated[float, Field(gt=0)]
    gear: Annotated[float, Field(gt=0)] = 1.0
    cumulative: bool = False
    wrap: Annotated[float, Field(gt=0)] | None = None

    def turned(self, series: Series, place: int, entry: Input) -> Turned:
        """Every tick counted once."""
        if self.cumulative:
            found = counted(series, place, str(self.column), self.wrap)
        else:
            found = Turned(summed(series.values[:, place]))
        angle = self.sign * 2 * np.pi / (self.ticks_per_turn * self.gear)
        return Turned(angle * found.integral, self.cumulative, found.wraps, found.flaws)

    def reason_against(self, entry: Input) -> tuple[str, str]:
        """Not of a wheel, or a range of something that does not add up."""
        if self.wrap is not None and not self.cumulative:
            return "wrap", "`wrap` is the range of a cumulative counter; add `cumulative: true`"
        return "form", _not_driving(entry, "ticks") or (
            "" if entry.unit == "rad/s" else f"{entry.name} is in {entry.unit}; ticks count turns"
        )

    def ends_needed(self, entry: Input) -> tuple[bool, bool]:
        """Ticks of the first row fell before the drive."""
        return self.cumulative, True

    @property
    def needs_every_row(self) -> bool:
        """Ticks since the row before are in no other row."""
        return not self.cumulative


def _form(value: Any) -> str:
    # By what is given, so that mistakes are those of the form that was meant.
    form = value.get("form") if isinstance(value, Mapping) else getattr(value, "form", None)
    return "speed" if form in (None, "value") else str(form)


AnyInputColumn = Annotated[
    Annotated[SpeedInput, Tag("speed")]
    | Annotated[AngleInput, Tag("angle")]
    | Annotated[TicksInput, Tag("ticks")],
    Discriminator(_form),
    Short("column"),
]


def input_flaws(columns: Mapping[str, Any], model: System) -> list[Flaw]:
    """Inputs the robot does not have, forms and units that do not fit."""
    entries = {entry.name: entry for entry in model.inputs}
    flaws = []
    for name, column in columns.items():
        key, reason = (
            column.reason_against(entries[name])
            if name in entries
            else ("", unknown_input(name, list(entries)))
        )
        if reason:
            flaws.append(Flaw(("log", "inputs", name, *filter(None, [key])), reason))
    return flaws


def unknown_input(name: str, known: Sequence[str]) -> str:
    """That the robot has no such input, and which one may be meant of those that it has."""
    return f"the robot has no input {name}; it has {', '.join(known)}{did_you_mean(name, known)}"


def input_columns(columns: Mapping[str, InputColumn], model: System) -> Sequence[InputColumn]:
    """A column for each of the robot's inputs, by default the one of its name."""
    return [columns.get(name) or SpeedInput(column=name) for name in model.input_names]


def _unit_of_integral(entry: Input) -> str:
    return entry.unit.removesuffix("/s")


def _not_driving(entry: Input, form: str) -> str:
    return "" if entry.drives else f"{entry.name} is no wheel's speed; its form is value, got {form!r}"
