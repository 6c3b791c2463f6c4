"""Multi-start search by Ipopt: starts, perturbed designs, a second stage, and one loop over all their solves.

The solves and the order of their results depend on the seed alone; the number of processes that share them
depends on their durations.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import TypeVar

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.work.parallel import run_tasks, waiting
from oed.kernel.cards import explored_text
from oed.kernel.criteria import D
from oed.kernel.problem import Problem
from oed.kernel.results import TOLERANCE
from oed.kernel.solution import BEST_YET, NOTHING_YET, Explored, HistoryPoint, Solution, Start, Status
from oed.optimize.conflict import describe_conflict
from oed.optimize.exploration import BARRIERS, Attempt, Exploration, explorer_of
from oed.optimize.ipopt_options import IpoptOptions
from oed.optimize.local import LocalSearch
from oed.optimize.results import LocalResult, announce_drive, is_better
from oed.optimize.shared_search import SharedSearch
from oed.optimize.solver import Context, earlier_design
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.perturbations import perturbed_design
from oed.optimize.transcription.starting_points import (
    SCREENED,
    Screening,
    random_drives,
    screen,
    starting_points,
    varied_starts,
)

ROUND = 4
"""Number of perturbations of a design before the best result is perturbed in turn."""
TRIAL = 4
"""Number of starts without a design after which the search checks for conflicting limits."""
RESCORED = 5
"""Largest number of screened drives that are scored at all times, the best first."""
POOL_SECONDS, READY_SECONDS = 8.0, 2.0
"""Remaining work [s] below which worker processes, which all build the program, do not pay.

The first is for processes that have to be started, the second for waiting processes.
"""

AnyJob = TypeVar("AnyJob", bound=Callable[[LocalSearch], LocalResult])
"""Type of a solve that a local search makes."""


class TimeUp(Exception):
    """Signal that the time limit of the search has passed."""


class IpoptSearch:
    """Multi-start search of one problem.

    Args:
        options: options of the search.
        problem: problem to be solved.
        context: seed, workers, progress, earlier solutions.
    """

    def __init__(self, options: IpoptOptions, problem: Problem, context: Context) -> None:
        """Write the expressions that all solves share."""
        self.options, self.problem, self.context = options, problem, context
        began = context.refining_since
        self.began = time.perf_counter() if began is None else began
        spent, limit = time.perf_counter() - self.began, options.time_limit
        self.deadline = np.inf if limit is None else time.time() + limit - spent
        self.shared = SharedSearch(uuid.uuid4().hex, problem, options, self.deadline)
        self.local = self.shared.local
        self.best: LocalResult | None = None
        self.starts: list[Start] = []
        self.stages: dict[str, float] = {}
        self.history: list[HistoryPoint] = []
        self.evaluations = 0
        self.explored: Explored | None = None
        self.stopped: Status | None = None
        self._screened_drives: list[Array] = []
        self._seconds: list[float] = []
        self._solves_left = 0.0
        self._best_objective = -np.inf
        self._reason = ""

    def run(self) -> Solution:
        """Return the best design; of an interrupted search, the best so far."""
        try:
            self._check_time()
            try:
                self._search_designs()
            finally:
                # The best screened drives are candidates for the design, too.
                self._keep_better(self._screened_drives)
            self._check_time()
            self._run_second_stage()
        except TimeUp:
            self.stopped = Status.TIME_LIMIT
        except KeyboardInterrupt:
            self.stopped = Status.INTERRUPTED
        return self._solution()

    def _search_designs(self) -> None:
        if self.context.refining_since is not None:
            self._solve_on_finer_spline()
        elif self.options.starts == "auto":
            self._explore()
        else:
            self._try_starts(self.options.starts)
            self._perturb(self.options.perturbations)

    def _solve_on_finer_spline(self) -> None:
        # Solves from the earlier design on a finer spline, with each barrier parameter: either may lead
        # farther.
        start = self._earlier_design(self.options.label)
        count = self.problem.design.spline.count
        self.context.progress.begin(f"refine the spline to {count} coefficients", len(BARRIERS))
        for barrier in reversed(BARRIERS):
            self._maximise([start], barrier)

    def _try_starts(self, count: int) -> None:
        rng, name = self.context.rng(0), self.options.start_from
        self.context.progress.begin("starts", count)
        screened = self._screen(self.local.design, rng)
        points = starting_points(self.local.design, count, rng, screened)
        if name is not None:
            points[0] = self._earlier_design(name)
        self._solves_left = count + (0 if self.options.starts == "auto" else self.options.perturbations)
        self._maximise(points[:TRIAL])
        # Where the first few starts give no design, the reason is looked for before trying more.
        if self.best is None:
            self._keep_better(self._screened_drives)
        if self.best is not None or not self._conflict:
            self._maximise(points[TRIAL:])
        self._note_stage("starts")

    def _perturb(self, count: int) -> None:
        if self.best is None:
            return
        rng = self.context.rng(1)
        if count:
            self.context.progress.begin("perturb and solve again", count)
        for first in range(0, count, ROUND):
            base, size = self.best.unknowns, min(ROUND, count - first)
            self._maximise(
                [perturbed_design(self.local.design, base, rng) for _ in range(size)], perturbed=True
            )
        self._note_stage("perturbations")

    def _explore(self) -> None:
        # Many solves, on a coarse grid where that suffices; the best are then solved on the search's own
        # grid.
        explorer = explorer_of(self.shared)
        design, name = explorer.local.design, self.options.start_from
        self.context.progress.begin("explore", 100)
        screened = self._screen(design, self.context.rng(0))
        fresh = varied_starts(design, screened, self.context.rng(3))
        exploration = Exploration(design, fresh, self.context.rng(1), self.options.budget)
        try:
            if name is not None:
                start = self._earlier_design(name)
                self._maximise([start])
                self._sketch(explorer, exploration, [Attempt(start)])
            while not exploration.done:
                self._sketch(explorer, exploration, exploration.next_round())
        except (TimeUp, KeyboardInterrupt):
            self._screened_drives[:0] = [optimum.unknowns for optimum in exploration.worth_finishing]
            raise
        finally:
            self.explored = exploration.explored
        optima = [optimum.unknowns for optimum in exploration.worth_finishing]
        self.context.progress.begin("starts", len(optima))
        self._solves_left = len(optima)
        self._maximise(optima, BARRIERS[-1])
        if self.best is None:
            self._try_starts(TRIAL)
        self._note_stage("starts")

    def _sketch(self, explorer: SharedSearch, exploration: Exploration, attempts: Sequence[Attempt]) -> None:
        self._solves_left = exploration.solves_left
        for attempt, sketch in self._results(explorer, attempts, sketching=True):
            before = exploration.percent
            exploration.take(attempt, sketch)
            self._solves_left = exploration.solves_left
            for _ in range(exploration.percent - before):
                self.context.progress.advance()

    def _run_second_stage(self) -> None:
        stage, share, best = self.options.second_stage, self.options.second_stage_share, self.best
        # The first stage of the criterion D has maximised log det already.
        done = stage == "none" or (stage == "logdet" and isinstance(self.problem.criterion, D))
        if done or best is None or best.evaluation is None or best.evaluation.singular:
            return
        self.context.progress.begin("second stage among equal optima", 1)
        decided = self.shared(partial(LocalSearch.second_stage, unknowns=best.unknowns, share=share))
        self.context.progress.advance()
        least = self.problem.criterion.concede(best.objective, share)
        # The second stage may lose more than the share only by rounding.
        if decided.objective >= least - 1e-6 * abs(least):
            self.best = replace(decided, gains=best.gains)
        self._note_stage("second_stage")

    def _maximise(
        self, points: Sequence[Array], barrier: float | None = None, *, perturbed: bool = False
    ) -> None:
        # Local searches to full tolerance; those from perturbed designs are not listed as starts.
        jobs = [partial(LocalSearch.maximise, unknowns=point, barrier=barrier) for point in points]
        for _, result in self._results(self.shared, jobs):
            if not perturbed:
                self.starts.append(result.start)
            if result.evaluation is None:
                self._reason = self._reason or result.reason
            elif self.best is None or is_better(result.objective, self.best.objective):
                # Differences within rounding keep the first design, on every machine.
                self.best = result

    def _results(
        self, shared: SharedSearch, jobs: Sequence[AnyJob], *, sketching: bool = False
    ) -> Iterator[tuple[AnyJob, LocalResult]]:
        # Yields the results of solves in the order of the solves, whichever ends first.
        first = 0
        while first < len(jobs):
            remaining = self._solves_left * float(np.mean(self._seconds)) if self._seconds else 0.0
            # The number of processes changes the time until a design is found, not the design.
            least = POOL_SECONDS if waiting() == 1 else min(READY_SECONDS, POOL_SECONDS)
            workers = self.context.workers if remaining > least else 1
            # The first solve runs alone and shows how long the next ones will take.
            count = len(jobs) if self._seconds else 1
            batch, ended = jobs[first : first + count], dict[int, tuple[LocalResult, float]]()
            interruption: BaseException | None = None
            try:
                hear = partial(self._record_end, ended, sketching)
                run_tasks(shared, batch, workers, hear)
            except (TimeUp, KeyboardInterrupt) as error:
                # Solves that have ended still count.
                interruption = error
            for place, (result, seconds) in sorted(ended.items()):
                self._extend_history(result, seconds)
                yield batch[place], result
            if interruption is not None:
                raise interruption
            first += len(batch)

    def _record_end(
        self,
        ended: dict[int, tuple[LocalResult, float]],
        sketching: bool,
        place: int,
        result: LocalResult,
    ) -> None:
        seconds = time.perf_counter() - self.began
        ended[place] = result, seconds
        self._seconds.append(result.wall_seconds)
        self._solves_left -= 1
        if result.evaluation is not None:
            announce_drive(self.context.progress, self.problem, result.evaluation, seconds)
        if not sketching:
            self._best_objective = max(self._best_objective, result.objective)
            text = f"best by {self.problem.criterion.kind}: {self._best_objective:.4g}"
            self.context.progress.advance(text if np.isfinite(self._best_objective) else "")
        self._check_time()

    def _extend_history(self, result: LocalResult, seconds: float) -> None:
        # A later start may end before an earlier one, but time in the history never decreases.
        self.evaluations += result.evaluations
        before = self.history[-1] if self.history else HistoryPoint(0, 0.0, -np.inf)
        if result.evaluation is not None and result.objective > before.objective:
            seconds = max(seconds, before.seconds)
            self.history.append(HistoryPoint(self.evaluations, seconds, result.objective))

    def _keep_better(self, drives: Sequence[Array]) -> None:
        reference = -np.inf if self.best is None else self.best.objective
        for unknowns in drives:
            evaluation = self.local.improvement(unknowns, reference)
            if evaluation is not None:
                self.best = LocalResult(unknowns, 0, 0.0, Status.UNIMPROVED, evaluation=evaluation)
                return

    def _screen(self, design: DesignExpressions, rng: np.random.Generator) -> Screening:
        screened = screen(design, rng)
        self.evaluations += SCREENED
        self._screened_drives = screened.feasible(TOLERANCE)[:RESCORED]
        return screened

    def _earlier_design(self, name: str) -> Array:
        return earlier_design(self.context.earlier, name, self.local.design)

    def _note_stage(self, name: str) -> None:
        if self.best is not None and self.best.evaluation is not None and self.best.evaluation.identifiable:
            self.stages[name] = self.best.objective

    def _check_time(self) -> None:
        if time.time() > self.deadline:
            raise TimeUp

    def _solution(self) -> Solution:
        status, detail = self._verdict()
        best = self.best if status.usable else None
        return Solution(
            name=self.options.label,
            kind=self.options.kind,
            trajectory=None if best is None else self.local.grid.trajectory(best.unknowns),
            evaluation=None if best is None else best.evaluation,
            status=status,
            starts=tuple(self.starts),
            wall_seconds=time.perf_counter() - self.began,
            seed=self.context.seed,
            detail=detail,
            stages=self.stages,
            history=tuple(self.history),
            gains={} if best is None else best.gains,
            explored=self.explored,
        )

    def _verdict(self) -> tuple[Status, str]:
        if self.best is None or self.best.evaluation is None:
            if self.stopped is not None:
                return self.stopped, NOTHING_YET
            return (Status.INFEASIBLE, self._conflict) if self._conflict else (Status.FAILED, self._reason)
        if not self.best.evaluation.identifiable:
            return Status.SINGULAR, ""
        if self.stopped is not None:
            return self.stopped, BEST_YET
        return self.best.status, "" if self.explored is None else explored_text(self.explored)

    @cached_property
    def _conflict(self) -> str:
        # Sentence about the conflicting limits; "" if they are compatible, or another reason is known.
        if self._reason:
            return ""
        self.context.progress.begin("find out which limits conflict", 1)
        points = random_drives(self.local.design, np.array([0.25, 0.5, 1.0]), self.context.rng(2))
        conflict = describe_conflict(self.local.design, list(points))
        self.context.progress.advance()
        return conflict
