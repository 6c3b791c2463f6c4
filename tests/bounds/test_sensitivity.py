"""What parameters can do to poses bounds tr(Z F) of every drive, and D and A with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import RADIUS, TRACK, problem_of
from drives import KINDS, keep, start_pose, wanted_speeds, within_limits
from test_soundness import random_joint

from oed.bounds import bound
from oed.bounds.certificate import INFLATION
from oed.bounds.sensitivity import sensitivity_bounds
from oed.kernel.criteria import A, D, E
from oed.kernel.problem import Problem
from oed.robots.limits import Rectangle, WheelAcceleration, WheelSpeed
from oed.robots.models import SkidSteer
from oed.robots.sensors import Poses
from oed.robots.sensors.poses import AbsoluteNoise
from oed.robots.space import DesignSpace

LENGTHS = ("wheel_radius_right", "wheel_radius_left", "track")
POSES = Poses(noise=AbsoluteNoise(position=0.01, heading=0.02))


def shares(problem: Problem, rng: np.random.Generator, drives: int) -> list[float]:
    """For every bound, the largest tr(Z F) of random drives as a share of it."""
    bounds = list(sensitivity_bounds(problem))
    best = np.zeros(len(bounds))
    for index in range(drives):
        kind = KINDS[index % len(KINDS)]
        speeds = within_limits(problem, wanted_speeds(problem, kind, rng))
        kept = keep(problem, speeds, start_pose(problem, kind, rng))
        if kept is None:
            continue
        (matrix,) = kept[1].information.values()
        found = [float(np.sum(one.multiplier * matrix)) / one.value for one in bounds]
        best = np.maximum(best, found)
    return list(best)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 4, 6, 7, 9, 10, 11])
def test_no_drive_says_more_of_any_combination(seed: int) -> None:
    rng = np.random.default_rng(2000 + seed)
    problem = random_joint(rng)
    found = shares(replace(problem, criterion=E(scaling=problem.criterion.scaling)), rng, 18)
    # Of these problems drives come within a factor of fifteen of a bound.
    assert 1 / 15 < max(found) <= 1 + INFLATION
    assert min(found) > 0


def test_a_robot_that_only_spins_all_but_reaches_what_is_said_of_its_track() -> None:
    # No room to move in: only the heading tells of the track, and it could turn no faster.
    problem = problem_of(
        design=DesignSpace(duration=4, samples=20, rest_to_rest=False, start={"x": 0, "y": 0}),
        limits=(WheelSpeed(bounds=10), Rectangle(x=(-1e-6, 1e-6), y=(-1e-6, 1e-6))),
        measurement=Poses(quantities=("heading",), noise=AbsoluteNoise(heading=0.02)),
        estimate=LENGTHS,
        criterion=E(scaling="relative"),
    )
    track = list(sensitivity_bounds(problem))[2].value
    turned = 10 * 2 * RADIUS / TRACK * 0.2 * (np.arange(21) - 10)
    assert track == pytest.approx(float((turned**2).sum()) / 0.02**2, rel=1e-9)


def test_slip_that_depends_on_parameters_is_not_bounded() -> None:
    robot = SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=0.1, slip_inner=0.2)
    names = ("slip_outer", "slip_inner")
    assert not list(sensitivity_bounds(problem_of(model=robot, measurement=POSES, estimate=names)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [D, A])
def test_joint_estimation_has_bounds_on_both(kind: type[D] | type[A]) -> None:
    problem = problem_of(
        design=DesignSpace(duration=6, samples=16),
        limits=(WheelSpeed(bounds=10), WheelAcceleration(bounds=20), Rectangle(x=(-1, 1), y=(-1, 1))),
        measurement=POSES,
        estimate=LENGTHS,
        criterion=kind(scaling="relative"),
    )
    found = bound(problem, nodes=1)
    assert np.isfinite(found.upper_bound)
    assert found.widened is not None
    assert found.upper_bound <= found.widened.upper_bound
    # More than the smallest eigenvalue alone says of it.
    if kind is A:
        smallest = bound(replace(problem, criterion=E(scaling="relative")), nodes=1)
        assert -1 / smallest.upper_bound > found.upper_bound
