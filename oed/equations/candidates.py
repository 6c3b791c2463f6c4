"""Trials that an experiment may consist of: settings of the inputs, listed or on a grid."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from itertools import product
from math import prod
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator, model_validator

from oed.equations.dimensions import Dimension, Quantity, expect_quantity, quantity
from oed.equations.issues import Issues, no_such
from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import PathFileError, ProblemError
from oed.foundation.files import text_of

MOST = 100_000
"""Largest number of candidates."""


class Grid(Component):
    """Values of an input, evenly spaced.

    Attributes:
        least, largest: ends, with their units.
        count: number of values, both ends included.
    """

    least: Quantity
    largest: Quantity
    count: Annotated[int, Field(ge=1, le=MOST)]


class Candidates(Component):
    """Trials to choose among; each is a setting of all inputs.

    Attributes:
        grid: every combination of values of the inputs.
        rows: instead, values of every input, trial by trial.
        file: instead, a CSV file with a column for every input, found from the study's folder.
    """

    grid: dict[str, Grid | tuple[Quantity, ...]] | None = None
    rows: dict[str, tuple[Quantity, ...]] | None = None
    file: str | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> Candidates:
        if [self.grid, self.rows, self.file].count(None) != 2:
            raise ValueError("expected one of grid, rows and file")
        return self

    @field_validator("rows")
    @classmethod
    def _equal_lengths(cls, rows: dict[str, tuple[Quantity, ...]] | None) -> object:
        lengths = {name: len(values) for name, values in (rows or {}).items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"expected as many values of every input, got {lengths}")
        return rows

    def read(self, folder: Path, inputs: tuple[str, ...]) -> Candidates:
        """Return these candidates, a file's rows in place of its name.

        Args:
            folder: folder that the file's name starts from.
            inputs: names of the columns.

        Raises:
            ProblemError: mistakes in the file, by its lines.
        """
        return self if self.file is None else Candidates(rows=_columns(folder / self.file, inputs))

    @property
    def entries(self) -> Mapping[str, Grid | tuple[Quantity, ...]]:
        """Values by the inputs' names; none of a file that has not been read."""
        return self.rows or {} if self.grid is None else self.grid

    @property
    def largest(self) -> dict[str, Quantity]:
        """One value of every input as the study has it, the largest of a grid."""
        return {
            name: values.largest if isinstance(values, Grid) else values[-1]
            for name, values in self.entries.items()
            if values
        }

    def table(self, dimensions: Mapping[str, Dimension]) -> Array:
        """Return the settings of the inputs, SI, (n, inputs).

        Args:
            dimensions: dimensions of the inputs, in their order.

        Raises:
            ProblemError: unknown inputs, inputs without values, or values in another unit.
        """
        issues = Issues("experiment", "candidates", "rows" if self.grid is None else "grid")
        issues.compare(self.entries, dimensions, "missing: values of {}", no_such("input", dimensions))
        columns = dict[str, Array]()
        for name, values in self.entries.items():
            if name in dimensions:
                with issues.at(name):
                    columns[name] = _column(values, dimensions[name], name)
        issues.check()
        ordered = [columns[name] for name in dimensions]
        count = max(map(len, ordered), default=0) if self.grid is None else prod(map(len, ordered))
        if count > MOST:
            issues.add(f"expected at most {MOST} candidates, got {count}: take fewer values")
            issues.check()
        return np.array(list(zip(*ordered, strict=True) if self.grid is None else product(*ordered)))


def _column(values: Grid | tuple[Quantity, ...], expected: Dimension, name: str) -> Array:
    if not values:
        raise ValueError("expected at least one value")
    message = f"{name} is {{expected}}, a value {{got}}"
    if isinstance(values, Grid):
        low, high = (expect_quantity(end, expected, message) for end in (values.least, values.largest))
        return np.linspace(low, high, values.count)
    return np.array([expect_quantity(value, expected, message) for value in values])


def _columns(path: Path, inputs: tuple[str, ...]) -> dict[str, tuple[Quantity, ...]]:
    issues = Issues("experiment", "candidates", "file")
    try:
        text = text_of(path, PathFileError, "utf-8-sig")
    except PathFileError as error:
        raise ProblemError.about(issues.key, str(error)) from None
    header, *lines = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines())] or [[]]
    rows = {number: row for number, row in enumerate(lines, start=2) if row}
    missing = ", ".join(name for name in inputs if name not in header)
    if missing:
        issues.add(f"{path}:1: the header lacks {missing}")
    elif not rows:
        issues.add(f"{path}:1: expected at least one row after the header")
    issues.check()
    columns: dict[str, list[Quantity]] = {name: [] for name in inputs}
    for number, row in rows.items():
        if len(row) != len(header):
            issues.add(f"{path}:{number}: expected {len(header)} cells")
            continue
        for name in inputs:
            columns[name].append(row[header.index(name)])
            try:
                quantity(columns[name][-1])
            except ValueError as error:
                issues.add(f"{path}:{number}: {name}: {error}")
    issues.check()
    return {name: tuple(values) for name, values in columns.items()}
