"""robot-40 by oed, from import to the design; the study problems/robot_40.yaml is the same problem."""

from __future__ import annotations

import sys

import oed
from benchmarks.peers import task

# The track that makes c11 = radius / track and c21 = radius / 2 the task's.
RADIUS = 2 * task.COEFFICIENTS["c21"]
TRACK = RADIUS / task.COEFFICIENTS["c11"]

FEW = {"starts": task.STARTS, "perturbations": 0}
"""As many starts as the peers are given."""
MANY = {"starts": 12}
"""E has many local optima that are almost as good."""
SEED = 2


def problem(criterion: str) -> oed.Problem:
    """The task by the package's Python interface."""
    spline = oed.Spline(degree=0, coefficients=task.INTERVALS)
    return oed.Problem(
        model=oed.DifferentialDrive(wheel_radius=RADIUS, track=TRACK),
        design=oed.DesignSpace(
            duration=task.DURATION, samples=task.READINGS, spline=spline, rest_to_rest=False
        ),
        measurement=oed.Poses(
            noise=oed.AbsoluteNoise(position=task.DEVIATION, heading=task.DEVIATION), initial_pose="known"
        ),
        limits=(oed.WheelSpeed(bounds=(0.0, task.FASTEST)),),
        criterion={"D": oed.D, "A": oed.A, "E": oed.E}[criterion](),
        estimate=tuple(task.COEFFICIENTS),
    )


def main() -> int:
    """Solve and print the design."""
    criterion = task.parse(__doc__ or "").criterion
    settings = oed.Ipopt(**(MANY if criterion == "E" else FEW))
    solution = oed.solve(problem(criterion), settings, seed=SEED)
    if solution.trajectory is None:
        task.give_up(solution.message)
    else:
        task.answer(solution.trajectory.coefficients.tolist(), solution.status.name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
