"""The search of Ipopt from many starts: which are tried, what is kept, what decides among equal optima."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.work.parallel import Workers, at_once, run_tasks, waiting
from oed.kernel.criteria import D
from oed.kernel.problem import Problem
from oed.kernel.results import TOLERANCE
from oed.kernel.solution import BEST_YET, NOTHING_YET, Explored, HistoryPoint, Solution, Start, Status
from oed.optimize.conflict import describe_conflict
from oed.optimize.earlier import earlier_design
from oed.optimize.exploration import BARRIERS, Attempt, Exploration, Explorer, explorer_of
from oed.optimize.ipopt_options import IpoptOptions
from oed.optimize.local import LocalSearch, local_search
from oed.optimize.local_results import Local, Settings, Sketch
from oed.optimize.local_tasks import Task, work
from oed.optimize.rounds import surely_better
from oed.optimize.solver import Context
from oed.optimize.standing import announce_drive
from oed.optimize.transcription.starting_points import (
    SCREENED,
    Screening,
    perturbed,
    random_drives,
    screen,
    starting_points,
    varied_starts,
)

if TYPE_CHECKING:
    from oed.optimize.terms.base import Terms

ROUND = 4
"""Perturbations tried from one design before the best of them is perturbed in turn."""
TRIAL = 4
"""Starts tried before a search that has found nothing asks whether the limits conflict."""
RESCORED = 5
"""Screened drives that are scored between their samples at most, the best first."""
SPARED = 0.5
"""Share of a search's time that machine code spares it."""
PERCENT = 100
"""Steps of an exploration's progress."""
POOL_SECONDS = 8.0
"""Work left below which starting worker processes, each building its own program, takes longer."""
READY_SECONDS = 2.0
"""The same where processes are there and wait."""


class _TimeUp(Exception):
    """The search's time limit has passed."""


@dataclass
class MultiStart:
    """A search on its way.

    Attributes:
        options: of the search.
        problem: to be solved.
        context: seeds, workers, progress, earlier designs.
        began: when, by `time.perf_counter`.
        further: whether it goes on from an earlier design alone, on a finer spline.
        best: found so far.
        starts: what each came to.
        stages: objective after each.
        stopped: why it ended before its end.
        evaluations: of the criterion.
        history: how the objective rose.
    """

    options: IpoptOptions
    problem: Problem
    context: Context
    began: float = field(default_factory=time.perf_counter)
    further: bool = False
    best: Local | None = None
    starts: list[Start] = field(default_factory=list)
    stages: dict[str, float] = field(default_factory=dict)
    stopped: Status | None = None
    evaluations: int = 0
    history: list[HistoryPoint] = field(default_factory=list)
    _reason: str = ""
    _binary: tuple[int, Path] | None = None
    _explored: Explored | None = None

    def __post_init__(self) -> None:
        """What all its solves share."""
        options = self.options
        self.token = uuid.uuid4().hex
        self.settings = Settings(
            options.max_iterations,
            options.tolerance,
            options.time_limit,
            options.second_stage,
            options.search_samples,
            deadline=None if options.time_limit is None else time.time() + options.time_limit,
        )
        # The same expressions that starts solved in this process use.
        search = local_search(self.token, self.problem, self.settings)
        self.grid, self.design = search.grid, search.design

    def run(self) -> Solution:
        """The best design; interrupted, the best so far."""
        try:
            for stage in (*self._stages, self._decide):
                if self._out_of_time():
                    raise _TimeUp
                stage()
        except _TimeUp:
            self.stopped = Status.TIME_LIMIT
        except KeyboardInterrupt:
            self.stopped = Status.INTERRUPTED
        return self._solution()

    @property
    def _stages(self) -> tuple[Callable[[], None], ...]:
        if self.further:
            return (self._go_on,)
        return (self._explore,) if self.options.starts == "auto" else (self._multi_start, self._perturb)

    def _go_on(self) -> None:
        # From the earlier design on a finer spline: which barrier parameter leads farther, nobody knows.
        begun = self._earlier_design(self.options.label)
        count = self.problem.design.spline.count
        self.context.progress.begin(f"refine the spline to {count} coefficients", len(BARRIERS))
        for barrier in BARRIERS[::-1]:
            self._try_starts([begun], barrier)

    def _multi_start(self) -> None:
        rng = self.context.rng(0)
        screened = screen(self.design, rng)
        points = starting_points(self.design, self._usual_starts, rng, screened)
        self.evaluations += SCREENED
        if self.options.start_from is not None:
            points[0] = self._earlier_design(self.options.start_from)
        self.context.progress.begin("starts", len(points))
        # The first one here: it shows how long a start takes, and whether workers are worth starting.
        self._try_starts(points[:1])
        self._compile(local_search(self.token, self.problem, self.settings), self._seconds_left)
        # Where the first few find nothing, asking why comes before trying the others.
        self._try_starts(points[1:TRIAL])
        if self.best is None:
            self._fall_back(screened)
        if self.best is None and self._conflict:
            return
        self._try_starts(points[TRIAL:])
        self._fall_back(screened)
        self._note_stage("starts")

    @property
    def _usual_starts(self) -> int:
        return TRIAL if self.options.starts == "auto" else self.options.starts

    def _explore(self) -> None:
        # Many solves, on a coarse grid where that will do; the best are then solved as ever.
        explorer = explorer_of(self.token, self.problem, self.settings, self.design.problem.design.samples)
        design = explorer.search.design
        screened = screen(design, self.context.rng(0))
        self.evaluations += SCREENED
        fresh = varied_starts(design, screened, self.context.rng(3))
        found = Exploration(design, fresh, self.context.rng(1), self.options.budget, explorer.pace)
        if self.options.start_from is not None:
            earlier = self._earlier_design(self.options.start_from)
            self._try_starts([earlier])
            first = Attempt(earlier, BARRIERS[-1])
            found.take(first, explorer(first))
        self.context.progress.begin("explore", PERCENT)
        try:
            found.run(partial(self._sketches, found, explorer))
        except (_TimeUp, KeyboardInterrupt):
            self._meet([one.unknowns for one in found.worth_finishing])
            self._fall_back(screened)
            raise
        finally:
            self._explored = found.explored
        self._finish(found.worth_finishing, alike=explorer.token == self.token)
        if self.best is None:
            self._multi_start()
        self._note_stage("starts")

    def _finish(self, ends: Sequence[Sketch], *, alike: bool) -> None:
        # On the search's grid: all of them, or, where that is the grid explored on, those that may be best.
        self.context.progress.begin("starts", len(ends))
        for each in [[one] for one in ends] if alike or not ends else [ends]:
            if self.best is None or each[0].value > self.best.objective:
                self._try_starts([one.unknowns for one in each], BARRIERS[-1])

    def _sketches(
        self, found: Exploration, explorer: Explorer, attempts: Sequence[Attempt]
    ) -> Iterator[tuple[Attempt, Sketch]]:
        # Some are found, and counted, before the next ones are begun.
        budget, begun = self.options.budget, 0
        while rest := attempts[begun:]:
            spent = found.spent
            # What is begun of a round is made, whatever it spends.
            share = max(budget / spent - 1, len(rest) / found.solves) if spent else 0.0
            left = share * (time.perf_counter() - self.began)
            explorer, workers = explorer.compiled(SPARED * left), self._workers(left)
            # The very first one alone: it shows how long the others will take.
            count = self._count(rest, workers, explorer.search.design.terms) if spent else 1
            yield from explorer.made(rest[:count], workers, self._hear)
            before, now = (int(min(PERCENT * one / budget, PERCENT)) for one in (spent, found.spent))
            for _ in range(now - before):
                self.context.progress.advance()
            begun += count

    def _hear(self, sketch: Sketch) -> None:
        self.evaluations += sketch.iterations
        if self._out_of_time():
            raise _TimeUp

    def _fall_back(self, screened: Screening) -> None:
        # No search is to end with less than the best drives that were only looked at.
        self._meet(screened.kept(TOLERANCE)[:RESCORED])

    def _meet(self, drives: Sequence[Array]) -> None:
        search = local_search(self.token, self.problem, self.settings)
        standing = -np.inf if self.best is None else self.best.objective
        for unknowns in drives:
            found = search.met(unknowns, standing)
            if found is not None:
                self.best = Local(unknowns, found, Status.UNIMPROVED, 0, 0, 0.0)
                return

    def _try_starts(self, points: Sequence[Array], barrier: float | None = None) -> None:
        results: list[Local | None] = []
        try:
            self._solve_all(points, results, barrier)
        finally:
            self.starts += [result.start for result in results if result is not None]

    @property
    def _seconds_left(self) -> float:
        # Of local searches, as far as anybody knows.
        left = self._usual_starts + self.options.perturbations - len(self.starts)
        typical = float(np.mean([start.wall_seconds for start in self.starts])) if self.starts else 0.0
        return left * typical

    def _workers(self, left: float) -> Workers:
        # How many processes share work of so many seconds decides only when a design is found, not which.
        least = POOL_SECONDS if waiting() == 1 else min(READY_SECONDS, POOL_SECONDS)
        return self.context.workers if left > least else 1

    def _count(self, tasks: Sequence[object], workers: Workers, terms: Terms) -> int:
        # Few as long as a compiler is at work, which takes a processor: what is begun now goes without it.
        return max(at_once(workers) - 1, 1) if terms.compiling else len(tasks)

    def _compile(self, search: LocalSearch, left: float) -> None:
        slots, binary = search.compile(SPARED * left)
        if binary is not None:
            self._binary = slots, binary

    def _perturb(self) -> None:
        left = self.options.perturbations
        if self.best is None:
            return
        rng = self.context.rng(1)
        if left:
            self.context.progress.begin("perturb and solve again", left)
        while left > 0:
            points = [perturbed(self.design, self.best.unknowns, rng) for _ in range(min(ROUND, left))]
            self._solve_all(points, [])
            left -= len(points)
        self._note_stage("perturbations")

    def _decide(self) -> None:
        options, best = self.options, self.best
        if options.second_stage == "none" or best is None or best.singular:
            return
        # Maximising log det is what the first stage of D has done.
        if options.second_stage == "logdet" and isinstance(self.problem.criterion, D):
            return
        self.context.progress.begin("second stage among equal optima", 1)
        decided = work(self._task(best.unknowns, options.second_stage_share))
        self.context.progress.advance()
        # Less than was asked for only by rounding; anything worse is no gain.
        asked = self.problem.criterion.concede(best.objective, options.second_stage_share)
        if decided.objective >= asked - 1e-6 * abs(asked):
            self.best = replace(decided, gains=best.gains)
        self._note_stage("second_stage")

    def _solve_all(
        self, points: Sequence[Array], results: list[Local | None], barrier: float | None = None
    ) -> None:
        results += [None] * len(points)
        ends = [0.0] * len(points)

        def take(index: int, result: Local) -> None:
            seconds = time.perf_counter() - self.began
            results[begun + index], ends[begun + index] = result, seconds
            if result.evaluation is not None:
                announce_drive(self.context, self.problem, result.evaluation, seconds)
            self.context.progress.advance(self._standing(results))
            if self._out_of_time():
                raise _TimeUp

        tasks, begun = [self._task(point, barrier=barrier) for point in points], 0
        workers = self._workers(self._seconds_left)
        try:
            while rest := tasks[begun:]:
                part = rest[: self._count(rest, workers, self.design.terms)]
                run_tasks(work, part, workers, take)
                begun += len(part)
        finally:
            # In the order of the starts, so that counts and ties are alike whatever the workers' timing.
            self._note_history(results, ends)
            self._keep_best(results)

    def _note_history(self, results: Sequence[Local | None], ends: Sequence[float]) -> None:
        # A later start may have ended before an earlier one; time in the history does not go back.
        for result, seconds in zip(results, np.maximum.accumulate(ends).tolist(), strict=True):
            if result is None:
                continue
            self.evaluations += result.evaluations
            risen = not self.history or result.objective > self.history[-1].objective
            if np.isfinite(result.objective) and risen:
                self.history.append(HistoryPoint(self.evaluations, seconds, result.objective))

    def _earlier_design(self, name: str) -> Array:
        return earlier_design(self.context.earlier, name, self.design)

    def _standing(self, results: Sequence[Local | None]) -> str:
        best = max(one.objective for one in (*results, self.best) if one is not None)
        return f"best by {self.problem.criterion.kind}: {best:.4g}" if np.isfinite(best) else ""

    def _task(self, unknowns: Array, share: float | None = None, barrier: float | None = None) -> Task:
        return Task(self.token, self.problem, self.settings, unknowns, share, barrier, self._binary)

    def _keep_best(self, results: Sequence[Local | None]) -> None:
        for result in results:
            if result is None or result.evaluation is None:
                self._reason = self._reason or ("" if result is None else result.reason)
                continue
            # Better than rounding alone could make it: else the first one stays, on every machine.
            if self.best is None or surely_better(result.objective, self.best.objective):
                self.best = result

    def _note_stage(self, name: str) -> None:
        if self.best is not None and not self.best.useless:
            self.stages[name] = self.best.objective

    def _out_of_time(self) -> bool:
        limit = self.options.time_limit
        return limit is not None and time.perf_counter() - self.began > limit

    def _solution(self) -> Solution:
        status, detail = self._verdict()
        best = self.best if status.usable else None
        return Solution(
            name=self.options.label,
            kind=self.options.kind,
            trajectory=None if best is None else self.grid.trajectory(best.unknowns),
            evaluation=None if best is None else best.evaluation,
            status=status,
            starts=tuple(self.starts),
            wall_seconds=time.perf_counter() - self.began,
            seed=self.context.seed,
            detail=detail,
            stages=self.stages,
            history=tuple(self.history),
            gains={} if best is None else best.gains,
            explored=self._explored,
        )

    def _verdict(self) -> tuple[Status, str]:
        if self.best is None:
            if self.stopped is not None:
                return self.stopped, NOTHING_YET
            return (Status.INFEASIBLE, self._conflict) if self._conflict else (Status.FAILED, self._reason)
        if self.best.useless:
            return Status.SINGULAR, ""
        said = "" if self._explored is None else self._explored.sentence
        return (self.stopped, BEST_YET) if self.stopped else (self.best.status, said)

    @cached_property
    def _conflict(self) -> str:
        # Which limits conflict, in words; "" if they were found to agree, or something else is in the way.
        if self._reason:
            return ""
        self.context.progress.begin("find out which limits conflict", 1)
        points = random_drives(self.design, np.array([0.25, 0.5, 1.0]), self.context.rng(2))
        conflict = describe_conflict(self.design, list(points))
        self.context.progress.advance()
        return conflict
