"""Certificates of several runs: never beaten by any drives, and so many times that of one run."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from builders import BOX, SPEED, problem_of, upper_bound
from drives import KINDS, keep, start_pose, wanted_speeds, within_limits
from test_soundness import random_joint, random_regression

from oed.bounds import LATTICE, bound
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.robots.sensors import Displacements, Poses, YawRate
from oed.robots.sensors.several import Several
from oed.robots.space import DesignSpace, StartPose

CORNERS = (StartPose(), StartPose(x=0.9, y=0.9, heading=1.0), StartPose(x=-0.9, heading=-2.0))


def several(problem: Problem, runs: int, start: Any = None) -> Problem:
    """The same problem for drives of several runs."""
    changed = {"runs": runs, "start": problem.design.start if start is None else start}
    fields = {name: getattr(problem, name) for name in problem.__dataclass_fields__}
    return Problem(**{**fields, "design": problem.design.model_copy(update=changed)})


def singles(problem: Problem) -> list[Problem]:
    """The problem of each run alone."""
    space = problem.design
    starts = space.start if isinstance(space.start, tuple) else (space.start,) * space.runs
    return [several(problem, 1, start) for start in starts]


def best_objective(problem: Problem, rng: np.random.Generator, drives: int, climbs: int) -> float:
    """Of random feasible runs put together, then each run replaced by another where that is better."""
    pools = []
    for single in singles(problem):
        pool = []
        for index in range(drives):
            kind = KINDS[index % len(KINDS)]
            start = start_pose(single, kind, rng)
            kept = keep(single, within_limits(single, wanted_speeds(single, kind, rng)), start)
            if kept is not None:
                pool.append((kept[0], start))
        pools.append(pool)
    if not all(pools):
        return -np.inf
    chosen, best = [0] * len(pools), -np.inf
    for _ in range(climbs):
        fresh = [int(rng.integers(len(pool))) for pool in pools]
        trial = [new if rng.random() < 0.6 else old for new, old in zip(fresh, chosen, strict=True)]
        rows, starts = zip(*(pool[at] for pool, at in zip(pools, trial, strict=True)), strict=True)
        space = problem.design
        drive = Trajectory.from_samples(
            np.vstack(rows),
            space.whole_duration,
            np.array(starts),
            rest_to_rest=space.rest_to_rest,
            runs=space.runs,
        )
        found = evaluate(problem, drive)
        assert all(margin.violation <= 1e-8 for margin in found.margins)
        if found.objective > best:
            chosen, best = trial, found.objective
    return best


# Those of some problems of which there is a bound that runs come near.
@pytest.mark.parametrize(
    ("make", "seed"),
    [*((random_regression, seed) for seed in (0, 4)), *((random_joint, seed) for seed in (5, 12))],
)
@pytest.mark.slow
def test_no_runs_beat_the_bound(make: Any, seed: int):
    rng = np.random.default_rng(300 + seed)
    runs = int(rng.integers(2, 4))
    problem = several(make(rng), runs)
    certificate = bound(problem, nodes=2)
    best = best_objective(problem, rng, 8, 14)
    assert np.isfinite(best)
    assert np.isfinite(certificate.upper_bound)
    for one in certificate.bounds:
        assert best <= one.value, (one.method, best / one.value - 1, problem)
    assert best <= certificate.upper_bound


@pytest.mark.parametrize("runs", [2, 5])
@pytest.mark.parametrize("segments", [1, 4, "samples"])
def test_runs_times_the_bound_of_one(runs: int, segments):
    """Closed forms of a regression; what a lattice finds is of one run alone."""
    one = problem_of(measurement=Displacements(segments=segments))
    single, joint = bound(one, nodes=1), bound(several(one, runs))
    plain = {one.method: one.value for one in single.bounds if LATTICE not in one.method}
    found = {one.method: one.value for one in joint.bounds}
    assert found == pytest.approx({method: runs * value for method, value in plain.items()}, rel=1e-9)
    assert joint.drive is None
    assert all("every run for itself" in one.assumptions for one in joint.bounds)
    if segments == 4:
        assert joint.upper_bound == pytest.approx(runs * upper_bound(4), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    "measurement",
    [
        Poses(noise={"position": 0.01, "heading": 0.02}),
        Several(sensors=(Poses(noise={"position": 0.01, "heading": 0.02}), YawRate(noise=0.01))),
    ],
    ids=["poses", "with a gyro"],
)
def test_starts_of_their_own_give_the_sum_of_the_bounds(measurement: Any):
    """The spread of positions depends on where a run starts."""
    one = problem_of(
        measurement=measurement,
        design=DesignSpace(duration=2, samples=10),
        limits=(SPEED, BOX),
        estimate=("wheel_radius_right", "wheel_radius_left", "track"),
    )
    problem = several(one, 2, CORNERS[:2])
    *each, found = (
        {one.method: one.value for one in bound(one, nodes=1).bounds} for one in (*singles(problem), problem)
    )
    assert found
    assert len({tuple(values.values()) for values in each}) > 1
    assert found == pytest.approx(
        {method: sum(values[method] for values in each) for method in each[0]}, rel=1e-9
    )


def test_equal_starts_listed_are_one_start_for_all():
    one = problem_of()
    listed, given = several(one, 2, (StartPose(),) * 2), several(one, 2)
    assert bound(listed).upper_bound == bound(given).upper_bound


def test_where_no_bound_is_known_there_is_none_of_several_runs():
    noise = {"position": 0.01}
    measurement = Displacements(segments=4, noise=noise, noise_model="absolute")
    assert bound(several(problem_of(measurement=measurement), 2)).upper_bound == np.inf
