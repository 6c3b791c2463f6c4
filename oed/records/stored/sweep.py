"""What sweep.json holds."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from oed.foundation.presenting import Card, Presented, dataframe, given, number
from oed.records.stored.parts import (
    Count,
    Name,
    Number,
    Positive,
    Seconds,
    Seed,
    Stored,
    require_different,
    require_known,
)

RECORD = "record.json"


class SweptKey(Stored):
    """A key that was varied, and its values."""

    key: str
    name: str
    unit: str
    values: Annotated[list[str], Field(min_length=1)]
    numeric: bool

    @property
    def varied(self) -> bool:
        """Whether it has several values."""
        return len(self.values) > 1


class SweptPoint(Stored):
    """A point, in a folder of its own: the values of the keys, and what its best drive reaches; SI."""

    values: dict[str, str]
    numbers: dict[str, Number | None]
    label: str
    folder: Name
    record: str | None
    status: str
    message: str
    seed: Seed
    design: str | None
    objective: Number | None
    lambda_min: Number | None
    standard_deviations: dict[str, Positive | None]
    upper_bound: Number | None
    gap: Number | None
    seconds: Seconds | None

    def _require(self) -> None:
        expected = f"{self.folder}/{RECORD}"
        if self.record not in (None, expected):
            raise ValueError(f"record: expected {expected!r}, got {self.record!r}")
        if self.record is None and self.design is not None:
            raise ValueError("record: expected that of the design, got none")


class StoredSweep(Presented, Stored):
    """A sweep."""

    format: Literal[1]
    oed_version: str
    study: str
    name: str
    keys: Annotated[list[SweptKey], Field(min_length=1)]
    points: Annotated[list[SweptPoint], Field(min_length=1)]
    best: str | None
    comparable: bool
    kept: Count = 0
    interrupted: bool

    def _require(self) -> None:
        folders = [one.folder for one in self.points]
        require_different("points", folders)
        require_known("best", [self.best] if self.best is not None else [], folders)
        seen = set[tuple[str, ...]]()
        for place, one in enumerate(self.points):
            self._require_values(f"points.{place}", one)
            seen.add(tuple(one.values[axis.key] for axis in self.keys))
        if len(seen) < len(self.points):
            raise ValueError("points: expected other values in each, got some twice")
        if len(seen) < self._combinations:
            raise ValueError(f"points: expected all {self._combinations} combinations, got {len(seen)}")

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row per point: the keys' values and what the best drive reaches, SI.

        Raises:
            UserMistake: pandas is not installed.
        """
        columns: dict[str, Any] = {
            axis.key: [(one.numbers if axis.numeric else one.values)[axis.key] for one in self.points]
            for axis in self.keys
        }
        for name in ("status", "design", "objective", "lambda_min", "upper_bound", "gap", "seconds"):
            columns[name] = [getattr(one, name) for one in self.points]
        parameters = dict.fromkeys(name for one in self.points for name in one.standard_deviations)
        for name in parameters:
            columns[name] = [one.standard_deviations.get(name) for one in self.points]
        return dataframe(
            columns, {"seconds": "s", **{axis.key: axis.unit for axis in self.keys if axis.numeric}}
        )

    def _card(self) -> Card:
        facts = given(
            ("varied", ", ".join(f"{axis.key} ({len(axis.values)})" for axis in self.varied)),
            ("points", str(len(self.points))),
            ("best", self.best),
            ("interrupted", "yes" if self.interrupted else ""),
        )
        rows = tuple((one.label, one.status, number(one.objective)) for one in self.points)
        return Card(f"Sweep of {self.name}", facts, ("point", "status", "objective"), rows)

    @property
    def varied(self) -> list[SweptKey]:
        """The keys of several values."""
        return [axis for axis in self.keys if axis.varied]

    @property
    def _combinations(self) -> int:
        product = 1
        for axis in self.keys:
            product *= len(set(axis.values))
        return product

    def _require_values(self, what: str, one: SweptPoint) -> None:
        for axis in self.keys:
            value = one.values.get(axis.key)
            require_known(f"{what}.values.{axis.key}", [str(value)], axis.values)
            if axis.numeric and one.numbers.get(axis.key) is None:
                raise ValueError(f"{what}.numbers.{axis.key}: expected a number, got none")
