"""The angle of a trailer, as an encoder at the hitch gives it, with its zero."""

from __future__ import annotations

from typing import Annotated, Literal

import casadi as ca
from pydantic import Field

from oed.foundation.errors import Flaw
from oed.foundation.quantities import Angle
from oed.foundation.text import count
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System, label_of
from oed.kernel.measurement.measurement import Nuisance
from oed.kernel.measurement.sensor import Moment, Sensor, Start
from oed.robots.sensors.logged import Noise
from oed.robots.sensors.placed import InitialPose, start_of

STATE = 3
"""Place of the trailer's angle among the states."""


class TrailerAngle(Sensor):
    """The trailer's heading relative to the tractor's [rad], at every n-th sample, plus a constant bias.

    Attributes:
        noise: standard deviation of one reading [rad].
        bias: the encoder's zero: "known", "unknown" (eliminated), or its standard deviation known
            beforehand [rad].
        initial_pose: "unknown" (eliminated), "known", or standard deviations known beforehand.
    """

    kind: Literal["trailer_angle"] = "trailer_angle"
    noise: Annotated[Angle, Field(gt=0)]
    bias: Literal["unknown", "known"] | Annotated[Angle, Field(gt=0)] = "known"
    initial_pose: InitialPose = "unknown"

    @property
    def start_known(self) -> Start:
        """What is known of the initial pose, the trailer's angle among it."""
        return start_of(self.initial_pose)

    @property
    def angles(self) -> tuple[int, ...]:
        """The reading itself."""
        return (0,)

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The bias, where it is not known."""
        if self.bias == "known":
            return ()
        deviation = self.bias if isinstance(self.bias, float) else None
        return (Nuisance("bias", 0.0, "rad", deviation),)

    def reading(self, moment: Moment) -> Expression:
        """Angle and bias."""
        return moment.state[STATE] + moment.nuisances.get("bias", 0.0)

    def whitening(self, moment: Moment) -> Expression:
        """1 / sigma."""
        return ca.SX(1 / self.noise)

    @property
    def units(self) -> tuple[str, ...]:
        """Of the reading."""
        return ("rad",)

    @property
    def subject(self) -> str:
        """The angle."""
        return "the trailer's angle"

    @property
    def remark(self) -> str:
        """That there is no bias, where that is known."""
        return " and no bias" if self.bias == "known" else ""

    def brief(self, samples: int) -> str:
        """How many are read."""
        return count(len(self.columns(samples)), "trailer angle")

    @property
    def noises(self) -> dict[str, Noise]:
        """That of the angle."""
        return {"trailer_angle": Noise(self.noise)}

    @property
    def mount(self) -> None:
        """Nowhere: an angle of the robot itself."""
        return None

    def flaws(self, system: System, samples: int) -> list[Flaw]:
        """A robot without a trailer."""
        if "trailer_angle" in system.states:
            return []
        return [
            Flaw(("measurement", "kind"), f"{label_of(system)} has no trailer whose angle could be measured")
        ]
