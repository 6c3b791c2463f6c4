"""The drives of a trial: baselines at the pace that people drive them, and random ones to predict."""

from __future__ import annotations

import numpy as np

from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.robots.baselines import NAMES, RANDOM, baseline_flaws, baselines

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


def drive_flaw(problem: Problem, name: str) -> str:
    """Why the robot cannot drive a baseline; "" where it can."""
    if name.startswith(SLOW) and problem.design.samples % 2:
        return f"{name} needs an even number of samples, got {problem.design.samples}"
    return "".join(flaw.message for flaw in baseline_flaws(problem, [name.removeprefix(SLOW)]))


def held_out_drives(problem: Problem, count: int, seed: int) -> tuple[Trajectory, ...]:
    """Random drives as large as the limits allow, other than any that is calibrated from.

    Args:
        problem: whose limits they keep.
        count: of drives.
        seed: of the draws.
    """
    return tuple(_largest(problem, RANDOM, seed + HELD_OUT * (index + 1)) for index in range(count))


def _largest(problem: Problem, name: str, seed: int) -> Trajectory:
    found = baselines(problem, name, seed=seed)[0].trajectory
    assert found is not None
    return found
