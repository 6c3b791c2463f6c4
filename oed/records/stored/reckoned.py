"""Dead reckoning along logs, as estimate.json holds it: its errors, and its paths."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from oed.foundation.arrays import Array
from oed.records.stored.parts import Column, Maybe, Number, Place, Stored, require_alike


class Reckoned(Stored):
    """Errors of dead reckoning along a log, as `Reckoning` has them; None where there are none to say."""

    __pydantic_extra__: dict[str, Number | None]

    length: Maybe = None
    rmse_position: Maybe = None
    rmse_aligned: Maybe = None
    rmse_heading: Maybe = None
    end_position: Maybe = None
    end_heading: Maybe = None
    drift_position: Maybe = None
    drift_heading: Maybe = None


class UnseenLogs(Stored):
    """Dead reckoning of logs that an estimate does not know, with nominal and with its parameters."""

    logs: Annotated[list[str], Field(min_length=1)]
    before: list[Reckoned]
    after: list[Reckoned]
    parameters: dict[str, Maybe] | Column | None = None
    mean: dict[str, Reckoned] | None = None

    def _require(self) -> None:
        require_alike(len(self.logs), before=self.before, after=self.after)


class ReckonedPath(Stored):
    """A path (x, y) [m], measured, and by dead reckoning with nominal (before) and estimated parameters, and
    its headings [rad]; None where it is interrupted. `before` and `after` are the errors of all of it.
    """

    log: str
    role: str | None = None
    t: Place | None = None
    x: Place
    y: Place
    before_x: Place
    before_y: Place
    after_x: Place
    after_y: Place
    heading: Place | None = None
    before_heading: Place | None = None
    after_heading: Place | None = None
    before: Reckoned | None = None
    after: Reckoned | None = None

    @property
    def paths(self) -> tuple[Array, Array, Array]:
        """Measured, before and after, each (n, 2)."""
        measured = np.array([self.x, self.y], dtype=float).T
        before = np.array([self.before_x, self.before_y], dtype=float).T
        return measured, before, np.array([self.after_x, self.after_y], dtype=float).T

    @property
    def position_errors(self) -> tuple[Array, Array]:
        """Distances to the measured path [m], before and after, each (n,)."""
        measured, before, after = self.paths
        return np.hypot(*(before - measured).T), np.hypot(*(after - measured).T)

    @property
    def heading_errors(self) -> tuple[Array, Array] | None:
        """Errors of the heading [rad], before and after, each (n,); None where it was not measured."""
        if not self.heading or not self.before_heading or not self.after_heading:
            return None
        measured = np.array(self.heading, dtype=float)
        before, after = (np.array(one, dtype=float) for one in (self.before_heading, self.after_heading))
        return (before - measured, after - measured) if np.isfinite(after - measured).any() else None

    @property
    def drawable(self) -> bool:
        """Whether each has a point."""
        return all(np.isfinite(path).all(axis=1).any() for path in self.paths)

    def _require(self) -> None:
        columns = ("y", "before_x", "before_y", "after_x", "after_y")
        require_alike(len(self.x), **{name: getattr(self, name) for name in columns})
        later = ("t", "heading", "before_heading", "after_heading")
        known = {name: column for name in later if (column := getattr(self, name))}
        require_alike(len(self.x), **known)
