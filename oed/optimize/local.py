"""Local search: Ipopt from one start, with more instants and tighter limits until all are satisfied."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import NotFinite
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.kernel.results import TOLERANCE, Evaluation
from oed.kernel.scorer import score
from oed.kernel.solution import Status
from oed.optimize.exchange import Exchange
from oed.optimize.ipopt_options import IpoptOptions
from oed.optimize.lower_level import Instants
from oed.optimize.results import LocalResult, Round, best_round, is_better, local_result
from oed.optimize.terms.chosen import ChosenRows
from oed.optimize.transcription.coarse import SearchGrid
from oed.optimize.transcription.design import smooth_objective
from oed.optimize.transcription.frame import SLIGHT
from oed.optimize.transcription.program import IpoptOutcome, Program

ROUNDS = 6
"""Largest number of solves whose drives are scored at all times; each one corrects limits and samples."""
HOPELESS = 0.1
"""Excess, as a share of a limit's size, above which a solve that did not converge ends the search.

Tightening cannot help there: the search has not found the feasible region.
"""
NARROWEST = 0.6
"""Largest tightening of a limit, as a share of its size."""
MISLED = 1e-5
"""Largest relative difference between the objectives on a coarse grid and on all samples."""
LOOSE = 1e-3
"""Tolerance of solves after which more instants may be added."""
SKETCHED = 1e-5
"""Smallest tolerance of sketches, the best of which are solved further."""
FINER, FINEST = 4, 64
"""Factor on the number of times of a sample at which missed instants are sought, and its largest value."""


class LocalSearch:
    """Local search of one problem, with a program of the criterion and a program of the second stage.

    Limits on instants are imposed at the instants that the search has collected.

    Args:
        problem: problem to be solved.
        options: options of Ipopt and of the stages.
        deadline: end of the entire search by `time.time`, which all processes share.
    """

    def __init__(self, problem: Problem, options: IpoptOptions, deadline: float = np.inf) -> None:
        """Write the expressions."""
        self.problem, self.options, self.deadline = problem, options, deadline
        self.grid = SearchGrid(problem, options.search_samples)
        self.design = self.grid.design
        self.scale = self.design.scale
        self._robots = [[matrix / self.scale for matrix in matrices] for matrices in self.grid.robots]
        self._objective = smooth_objective(problem, self._robots)
        self.exchange = Exchange(problem, self.design.terms)

    @cached_property
    def program(self) -> Program:
        """Program that maximises the criterion."""
        return self._program(self._objective.maximised, self._objective.floors)

    @cached_property
    def _second_program(self) -> Program:
        floors = ca.vertcat(self._objective.floors, self._objective.maximised)
        if self.options.second_stage == "shortest_path":
            softening = max(0.01 * self.problem.model.speed_of(self.design.terms.input_scale), 1e-6)
            return self._program(-self.design.terms.drive.path_length(softening=softening), floors)
        roots = (ca.chol(matrix) for matrix in self._robots[0])
        return self._program(sum(2 * ca.sum1(ca.log(ca.diag(root))) for root in roots), floors)

    def _program(self, maximised: Expression, floors: Expression) -> Program:
        return Program(
            self.design,
            objective=maximised,
            auxiliary=self._objective.variables,
            equalities=self._objective.equalities,
            floors=floors,
            constants=self.grid.corrections,
            options=self.options.for_ipopt,
        )

    @property
    def no_floors(self) -> Array:
        """Lower bounds (f,) of the floors without a second stage."""
        return np.zeros(self._objective.floors.shape[0])

    @cached_property
    def _sketch_exchange(self) -> Exchange | None:
        # On a coarse grid, limits are imposed at the ends of all samples at once: this leads to better drives
        # than adding instants step by step, and sketches need no limits between samples.
        exchange = Exchange(self.design.terms.problem, self.design.terms)
        return exchange if self.grid.coarse and exchange.needed else None

    def maximise(self, unknowns: Array, barrier: float | None = None) -> LocalResult:
        """Maximise the criterion from a start; the start is the result where it is better than the end.

        Args:
            unknowns: first values of z, (n,).
            barrier: first barrier parameter of the first solve, see `Program.solve`.
        """
        result = self._search(unknowns, self.no_floors, self.grid.no_correction, barrier)
        better = self.improvement(unknowns, result.objective)
        if better is None:
            return result
        # The gains at the end also hold at a start that is equally good.
        level = result.objective >= better.objective - MISLED * abs(better.objective)
        return replace(
            result,
            unknowns=unknowns,
            evaluation=better,
            status=Status.UNIMPROVED,
            reason="",
            gains=result.gains if level else {},
        )

    def second_stage(self, unknowns: Array, share: float) -> LocalResult:
        """Return the best design by the second measure that keeps `share` of this design's objective."""
        corrections = self.grid.correction(unknowns)
        value = float(self.design.objective(self._matrices(unknowns, corrections)))
        # A margin of 0.1 % of the concession keeps rounding from violating it.
        level = self.problem.criterion.concede(value, share + 1e-3 * (1 - share))
        return self._search(unknowns, np.append(self.no_floors, level), corrections, second=True)

    def sketch(self, unknowns: Array, barrier: float) -> LocalResult:
        """Solve once on the search's own grid, without tightening, to rank a start.

        Args:
            unknowns: first values of z, (n,).
            barrier: first barrier parameter, see `Program.solve`.
        """
        began, nothing, excess = time.perf_counter(), self.grid.no_correction, 0.0
        exchange = self._sketch_exchange
        options: dict[str, Any] = {
            "floors": self.no_floors,
            "barrier": barrier,
            "tolerance": max(SKETCHED, self.options.tolerance),
        }
        try:
            if exchange is None:
                instants = self.exchange.first_instants()
                outcome, _ = self.solve_exchanging(self.program, unknowns, nothing, instants, **options)
            else:
                instants = exchange.at_samples()
                chosen = exchange.chosen_rows(instants, self.design.trajectory(unknowns))
                outcome = self.solve(self.program, unknowns, nothing, chosen=chosen, **options)
                drive = self.design.trajectory(outcome.unknowns)
                excess = float(exchange.lower_level.violations(instants, drive).max())
        except NotFinite:
            return LocalResult(unknowns, 1, time.perf_counter() - began, Status.FAILED)
        _, at_samples = self.design.score_many(outcome.unknowns[None, :])
        value = float(self.design.objective(self.grid.matrices_of(outcome.unknowns, nothing)))
        satisfied = max(at_samples.max(initial=0.0), excess) <= TOLERANCE and np.isfinite(value)
        return LocalResult(
            outcome.unknowns,
            max(outcome.iterations, 1),
            time.perf_counter() - began,
            Status.ACCEPTABLE if satisfied else Status.FAILED,
            evaluations=outcome.evaluations,
            sketched=value if satisfied else -np.inf,
        )

    def improvement(self, unknowns: Array, reference: float) -> Evaluation | None:
        """Return the scores of a drive if it is feasible and better than `reference`, else None."""
        try:
            evaluation = score(self.problem, self.grid.trajectory(unknowns))
        except NotFinite:
            return None
        usable = evaluation.feasible and evaluation.identifiable
        return evaluation if usable and is_better(evaluation.objective, reference) else None

    def _search(
        self,
        unknowns: Array,
        floors: Array,
        corrections: Array,
        barrier: float | None = None,
        *,
        second: bool = False,
    ) -> LocalResult:
        # A drive that is not finite ends a search, but earlier rounds still count.
        began, rounds, failure = time.perf_counter(), list[Round](), ""
        try:
            for solve in self._rounds(unknowns, floors, corrections, barrier, second=second):
                rounds.append(solve)
        except NotFinite as error:
            failure = str(error)
        seconds = time.perf_counter() - began
        if not rounds:
            return LocalResult(unknowns, 0, seconds, Status.FAILED, reason=failure)
        place = best_round(rounds)
        gains = {} if second else self.gains(rounds[place][0])
        return replace(local_result(rounds, place, seconds, failure), gains=gains)

    def _rounds(
        self,
        unknowns: Array,
        floors: Array,
        corrections: Array,
        barrier: float | None = None,
        *,
        second: bool,
    ) -> Iterator[Round]:
        # Solves under ever tighter limits, each with the scores of its drive.
        program = self._second_program if second else self.program
        backoff, instants = np.zeros(len(self.problem.limits)), self.exchange.first_instants()
        after: IpoptOutcome | None = None
        for _ in range(ROUNDS):
            options: dict[str, Any] = {"floors": floors, "backoff": backoff, "barrier": barrier}
            outcome, instants = self.solve_exchanging(
                program, unknowns, corrections, instants, after, **options
            )
            # Limits and corrections change little from round to round: each continues the one before.
            unknowns, after = outcome.unknowns, outcome if outcome.succeeded else None
            drive = self.grid.trajectory(unknowns)
            evaluation = score(self.problem, drive)
            yield outcome, evaluation
            excess = self._excess(evaluation)
            # A second stage that fails under tighter limits has no freedom left.
            hopeless = not outcome.succeeded and (second or excess.max() > HOPELESS)
            satisfied = not (excess.any() or self._is_misled(unknowns, corrections, evaluation))
            if hopeless or satisfied or time.time() > self.deadline:
                return
            before, more = backoff, self._missed_instants(instants, drive, excess)
            backoff = np.where(self._at_instants, 0.0, np.minimum(backoff + 1.1 * excess, NARROWEST))
            instants = self.exchange.with_more(instants, more, drive)
            stuck = np.array_equal(before, backoff) and not len(more) and not self.grid.coarse
            if excess.any() and stuck:
                return
            corrections = self.grid.correction(unknowns)

    def solve_exchanging(
        self,
        program: Program,
        unknowns: Array,
        corrections: Array,
        instants: Instants,
        after: IpoptOutcome | None = None,
        **options: Any,
    ) -> tuple[IpoptOutcome, Instants]:
        """Solve with ever more instants until limits are satisfied; return the outcome and these instants.

        Args:
            program: program to solve.
            unknowns: first values of z, (n,).
            corrections: corrections of the grid.
            instants: first instants.
            after: earlier solve that the first one continues.
            options: further arguments of `Program.solve`.
        """
        tolerance = options.pop("tolerance", None)

        def solve(
            begin: Array, before: IpoptOutcome | None, chosen: ChosenRows | None, loosely: bool
        ) -> IpoptOutcome:
            enough = max(tolerance or 0.0, LOOSE) if loosely else tolerance
            further = {"after": before, "chosen": chosen, "tolerance": enough}
            return self.solve(program, begin, corrections, **further, **options)

        return self.exchange.solve(solve, unknowns, after, instants, self.grid.trajectory, self.deadline)

    def solve(self, program: Program, unknowns: Array, corrections: Array, **options: Any) -> IpoptOutcome:
        """Call Ipopt once from a start, with the grid's corrections.

        Args:
            program: program to solve.
            unknowns: first values of z, (n,).
            corrections: corrections of the grid.
            options: further arguments of `Program.solve`.
        """
        first = self._objective.initial(self._matrices(unknowns, corrections))
        return program.solve(unknowns, first, constants=corrections, **options)

    def _matrices(self, unknowns: Array, corrections: Array) -> list[list[Array]]:
        # Scaled matrices, as the program uses them.
        robots = self.grid.matrices_of(unknowns, corrections)
        return [[matrix / self.scale for matrix in matrices] for matrices in robots]

    def gains(self, outcome: IpoptOutcome) -> dict[str, float]:
        """Return the gains by wider limits (see `Solution`) at the end of a solve of `program`."""
        if not outcome.succeeded:
            return {}
        size = sum(len(estimation.judged) for estimation in self.problem.any_estimations)
        gains = {}
        limits = zip(self.problem.limits, self.design.terms.rows, outcome.gains, strict=True)
        for limit, rows, gain in limits:
            widened = outcome.maximised + SLIGHT * gain
            share = self.problem.objective.change(widened, outcome.maximised, size)
            # The size of a limit may be in other units than the size of its rows.
            amount = limit.amount(SLIGHT * rows.size)
            if amount > 0:
                gains[limit.name] = float(share / amount)
        return gains

    def _missed_instants(self, instants: Instants, drive: Trajectory, excess: Array) -> Instants:
        # Instants between the checked times where limits are exceeded, as across a thin wall.
        finer, more = 1, instants.some(np.zeros(len(instants), dtype=bool))
        while excess[self._at_instants].any() and not len(more) and finer <= FINEST:
            more = self.exchange.more(instants, drive, finer)
            finer *= FINER
        return more

    @cached_property
    def _at_instants(self) -> Bools:
        # Mask of the limits that are imposed at the instants of the exchange.
        return np.isin(np.arange(len(self.problem.limits)), self.design.terms.instants.limits)

    def _is_misled(self, unknowns: Array, corrections: Array, evaluation: Evaluation) -> bool:
        # True where the objective on the grid differs from that on all samples.
        if not self.grid.coarse:
            return False
        value = float(self.design.objective(self.grid.matrices_of(unknowns, corrections)))
        return abs(value - evaluation.objective) > MISLED * abs(evaluation.objective)

    def _excess(self, evaluation: Evaluation) -> Array:
        # Half the tolerance is kept for rounding, so that independent checks pass the design as well.
        margins = {margin.name: margin for margin in evaluation.margins}
        shares = [margins[limit.name].violation / margins[limit.name].size for limit in self.problem.limits]
        return np.where(np.array(shares) > TOLERANCE / 2, shares, 0.0)
