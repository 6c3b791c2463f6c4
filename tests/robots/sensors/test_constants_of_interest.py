"""Constants of sensors that are asked for like parameters, as where a lidar sits on the robot."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from builders import input_limits, problem_of

import oed
from oed.foundation.errors import ProblemError
from oed.kernel.criteria import D, E
from oed.kernel.measurement.prior import Prior
from oed.kernel.problem import Problem
from oed.robots.models import DifferentialDrive
from oed.robots.sensors import Poses, RelativePoses, Several

WHEELS = ("wheel_radius_right", "wheel_radius_left", "track")
PLACE = ("sensor_x", "sensor_y", "sensor_heading")
MATCHER = RelativePoses(
    noise={"position": 2e-3, "heading": 0.01}, mounting={"x": 0.1, "y": -0.04, "heading": 0.3}
)
asking = partial(
    problem_of,
    model=DifferentialDrive(wheel_radius=0.05, track=0.2),
    limits=input_limits,
    measurement=MATCHER,
    criterion=D(),
)


def driven(problem: Problem) -> oed.Trajectory:
    inputs = np.random.default_rng(4).uniform(-3, 3, (problem.design.samples, 2))
    starts = problem.start_states(np.zeros(3))
    return oed.Trajectory.from_samples(inputs, problem.design.duration, starts)


def covariance(problem: Problem, *names: str) -> np.ndarray:
    found = oed.evaluate(problem, driven(problem))
    places = [found.parameters["joint"].index(name) for name in names]
    return found.covariances["joint"][np.ix_(places, places)]


@pytest.mark.slow
def test_they_are_as_precise_as_they_were_as_nuisances():
    both = asking(estimate=("sensor_y", *WHEELS, "sensor_heading", "sensor_x"))
    np.testing.assert_allclose(covariance(both, *WHEELS), covariance(asking(), *WHEELS), rtol=1e-8)
    # Some of them asked for, the others are nuisances all the same.
    some = asking(estimate=(*WHEELS, "relative_poses.sensor_x"))
    np.testing.assert_allclose(
        covariance(some, *WHEELS, "relative_poses.sensor_x"), covariance(both, *WHEELS, "sensor_x"), rtol=1e-8
    )
    # And so are wheels that are known.
    alone = covariance(asking(estimate=PLACE), *PLACE)
    assert np.all(np.diag(alone) < np.diag(covariance(both, *PLACE)))


def test_of_poses_it_is_the_lever_arm():
    arm = {"x": 0.1, "y": 0.05, "known": False}
    sensors = [Poses(noise={"position": 1e-3, "heading": 0.01}, lever_arm=arm), MATCHER]
    both = asking(measurement=Several(sensors=tuple(sensors)), estimate=(*WHEELS, "lever_arm.x", "sensor_x"))
    plain = asking(measurement=Several(sensors=tuple(sensors)))
    np.testing.assert_allclose(covariance(both, *WHEELS), covariance(plain, *WHEELS), rtol=1e-8)


def test_a_prior_knows_of_them():
    names = (*WHEELS, *PLACE)
    known = asking(estimate=names, prior=Prior(standard_deviations={"sensor_x": 1e-4}))
    assert covariance(known, "sensor_x")[0, 0] < 1e-8
    sure = covariance(asking(estimate=(*WHEELS, *PLACE[1:]), measurement=MATCHER.model_copy()), *PLACE[1:])
    assert np.all(np.diag(covariance(known, *PLACE[1:])) <= np.diag(sure) * (1 + 1e-9))


def test_a_criterion_may_ask_for_them_alone():
    problem = asking(estimate=(*WHEELS, *PLACE), criterion=E(subset=("sensor_x", "sensor_y")))
    found = oed.evaluate(problem, driven(problem))
    expected = np.linalg.inv(covariance(problem, "sensor_x", "sensor_y") / np.outer([0.1, 0.04], [0.1, 0.04]))
    assert found.objective == pytest.approx(np.linalg.eigvalsh(expected)[0], rel=1e-8)


@pytest.mark.slow
def test_the_estimator_gives_them():
    problem = asking(estimate=("sensor_y", *WHEELS, "sensor_x"))
    estimator = oed.make_estimator(problem, driven(problem))
    assert estimator.parameters == problem.estimate
    assert estimator.nuisances == ("relative_poses.sensor_heading",)
    np.testing.assert_allclose(estimator.covariance, covariance(problem, *problem.estimate), rtol=1e-6)
    estimates, linear = estimator.simulate(np.random.default_rng(0), 150)
    spread = np.sqrt(np.diag(estimator.covariance))
    np.testing.assert_allclose(estimates.std(axis=0), spread, rtol=0.25)
    np.testing.assert_allclose(estimates, linear, atol=float((0.3 * spread).max()))
    found = estimator.fit(estimator.predicted())
    assert found.parameters == problem.estimate
    np.testing.assert_allclose(found.values, estimator.true, atol=1e-9)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"estimate": (*WHEELS, "sensor_z")}, r"constants of sensors \(relative_poses.sensor_x, .*sensor_z"),
        ({"estimate": ("sensor_x", "relative_poses.sensor_x")}, "listed twice"),
        (
            {
                "estimate": ("track", "sensor_x"),
                "measurement": MATCHER.model_copy(
                    update={"mounting": oed.Mounting(x=0.1, deviation={"position": 0.01, "heading": 0.1})}
                ),
            },
            "sensor_x beforehand is to be given as `prior`",
        ),
        (
            {
                "estimate": ("track", "sensor_x"),
                "measurement": MATCHER.model_copy(update={"mounting": oed.Mounting(x=0.1, known=True)}),
            },
            "sensor_x",
        ),
    ],
    ids=["unknown", "twice", "deviation", "known"],
)
def test_what_cannot_be_asked_for(keys: dict[str, object], words: str):
    with pytest.raises(ProblemError, match=words):
        asking(**keys)
