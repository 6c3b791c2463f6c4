"""Every solver's designs stay below their problem's bound."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from builders import ACCELERATION, BOX, problem_of

from oed.bounds import Certificate, bound
from oed.kernel.criteria import E
from oed.kernel.problem import Problem
from oed.optimize import Genetic, Ipopt, Solver, solve
from oed.robots.limits import WheelSpeed
from oed.robots.models import DifferentialDrive
from oed.robots.sensors import Displacements, Poses

# Designs that no second stage trades for others of nearly the same objective come nearest to their bounds.
SOLVERS: dict[str, Solver] = {
    "ipopt": Ipopt(starts=1, perturbations=0, second_stage="none"),
    "genetic": Genetic(population=40, generations=20),
}
UNEQUAL = DifferentialDrive(wheel_radius_right=0.05, wheel_radius_left=0.045, track=0.18)
NOISE = {"position": 0.01, "heading": 0.02}
PROBLEMS: dict[str, Problem] = {
    "segments": problem_of(),
    "relative": problem_of(model=UNEQUAL, measurement=Displacements(noise=NOISE), criterion=E()),
    "samples": problem_of(measurement=Displacements(segments="samples")),
    "forward": problem_of(
        measurement=Displacements(segments="samples"),
        limits=(WheelSpeed(bounds=(0, 7)), ACCELERATION, BOX),
    ),
    "heading": problem_of(measurement=Displacements(segments=2, regressor="heading")),
    "joint": problem_of(measurement=Poses(noise=NOISE), criterion=E()),
    "coefficients": problem_of(
        measurement=Poses(noise=NOISE), criterion=E(), estimate=("c11", "c12", "c21", "c22")
    ),
    "fast": problem_of(limits=(WheelSpeed(bounds=30), ACCELERATION, BOX)),
}


@cache
def bounded(problem: Problem) -> Certificate:
    """Both solvers' designs are held against the same bound."""
    return bound(problem, nodes=2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "by"),
    # Populations come less near a bound: of them one form of each sort.
    [*((name, "ipopt") for name in PROBLEMS), *((name, "genetic") for name in ("forward", "joint", "fast"))],
)
def test_no_design_exceeds_its_bound(name: str, by: str) -> None:
    problem = PROBLEMS[name]
    certificate = bounded(problem)
    found = solve(problem, SOLVERS[by], seed=3, workers=1)
    assert np.isfinite(certificate.upper_bound)
    assert found.evaluation is not None
    assert found.evaluation.feasible
    for one in certificate.bounds:
        # Positions may exceed the room by what scoring tolerates; wheel speeds never exceed their limits.
        spare = 2e-3 if "every position within the room" in one.assumptions else 1e-9
        assert found.evaluation.objective <= one.value * (1 + spare), one.method


def test_the_order_of_the_parameters_does_not_matter() -> None:
    measurement = Displacements(noise=NOISE)
    values = [
        bound(problem_of(model=UNEQUAL, measurement=measurement, criterion=E(), estimate=names)).upper_bound
        for names in (("c21", "c22"), ("c22", "c21"))
    ]
    assert values[0] == pytest.approx(values[1], rel=1e-12)
