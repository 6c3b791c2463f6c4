"""Which columns of a log are what, in a study file: times, the robot's inputs, poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
)
from pydantic_core import CoreSchema, core_schema

from oed.foundation.component import Component
from oed.foundation.quantities import parse_quantity

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds in each unit of time that logs have."""

ColumnPlace = Annotated[int, Field(ge=0, strict=True)] | str


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


class Column(Component):
    """A column of a table: its name in the header, or its index from 0."""

    column: ColumnPlace


class TimeColumn(Column):
    """The column of the times.

    Attributes:
        unit: s, ms, us or ns.
    """

    unit: Literal["s", "ms", "us", "ns"] = "s"

    @property
    def factor(self) -> float:
        """Seconds in a unit."""
        return TIME_UNITS[self.unit]


class PoseColumn(Column):
    """The column of one state of the robot.

    Attributes:
        unit: e.g. "mm", "deg"; SI by default.
    """

    unit: str | None = None


def unit_factor(unit: str | None, si: str) -> float:
    """SI units in one `unit`; 1 where none is given.

    Raises:
        ValueError: unknown, or of another kind.
    """
    return 1.0 if unit is None else parse_quantity(f"1 {unit}", si)


def unit_reason(unit: str | None, si: str) -> str:
    """Why a unit is not one of the kind of `si`; "" where it is."""
    try:
        unit_factor(unit, si)
    except ValueError as error:
        return str(error)
    return ""
