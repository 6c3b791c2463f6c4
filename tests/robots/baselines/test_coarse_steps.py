"""The largest drive where motion is integrated: looked for with coarse steps, satisfied by fine ones."""

from __future__ import annotations

import numpy as np
import pytest
from builders import problem_of

from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.kernel.scorer import limits_exceeded
from oed.robots.baselines import fitting
from oed.robots.baselines.fitting import EXACT, Shape, largest, largest_by_coarse_steps
from oed.robots.limits import CommandedSpeed, CommandedYawRate, Rectangle
from oed.robots.models import Unicycle
from oed.robots.sensors import Poses

ROOM = Rectangle(x=(-1.0, 1.0), y=(-1.0, 1.0))


@pytest.fixture(scope="module")
def coarse() -> Problem:
    """A robot that lags by less than a sample, whose own steps place it wrongly."""
    return problem_of(
        model=Unicycle(lag_v=0.1, lag_omega=0.15),
        measurement=Poses(noise={"position": 0.01, "heading": 0.02}),
        limits=(CommandedSpeed(bounds=4.0), CommandedYawRate(bounds=2.0), ROOM),
        duration=6.0,
        samples=12,
        coefficients=8,
    )


@pytest.fixture(scope="module")
def shape(coarse) -> Shape:
    """Straight drives of any speed with the same bend: coarse steps see it turn too far."""

    def drive(size: float, laps: int) -> Trajectory:
        table = np.zeros((8, 2))
        table[1:-1, 0] = size
        table[3:5, 1] = 2.0
        return coarse.design.trajectory(table, coarse.fixed_starts)

    return Shape(drive, 4.0, 0.0, lambda laps: True, lambda size, laps: 0.0, lambda size, laps: "")


@pytest.mark.parametrize("steps", [fitting.MOST_SHRUNK, 0.0], ids=["shrunk", "looked for again"])
def test_it_is_nearly_as_large_as_with_fine_steps_alone(
    steps, coarse, shape, monkeypatch: pytest.MonkeyPatch
):
    fine = coarse.refined(16)
    monkeypatch.setattr(fitting, "MOST_SHRUNK", steps)
    size = largest_by_coarse_steps(fine, coarse, shape, 1, below=np.inf)
    assert limits_exceeded(fine, shape.drive(largest(coarse, shape, 1), 1), EXACT)
    assert not limits_exceeded(fine, shape.drive(size, 1), EXACT)
    assert size == pytest.approx(largest(fine, shape, 1), rel=0.01)
