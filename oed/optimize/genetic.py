"""Global search without derivatives: the genetic algorithm of pymoo on the spline coefficients.

The genes are the unknowns of the design: spline coefficients, and start poses where these are free. Each
generation is scored at once by the function that also screens Ipopt's starts; the best candidates are scored
again by `score`, which checks the limits at all times.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PositiveInt

from oed.foundation.arrays import Array
from oed.foundation.errors import NotFinite
from oed.foundation.quantities import Duration
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.kernel.scorer import score
from oed.kernel.solution import BEST_YET, NOTHING_YET, HistoryPoint, Solution, Status
from oed.optimize.candidate_scores import CandidateScorer
from oed.optimize.results import announce_drive
from oed.optimize.solver import Context, Solver
from oed.optimize.transcription.coarse import SearchGrid
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.starting_points import random_drives, start_bounds

REFINE = 2
"""Path points per sample at which candidates are checked.

It is 1 for limits with a back-off, whose rows at a point take as long as a whole sample of the drive.
"""
MOST_TIGHTENED = 0.1
"""Largest tightening of a limit as a share of its size.

Between these points, drives in a workspace exceed limits by up to 4 %, drives through a wall by its
thickness.
"""
FINER, FINEST = 4, 32
"""Factor on the number of points where all candidates that are feasible at the points exceed limits between
them, and the largest number of points per sample.
"""
MOST_DRIVES = 10_000
"""Largest number of drives per generation: pymoo compares all pairs of them, which then takes 2 GB."""
RESCORED = 3
"""Largest number of candidates of a generation that are scored again, from the best down."""


class Genetic(Solver):
    """Real-coded genetic algorithm with elitist survival that prefers feasible candidates.

    It uses simulated binary crossover and polynomial mutation.

    Attributes:
        population: number of drives per generation, 10,000 at most.
        generations: largest number of generations.
        evaluations: largest number of drives to score; None for no limit.
        time_limit: largest search time [s]; None for no limit. The result of a search that it ends depends on
            the machine.
    """

    kind: Literal["genetic"] = "genetic"
    population: Annotated[int, Field(ge=4, le=MOST_DRIVES)] = 200
    generations: PositiveInt = 300
    evaluations: PositiveInt | None = None
    time_limit: Annotated[Duration, Field(gt=0)] | None = None

    def search(self, problem: Problem, context: Context) -> Solution:
        """Return the best design of all generations; of an interrupted search, the best so far."""
        return _GeneticSearch(self, problem, context).run()


@dataclass(frozen=True, eq=False)
class Population:
    """Candidates that the next generation starts from.

    Attributes:
        unknowns: unknowns of the design, (K, size).
        values: values of the criterion, (K,).
        excess: excess over each limit at the points, in shares of its size, (K, limits).
    """

    unknowns: Array
    values: Array
    excess: Array

    def feasible_from_the_best(self) -> Iterator[int]:
        """Yield the places of candidates that satisfy all limits at the points, the best first."""
        feasible = self.excess.max(axis=1, initial=0.0) <= 0
        for place in np.argsort(-self.values, kind="stable"):
            if feasible[place]:
                yield int(place)


class Generations:
    """Generations of the genetic algorithm of pymoo.

    Args:
        population: number of candidates.
        scorer: scorer of candidates.
        design: expressions of the problem.
        sampling: unknowns of the first generation, (population, size).
        seed: seed of all random numbers.

    Attributes:
        evaluations: number of candidates scored so far.
    """

    def __init__(
        self,
        population: int,
        scorer: CandidateScorer,
        design: DesignExpressions,
        sampling: Array,
        seed: int,
    ) -> None:
        """Set the algorithm up."""
        # pymoo is loaded only when such a search runs.
        from pymoo.algorithms.soo.nonconvex.ga import GA
        from pymoo.core.problem import Problem as Bounds

        bounds = design.coefficient_bounds
        if design.terms.size > len(bounds):
            bounds = np.vstack([bounds, start_bounds(design)])
        low, high = bounds.T
        limits = len(design.terms.rows)
        problem = Bounds(n_var=len(bounds), n_obj=1, n_ieq_constr=limits, xl=low, xu=high)
        self._scorer, self.evaluations = scorer, 0
        self._algorithm = GA(pop_size=population, sampling=sampling)
        self._algorithm.setup(problem, seed=seed, verbose=False)

    def advance(self) -> Population | None:
        """Make, score and select the next generation; return None where no candidate is new."""
        offspring = self._algorithm.ask()
        if offspring is None:
            return None
        values, excess = self._scorer.score(offspring.get("X"))
        self.evaluations += len(offspring)
        offspring.set("F", -values[:, None], "G", excess)
        self._algorithm.tell(infills=offspring)
        unknowns, costs, excess = self._algorithm.pop.get("X", "F", "G")
        return Population(np.asarray(unknowns, dtype=float), -costs[:, 0], excess)

    def tighten(self, tightening: Array) -> None:
        """Tighten the limits, for the candidates selected and for all that follow.

        Args:
            tightening: total shares of the limits' sizes, (limits,).
        """
        population = self._algorithm.pop
        excess = population.get("G") + tightening - self._scorer.tightening
        # pymoo selects candidates by the sum of their violations, which it stores.
        population.set("G", excess, "CV", np.maximum(excess, 0.0).sum(axis=1, keepdims=True))
        self._scorer.tightening = tightening


def excess_between(evaluation: Evaluation, at_points: Array) -> Array:
    """Return the additional excess (limits,) of a drive between the points, in shares of the limits' sizes.

    It is 0 where the limit is satisfied, and where it is more than `MOST_TIGHTENED`: a wall thinner than the
    distance between two points must not forbid drives far from it.

    Args:
        evaluation: scores of the drive at all times.
        at_points: excess over each limit at the points, in shares of its size, (limits,).
    """
    margins = evaluation.margins[: len(at_points)]
    further = np.array([margin.violation / margin.size for margin in margins]) - at_points
    satisfied = np.array([margin.satisfied for margin in margins], dtype=bool)
    return np.where(satisfied | (further > MOST_TIGHTENED), 0.0, further)


@dataclass
class _GeneticSearch:
    options: Genetic
    problem: Problem
    context: Context
    began: float = field(default_factory=time.perf_counter)
    best: tuple[Array, Evaluation] | None = None
    best_value: float = -np.inf
    history: list[HistoryPoint] = field(default_factory=list)
    evaluations: int = 0
    refused: set[bytes] = field(default_factory=set)

    def run(self) -> Solution:
        try:
            status = self._search_with_finer_points()
        except KeyboardInterrupt:
            status = Status.INTERRUPTED
        return self._solution(status)

    def _search_with_finer_points(self) -> Status:
        robust = self.problem.robust
        rng, refine = self.context.rng(3), REFINE if robust is None or not robust.backs_off else 1
        while True:
            self.grid = SearchGrid(self.problem, refine=refine)
            self.refused.clear()
            status = self._search(rng, refine)
            all_refused = self.best is None and self.refused and status is not Status.TIME_LIMIT
            if not all_refused or self._used_up or refine >= FINEST:
                return status
            refine = min(FINER * refine, FINEST)

    @property
    def _used_up(self) -> bool:
        limit = self.options.evaluations
        return limit is not None and self.evaluations >= limit

    def _search(self, rng: np.random.Generator, refine: int) -> Status:
        options, before, design = self.options, self.evaluations, self.grid.design
        sampling = random_drives(design, rng.uniform(0.05, 1.0, options.population), rng)
        seed = int(rng.integers(2**31))
        expected = options.population * options.generations
        expected = min(expected, options.evaluations or expected)
        until = np.inf if options.time_limit is None else self.began + options.time_limit
        scorer = CandidateScorer(design, refine, self.context.workers, expected, until)
        generations = Generations(options.population, scorer, design, sampling, seed)
        self.context.progress.begin(options.kind, options.generations)
        for _ in range(options.generations):
            selected = generations.advance()
            if selected is None:
                break
            candidates, self.evaluations = selected, before + generations.evaluations
            generations.tighten(self._rescore(candidates, RESCORED, scorer.tightening))
            kind = self.problem.criterion.kind
            note = "" if self.best is None else f"best by {kind}: {self.best[1].objective:.4g}"
            self.context.progress.advance(note)
            if time.perf_counter() > until:
                return Status.TIME_LIMIT
            if self._used_up:
                break
        if self.best is None:
            self._rescore(candidates, None, scorer.tightening)
        return Status.SEARCHED

    def _rescore(self, candidates: Population, most: int | None, tightening: Array) -> Array:
        # Keeps the best candidate that satisfies all limits; returns the tightening (limits,) with which the
        # refused candidates would have been infeasible at the points.
        needed = tightening
        unseen = (
            place
            for place in candidates.feasible_from_the_best()
            if candidates.unknowns[place].tobytes() not in self.refused
        )
        for place in islice(unseen, most):
            value, unknowns = float(candidates.values[place]), candidates.unknowns[place]
            if value <= self.best_value:
                break
            # A drive that is not finite violates every limit.
            with contextlib.suppress(NotFinite):
                evaluation = score(self.problem, self.grid.trajectory(unknowns))
                if evaluation.feasible:
                    self._keep(value, unknowns, evaluation)
                    break
                at_points = candidates.excess[place] - tightening
                needed = np.maximum(needed, excess_between(evaluation, at_points))
            self.refused.add(unknowns.tobytes())
        return needed

    def _keep(self, value: float, unknowns: Array, evaluation: Evaluation) -> None:
        self.best_value = value
        if self.best is not None and evaluation.objective <= self.best[1].objective:
            return
        self.best = (unknowns, evaluation)
        seconds = time.perf_counter() - self.began
        announce_drive(self.context.progress, self.problem, evaluation, seconds)
        self.history.append(HistoryPoint(self.evaluations, seconds, evaluation.objective))

    def _solution(self, status: Status) -> Solution:
        best = self.best
        if best is not None:
            seconds = time.perf_counter() - self.began
            self.history.append(HistoryPoint(self.evaluations, seconds, best[1].objective))
        detail = ""
        if status in (Status.INTERRUPTED, Status.TIME_LIMIT):
            detail = NOTHING_YET if best is None else BEST_YET
        elif best is None:
            status = Status.FAILED
        if best is not None and not best[1].identifiable:
            status, best = Status.SINGULAR, None
        return Solution(
            name=self.options.label,
            kind=self.options.kind,
            trajectory=None if best is None else self.grid.trajectory(best[0]),
            evaluation=None if best is None else best[1],
            status=status,
            wall_seconds=time.perf_counter() - self.began,
            seed=self.context.seed,
            detail=detail,
            history=tuple(self.history),
        )
