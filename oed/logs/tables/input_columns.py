"""Columns of the robot's inputs, each with the form in which the log has it: speeds, angles, ticks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import Discriminator, Tag

from oed.foundation.errors import Flaw
from oed.foundation.text import did_you_mean
from oed.kernel.dynamics.system import System
from oed.logs.input_forms import AngleForm, SpeedForm, TicksForm
from oed.logs.tables.columns import Column, Short


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


def input_flaws(forms: Mapping[str, Any], model: System) -> list[Flaw]:
    """Inputs the robot does not have, forms and units that do not fit."""
    entries = {entry.name: entry for entry in model.inputs}
    flaws = []
    for name, form in forms.items():
        key, reason = (
            form.reason_against(entries[name], model.lever(entries[name]))
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
