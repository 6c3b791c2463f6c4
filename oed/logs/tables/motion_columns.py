"""Which columns of a log are what, where a sensor read how it moved: scan matching, visual odometry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.kernel.dynamics.system import System
from oed.logs.form import Repeats
from oed.logs.input_forms import unit_factor, unit_reason
from oed.logs.motions import PAIRS, QUANTITIES, inverted
from oed.logs.series import Series
from oed.logs.tables.columns import Column, MaybeBeside, PoseColumn, Short, TimeColumn

Key = tuple[str, ...]
UNITS = dict(zip(QUANTITIES, ("m", "m", "rad"), strict=True))

ENTRIES = ("xx", "xy", "xh", "yy", "yh", "hh")
"""Keys of a covariance's entries, in the order of `PAIRS`."""


class CovarianceColumns(Component):
    """The columns of a motion's covariance, in the units of those of x, y and heading.

    Attributes:
        xx, yy, hh: variances of x, y and heading.
        xy, xh, yh: covariances; 0 where there is no column.
    """

    xx: Annotated[Column, Short("column")]
    yy: Annotated[Column, Short("column")]
    hh: Annotated[Column, Short("column")]
    xy: Annotated[Column, Short("column")] | None = None
    xh: Annotated[Column, Short("column")] | None = None
    yh: Annotated[Column, Short("column")] | None = None


class RelativePoseColumns(MaybeBeside):
    """Where the motions of a sensor are: in each row how it moved from one time to another.

    Attributes:
        t0, t1: columns of the times between which it moved.
        time: instead of these, the column of the times at which motions end, each of which began at the row
            before; that of the inputs where none of the three is given.
        x, y, heading: columns of the sensor's pose at the end, seen from where it began.
        covariance: columns of the covariance of these.
        inverse: whether rows have the motion backwards: the pose at the beginning, seen from the end.
    """

    t0: Annotated[TimeColumn, Short("column")] | None = None
    t1: Annotated[TimeColumn, Short("column")] | None = None
    time: Annotated[TimeColumn, Short("column")] | None = None
    x: Annotated[PoseColumn, Short("column")] = PoseColumn(column="x")
    y: Annotated[PoseColumn, Short("column")] = PoseColumn(column="y")
    heading: Annotated[PoseColumn, Short("column")] = PoseColumn(column="heading")
    covariance: CovarianceColumns | None = None
    inverse: bool = False
    file: Annotated[str, Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _times_in_one_way(self) -> RelativePoseColumns:
        if (self.t0 is None) != (self.t1 is None):
            raise ValueError("t0 and t1 belong together: give both, or `time` of rows that follow each other")
        if self.t0 is not None and self.time is not None:
            raise ValueError("give t0 and t1, or `time` of rows that follow each other; not both")
        if self.inverse and self.covariance is not None:
            raise ValueError("a covariance is that of the motion forwards; omit it, or give motions forwards")
        return self

    @property
    def clock(self) -> TimeColumn | None:
        """The column of the times at which motions end; None for that of the inputs."""
        return self.t1 or self.time

    @property
    def held(self) -> Repeats:
        """A motion of 0 is one."""
        return "keep"

    @property
    def columns(self) -> dict[str, PoseColumn]:
        """Of x, y and heading."""
        return {"x": self.x, "y": self.y, "heading": self.heading}

    @property
    def factors(self) -> list[float]:
        """SI units in those of the columns of x, y, heading and of the covariance's entries."""
        each = [unit_factor(one.unit, UNITS[name]) for name, one in self.columns.items()]
        return [*each, *(each[row] * each[column] for row, column in PAIRS if self.covariance is not None)]

    def issues(self, model: System) -> list[Issue]:
        """Units of another kind."""
        reasons = {name: unit_reason(one.unit, UNITS[name]) for name, one in self.columns.items()}
        key, clocks = ("log", "relative_poses"), {"t0": self.t0, "t1": self.t1, "time": self.time}
        units = [Issue((*key, name, "unit"), reason) for name, reason in reasons.items() if reason]
        return [*units, *(issue for name, one in clocks.items() if one for issue in one.issues(key[1], name))]


def motion_columns(given: RelativePoseColumns) -> dict[Key, Column]:
    """All columns of motions by their keys within `log`, but that of when they end."""
    columns: dict[Key, Column] = {} if given.t0 is None else {("relative_poses", "t0"): given.t0}
    columns |= {("relative_poses", name): one for name, one in given.columns.items()}
    for name, one in given.covariance or ():
        if one is not None:
            columns["relative_poses", "covariance", name] = one
    return columns


def motion_series(series: Series, runs: Sequence[str] | None, given: RelativePoseColumns) -> Series:
    """When each motion began, what it was, and all entries of its covariance, SI.

    Args:
        series: the numbers of `motion_columns`.
        runs: of every row, where there are several.
        given: which column has what.
    """
    if given.t0 is not None:
        begins, values = series.values[:, 0], series.values[:, 1:]
    else:
        begins, values = _before(series, runs), series.values
    if given.covariance is not None:
        names = [name for name, one in given.covariance if one is not None]
        none = np.where(np.isnan(values[:, 0]), np.nan, 0.0)
        own = dict(zip(names, values[:, 3:].T, strict=True))
        values = np.column_stack([values[:, :3], *(own.get(name, none) for name in ENTRIES)])
    values = values * given.factors
    if given.inverse:
        values[:, :3] = inverted(values[:, :3])
    return series.with_values(np.column_stack([begins, values]))


def _before(series: Series, runs: Sequence[str] | None) -> Array:
    # The time of the row with numbers before each row of the same run; of the first its own.
    begins = np.full(len(series), np.nan)
    filled = np.flatnonzero(~np.isnan(np.column_stack([series.times, series.values])).any(axis=1))
    labels = np.array(runs)[filled] if runs is not None else np.zeros(len(filled))
    for label in np.unique(labels):
        rows = filled[labels == label]
        begins[rows] = series.times[np.concatenate([rows[:1], rows[:-1]])]
    return begins
