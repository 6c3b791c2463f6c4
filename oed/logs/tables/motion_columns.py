"""Which columns of a log are what, where a sensor read how it moved: scan matching, visual odometry."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from oed.foundation.component import Component
from oed.foundation.errors import Flaw
from oed.kernel.dynamics.system import System
from oed.logs.form import Repeats
from oed.logs.motions import PAIRS, QUANTITIES
from oed.logs.tables.columns import Column, PoseColumn, Short, TimeColumn, beside, unit_factor, unit_reason
from oed.logs.tables.table import Delimiter

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


class RelativePoseColumns(Component):
    """Where the motions of a sensor are: in each row how it moved from one time to another.

    Attributes:
        t0, t1: columns of the times between which it moved.
        time: instead of these, the column of the times at which motions end, each of which began at the row
            before; that of the inputs where none of the three is given.
        x, y, heading: columns of the sensor's pose at the end, seen from where it began.
        covariance: columns of the covariance of these.
        inverse: whether rows have the motion backwards: the pose at the beginning, seen from the end.
        file: they are in a file of their own, beside the log; "{stem}" stands for the log's stem.
        delimiter, header: of that file, as of the log's own; found by itself by default.
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
    delimiter: Delimiter | None = None
    header: bool | None = None

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

    def beside(self, log: Path) -> Path | None:
        """Where the motions of a log are; None where they are in the log itself."""
        return beside(self.file, log)

    def flaws(self, model: System) -> list[Flaw]:
        """Units of another kind."""
        reasons = {name: unit_reason(one.unit, UNITS[name]) for name, one in self.columns.items()}
        key = ("log", "relative_poses")
        return [Flaw((*key, name, "unit"), reason) for name, reason in reasons.items() if reason]
