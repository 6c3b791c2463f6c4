"""What is known of sensors' constants, and of the pose that a drive begins in, before anything is read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from oed.foundation.component import Component
from oed.foundation.quantities import Angle, Length
from oed.kernel.measurement.sensor import Start


class PosePrior(Component):
    """A prior of the initial pose: standard deviations [m, rad].

    `heading` is that of a trailer's angle as well; of a yaw rate that lags nothing is taken to be known.
    """

    position: Annotated[Length, Field(gt=0)]
    heading: Annotated[Angle, Field(gt=0)]

    def of(self, unit: str) -> float:
        """That of a coordinate, by its unit: m or rad."""
        return self.heading if unit == "rad" else self.position


REST = 1e-3
"""Standard deviation [m/s, rad/s] of the speeds of a robot that is known to rest."""
InitialPose = Literal["unknown", "known", "resting"] | PosePrior


def start_of(initial_pose: InitialPose) -> Start:
    """What is known of the states that a drive begins in, as the kernel asks for it."""
    if initial_pose == "resting":
        return {"m/s": REST, "rad/s": REST}
    return (known_to(initial_pose) or {}) if isinstance(initial_pose, PosePrior) else initial_pose


def known_to(given: str | float | PosePrior) -> Mapping[str, float] | None:
    """Standard deviations of the prior of a constant, by their units ("" for any); {} where it is unknown,
    None where it is known and no nuisance.
    """
    if given == "known":
        return None
    if isinstance(given, PosePrior):
        return {unit: given.of(unit) for unit in ("m", "rad")}
    return {"": given} if isinstance(given, float) else {}
