"""Nuisances of sensors in joint least squares: simulated estimates scatter as promised, directions wrap."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from builders import SPEED, problem_of, random_drive

from oed.estimation.methods import Nonlinear
from oed.kernel.criteria import E
from oed.kernel.measurement.sensor import Sensor
from oed.robots.sensors import Landmarks, Poses, Ranges, Several, Tags, YawRate
from oed.robots.space import StartPose
from oed.simulation import validate

sensed_problem = partial(
    problem_of, period=0.25, start=StartPose(heading=0.4), limits=(SPEED,), criterion=E()
)
PLACES = ((4.0, 3.0), (-3.5, 2.5), (0.5, -4.0))
SIGHT = {"range": 3e-3, "bearing": 2e-3, "orientation": 5e-3}
LANDMARKS = Landmarks(landmarks=PLACES, noise=SIGHT)

SENSORS: dict[str, tuple[Sensor, ...]] = {
    "landmarks of unknown place": (LANDMARKS.model_copy(update={"map": "unknown"}),),
    "tags seen by a camera somewhere": (
        Tags(
            tags=[(*place, 0.3) for place in PLACES],
            noise=SIGHT,
            lever_arm={"x": 0.1, "known": False, "heading": 0.5},
            map={"position": 0.02, "heading": 0.05},
        ),
    ),
    "ranges to beacons known roughly": (Ranges(beacons=PLACES, noise=3e-3, map=0.02, bias="unknown"),),
    "late positions and a scaled gyro": (
        Poses(quantities=("x", "y"), noise={"position": 1e-3}, latency="unknown"),
        YawRate(noise=0.01, scale=0.02),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SENSORS)
def test_estimates_scatter_as_promised(name: str):
    problem = sensed_problem(measurement=Several(sensors=SENSORS[name]))
    result = validate(problem, random_drive(problem, 3, 5.0), replicates=60, seed=2)
    assert result.passed
    assert np.abs(result.paired_ratio - 1).max() < 0.03


def test_directions_are_known_up_to_full_turns():
    camera = Landmarks(landmarks=PLACES, noise=SIGHT, lever_arm={"heading": 3.0})
    problem = sensed_problem(measurement=camera)
    estimator, rng = Nonlinear(problem, random_drive(problem, 3, 5.0)), np.random.default_rng(1)
    readings = estimator.predicted() + rng.normal(scale=1e-3, size=len(estimator.predicted()))
    turned = readings.copy()
    turned[1::2] += 2 * np.pi * rng.integers(-1, 2, len(turned) // 2)
    found, other = estimator.fit(readings), estimator.fit(turned)
    np.testing.assert_allclose(other.values, found.values, rtol=1e-9)
    np.testing.assert_allclose(found.values, estimator.true, rtol=0.05)
    # Some of them are seen across the direction where angles begin anew.
    assert np.ptp(readings[1::2]) > 6
