"""A robot of the user's own, named in a study by where its class stands."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import ConfigDict

from oed.foundation.component import Component
from oed.foundation.own.part import OwnPart
from oed.foundation.quantities import parse_quantity
from oed.robots.models.model import Model
from oed.robots.models.tryout import try_out


class RobotDescription(Component):
    """What a robot of the user's own says of itself."""

    kind: str | None = None


class PythonRobot(OwnPart, Model):
    """The robot that `object` ("my_module:MyRobot") makes of all further keys."""

    model_config = ConfigDict(extra="allow")

    noun = "robot"
    kind: Literal["python"] = "python"
    described: RobotDescription | None = None

    def try_out(self, part: Any) -> None:
        """Ask the robot for everything.

        Raises:
            ValueError: what it says of itself is not what it is to be, or does not fit together.
        """
        try_out(part)

    @property
    def body_width(self) -> float:
        """Its `track` [m], if it is given one; no code is run for it."""
        try:
            return parse_quantity((self.model_extra or {}).get("track", 0.0), "m")
        except ValueError:
            return 0.0
