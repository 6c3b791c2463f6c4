"""Limits on where a drive ends: at a place, facing a way, or where it began."""

from __future__ import annotations

from math import radians
from typing import Annotated, Any, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from oed.foundation.component import Component
from oed.foundation.quantities import Angle, Length
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.limit import Limit, Rows


class Place(Component):
    """A point of the room [m]."""

    x: Length
    y: Length


class EndPosition(Limit):
    """Every run ends within `tolerance` [m] of a place, or of its own start: a closed path.

    In YAML `start`, `{x: 1 m, y: 0 m}`, or `{at: start, tolerance: 5 mm}`.
    """

    name: ClassVar[str] = "end_position"
    loosened: ClassVar[str] = "{amount} more tolerance of where it ends"
    looks_at: ClassVar[Literal["run"]] = "run"
    at: Place | Literal["start"]
    tolerance: Annotated[Length, Field(gt=0)] = 0.01

    @model_validator(mode="before")
    @classmethod
    def _bare_value(cls, value: Any) -> Any:
        if isinstance(value, dict) and "at" not in value:
            place = {key: entry for key, entry in value.items() if key != "tolerance"}
            return {"at": place, **{key: value[key] for key in value if key == "tolerance"}}
        return value if isinstance(value, dict) else {"at": value}

    def rows(self, drive: Drive) -> Rows:
        """(d^2 + tolerance^2) / (2 tolerance) of the distance d from the place, of every run: smooth at the
        place, and at the tolerance what the distance is.
        """
        first, last = drive.ends_of(drive.path)
        if isinstance(self.at, Place):
            offset = last[:, :2] - ca.repmat(ca.DM([[self.at.x, self.at.y]]), drive.runs, 1)
        else:
            offset = last[:, :2] - first[:, :2]
        square = offset[:, 0] ** 2 + offset[:, 1] ** 2
        away = (square + self.tolerance**2) / (2 * self.tolerance)
        bound = np.full(drive.runs, self.tolerance)
        return Rows(away, np.full(drive.runs, -np.inf), bound, self.tolerance, "m")

    def amount(self, excess: float) -> float:
        """The distance beyond the tolerance [m]."""
        return float(np.sqrt(max(self.tolerance * (2 * excess + self.tolerance), 0.0))) - self.tolerance


class EndHeading(Limit):
    """Every run ends facing `at` [rad], or as it began, within `tolerance` [rad]; full turns do not count."""

    name: ClassVar[str] = "end_heading"
    loosened: ClassVar[str] = "{amount} more tolerance of the heading at the end"
    in_degrees: ClassVar[bool] = True
    looks_at: ClassVar[Literal["run"]] = "run"
    at: Angle | Literal["start"]
    tolerance: Annotated[Angle, Field(gt=0)] = radians(1.0)

    @model_validator(mode="before")
    @classmethod
    def _bare_value(cls, value: Any) -> Any:
        return value if isinstance(value, dict) else {"at": value}

    def rows(self, drive: Drive) -> Rows:
        """Twice the sine of half the difference, of every run: the difference itself where it is small."""
        first, last = drive.ends_of(drive.path)
        difference = last[:, 2] - (first[:, 2] if self.at == "start" else self.at)
        bound = np.full(drive.runs, self._bound)
        return Rows(2 * ca.sin(difference / 2), -bound, bound, self.tolerance, "rad")

    def amount(self, excess: float) -> float:
        """The angle beyond the tolerance [rad]."""
        away = 2 * np.arcsin(np.clip((excess + self._bound) / 2, 0.0, 1.0))
        return float(away) - min(self.tolerance, np.pi)

    @property
    def _bound(self) -> float:
        return 2 * float(np.sin(min(self.tolerance, np.pi) / 2))
