"""How drives are tried on a simulated robot with slip: the study's key `physics`."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field, field_validator

from oed.estimation import Alternative, CalibrationOptions
from oed.estimation.setup.options import Method
from oed.foundation.component import Component, OneOf
from oed.foundation.quantities import Ratio
from oed.kernel.criteria import CRITERION_CHOICES, Criterion
from oed.simulation.physics import PHYSICS_ROBOTS, FourWheels, PhysicsRobot, Variation
from oed.simulation.trial.paths import BASELINES


def _known_path(name: str) -> str:
    if name not in BASELINES:
        raise ValueError(f"expected one of {', '.join(BASELINES)}, got {name!r}")
    return name


Friction = Annotated[Ratio, Field(gt=0)]
PathName = Annotated[str, AfterValidator(_known_path), Field(json_schema_extra={"enum": list(BASELINES)})]

AS_DESIGNED = CalibrationOptions(segment="log", sensor_place=(), clock_offset=False, noise="stated")
"""Whole drives of which nothing is unknown but the parameters and the initial pose, as designs take it."""
USUAL_DRIVES = ("circle", "square", "slow_square", "straight_and_spin", "random")


class Trial(Component):
    """Drives of a simulated robot with slip, from each of which every model is calibrated.

    Attributes:
        robot: that drives, but for the friction of its floor.
        frictions: of the floors.
        repeats: robots drawn for each floor.
        variation: how much they differ.
        models: robots to calibrate besides the study's own, each with an optimal drive of its own.
        criterion: of these drives; the study's if None.
        drives: baselines to calibrate from, as large as the limits allow in the study's duration;
            slow_... is the first half of one at half the speed.
        held_out: random drives that predictions are tried on.
        calibration: how models are calibrated.
        methods: of calibration, by which the study's own robot is calibrated besides.
        resamples: of the repeats, for intervals.
    """

    robot: Annotated[PhysicsRobot, OneOf(PHYSICS_ROBOTS)] = FourWheels()
    frictions: Annotated[tuple[Friction, ...], Field(min_length=1)] = (0.5, 0.8)
    repeats: Annotated[int, Field(ge=2)] = 20
    variation: Variation = Variation()
    models: tuple[Alternative, ...] = ()
    criterion: Annotated[Criterion, OneOf(CRITERION_CHOICES)] | None = None
    drives: Annotated[tuple[PathName, ...], Field(min_length=1)] = USUAL_DRIVES
    held_out: Annotated[int, Field(ge=1)] = 8
    calibration: CalibrationOptions = AS_DESIGNED
    methods: tuple[Method, ...] = ()
    resamples: Annotated[int, Field(ge=100)] = 2000

    @field_validator("frictions", "drives", "methods")
    @classmethod
    def _each_once(cls, given: tuple[object, ...]) -> tuple[object, ...]:
        twice = sorted({str(one) for one in given if given.count(one) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)} is listed twice")
        return given
