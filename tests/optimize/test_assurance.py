"""A robust search is not done before enough simulated robots keep the limits."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
from builders import ACCELERATION, SPEED, problem_of
from pydantic import Field

from oed.kernel.criteria import D, E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status, Violation
from oed.optimize import Genetic, Ipopt, assurance, solve
from oed.optimize.assurance import FINAL, MORE_DRAWS, NARROWER, UNTRIED, search_with_assurance
from oed.optimize.solver import Context, Solver
from oed.robots.limits import Rectangle
from oed.robots.sensors import Poses
from oed.uncertainty.departures import interval_of, violated, violation_probability
from oed.uncertainty.robust import ADDED, TIGHTER, Robust

RADII = {"wheel_radius_right": "5 %", "wheel_radius_left": "5 %", "track": "5 %"}
ROOM = Rectangle(x=(-0.4, 0.4), y=(-0.4, 0.4))
QUICK = Ipopt(starts=1, perturbations=0, second_stage="none")
DRAWS, CONFIDENCE, BETA = 300, 0.97, 1.2
SCALES = np.linspace(1.0, 0.4, 31)


robust_problem = partial(
    problem_of,
    duration=6,
    samples=12,
    coefficients=6,
    measurement=Poses(noise={"position": 0.01, "heading": 0.02}),
    criterion=E(scaling="relative"),
    limits=(SPEED, ACCELERATION, ROOM),
    within=RADII,
)


def tightened(**options: Any) -> Robust:
    return Robust(**{"draws": DRAWS, "confidence": CONFIDENCE, "beta": BETA, **options})


class Larger(Solver):
    """One drive, as fast as it keeps the limits: `asked` are the problems that it was searched for.

    With `stubborn` it is always the fastest; with `status` it says that it ended so.
    """

    asked: ClassVar[list[tuple[Problem, Context]]] = []
    kind: Literal["larger"] = "larger"
    stubborn: bool = False
    finds: bool = True
    status: Status = Field(default=Status.CONVERGED)
    quick: bool = False

    def again(self, *, quick: bool = True) -> Larger:
        """A quick one, said to be so."""
        return self.model_copy(update={"quick": quick})

    def search(self, problem: Problem, context: Context) -> Solution:
        """The fastest."""
        self.asked.append((problem, context))
        drives = [self.drive(problem, scale) for scale in SCALES if self.finds]
        # Whatever is slower than a drive that keeps the limits keeps them, too.
        kept = bisect_left(drives, True, key=lambda one: self.stubborn or evaluate(problem, one).feasible)
        best = drives[kept] if kept < len(drives) else None
        scored = None if best is None else evaluate(problem, best)
        status = Status.FAILED if best is None else self.status
        return Solution(self.label, self.kind, best, scored, status, seed=context.seed, wall_seconds=1.0)

    def drive(self, problem: Problem, scale: float) -> Trajectory:
        table = np.zeros((problem.design.all_coefficients, 2))
        table[1:-1] = scale * np.array([4.0, 3.0])
        return problem.design.trajectory(table, problem.fixed_starts)


@dataclass(frozen=True)
class Asked:
    """All that is asked of a problem where neither searches nor robots look at it."""

    robust: Robust


@pytest.fixture(autouse=True)
def nothing_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Larger, "asked", [])


def enough(problem: Problem, solution: Solution) -> bool:
    return solution.violation.interval[1] <= 1 - problem.robust.confidence


@pytest.fixture(scope="module")
def raised() -> tuple[Problem, Solution, list[tuple[Problem, Context]]]:
    problem = robust_problem(robust=tightened())
    Larger.asked.clear()
    solution = solve(problem, Larger(name="mine"), seed=3, workers=1)
    return problem, solution, list(Larger.asked)


@pytest.mark.slow
class TestRaised:
    def test_too_small_a_back_off_is_raised(self, raised):
        problem, solution, asked = raised
        # The last one is a whole search with the back-off that was found to be enough.
        expected = BETA * TIGHTER ** np.append(np.arange(len(asked) - 1), len(asked) - 2)
        assert len(asked) > 2
        assert enough(problem, solution)
        assert [one.robust.reach for one, _ in asked] == pytest.approx(expected)
        assert solution.robust.reach == asked[-1][0].robust.reach

    def test_what_is_as_quick_as_it_can_be_is_not_searched_once_more(self, raised, monkeypatch):
        problem, solution, asked = raised
        monkeypatch.setattr(Larger, "again", Solver.again)
        Larger.asked.clear()
        quick = solve(problem, Larger(name="mine"), seed=3, workers=1)
        assert len(Larger.asked) == len(asked) - 1
        assert quick.violation.probability == solution.violation.probability

    def test_no_more_than_needed(self, raised):
        _, _, asked = raised
        # The drive before the first that few enough left was left by too many.
        index = len(asked) - 3
        before = Larger().search(asked[index][0], Context(seed=3))
        # By the draws of its own, or by those that decide.
        found = [
            violation_probability(asked[0][0], before.trajectory, draws=DRAWS, seed=3, stream=stream)
            for stream in (1 + index, FINAL)
        ]
        assert max(one.interval[1] for one in found) > 1 - CONFIDENCE

    def test_what_is_told_is_of_the_drive(self, raised):
        problem, solution, asked = raised
        again = violation_probability(problem, solution.trajectory, draws=DRAWS, seed=solution.violation.seed)
        assert again.probability == solution.violation.probability
        assert solution.evaluation.margins == evaluate(problem, solution.trajectory).margins
        assert solution.evaluation.feasible
        assert solution.wall_seconds == len(asked)

    def test_what_decides_are_draws_that_no_search_was_tightened_by(self, raised):
        problem, solution, _ = raised
        told = violation_probability(problem, solution.trajectory, draws=DRAWS, seed=3, stream=FINAL)
        assert (solution.violation.seed, solution.violation.farthest) == (3, told.farthest)
        fast = Larger(stubborn=True).search(problem, Context(seed=3)).trajectory
        first, second = (
            violation_probability(problem, fast, draws=DRAWS, seed=3, stream=stream) for stream in (FINAL, 1)
        )
        assert first.farthest != second.farthest

    def test_the_design_before_is_known_to_the_next_search(self, raised):
        _, _, asked = raised
        known = [context.earlier for _, context in asked]
        assert known[0] == {}
        assert all(list(one) == ["mine"] for one in known[1:])

    @pytest.mark.slow
    def test_the_worst_robots_are_added(self):
        normal = {**RADII, "distribution": "normal"}
        problem = robust_problem(robust=tightened(kind="scenarios"), within=normal)
        solution = solve(problem, Larger(), seed=3, workers=1)
        kept = solution.robust.added_scenarios
        assert len(Larger.asked) > 1
        assert 0 < len(kept) <= ADDED * (len(Larger.asked) - 2)
        assert enough(problem, solution)
        assert not violated(problem, solution.trajectory, np.array(kept)).any()
        assert solution.robust.reach == pytest.approx(BETA)

    def test_enough_at_once_is_enough(self):
        problem = robust_problem(robust=tightened(beta=4.0))
        solution = solve(problem, Larger(), workers=1)
        assert len(Larger.asked) == 1
        assert solution.robust == problem.robust

    @pytest.mark.slow
    def test_a_search_by_another_criterion_is_made_sure_of_too(self):
        problem = robust_problem(robust=tightened())
        solution = solve(problem, Larger(criterion=D(scaling="relative")), seed=3, workers=1)
        assert enough(problem, solution)
        assert solution.criterion == "D"
        assert solution.evaluation.objective == evaluate(problem, solution.trajectory).objective

    def test_a_problem_that_is_not_robust_is_searched_once(self):
        solution = solve(robust_problem(robust=None), Larger(), workers=1)
        assert len(Larger.asked) == 1
        assert (solution.violation, solution.robust) == (None, None)


class TestLevel:
    """How often a drive is accepted that too many robots violate."""

    RUNS = 60

    @pytest.fixture
    def accepted(self, monkeypatch: pytest.MonkeyPatch) -> Any:
        problem = robust_problem(robust=tightened())
        drive = Larger().drive(problem, 1.0)
        scored = evaluate(problem, drive)
        found = Solution("mine", "larger", drive, scored, Status.CONVERGED)
        rng, interval = np.random.default_rng(0), cache(interval_of)

        def tried(*_: Any, draws: int, stream: int, seed: int, **options: Any) -> Violation:
            # As many as are allowed, and one in a thousand more; the draws before give no warning.
            count = rng.binomial(draws, 1.001 * (1 - CONFIDENCE)) if stream == FINAL else 0
            found = interval(int(count), draws, **options)
            return Violation(count / draws, found, draws, seed, {}, 0.0, np.zeros((0, 3)))

        monkeypatch.setattr(assurance, "violation_probability", tried)
        monkeypatch.setattr(assurance, "score", lambda *_: scored)
        monkeypatch.setattr(Larger, "search", lambda self, problem, context: found)

        def times(draws: int) -> int:
            asked = Asked(tightened(draws=draws))
            ends = [search_with_assurance(Larger(), asked, Context(seed=0)) for _ in range(self.RUNS)]
            return sum(one.trajectory is not None for one in ends)

        return times

    @pytest.mark.parametrize("draws", [122, 300, 3000])
    def test_is_that_of_the_interval_however_many_drives_are_verified(self, accepted, draws: int):
        # The fewest that can show it of one drive, of some drives, and more.
        level = 0.025
        assert accepted(draws) / self.RUNS <= level + 3 * (level * (1 - level) / self.RUNS) ** 0.5

    def test_few_draws_that_reject_a_drive_end_the_search(self, accepted):
        problem = robust_problem(robust=tightened(draws=122))
        end = search_with_assurance(Larger(), problem, Context(seed=0))
        assert end.trajectory is None
        assert MORE_DRAWS in end.message

    def test_many_draws_show_it_of_all_drives_few_of_one(self):
        assert [tightened(draws=draws).verifications(13) for draws in (122, 160, 300, 10**7)] == [
            1,
            3,
            13,
            13,
        ]

    def test_the_interval_of_several_drives_is_wider(self):
        alone, together = interval_of(3, 1000), interval_of(3, 1000, 13)
        assert together[0] < alone[0] < 0.003 < alone[1] < together[1]


@pytest.mark.slow
class TestGivenUp:
    def test_after_so_many_searches(self, monkeypatch: pytest.MonkeyPatch):
        assert assurance.ROUNDS > 3
        monkeypatch.setattr(assurance, "ROUNDS", 3)
        solution = solve(robust_problem(robust=tightened()), Larger(stubborn=True), workers=1)
        assert len(Larger.asked) == 3
        assert solution.status is Status.FAILED
        assert (solution.trajectory, solution.evaluation) == (None, None)
        assert "On the last drive 100.00 % of 300 robots violated the limits" in solution.message
        assert "where 3.00 % may" in solution.message
        assert NARROWER in solution.message

    def test_where_nothing_is_found_it_is_said_what_to_do(self):
        solution = solve(robust_problem(robust=tightened()), Larger(finds=False), workers=1)
        assert len(Larger.asked) == 1
        assert solution.trajectory is None
        assert "robots left" not in solution.message
        assert "a short drive that stays well inside would narrow it" in solution.message

    @pytest.mark.slow
    def test_a_room_too_small_is_named(self):
        tiny = Rectangle(x=(-0.01, 0.01), y=(-0.01, 0.01))
        problem = robust_problem(
            robust=tightened(beta=None), within={"x": "3 cm"}, limits=(SPEED, tiny), samples=6
        )
        # How long Ipopt tries is not what tells it.
        solution = solve(problem, QUICK.model_copy(update={"max_iterations": 15}), workers=1)
        assert solution.status is Status.INFEASIBLE
        assert solution.trajectory is None
        assert "workspace" in solution.message
        assert NARROWER in solution.message


@pytest.mark.slow
class TestInterrupted:
    def test_the_best_so_far_is_told_with_how_many_leave(self):
        solution = solve(robust_problem(robust=tightened()), Larger(status=Status.INTERRUPTED), workers=1)
        assert len(Larger.asked) == 1
        assert solution.status is Status.INTERRUPTED
        assert solution.trajectory is not None
        assert solution.violation.interval[1] > 1 - CONFIDENCE

    @pytest.mark.parametrize(("number", "beta"), [(2, 4.0), (2, BETA), (5, BETA)])
    # Of five searches the last is a whole one; enough at once, there is but one.
    def test_whichever_search_it_interrupts(self, number: int, beta: float, monkeypatch: pytest.MonkeyPatch):
        searched = Larger.search

        def strike(self: Larger, problem: Problem, context: Context) -> Solution:
            found = searched(self, problem, context)
            last = len(Larger.asked) == number
            return replace(found, status=Status.INTERRUPTED) if last else found

        monkeypatch.setattr(Larger, "search", strike)
        solution = solve(robust_problem(robust=tightened(beta=beta)), Larger(), seed=3, workers=1)
        reached = len(Larger.asked) == number
        assert reached == (beta == BETA)
        assert (solution.status is Status.INTERRUPTED) == reached
        assert solution.trajectory is not None

    def test_while_robots_are_simulated(self, monkeypatch: pytest.MonkeyPatch):
        def strike(*_: Any, **__: Any) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr("oed.optimize.assurance.violation_probability", strike)
        solution = solve(robust_problem(robust=tightened()), Larger(), workers=1)
        assert solution.status is Status.INTERRUPTED
        assert solution.trajectory is not None
        assert UNTRIED in solution.message


short_problem = partial(robust_problem, duration=5, samples=8)
"""For searches of Ipopt and populations, which take longer than one drive does."""


@cache
def designed(workers: int = 1, **options: Any) -> tuple[Problem, Solution]:
    problem = short_problem(robust=tightened(**{"beta": None, **options}))
    return problem, solve(problem, QUICK, seed=1, workers=workers)


@pytest.mark.slow
@pytest.mark.usefixtures("few_screened")
class TestSearches:
    @pytest.mark.parametrize("kind", ["chance", "scenarios"])
    def test_designs_are_kept_by_enough_robots(self, kind: str):
        problem, solution = designed(kind=kind)
        assert enough(problem, solution)
        fresh = violation_probability(problem, solution.trajectory, draws=1000, seed=77)
        assert fresh.probability <= 1 - CONFIDENCE
        assert solution.evaluation.feasible

    def test_of_coefficients_too(self):
        # The matrix c is estimated, and the robot's own parameters are uncertain.
        problem = short_problem(robust=tightened(beta=None), estimate=("c11", "c12", "c21", "c22"))
        solution = solve(problem, QUICK, seed=1, workers=1)
        assert enough(problem, solution)
        assert solution.evaluation.parameters == {"joint": ("c11", "c12", "c21", "c22")}

    def test_the_nominal_design_is_not(self):
        problem, solution = designed()
        plain = solve(replace(problem, robust=None), QUICK, seed=1, workers=1)
        assert violation_probability(problem, plain.trajectory, draws=500).probability > 0.3
        assert plain.evaluation.objective > solution.evaluation.objective

    def test_what_is_reached_is_what_evaluate_says(self):
        # So many robots accept the first drive: starts are all of one search.
        problem, solution = designed(objective="mean", draws=1000)
        assert solution.robust == problem.robust
        assert solution.evaluation.objective == evaluate(problem, solution.trajectory).objective
        best = max(start.objective for start in solution.starts if start.objective)
        assert solution.evaluation.objective == pytest.approx(best, rel=1e-6)

    def test_the_worst_case_of_the_worst_cases_design_is_best(self):
        problem, plain = designed()
        judged = replace(problem, robust=tightened(beta=None, objective="worst"))
        options = QUICK.model_copy(update={"start_from": "ipopt"})
        cautious = solve(judged, options, seed=1, workers=1, earlier={"ipopt": plain})
        assert cautious.evaluation.objective == evaluate(judged, cautious.trajectory).objective
        before = evaluate(judged, plain.trajectory).objective
        assert before < cautious.evaluation.objective < plain.evaluation.objective

    def test_workers_do_not_matter(self, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr("oed.optimize.search.POOL_SECONDS", 0.0)
        problem = short_problem(robust=tightened(beta=2.0))
        # The first start is done alone.
        several = QUICK.model_copy(update={"starts": 3, "max_iterations": 8})
        one, two = (solve(problem, several, seed=1, workers=workers) for workers in (1, 2))
        np.testing.assert_array_equal(one.trajectory.coefficients, two.trajectory.coefficients)
        assert one.violation.probability == two.violation.probability
        assert one.robust == two.robust

    def test_genetic_searches_are_made_sure_of_too(self):
        problem = short_problem(robust=tightened())
        solution = solve(problem, Genetic(population=30, generations=8), seed=1, workers=1)
        assert enough(problem, solution)
        assert solution.evaluation.feasible
        assert solution.robust.reach > BETA
