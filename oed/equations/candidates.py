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

from oed.equations.dimensions import Dimension, quantity
from oed.equations.given import Quantity
from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import FileIssue, Issue, PathFileError, ProblemError
from oed.foundation.files import text_of

MOST = 100_000
"""Candidates."""


class Grid(Component):
    """Values of an input, evenly spaced.

    Attributes:
        least, largest: with their units.
        count: how many, both ends included.
    """

    least: Quantity
    largest: Quantity
    count: Annotated[int, Field(ge=1, le=MOST)]

    @property
    def values(self) -> tuple[Array, tuple[Dimension, ...]]:
        """The values, SI, and the dimensions of both ends.

        Raises:
            ValueError: no quantities.
        """
        (low, one), (high, other) = quantity(self.least), quantity(self.largest)
        return np.linspace(low, high, self.count), (one, other)


class Candidates(Component):
    """Trials to choose among; each is a setting of all inputs.

    Attributes:
        grid: every combination of values of the inputs.
        rows: instead, values of every input, trial by trial.
        file: instead, a CSV file with a column of every input, found from the study's folder.
    """

    grid: dict[str, Grid | tuple[Quantity, ...]] | None = None
    rows: dict[str, tuple[Quantity, ...]] | None = None
    file: str | None = None

    @model_validator(mode="after")
    def _one_way_to_give_them(self) -> Candidates:
        if sum(one is not None for one in (self.grid, self.rows, self.file)) != 1:
            raise ValueError("expected one of grid, rows and file")
        return self

    @field_validator("rows")
    @classmethod
    def _as_many_of_each(cls, rows: dict[str, tuple[Quantity, ...]] | None) -> object:
        lengths = {name: len(values) for name, values in (rows or {}).items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"expected as many values of every input, got {lengths}")
        return rows

    def read(self, folder: Path, inputs: tuple[str, ...]) -> Candidates:
        """These candidates, a file's rows in place of its name.

        Args:
            folder: from which the file is found.
            inputs: names of the columns.

        Raises:
            ProblemError: what the file lacks, by its lines.
        """
        if self.file is None:
            return self
        try:
            return Candidates(rows=_columns(folder / self.file, inputs))
        except PathFileError as error:
            issues = [Issue(("experiment", "candidates", "file"), str(one)) for one in error.issues]
            raise ProblemError(issues) from None

    @property
    def largest(self) -> dict[str, Quantity]:
        """A value of every input as it is written, the largest of a grid; of a file's inputs none."""
        given = self.grid if self.grid is not None else self.rows or {}
        return {name: one.largest if isinstance(one, Grid) else one[-1] for name, one in given.items() if one}

    def table(self, units: Mapping[str, Dimension]) -> Array:
        """Settings of the inputs, SI, (n, inputs).

        Args:
            units: dimensions of the inputs, in their order.

        Raises:
            ProblemError: inputs that there are not, or of which nothing is said, values of another unit.
        """
        given, key = (self.grid, "grid") if self.grid is not None else (self.rows or {}, "rows")
        found, issues = dict[str, Array](), list[Issue]()
        for name in dict.fromkeys((*units, *given)):
            reason = _missing(name, given, units)
            if not reason:
                try:
                    found[name], dimensions = _values(given[name])
                    wrong = [one for one in dimensions if not one.fits(units[name])]
                    reason = f"{name} is {units[name].words}, a value {wrong[0].words}" if wrong else ""
                except ValueError as error:
                    reason = str(error)
            if reason:
                issues.append(Issue(("experiment", "candidates", key, name), reason))
        if issues:
            raise ProblemError(issues)
        each = [found[name] for name in units]
        count = prod(map(len, each)) if self.grid is not None else max(map(len, each), default=0)
        if count > MOST:
            text = f"expected at most {MOST} candidates, got {count}: take fewer values"
            raise ProblemError.about(("experiment", "candidates", key), text)
        return np.array(list(product(*each)) if self.grid is not None else list(zip(*each, strict=True)))


def _missing(name: str, given: Mapping[str, object], units: Mapping[str, Dimension]) -> str:
    if name not in units:
        return f"the system has no such input; it has {', '.join(units) or 'none'}"
    return "" if name in given else f"missing: values of {name}"


def _values(given: Grid | tuple[Quantity, ...]) -> tuple[Array, tuple[Dimension, ...]]:
    if isinstance(given, Grid):
        return given.values
    if not given:
        raise ValueError("expected at least one value")
    values, dimensions = zip(*map(quantity, given), strict=True)
    return np.array(values), dimensions


def _columns(path: Path, inputs: tuple[str, ...]) -> dict[str, tuple[Quantity, ...]]:
    name, text = str(path), text_of(path, PathFileError, "utf-8-sig")
    lines = list(csv.reader(text.splitlines()))
    header = [cell.strip() for cell in lines[0]] if lines else []
    missing = [one for one in inputs if one not in header]
    if missing:
        raise PathFileError([FileIssue(name, 1, 0, "", f"the header lacks {', '.join(missing)}")])
    numbered = [(number, row) for number, row in enumerate(lines[1:], start=2) if row]
    short = [number for number, row in numbered if len(row) != len(header)]
    if short or not numbered:
        what = f"expected {len(header)} cells" if short else "expected at least one row after the header"
        raise PathFileError([FileIssue(name, short[0] if short else 1, 0, "", what)])
    issues = [
        FileIssue(name, number, 0, one, reason)
        for number, row in numbered
        for one in inputs
        if (reason := _issue(row[header.index(one)]))
    ]
    if issues:
        raise PathFileError(issues)
    return {one: tuple(row[header.index(one)].strip() for _, row in numbered) for one in inputs}


def _issue(cell: str) -> str:
    try:
        quantity(cell.strip())
    except ValueError as error:
        return str(error)
    return ""
