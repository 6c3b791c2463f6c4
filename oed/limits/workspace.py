"""Limits on where the robot may be."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import field_validator

from oed.errors import Flaw
from oed.limits.limit import Limit, Rows
from oed.models.model import Model
from oed.quantities import Length
from oed.rollout import Drive
from oed.trajectory import DesignSpace


class Workspace(Limit):
    """An area that the robot's origin must not leave."""

    name: ClassVar[str] = "workspace"
    kind: str

    @property
    @abstractmethod
    def extent(self) -> tuple[float, float, float, float]:
        """Bounding box (x_min, x_max, y_min, y_max) [m]."""

    def contains(self, x: float, y: float) -> bool:
        """Whether the point [m] lies in the bounding box."""
        x_min, x_max, y_min, y_max = self.extent
        return x_min <= x <= x_max and y_min <= y <= y_max

    def flaws(self, model: Model, space: DesignSpace) -> list[Flaw]:
        """A fixed start outside."""
        start = space.fixed_start
        if start is None or self.contains(start[0], start[1]):
            return []
        x_min, x_max, y_min, y_max = self.extent
        text = (
            f"the start ({start[0]:g} m, {start[1]:g} m) lies outside the workspace "
            f"x [{x_min:g}, {x_max:g}] m, y [{y_min:g}, {y_max:g}] m; move the start or widen the workspace"
        )
        return [Flaw(("limits", self.name), text)]


class Rectangle(Workspace):
    """x and y each within [min, max] [m]."""

    kind: Literal["rectangle"] = "rectangle"
    x: tuple[Length, Length]
    y: tuple[Length, Length]

    @field_validator("x", "y")
    @classmethod
    def _min_below_max(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not value[0] < value[1]:
            raise ValueError(f"expected min below max, got [{value[0]:g}, {value[1]:g}] m")
        return value

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """The rectangle itself [m]."""
        return (*self.x, *self.y)

    def rows(self, drive: Drive) -> Rows:
        """X and y of every path point; the size is the shorter half-side."""
        count = drive.path.shape[0]
        lower = np.repeat([self.x[0], self.y[0]], count)
        upper = np.repeat([self.x[1], self.y[1]], count)
        size = min(self.x[1] - self.x[0], self.y[1] - self.y[0]) / 2
        return Rows(ca.vertcat(drive.path[:, 0], drive.path[:, 1]), lower, upper, size, "m")


WORKSPACES: tuple[type[Workspace], ...] = (Rectangle,)
