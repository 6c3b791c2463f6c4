"""One local search: Ipopt from one start, repeated with tightened limits until the fine grid is satisfied."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.errors import NotFinite
from oed.evaluation import TOLERANCE, Evaluation, evaluate
from oed.expression import Expression
from oed.problem import Problem
from oed.solution import Status
from oed.solvers.coarse import Grid
from oed.solvers.epigraph import objective_of
from oed.solvers.program import Outcome, Program

Array = npt.NDArray[np.float64]

TIGHTENINGS = 6
"""Times that limits exceeded between the samples are tightened before the search is given up."""
HOPELESS = 0.1
"""Excess, as a share of a limit's size, that no tightening mends: the search has not found the inside."""
MISLED = 1e-5
"""Share of the objective by which a coarse grid may see a design otherwise than all samples do."""

_STATUS = {
    "Solve_Succeeded": Status.CONVERGED,
    "Solved_To_Acceptable_Level": Status.ACCEPTABLE,
    "Feasible_Point_Found": Status.ACCEPTABLE,
    "Search_Direction_Becomes_Too_Small": Status.ACCEPTABLE,
    "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": Status.TIME_LIMIT,
    "Maximum_WallTime_Exceeded": Status.TIME_LIMIT,
    "Infeasible_Problem_Detected": Status.INFEASIBLE,
    "Restoration_Failed": Status.INFEASIBLE,
}


@dataclass(frozen=True)
class Local:
    """The result of one local search: where it ended, and its evaluation if that is a feasible design."""

    unknowns: Array
    evaluation: Evaluation | None
    status: Status
    iterations: int
    evaluations: int
    wall_seconds: float
    reason: str = ""
    """Why it has failed, where that is known."""

    @property
    def singular(self) -> bool:
        """Whether there is no design, or one that leaves parameters undetermined."""
        return self.evaluation is None or self.evaluation.singular

    @property
    def objective(self) -> float:
        """The objective reached, minus infinity without a feasible design."""
        return -np.inf if self.evaluation is None else self.evaluation.objective


@dataclass(frozen=True)
class Settings:
    """What a local search needs to know of the solver's options."""

    max_iterations: int
    tolerance: float
    time_limit: float | None
    second_stage: str
    search_samples: int | None = None

    @property
    def ipopt(self) -> dict[str, Any]:
        """The options in Ipopt's names."""
        options: dict[str, Any] = {"ipopt.max_iter": self.max_iterations, "ipopt.tol": self.tolerance}
        if self.time_limit is not None:
            options["ipopt.max_wall_time"] = self.time_limit
        return options


class LocalSearch:
    """The compiled programs of one problem: the criterion's, and the second stage's."""

    def __init__(self, problem: Problem, settings: Settings) -> None:
        """Write the expressions; programs are built when first used."""
        self.problem = problem
        self.settings = settings
        self.grid = Grid(problem, settings.search_samples)
        self.design = self.grid.design
        self.scale = self.design.scale
        self._robots = [[matrix / self.scale for matrix in own] for own in self.grid.robots]
        self._objective = objective_of(problem, self._robots)
        # Constants of a solve, though Ipopt is told of them as unknowns that are fixed.
        self._auxiliary = ca.vertcat(self._objective.variables, self.grid.corrections)

    @cached_property
    def program(self) -> Program:
        """The criterion's program."""
        return Program(
            self.design,
            objective=self._objective.maximised,
            auxiliary=self._auxiliary,
            equalities=self._objective.equalities,
            floors=self._objective.floors,
            options=self.settings.ipopt,
        )

    @cached_property
    def _second(self) -> Program:
        return Program(
            self.design,
            objective=self._secondary(),
            auxiliary=self._auxiliary,
            equalities=self._objective.equalities,
            floors=ca.vertcat(self._objective.floors, self._objective.maximised),
            options=self.settings.ipopt,
        )

    def _secondary(self) -> Expression:
        if self.settings.second_stage == "shortest_path":
            fastest = self.problem.model.twist(
                ca.DM(self.design.input_scale), ca.DM(self.problem.model.nominal)
            )
            return -self.design.terms.drive.path_length(softening=max(0.01 * abs(float(fastest[0])), 1e-6))
        return sum(2 * ca.sum1(ca.log(ca.diag(ca.chol(matrix)))) for matrix in self._robots[0])

    def maximise(self, unknowns: Array) -> Local:
        """Maximise the criterion from a start; one that leads to what is not finite fails."""
        try:
            return self._maximised(unknowns)
        except NotFinite as error:
            return Local(unknowns, None, Status.FAILED, 0, 0, 0.0, str(error))

    def _maximised(self, unknowns: Array) -> Local:
        floors = np.zeros(self._objective.floors.shape[0])
        return self._tightened(self.program, unknowns, floors, self.grid.no_correction)

    def settle(self, unknowns: Array, share: float) -> Local:
        """Among designs with at least `share` of this design's objective, the best by the second measure."""
        corrections = self.grid.correction(unknowns)
        value = float(self.design.objective(self._numeric(unknowns, corrections)))
        # A little more than asked for, lest rounding leave a little less.
        level = self.problem.criterion.concede(value, share + 1e-3 * (1 - share))
        floors = np.append(np.zeros(self._objective.floors.shape[0]), level)
        return self._tightened(self._second, unknowns, floors, corrections)

    def _tightened(self, program: Program, unknowns: Array, floors: Array, corrections: Array) -> Local:
        began = time.perf_counter()
        backoff = np.zeros(len(self.problem.limits))
        outcomes: list[Outcome] = []
        for _ in range(TIGHTENINGS):
            # Limits and corrections change little from round to round: each goes on from the one before.
            after = outcomes[-1] if outcomes and outcomes[-1].succeeded else None
            outcome = self.solved(program, unknowns, corrections, floors, backoff, after)
            outcomes.append(outcome)
            unknowns = outcome.unknowns
            evaluation = evaluate(self.problem, self.grid.trajectory(unknowns))
            excess = self._excess(evaluation)
            if excess.max() > HOPELESS or not (
                excess.any() or self._misled(unknowns, corrections, evaluation)
            ):
                break
            backoff += 1.1 * excess
            corrections = self.grid.correction(unknowns)
        return _judged(outcomes, evaluation, time.perf_counter() - began)

    def solved(
        self,
        program: Program,
        unknowns: Array,
        corrections: Array,
        floors: Array | None = None,
        backoff: Array | None = None,
        after: Outcome | None = None,
    ) -> Outcome:
        """One call of Ipopt from a start, with the grid's corrections."""
        begun = self.initial(unknowns, corrections)
        free = np.full(len(begun), np.inf)
        return program.solve(
            unknowns,
            np.concatenate([begun, corrections]),
            floors=floors,
            backoff=backoff,
            auxiliary_lower=np.concatenate([-free, corrections]),
            auxiliary_upper=np.concatenate([free, corrections]),
            after=after,
        )

    def _misled(self, unknowns: Array, corrections: Array, evaluation: Evaluation) -> bool:
        # Whether the grid saw a design much otherwise than all samples do.
        if not self.grid.coarse:
            return False
        seen = float(self.design.objective(self.grid.matrices_of(unknowns, corrections)))
        return abs(seen - evaluation.objective) > MISLED * abs(evaluation.objective)

    def initial(self, unknowns: Array, corrections: Array) -> Array:
        """The epigraph's auxiliary unknowns for a design."""
        return self._objective.initial(self._numeric(unknowns, corrections))

    def _numeric(self, unknowns: Array, corrections: Array) -> list[list[Array]]:
        found = self.grid.matrices_of(unknowns, corrections)
        return [[matrix / self.scale for matrix in own] for own in found]

    def _excess(self, evaluation: Evaluation) -> Array:
        # Half the tolerance is left for rounding, so that the design passes other people's checks as well.
        named = {margin.name: margin for margin in evaluation.margins}
        shares = np.array(
            [named[limit.name].violation / named[limit.name].size for limit in self.problem.limits]
        )
        return np.where(shares > TOLERANCE / 2, shares, 0.0)


def _judged(outcomes: Sequence[Outcome], evaluation: Evaluation, seconds: float) -> Local:
    last = outcomes[-1]
    status = _STATUS.get(last.return_status, Status.FAILED)
    found = evaluation.feasible and bool(np.isfinite(evaluation.objective))
    if not found:
        status = status if status is Status.INFEASIBLE else Status.FAILED
    elif status in (Status.INFEASIBLE, Status.FAILED):
        # A feasible end is a design, whatever made Ipopt stop there.
        status = Status.ACCEPTABLE
    return Local(
        last.unknowns,
        evaluation if found else None,
        status,
        sum(outcome.iterations for outcome in outcomes),
        sum(outcome.evaluations for outcome in outcomes),
        seconds,
    )


_CACHE: OrderedDict[str, LocalSearch] = OrderedDict()
_CACHED = 4


def local_search(token: str, problem: Problem, settings: Settings) -> LocalSearch:
    """The search of this token, built once in each process."""
    if token not in _CACHE:
        _CACHE[token] = LocalSearch(problem, settings)
        if len(_CACHE) > _CACHED:
            _CACHE.popitem(last=False)
    return _CACHE[token]
