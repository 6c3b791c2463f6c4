"""Limit on the angle between a tractor and its trailer."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from oed.foundation.errors import Flaw
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System, label_of
from oed.kernel.limit import BareLimit, PathLimit, Rows, TwoSided

STATE = "trailer_angle"


class TrailerAngle(BareLimit, PathLimit):
    """The trailer's angle within `bounds` [rad]: 0 straight behind, before the trailer jackknifes."""

    name: ClassVar[str] = "trailer_angle"
    in_degrees: ClassVar[bool] = True
    bounds: Annotated[tuple[float, float], TwoSided("rad", "60 deg")]

    def rows_at(self, path: Expression, system: System) -> Rows:
        """The angle at every point."""
        angle = path[:, system.states.index(STATE)]
        count, (low, high) = angle.shape[0], self.bounds
        return Rows(angle, np.full(count, low), np.full(count, high), max(abs(low), abs(high)), "rad")

    def flaws(self, system: System, space: Space) -> list[Flaw]:
        """A robot without a trailer, or bounds that exclude 0, where every run begins."""
        low, high = self.bounds
        if STATE not in system.states:
            text = f"{label_of(system)} has no trailer"
        elif not low <= 0 <= high:
            text = f"[{low:g}, {high:g}] rad excludes 0, where every run begins"
        else:
            return []
        return [Flaw(("limits", self.name), text)]
