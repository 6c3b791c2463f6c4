"""One local search: Ipopt from one start, and again with more instants of limits until all are kept."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import NotFinite
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.limit import PathLimit
from oed.kernel.measurement.square_root import SQUARED
from oed.kernel.problem import Problem
from oed.kernel.results import TOLERANCE, Evaluation
from oed.kernel.scorer import score
from oed.kernel.solution import Status
from oed.optimize.exchange import Exchange
from oed.optimize.local_results import Local, Settings
from oed.optimize.lower_level import Instants
from oed.optimize.rounds import Round, chosen_of, judged, surely_better
from oed.optimize.terms.slots import Chosen
from oed.optimize.transcription.chain import SLIGHT
from oed.optimize.transcription.coarse import Grid
from oed.optimize.transcription.design import objective_of
from oed.optimize.transcription.program import Outcome, Program, slots_for

Stage = Literal["program", "second"]

ROUNDS = 6
"""Solves that are judged at all times, each closer to what all limits and samples ask than the one before."""
HOPELESS = 0.1
"""Excess, as a share of a limit's size, that no tightening mends where Ipopt has not converged either: the
search has not found the inside.
"""
NARROWEST = 0.6
"""Share of a limit's size that tightening may take away at most."""
MISLED = 1e-5
"""Share of the objective by which a coarse grid may see a design otherwise than all samples do."""
LOOSE = 1e-3
"""Tolerance of solves after which more instants may be added."""
SLIPPED = 0.02
"""Excess between the points of a path, as a share of a limit's size, from which more points are asked."""
FINER, FINEST = 4, 64
"""Factor on the points per sample then, and the most there are."""


class LocalSearch:
    """The compiled programs of one problem: the criterion's, and the second stage's.

    Limits on instants hold at those that the search has come across. Of a robust problem, limits on the path
    hold at `refine` points per sample; where a design slips through between them, it goes on with more.
    """

    def __init__(self, problem: Problem, settings: Settings, refine: int = 1) -> None:
        """Write the expressions; programs are built when first used."""
        self.problem = problem
        self.settings = settings
        self.refine = refine
        self.grid = Grid(problem, settings.search_samples, refine)
        self.design = self.grid.design
        self.scale = self.design.scale
        self._robots = [[matrix / self.scale for matrix in own] for own in self.grid.robots]
        self._objective = objective_of(problem, self._robots)
        self.exchange = Exchange(problem, self.design.terms)
        # Constants of a solve, though Ipopt is told of them as unknowns that are fixed.
        self._auxiliary = ca.vertcat(self._objective.variables, self.grid.corrections)

    @cached_property
    def _finer(self) -> LocalSearch:
        return LocalSearch(self.problem, self.settings, FINER * self.refine)

    @property
    def no_floors(self) -> Array:
        """Values of the criterion's floors, which ask nothing."""
        return np.zeros(self._objective.floors.shape[0])

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
            softening = max(0.01 * self.problem.model.speed_of(self.design.terms.input_scale), 1e-6)
            return -self.design.terms.drive.path_length(softening=softening)
        return sum(2 * ca.sum1(ca.log(ca.diag(ca.chol(matrix)))) for matrix in self._robots[0])

    def exchanged(
        self,
        program: Program,
        unknowns: Array,
        corrections: Array,
        instants: Instants | None = None,
        after: Outcome | None = None,
        until: float = np.inf,
        **given: Any,
    ) -> tuple[Outcome, Instants]:
        """Solve from a start with ever more instants, until limits are kept: where that ends, and those.

        Args:
            program: that is solved.
            unknowns: z to begin at.
            corrections: of the grid.
            instants: to begin with; as every search does by default.
            after: the solve that it goes on from.
            until: as of `Exchange.solved`.
            given: further arguments of `solved`.
        """
        known = self.exchange.begun() if instants is None else instants

        def solve(begin: Array, before: Outcome | None, chosen: Chosen | None, loosely: bool) -> Outcome:
            tolerance = given.get("tolerance")
            if loosely:
                tolerance = max(tolerance or 0.0, LOOSE)
            how = {**given, "tolerance": tolerance}
            return self.solved(program, begin, corrections, after=before, chosen=chosen, **how)

        return self.exchange.solved(solve, unknowns, after, known, self.grid.trajectory, until)

    def maximise(self, unknowns: Array, barrier: float | None = None) -> Local:
        """Maximise the criterion from a start; the start itself if that is better than where this ends.

        Args:
            unknowns: z to begin at.
            barrier: as of `Program.solve`, for the first solve.
        """
        floors = self.no_floors
        found = self._best("program", unknowns, floors, self.grid.no_correction, barrier)
        better = self.met(unknowns, found.objective)
        if better is None:
            return found
        level = found.objective >= better.objective - MISLED * abs(better.objective)
        return Local(
            unknowns,
            better,
            Status.UNIMPROVED,
            found.iterations,
            found.evaluations,
            found.wall_seconds,
            # Of a start that is as good as where a solve from it ended.
            gains=found.gains if level else {},
        )

    def met(self, unknowns: Array, standing: float) -> Evaluation | None:
        """What a drive that nobody searched for is worth, if it is feasible and better than `standing`."""
        if not self._may_be_better(unknowns, standing):
            return None
        try:
            found = score(self.problem, self.grid.trajectory(unknowns))
        except NotFinite:
            return None
        usable = found.feasible and found.identifiable
        return found if usable and surely_better(found.objective, standing) else None

    def _may_be_better(self, unknowns: Array, standing: float) -> bool:
        # Without scoring it. Of fewer samples than all nobody knows by how much their information differs.
        if self.grid.coarse:
            return True
        matrices = self.grid.matrices_of(unknowns, self.grid.no_correction)
        # As much as it may be worth: of nearly singular matrices, rounding decides.
        most = [[one + np.diag(2 * SQUARED * np.diag(one)) for one in own] for own in matrices]
        return surely_better(float(self.design.objective(most)), standing)

    def compile(self, spared: float, instants: Instants | None = None) -> tuple[int, Path | None]:
        """Let a compiler begin on what a search calls most often: for how many slots, and where it will be.

        Args:
            spared: time [s] that this would spare.
            instants: that are begun with; as every search does by default.
        """
        slots = slots_for(len(self.exchange.begun() if instants is None else instants))
        return slots, self.design.terms.compile(slots, spared=spared)

    def second_stage(self, unknowns: Array, share: float) -> Local:
        """Among designs with at least `share` of this design's objective, the best by the second measure."""
        corrections = self.grid.correction(unknowns)
        value = float(self.design.objective(self._numeric(unknowns, corrections)))
        # A little more than asked for, lest rounding end a little below.
        level = self.problem.criterion.concede(value, share + 1e-3 * (1 - share))
        floors = np.append(self.no_floors, level)
        return self._best("second", unknowns, floors, corrections)

    def _best(
        self, stage: Stage, unknowns: Array, floors: Array, corrections: Array, barrier: float | None = None
    ) -> Local:
        # What is not finite ends a search, but takes nothing from the rounds before.
        began, rounds, reason = time.perf_counter(), list[Round](), ""
        try:
            for one in self._rounds(stage, unknowns, floors, corrections, self.settings.until, barrier):
                rounds.append(one)
        except NotFinite as error:
            reason = str(error)
        seconds = time.perf_counter() - began
        if not rounds:
            return Local(unknowns, None, Status.FAILED, 0, 0, seconds, reason)
        chosen = chosen_of(rounds)
        gains = self.gains(rounds[chosen][0]) if stage == "program" else {}
        return replace(judged(rounds, chosen, seconds, reason), gains=gains)

    def gains(self, outcome: Outcome) -> dict[str, float]:
        """As of a `Solution`, of where a solve of the criterion's program ended."""
        if not outcome.succeeded:
            return {}
        size = sum(len(one.judged) for one in self.problem.any_estimations)
        more = outcome.maximised + SLIGHT * outcome.gains
        shares = [self.problem.objective.change(one, outcome.maximised, size) for one in more]
        # Of a limit's own size, which its rows may measure otherwise.
        wider = [
            limit.amount(SLIGHT * rows.size)
            for limit, rows in zip(self.problem.limits, self.design.terms.rows, strict=True)
        ]
        found = zip(self.problem.limits, shares, wider, strict=True)
        return {limit.name: float(share / by) for limit, share, by in found if by > 0}

    def _rounds(
        self,
        stage: Stage,
        unknowns: Array,
        floors: Array,
        corrections: Array,
        until: float,
        barrier: float | None = None,
    ) -> Iterator[Round]:
        # Solves under limits tightened again and again, each with what its end is worth.
        program = self.program if stage == "program" else self._second
        backoff = np.zeros(len(self.problem.limits))
        after: Outcome | None = None
        instants = self.exchange.begun()
        for _ in range(ROUNDS):
            given: dict[str, Any] = {"floors": floors, "backoff": backoff, "barrier": barrier, "until": until}
            outcome, instants = self.exchanged(program, unknowns, corrections, instants, after, **given)
            # Limits and corrections change little from round to round: each goes on from the one before.
            unknowns, after = outcome.unknowns, outcome if outcome.succeeded else None
            drive = self.grid.trajectory(unknowns)
            evaluation = score(self.problem, drive)
            yield outcome, evaluation
            excess = self._excess(evaluation)
            # A second stage that fails under tighter limits has no room left to choose in.
            lost = not outcome.succeeded and (stage == "second" or excess.max() > HOPELESS)
            kept = not (excess.any() or self._misled(unknowns, corrections, evaluation))
            if lost or kept or time.perf_counter() > until:
                break
            if outcome.succeeded and self._slips(excess):
                yield from self._finer._rounds(stage, unknowns, floors, corrections, until)
                return
            before, more = backoff, self._missed(instants, drive, excess)
            backoff = np.where(self._by_instants, 0.0, np.minimum(backoff + 1.1 * excess, NARROWEST))
            instants = self.exchange.with_more(instants, more, drive)
            stuck = np.array_equal(before, backoff) and not len(more) and not self.grid.coarse
            if excess.any() and stuck:
                break
            corrections = self.grid.correction(unknowns)

    def _missed(self, instants: Instants, drive: Trajectory, excess: Array) -> Instants:
        # Instants between the times looked at, where limits are exceeded: as across a thin wall.
        finer, more = 1, instants.some(np.zeros(len(instants), dtype=bool))
        while excess[self._by_instants].any() and not len(more) and finer <= FINEST:
            more = self.exchange.more(instants, drive, finer)
            finer *= FINER
        return more

    @cached_property
    def _by_instants(self) -> Bools:
        return np.isin(np.arange(len(self.problem.limits)), self.design.terms.instants.limits)

    def _slips(self, excess: Array) -> bool:
        # Whether a design that keeps the limits on the path at all points asked is far beyond them between.
        return self.refine < FINEST and bool(np.any(excess[self._on_path] > SLIPPED))

    @cached_property
    def _on_path(self) -> Bools:
        # Of a robust problem.
        own = np.array([isinstance(limit, PathLimit) for limit in self.problem.limits])
        return own & ~self._by_instants

    def solved(
        self,
        program: Program,
        unknowns: Array,
        corrections: Array,
        floors: Array | None = None,
        backoff: Array | None = None,
        after: Outcome | None = None,
        barrier: float | None = None,
        tolerance: float | None = None,
        chosen: Chosen | None = None,
    ) -> Outcome:
        """One call of Ipopt from a start, with the grid's corrections.

        Args:
            program: that is solved.
            unknowns: z to begin at.
            corrections: of the grid.
            floors: of the program.
            backoff: share of its size by which each limit is tightened.
            after: the solve that it goes on from.
            barrier: as of `Program.solve`.
            tolerance: as of `Program.solve`.
            chosen: as of `Program.solve`.
        """
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
            barrier=barrier,
            tolerance=tolerance,
            chosen=chosen,
        )

    def _misled(self, unknowns: Array, corrections: Array, evaluation: Evaluation) -> bool:
        # Whether the grid saw a design much otherwise than all samples do.
        if not self.grid.coarse:
            return False
        judged = float(self.design.objective(self.grid.matrices_of(unknowns, corrections)))
        return abs(judged - evaluation.objective) > MISLED * abs(evaluation.objective)

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


_CACHE: OrderedDict[str, LocalSearch] = OrderedDict()
"""Searches of this process by their tokens, the one used last behind the others."""
_CACHED = 4
"""Searches that a process holds at once, each with its programs."""


def local_search(token: str, problem: Problem, settings: Settings) -> LocalSearch:
    """The search of this token, built once in each process.

    Args:
        token: of the whole search, by which workers know it.
        problem: to be solved.
        settings: of Ipopt and the stages.
    """
    if token not in _CACHE:
        _CACHE[token] = LocalSearch(problem, settings)
        if len(_CACHE) > _CACHED:
            _CACHE.popitem(last=False)
    _CACHE.move_to_end(token)
    return _CACHE[token]
