"""Classes of the user's own need nothing of the package but what `oed` itself has."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca
import numpy as np
import pytest
from builders import ACCELERATION, SPEED, problem_of

import oed


class LogVolume(oed.Criterion):
    """The logarithm of the determinant, written anew."""

    kind: Literal["log_volume"] = "log_volume"

    def value(self, matrices):
        """The sum of the logarithms."""
        return sum(np.linalg.slogdet(one)[1] for one in matrices)

    def epigraph(self, matrices):
        """It is smooth as it stands."""
        nothing = ca.SX(0, 1)
        objective = sum((ca.log(ca.det(one)) for one in matrices), start=ca.SX(0))
        return oed.Epigraph(objective, nothing, nothing, lambda numbers: np.zeros(0))

    def issues(self, subject: oed.Subject) -> list[oed.Issue]:
        """One parameter needs no criterion."""
        few = any(len(names) < 2 for names in subject.parameters)
        return [oed.Issue(("criterion",), "expected several parameters")] if few else []


class HalfPlane(oed.PathLimit):
    """The robot stays to the right of a line."""

    name: ClassVar[str] = "half_plane"
    per_metre: ClassVar[float] = 1.0
    reach: float = 0.5

    def rows_at(self, path, system: oed.System) -> oed.Rows:
        """X at most so much."""
        x = path[:, 0]
        return oed.Rows(x, np.full(x.shape[0], -np.inf), np.full(x.shape[0], self.reach), self.reach, "m")


class Random(oed.Solver):
    """The best of random drives."""

    kind: Literal["random"] = "random"
    draws: int = 20

    def search(self, problem: oed.Problem, context: oed.Context) -> oed.Solution:
        """Draw, score, keep the best that can be driven."""
        rng, space = context.rng(1), problem.design
        shape = (space.all_coefficients, len(problem.model.inputs))
        drives = [space.trajectory(rng.uniform(-1, 1, shape), [0.0, 0.0, 0.0]) for _ in range(self.draws)]
        scores = [oed.evaluate(problem, one) for one in drives]
        best = max(range(self.draws), key=lambda place: (scores[place].feasible, scores[place].objective))
        return oed.Solution(self.label, self.kind, drives[best], scores[best], oed.Status.SEARCHED)


@pytest.fixture(scope="module")
def problem() -> oed.Problem:
    measurement = oed.Poses(noise={"position": 0.01, "heading": 0.01})
    limits = (SPEED, ACCELERATION, HalfPlane())
    return problem_of(measurement=measurement, limits=limits, criterion=LogVolume())


@pytest.mark.slow
def test_a_search_follows_an_own_criterion_and_limit(problem):
    found = oed.solve(problem, oed.Ipopt(starts=1, perturbations=0, second_stage="none"))
    assert found.evaluation.feasible
    assert found.evaluation.states[:, 0].max() <= 0.5005
    log_det = found.evaluation.log_determinant
    assert found.evaluation.objective == pytest.approx(log_det)


def test_an_own_criterion_refuses_what_it_does_not_judge(problem):
    with pytest.raises(oed.ProblemError, match="criterion: expected several parameters"):
        problem_of(measurement=problem.measurement, criterion=LogVolume(subset=("track",)))


def test_an_own_solver_is_solved_with(problem):
    found = oed.solve(problem, Random(draws=3), workers=1)
    assert (found.kind, found.status) == ("random", oed.Status.SEARCHED)
    assert repr(found).startswith("Solution random: searched\n")
