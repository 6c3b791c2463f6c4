"""The flagship's robot and room, measured in the three forms that the benchmarks solve."""

from __future__ import annotations

from oed import (
    DesignSpace,
    DifferentialDrive,
    Displacements,
    E,
    Measurement,
    Poses,
    Problem,
    Rectangle,
    WheelAcceleration,
    WheelSpeed,
)

SEGMENTS = 10
FORMS: dict[str, tuple[Measurement, E]] = {
    "segment": (Displacements(segments=SEGMENTS), E(scaling="none")),
    "per-sample": (Displacements(segments="samples"), E(scaling="none")),
    "joint": (Poses(noise={"position": 0.01, "heading": 0.0175}), E()),
}


def problem_of(form: str, samples: int) -> Problem:
    """The design problem of 20 s in a room of 2 m x 2 m, 16 spline coefficients a wheel."""
    measurement, criterion = FORMS[form]
    return Problem(
        model=DifferentialDrive(wheel_radius=0.049, track=0.18),
        design=DesignSpace(duration=20, samples=samples),
        measurement=measurement,
        limits=(WheelSpeed(bounds=10), WheelAcceleration(bounds=20), Rectangle(x=(-1, 1), y=(-1, 1))),
        criterion=criterion,
    )
