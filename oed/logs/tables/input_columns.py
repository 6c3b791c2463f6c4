"""Columns of the robot's inputs, each with the form in which the log has it: speeds, angles, ticks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Tag

from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.text import did_you_mean
from oed.kernel.dynamics.system import System
from oed.logs.input_forms import AngleForm, SpeedForm, TicksForm, rims, unit_factor, unit_reason
from oed.logs.integrals import Turned
from oed.logs.log import Finding
from oed.logs.odometry import UNITS, odometry_issues, rolled
from oed.logs.series import Series
from oed.logs.tables.columns import Column, PoseColumn, Short


class SpeedInput(Column, SpeedForm):
    """The column of an input's own value."""


class AngleInput(Column, AngleForm):
    """The column of an angle."""


class TicksInput(Column, TicksForm):
    """The column of an encoder's ticks."""


InputColumn = SpeedInput | AngleInput | TicksInput


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


class OdometryColumns(Component):
    """Columns of poses that odometry has summed up: their increments are the robot's speed and yaw rate.

    Attributes:
        form: "poses".
        x, y, heading: their columns.
    """

    form: Literal["poses"]
    x: Annotated[PoseColumn, Short("column")]
    y: Annotated[PoseColumn, Short("column")]
    heading: Annotated[PoseColumn, Short("column")]

    def issues(self, model: System) -> list[Issue]:
        """A robot of other inputs, and units of another kind."""
        columns = self.columns(model).items()
        reasons = {name: unit_reason(column.unit, UNITS[name]) for name, column in columns}
        units = [Issue(("log", "inputs", name, "unit"), text) for name, text in reasons.items() if text]
        return [*odometry_issues(model), *units]

    def columns(self, model: System) -> dict[str, PoseColumn]:
        """Of x, y and heading."""
        return {name: getattr(self, name) for name in UNITS}

    def turned(self, series: Series, model: System) -> tuple[list[Turned], tuple[Finding, ...]]:
        """The integral of each of the robot's inputs, and what is to be said of them."""
        factors = [unit_factor(getattr(self, name).unit, si) for name, si in UNITS.items()]
        return rolled(series.with_values(series.values * factors), model)

    def ends_needed(self, model: System) -> list[tuple[bool, bool]]:
        """Whether the first and the last row of a drive have a say, by column: they do."""
        return [(True, True)] * len(UNITS)

    @property
    def needs_every_row(self) -> bool:
        """Whether motion is lost with every row that is left out: sums go on."""
        return False


@dataclass(frozen=True)
class InputColumns:
    """A column for each of the robot's inputs, by default the one of its name.

    Attributes:
        each: those that are given, by the inputs' names.
    """

    each: Mapping[str, InputColumn]

    def issues(self, model: System) -> list[Issue]:
        """Inputs the robot does not have, forms and units that do not fit."""
        return input_issues(self.each, model)

    def columns(self, model: System) -> dict[str, Any]:
        """Of every input."""
        return {name: self.each.get(name) or SpeedInput(column=name) for name in model.input_names}

    def turned(self, series: Series, model: System) -> tuple[list[Turned], tuple[Finding, ...]]:
        """The integral of each of the robot's inputs, and what is to be said of them."""
        forms = list(zip(model.inputs, self.columns(model).values(), strict=True))
        turned = [
            form.turned(series, place, entry, model.lever(entry), str(form.column))
            for place, (entry, form) in enumerate(forms)
        ]
        by_rim = rims(forms, model)
        wild = [found for one in turned for found in one.found]
        return turned, tuple(wild if by_rim is None else [*wild, by_rim])

    def ends_needed(self, model: System) -> list[tuple[bool, bool]]:
        """Whether the first and the last row of a drive have a say, by column."""
        columns = zip(self.columns(model).values(), model.inputs, strict=True)
        return [column.ends_needed(entry) for column, entry in columns]

    @property
    def needs_every_row(self) -> bool:
        """Whether motion is lost with every row that is left out."""
        return any(column.needs_every_row for column in self.each.values())


def _sort(value: Any) -> str:
    poses = isinstance(value, OdometryColumns) or (
        isinstance(value, Mapping) and value.get("form") == "poses"
    )
    return "poses" if poses else "inputs"


AnyInputColumns = Annotated[
    Annotated[dict[str, AnyInputColumn], Tag("inputs")] | Annotated[OdometryColumns, Tag("poses")],
    Discriminator(_sort),
]
"""A log's key `inputs`: columns by the inputs' names, or those of odometry's poses."""


def input_issues(forms: Mapping[str, Any], model: System) -> list[Issue]:
    """Inputs the robot does not have, forms and units that do not fit."""
    entries = {entry.name: entry for entry in model.inputs}
    issues = []
    for name, form in forms.items():
        key, reason = (
            form.reason_against(entries[name], model.lever(entries[name]))
            if name in entries
            else ("", unknown_input(name, list(entries)))
        )
        if reason:
            issues.append(Issue(("log", "inputs", name, *filter(None, [key])), reason))
    return issues


def unknown_input(name: str, known: Sequence[str]) -> str:
    """That the robot has no such input, and which one may be meant of those that it has."""
    return f"the robot has no input {name}; it has {', '.join(known)}{did_you_mean(name, known)}"
