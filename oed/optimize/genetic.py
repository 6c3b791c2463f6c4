"""Global search without derivatives: the paper's genetic algorithm, and two relatives, by pymoo.

Genes are the spline coefficients (and the start pose where it is free). A population is scored at once
through the same compiled function that screens Ipopt's starts, by several processes where that is faster.
What keeps all limits is better than what exceeds any, as in pymoo; limits that drives exceed a little between
the points looked at are tightened by as much.
"""

from __future__ import annotations

import contextlib
import time
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PositiveInt

from oed.foundation.arrays import Array
from oed.foundation.errors import NotFinite
from oed.foundation.quantities import Duration
from oed.kernel.evaluation import Evaluation
from oed.kernel.problem import Problem
from oed.kernel.scorer import score
from oed.kernel.solution import BEST_YET, NOTHING_YET, HistoryPoint, Solution, Status
from oed.optimize.generations import Generations, OfPymoo, OnArrays, Operators, Scored, Standing
from oed.optimize.population import Population
from oed.optimize.solver import Context, Solver
from oed.optimize.standing import announce_drive
from oed.optimize.transcription.coarse import Grid
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.starting_points import random_drives, start_bounds

REFINE = 2
"""Path points per sample that the population is checked at first, of problems without back-off; the best are
re-scored at all times.
"""
MOST_TIGHTENED = 0.1
"""Share of a limit's size by which it is tightened at most: drives in a room exceed limits by up to 4 %
between these points, those through a wall by about its thickness.
"""
FINER, FINEST = 4, 32
"""Factor on these points where all that seems feasible slips through between them, and the most there are."""
RESCORED = 3
"""Candidates of a generation that are re-scored at most, from the best down."""


class PopulationSearch(Solver):
    """What the searches by pymoo share.

    Attributes:
        population: drives per generation.
        generations: at most.
        evaluations: drives scored at most; None for no limit.
        time_limit: [s]; None for none. A search that it ends depends on the machine.
    """

    population: Annotated[int, Field(ge=4, le=1_000_000)] = 200
    generations: PositiveInt = 300
    evaluations: PositiveInt | None = None
    time_limit: Annotated[Duration, Field(gt=0)] | None = None

    @abstractmethod
    def begun(self, searched: Any, sampling: Array, seed: int) -> Generations:
        """The search's generations.

        Args:
            searched: the problem as one of pymoo's.
            sampling: unknowns to begin with, (population, size).
            seed: of all random numbers.
        """

    def _of_pymoo(self, algorithm: Any, searched: Any, seed: int) -> Generations:
        from pymoo.termination import get_termination

        termination = get_termination("n_gen", self.generations)
        algorithm.setup(searched, termination=termination, seed=seed, verbose=False)
        return OfPymoo(algorithm)

    def search(self, problem: Problem, context: Context) -> Solution:
        """The best design of all generations; interrupted, the best so far."""
        return _Run(self, problem, context).run()


class Genetic(PopulationSearch):
    """A real-coded genetic algorithm with elitist survival and feasibility-first selection.

    Attributes:
        crossover: "sbx" (simulated binary), "uniform" or "two_point".
        mutation: "polynomial" or "gaussian".
    """

    kind: Literal["genetic"] = "genetic"
    crossover: Literal["sbx", "uniform", "two_point"] = "sbx"
    mutation: Literal["polynomial", "gaussian"] = "polynomial"

    def begun(self, searched: Any, sampling: Array, seed: int) -> Generations:
        """Those of pymoo's GA with the operators chosen."""
        return OnArrays(self.operators(searched), searched.scored, sampling, self.generations, seed)

    def operators(self, searched: Any) -> Operators:
        """Pymoo's operators chosen, for a problem of pymoo's."""
        from pymoo.operators.crossover.pntx import TwoPointCrossover
        from pymoo.operators.crossover.sbx import SBX
        from pymoo.operators.crossover.ux import UniformCrossover
        from pymoo.operators.mutation.pm import PM

        crossovers = {"sbx": SBX, "uniform": UniformCrossover, "two_point": TwoPointCrossover}
        mutations = {"polynomial": PM, "gaussian": _gaussian}
        return Operators(crossovers[self.crossover](), mutations[self.mutation](), searched)


def _gaussian() -> Any:
    from pymoo.operators.mutation.gauss import GaussianMutation
    from pymoo.operators.repair.bounds_repair import repair_random_init

    class Seeded(GaussianMutation):  # type: ignore[misc]
        # Pymoo's own puts back what leaves the bounds by random numbers without a seed.
        def _do(self, problem: Any, X: Array, random_state: Any = None, **_: Any) -> Array:
            moved = random_state.random(X.shape) < self.get_prob_var(problem, size=(len(X), 1))
            spread = np.broadcast_to(self.sigma.get() * (problem.xu - problem.xl), X.shape)
            found = np.array(X, dtype=float)
            found[moved] = random_state.normal(X[moved], spread[moved])
            return np.asarray(repair_random_init(found, X, problem.xl, problem.xu, random_state=random_state))

    return Seeded()


class DifferentialEvolution(PopulationSearch):
    """Differential evolution; `variant` as pymoo names it, e.g. "DE/rand/1/bin"."""

    kind: Literal["differential_evolution"] = "differential_evolution"
    variant: Annotated[str, Field(pattern=r"^DE/(best|rand)/\d/(bin|exp)$")] = "DE/best/1/bin"

    def begun(self, searched: Any, sampling: Array, seed: int) -> Generations:
        """Those of pymoo's DE."""
        from pymoo.algorithms.soo.nonconvex.de import DE

        algorithm = DE(pop_size=self.population, sampling=sampling, variant=self.variant)
        return self._of_pymoo(algorithm, searched, seed)


class CmaEs(PopulationSearch):
    """Covariance matrix adaptation; `sigma` is the first step, as a share of each gene's range."""

    kind: Literal["cmaes"] = "cmaes"
    population: Annotated[int, Field(ge=4, le=1_000_000)] = 40
    sigma: Annotated[float, Field(gt=0, lt=1)] = 0.05

    def begun(self, searched: Any, sampling: Array, seed: int) -> Generations:
        """Those of pymoo's CMA-ES from the gentlest drive of the sampling."""
        from pymoo.algorithms.soo.nonconvex.cmaes import CMAES

        gentlest = sampling[np.argmin(np.abs(sampling).max(axis=1))]
        algorithm = CMAES(x0=gentlest, sigma=self.sigma, pop_size=self.population)
        return self._of_pymoo(algorithm, searched, seed)


def _as_pymoo(design: DesignExpressions, population: Population) -> Any:
    # Made inside a function, for pymoo is loaded only when such a search runs.
    from pymoo.core.problem import Problem as PymooProblem

    bounds = design.coefficient_bounds
    if design.terms.size > len(bounds):
        bounds = np.vstack([bounds, start_bounds(design)])

    class Design(PymooProblem):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(
                n_var=design.terms.size,
                n_obj=1,
                n_ieq_constr=len(design.terms.rows),
                xl=bounds[:, 0],
                xu=bounds[:, 1],
            )

        def scored(self, candidates: Array) -> Scored:
            return population.score(candidates)

        def _evaluate(self, x: Array, out: dict[str, Any], *_: Any, **__: Any) -> None:
            values, excess = population.score(x)
            out["F"] = -values[:, None]
            out["G"] = excess

    return Design()


def excess_between(evaluation: Evaluation, at_points: Array) -> Array:
    """Return how much more a drive exceeds each limit between the points than at them, (limits,).

    It is 0 where the limit is satisfied, and where it is more than `MOST_TIGHTENED`: a wall thinner than the
    way between two points must not forbid drives far from it.

    Args:
        evaluation: of the drive, at all times.
        at_points: by how much each limit is exceeded at the points, in shares of its size, (limits,).
    """
    margins = evaluation.margins[: len(at_points)]
    further = np.array([margin.violation / margin.size for margin in margins]) - at_points
    satisfied = np.array([margin.satisfied for margin in margins], dtype=bool)
    return np.where(satisfied | (further > MOST_TIGHTENED), 0.0, further)


@dataclass
class _Run:
    options: PopulationSearch
    problem: Problem
    context: Context
    began: float = field(default_factory=time.perf_counter)
    best: tuple[Array, Evaluation] | None = None
    standing: float = -np.inf
    history: list[HistoryPoint] = field(default_factory=list)
    evaluations: int = 0
    refused: set[bytes] = field(default_factory=set)

    def run(self) -> Solution:
        status = Status.SEARCHED
        try:
            status = self._refined()
        except KeyboardInterrupt:
            status = Status.INTERRUPTED
        return self._solution(status)

    def _refined(self) -> Status:
        # Again with more points of the path, as long as all that is found slips through between them.
        # With a back-off a point takes as long as the whole way to it.
        robust = self.problem.robust
        rng, refine = self.context.rng(3), REFINE if robust is None or not robust.backs_off else 1
        while True:
            self.grid = Grid(self.problem, refine=refine)
            self.design = self.grid.design
            self.refused.clear()
            status = self._generations(rng, refine)
            slipped = self.best is None and self.refused and status is not Status.TIME_LIMIT
            if not slipped or self._enough or refine >= FINEST:
                return status
            refine = min(FINER * refine, FINEST)

    @property
    def _enough(self) -> bool:
        limit = self.options.evaluations
        return limit is not None and self.evaluations >= limit

    def _generations(self, rng: np.random.Generator, refine: int) -> Status:
        options, before = self.options, self.evaluations
        amplitudes = rng.uniform(0.05, 1.0, options.population)
        sampling = random_drives(self.design, amplitudes, rng)
        seed = int(rng.integers(2**31))
        expected = options.population * options.generations
        expected = min(expected, options.evaluations or expected)
        until = np.inf if options.time_limit is None else self.began + options.time_limit
        population = Population(self.design, refine, self.context.workers, expected, until)
        generations = options.begun(_as_pymoo(self.design, population), sampling, seed)
        self.context.progress.begin(options.kind, options.generations)
        while not generations.ended:
            generations.advance()
            self.evaluations = before + generations.evaluations
            tightening = self._keep_best(generations.standing, population.tightening)
            further, population.tightening = tightening - population.tightening, tightening
            generations.tighten(further)
            kind = self.problem.criterion.kind
            note = "" if self.best is None else f"best by {kind}: {self.best[1].objective:.4g}"
            self.context.progress.advance(note)
            if time.perf_counter() > until:
                return Status.TIME_LIMIT
            if self._enough:
                break
        if self.best is None:
            self._keep_best(generations.standing, population.tightening, last=True)
        return Status.SEARCHED

    def _keep_best(self, standing: Standing, tightening: Array, *, last: bool = False) -> Array:
        # Returns the tightening, (limits,), with which the drives refused here would have been infeasible.
        needed = tightening
        for place in islice(self._fresh(standing), None if last else RESCORED):
            value, unknowns = -float(standing.costs[place]), standing.unknowns[place]
            if value <= self.standing:
                break
            # A drive that is not finite keeps no limit.
            with contextlib.suppress(NotFinite):
                evaluation = score(self.problem, self.grid.trajectory(unknowns))
                if evaluation.feasible:
                    self._keep(value, unknowns, evaluation)
                    break
                at_points = standing.excess[place] - tightening
                needed = np.maximum(needed, excess_between(evaluation, at_points))
            self.refused.add(unknowns.tobytes())
        return needed

    def _fresh(self, standing: Standing) -> Iterator[int]:
        # Drives that keep the limits where the population is checked, the best first, but those that do not
        # keep them between: surviving from generation to generation, they would be in the others' way.
        feasible = standing.feasible
        for place in np.argsort(standing.costs, kind="stable"):
            if feasible[place] and standing.unknowns[place].tobytes() not in self.refused:
                yield int(place)

    def _keep(self, value: float, unknowns: Array, evaluation: Evaluation) -> None:
        self.standing = value
        if self.best is not None and evaluation.objective <= self.best[1].objective:
            return
        self.best = (unknowns, evaluation)
        seconds = time.perf_counter() - self.began
        announce_drive(self.context, self.problem, evaluation, seconds)
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
