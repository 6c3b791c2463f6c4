"""How drives are tried on a simulated robot with slip: the study's key `physics`, and the drives it names."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, field_validator

from oed.estimation import Alternative, CalibrationOptions
from oed.estimation.setup.options import Method
from oed.foundation.component import Component, OneOf
from oed.foundation.quantities import Ratio
from oed.kernel.criteria import CRITERION_CHOICES, Criterion
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.robots.baselines import NAMES, RANDOM, baselines, refusal
from oed.robots.sensors.pose_noise import Discrepancy
from oed.simulation.physics import PHYSICS_ROBOTS, FourWheels, PhysicsRobot, Variation

SLOW = "slow_"
HALVED = ("square", "rounded_square", "figure_eight", "straight_and_spin")
"""Paths of two halves with a rest between them."""
BASELINES = (*NAMES, *(f"{SLOW}{name}" for name in HALVED))
"""Names of baselines, with their pace."""
HELD_OUT = 1_000_003
"""Between the seeds of random drives that are held out: none is that of a random path to calibrate from."""


def paced_baseline(problem: Problem, name: str, seed: int = 0) -> Trajectory:
    """A baseline as large as the limits allow in the study's duration.

    slow_... is the first half of it in the whole time, at half the speed: of a square, which people drive to
    the left and then to the right, the lap to the left.

    Args:
        problem: whose limits, duration and start it is made for.
        name: of the path.
        seed: of a random one.

    Raises:
        ProblemError: a path that the robot cannot drive.
    """
    whole = _largest(problem, name.removeprefix(SLOW), seed)
    if not name.startswith(SLOW):
        return whole
    space, half = problem.design, whole.inputs[: whole.samples // 2]
    slowly = np.repeat(half / 2, 2, axis=0)
    return Trajectory.from_samples(slowly, space.duration, whole.start, rest_to_rest=space.rest_to_rest)


def drive_issue(problem: Problem, name: str) -> str:
    """Why the robot cannot drive a baseline; "" where it can."""
    if name.startswith(SLOW) and problem.design.samples % 2:
        return f"{name} needs an even number of samples, got {problem.design.samples}"
    return refusal(problem, name.removeprefix(SLOW))


def held_out_drives(problem: Problem, count: int, seed: int) -> tuple[Trajectory, ...]:
    """Random drives as large as the limits allow, other than any that is calibrated from.

    Args:
        problem: whose limits they keep.
        count: of drives.
        seed: of the draws.
    """
    return tuple(_largest(problem, RANDOM, seed + HELD_OUT * (index + 1)) for index in range(count))


def _largest(problem: Problem, name: str, seed: int) -> Trajectory:
    found = baselines(problem, name, seed=seed, one_way=False)[0].trajectory
    assert found is not None
    return found


def _known_path(name: str) -> str:
    if name not in BASELINES:
        raise ValueError(f"expected one of {', '.join(BASELINES)}, got {name!r}")
    return name


Friction = Annotated[Ratio, Field(gt=0)]
PathName = Annotated[str, AfterValidator(_known_path), Field(json_schema_extra={"enum": list(BASELINES)})]


class Pilot(Component):
    """What a model cannot say, from the residuals of a simulated pilot drive on a floor between the others.

    Attributes:
        pilot: the baseline that is driven.
    """

    pilot: PathName


def _form(value: Any) -> str:
    # By what is given, so that mistakes are those of the form that was meant.
    named = "pilot" in value if isinstance(value, dict) else isinstance(value, Pilot)
    return "from a pilot drive" if named else "as numbers"


AnyDiscrepancy = Annotated[
    Annotated[Discrepancy, Tag("as numbers")] | Annotated[Pilot, Tag("from a pilot drive")],
    Discriminator(_form),
]
AS_DESIGNED = CalibrationOptions(segment="log", sensor_place=(), clock_offset=False, noise="specified")
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
        task: whether every model has another drive, designed for the held-out drives themselves: by
            criterion I.
        discrepancy: another drive for every model, of the same aim but designed with noise that knows what
            the model cannot say: in numbers, or as the residuals of a pilot drive show it.
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
    task: bool = False
    discrepancy: AnyDiscrepancy | None = None
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
