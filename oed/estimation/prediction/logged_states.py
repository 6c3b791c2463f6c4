"""What logs hold, as a sensor: states of the robot, its pose where and as the pose sensor sits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.measurement import Nuisance
from oed.kernel.measurement.sensor import Moment
from oed.robots.models.model import Model
from oed.robots.sensors.placed import LeverArm, PlacedSensor


class LoggedStates(PlacedSensor):
    """States of a robot at all times, x, y and heading at the sensor's place, in units of their noise.

    Attributes:
        places: of what is read among the robot's states.
        lever_arm: unknown, like the angle by which the sensor is turned.
    """

    kind: Literal["logged_states"] = "logged_states"
    places: tuple[int, ...]
    lever_arm: LeverArm = LeverArm(known=False)

    @classmethod
    def of(cls, model: Model, quantities: Sequence[str]) -> LoggedStates:
        """Those of that name."""
        return cls(places=tuple(map(model.states.index, quantities)))

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The sensor's place: ahead, to the left [m], turned [rad]."""
        return (*super().nuisances, Nuisance("turn", 0.0, "rad"))

    def reading(self, moment: Moment) -> Expression:
        """The states' values."""
        heading = moment.state[2] + moment.nuisances["turn"]
        values = [*self.position(moment), heading, *ca.vertsplit(moment.state)[3:]]
        return ca.vertcat(*(values[place] for place in self.places))

    def whitening(self, moment: Moment) -> Expression:
        """Unity."""
        return ca.SX.eye(len(self.places))
