"""The angle of a trailer, as an encoder at the hitch gives it, with its zero."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from oed.foundation.errors import Flaw
from oed.foundation.quantities import Angle
from oed.foundation.text import count
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System, label_of
from oed.kernel.measurement.sensor import Moment, Start
from oed.robots.sensors.biased import BiasedSensor
from oed.robots.sensors.logged import Noise
from oed.robots.sensors.placed import InitialPose, start_of

STATE = 3
"""Place of the trailer's angle among the states."""


class TrailerAngle(BiasedSensor):
    """The trailer's heading relative to the tractor's [rad], at every n-th sample, plus a constant bias.

    Attributes:
        noise: standard deviation of one reading [rad].
        bias: the encoder's zero: "known", "unknown" (eliminated), or the standard deviation of its
            prior [rad].
        initial_pose: "unknown" (eliminated), "known", or a prior's standard deviations.
    """

    kind: Literal["trailer_angle"] = "trailer_angle"
    unit = "rad"
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

    def quantity(self, moment: Moment) -> Expression:
        """The angle."""
        return moment.state[STATE]

    @property
    def subject(self) -> str:
        """The angle."""
        return "the trailer's angle"

    def brief(self, samples: int) -> str:
        """How many are read."""
        return count(len(self.columns(samples)), "trailer angle")

    @property
    def noises(self) -> dict[str, Noise]:
        """The noise of the angle."""
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
