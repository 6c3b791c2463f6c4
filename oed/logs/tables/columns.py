"""Which columns of a log are what, in a study file: times, and the reference poses, which may stand in a file
beside it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
)
from pydantic_core import CoreSchema, core_schema

from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.text import did_you_mean
from oed.kernel.dynamics.system import System
from oed.logs.form import Repeats
from oed.logs.input_forms import unit_reason
from oed.logs.tables.table import Delimiter

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds in each unit of time that logs have."""

ColumnPlace = Annotated[int, Field(ge=0, strict=True)] | str


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] <= ends[1]:
        raise ValueError(f"expected [low, high], got [{ends[0]:g}, {ends[1]:g}]")
    return ends


Wanted = float | str | Annotated[tuple[float, float], AfterValidator(_rising)]


def _names(value: Any) -> Any:
    return {str(key): entry for key, entry in value.items()} if isinstance(value, Mapping) else value


Kept = Annotated[dict[str, Wanted], BeforeValidator(_names)]
"""Values, or ranges, of columns in the rows that are kept."""


@dataclass(frozen=True)
class Short:
    """Pydantic annotation: a value that is no mapping stands for {key: value}, as in `x: 2`."""

    key: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Write the short form out before validation."""
        return core_schema.no_info_before_validator_function(self._written_out, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> Mapping[str, Any]:
        """Either form, for editors."""
        return {"anyOf": [handler(schema), {"type": ["integer", "string"]}]}

    def _written_out(self, value: Any) -> Any:
        return value if isinstance(value, Mapping | Component) else {self.key: value}


@dataclass(frozen=True)
class MayBeNone:
    """Pydantic annotation: poses that are "none", for none of x, y and heading was measured."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Write the word out before validation."""
        return core_schema.no_info_before_validator_function(self._written_out, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> Mapping[str, Any]:
        """Either form, for editors."""
        return {"anyOf": [handler(schema), {"enum": ["none"]}]}

    def _written_out(self, value: Any) -> Any:
        return dict.fromkeys(("x", "y", "heading"), "none") if value == "none" else value


class Column(Component):
    """A column of a table: its name in the header, or its index from 0."""

    column: ColumnPlace


class TimeColumn(Column):
    """The column of the times.

    Attributes:
        form: "number", or "date" for dates and times as in ISO 8601; found by itself by default.
        unit: s, ms, us or ns, of numbers; by default s, or the one in which they are times since 1970.
    """

    form: Literal["number", "date"] | None = None
    unit: Literal["s", "ms", "us", "ns"] | None = None

    def issues(self, *key: str) -> list[Issue]:
        """A unit of dates; `key` is the column's own, within `log`."""
        if self.form == "date" and self.unit is not None:
            return [Issue(("log", *key, "unit"), "a date has no unit; leave it out")]
        return []


class PoseColumn(Column):
    """The column of one state of the robot.

    Attributes:
        unit: e.g. "mm", "deg"; SI by default.
    """

    unit: str | None = None


NONE_OR_GIVEN = Discriminator(lambda value: "none" if value == "none" else "given")
"""What is the word "none", or tagged "given"."""
AnyPoseColumn = Annotated[
    Annotated[Literal["none"], Tag("none")] | Annotated[PoseColumn, Short("column"), Tag("given")],
    NONE_OR_GIVEN,
]


class MaybeBeside(Component):
    """What may be in a file of its own, beside the log.

    Attributes:
        file: that file; "{stem}" stands for the log's stem.
        delimiter, header: of it, as of the log's own; found by themselves by default.
    """

    file: str | None = None
    delimiter: Delimiter | None = None
    header: bool | None = None

    def beside(self, log: Path) -> Path | None:
        """The file of a log; None where it is all in the log itself."""
        return None if self.file is None else log.parent / self.file.replace("{stem}", log.stem)


class PoseColumns(MaybeBeside):
    """Where the reference poses are; further states of the robot are keys by their own names.

    Attributes:
        x, y, heading: their columns, or "none" for what was not measured.
        time: column of their own clock, where it is not that of the inputs.
        form: of their file: "tum" (timestamp, position, quaternion) or "csv"; by its ending by default.
        keep: only the poses of rows in which these columns have the value, or lie within [low, high]; the
            wheels turn on in others.
        held: "drop" rows that repeat a pose while the wheels turn, as a slower sensor's do, or "keep" them.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, AnyPoseColumn] = Field(init=False)

    x: AnyPoseColumn = PoseColumn(column="x")
    y: AnyPoseColumn = PoseColumn(column="y")
    heading: AnyPoseColumn = PoseColumn(column="heading")
    time: Annotated[TimeColumn, Short("column")] | None = None
    form: Literal["tum", "csv"] | None = None
    keep: Kept = {}  # noqa: RUF012
    held: Repeats = "drop"

    @property
    def is_tum(self) -> bool:
        """Whether the poses are in a TUM file."""
        by_ending = (self.file or "").lower().endswith((".tum", ".txt"))
        return self.file is not None and (self.form == "tum" or (self.form is None and by_ending))

    @property
    def clock(self) -> TimeColumn | None:
        """The column of their times; None for that of the inputs."""
        return self.time

    @property
    def columns(self) -> dict[str, PoseColumn]:
        """What was measured, by the state's name."""
        plain = {"x": self.x, "y": self.y, "heading": self.heading}
        further = self.__pydantic_extra__ or {}
        return {name: one for name, one in (plain | further).items() if isinstance(one, PoseColumn)}

    def issues(self, model: System, *, needed: bool = True) -> list[Issue]:
        """States the robot does not have, units of another kind, nothing measured where that is `needed`."""
        key, issues = ("log", "poses"), []
        units = dict(zip(model.states, model.state_units, strict=True))
        for name, column in self.columns.items():
            if name not in units:
                hint = did_you_mean(name, units)
                text = f"the robot has no state {name}; it has {', '.join(model.states)}{hint}"
                issues.append(Issue((*key, name), text))
            elif reason := unit_reason(column.unit, units[name]):
                issues.append(Issue((*key, name, "unit"), reason))
        if needed and not self.columns:
            issues.append(Issue(key, "nothing of the robot's pose was measured"))
        if self.form is not None and self.file is None:
            issues.append(Issue((*key, "form"), "is that of a file of its own; add `file`"))
        issues += [] if self.time is None else self.time.issues("poses", "time")
        if self.is_tum and self.keep:
            issues.append(Issue((*key, "keep"), "a TUM file has no further columns; leave it out"))
        return issues
