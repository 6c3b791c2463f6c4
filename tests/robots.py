"""Example robots: one or more of every listed kind, each with an independent twist.

A new robot is tested by being added to `EXAMPLES`; `test_models.py` fails until it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import oracle

from oed.models import DifferentialDrive, Model, SkidSteer

RADIUS, TRACK = 0.049, 0.18


@dataclass(frozen=True)
class Example:
    """A robot, and its effective inputs and twist written independently of the package."""

    name: str
    model: Model
    effective: Callable[[np.ndarray], np.ndarray]
    twist: Callable[[np.ndarray], np.ndarray]


def _two_sided(name: str, model: Model, radii: tuple[float, float], slips=(0.0, 0.0)) -> Example:
    def effective(speeds):
        return oracle.skid_speeds(speeds, *slips)

    return Example(
        name, model, effective, lambda speeds: oracle.differential_twist(effective(speeds), *radii, TRACK)
    )


EXAMPLES: dict[str, tuple[Example, ...]] = {
    "differential_drive": (
        _two_sided("differential", DifferentialDrive(wheel_radius=RADIUS, track=TRACK), (RADIUS, RADIUS)),
        _two_sided(
            "differential_unequal",
            DifferentialDrive(wheel_radius_right=0.051, wheel_radius_left=0.047, track=TRACK),
            (0.051, 0.047),
        ),
    ),
    "skid_steer": (
        _two_sided("skid_no_slip", SkidSteer(wheel_radius=RADIUS, track=TRACK), (RADIUS, RADIUS)),
        _two_sided(
            "skid_slip",
            SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=0.12, slip_inner=-0.05),
            (RADIUS, RADIUS),
            (0.12, -0.05),
        ),
    ),
}

ROBOTS = [example for examples in EXAMPLES.values() for example in examples]


def draw_inputs(rng: np.random.Generator, count: int, inputs: int = 2) -> np.ndarray:
    """Inputs (count, inputs) whose magnitudes are far apart, so that the outer side is beyond doubt."""
    magnitudes = np.linspace(1.0, 9.0, inputs) + rng.uniform(-0.9, 0.9, (count, inputs))
    return rng.permuted(magnitudes * rng.choice([-1.0, 1.0], (count, inputs)), axis=1)
