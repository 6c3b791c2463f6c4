"""Limits tightened by a rule of the user's own: the kernel asks nothing else of what is uncertain."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
import pytest
from builders import ACCELERATION, SPEED, problem_of, random_drive

import oed
from oed.foundation.errors import Issue, ProblemError
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.limit import PathLimit, Rows
from oed.kernel.problem import Problem
from oed.kernel.tightening import ParameterUncertainty, Scenarios, Tightening, UncertainSystem
from oed.robots.limits import Rectangle

POSES = oed.Poses(noise={"position": 0.01, "heading": 0.01})
ROOM = Rectangle(x=(-2, 2), y=(-2.5, 2.5))
LARGER = 1.2


class Fixed(Tightening):
    """The same distance from every wall; robots with larger wheels keep the walls as they stand."""

    kind: Literal["fixed"] = "fixed"
    distance: float = 0.0
    others: int = 0

    @property
    def backs_off(self) -> bool:
        return self.distance > 0

    def backed_off(self, limit: PathLimit, drive: Drive, system: UncertainSystem) -> Rows:
        rows = limit.rows(drive)
        return rows.backed_off(self.distance * np.ones(rows.expression.shape[0]))

    def scenarios(self, system: UncertainSystem) -> Scenarios:
        return self.sized(system, [LARGER] * self.others)

    def judged(self, system: UncertainSystem) -> Scenarios:
        return self.sized(system, [1.0, LARGER])

    def sized(self, system: UncertainSystem, factors: list[float]) -> Scenarios:
        parameters = np.outer(factors, system.model.nominal)
        parameters[:, 2] = system.model.nominal[2]
        shape = (len(factors), system.runs, len(system.model.states))
        return Scenarios(system.model, parameters, np.zeros(shape))


class Unknown(ParameterUncertainty):
    """ParameterUncertainty of a constant that no robot has."""

    constant: str

    def issues(self, system: UncertainSystem) -> list[Issue]:
        known = [parameter.name for parameter in system.model.parameters]
        return [] if self.constant in known else [Issue(("uncertainty",), f"no {self.constant}")]


tight_problem = partial(problem_of, limits=(SPEED, ACCELERATION, ROOM))


def margin(problem: Problem, drive: Trajectory) -> float:
    found = next(one for one in evaluate(problem, drive).margins if one.name == "workspace")
    assert found.certain
    return found.margin


@pytest.fixture(scope="module")
def drive() -> Trajectory:
    return random_drive(tight_problem(robust=None), 2, 5.0)


def enlarged(problem: Problem) -> Problem:
    values = dict.fromkeys(("wheel_radius_right", "wheel_radius_left"), LARGER * 0.049)
    return replace(problem, model=problem.model.with_values(values), robust=None)


@pytest.mark.slow
def test_a_back_off_is_taken_from_the_margin(drive: Trajectory):
    expected = margin(tight_problem(robust=None), drive) - 0.3
    assert margin(tight_problem(robust=Fixed(distance=0.3)), drive) == pytest.approx(expected, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("distance", [0.0, 0.05])
def test_scenarios_keep_limits_as_they_stand(drive: Trajectory, distance: float):
    plain = tight_problem(robust=None)
    alone, others = margin(plain, drive) - distance, margin(enlarged(plain), drive)
    assert others < alone
    found = margin(tight_problem(robust=Fixed(distance=distance, others=1)), drive)
    assert found == pytest.approx(others, abs=1e-6)


@pytest.mark.parametrize(("objective", "together"), [("worst", np.min), ("mean", np.mean)])
def test_the_criterion_is_that_of_those_judged(drive: Trajectory, objective: str, together):
    problem = tight_problem(robust=Fixed(objective=objective))
    each = [evaluate(one, drive).objective for one in (tight_problem(robust=None), enlarged(problem))]
    assert each[0] != pytest.approx(each[1], rel=1e-3)
    assert evaluate(problem, drive).objective == pytest.approx(together(each), rel=1e-9)


def test_systems_of_which_the_same_is_said_are_one():
    said = {
        "uncertainty": Unknown(constant="track"),
        "prior": oed.Prior(standard_deviations={"track": "5 %"}),
    }
    known, again = (problem_of(measurement=POSES, **said).uncertain_system for _ in range(2))
    assert known == again
    assert hash(known) == hash(again)
    twice = oed.DesignSpace(duration=10, samples=40, runs=2)
    for other in ({"uncertainty": None}, {"prior": None}, {"design": twice}):
        assert problem_of(measurement=POSES, **{**said, **other}).uncertain_system != known
    assert known != known.model


def test_what_cannot_be_uncertain_so_is_said():
    problem_of(uncertainty=Unknown(constant="track"))
    with pytest.raises(ProblemError, match="no mass"):
        problem_of(uncertainty=Unknown(constant="mass"))


@pytest.mark.slow
def test_a_search_keeps_the_back_off():
    problem = tight_problem(robust=Fixed(distance=0.3), design=oed.DesignSpace(duration=6, samples=12))
    found = oed.solve(problem, oed.Ipopt(starts=1, perturbations=0), seed=0)
    assert found.evaluation.feasible
    assert found.violation is None
    path = found.evaluation.path
    assert np.abs(path[:, 0]).max() <= 1.7 + 1e-6
