"""Reasons why no drive is feasible: conflicting limits, and the amounts by which they conflict."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import excess_text, words
from oed.optimize.exchange import Exchange
from oed.optimize.terms.chosen import ChosenRows
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.program import IpoptOutcome, Program

NEGLIGIBLE = 1e-4
"""Relaxation, as a share of a limit's size, below which the limit counts as satisfied."""


def describe_conflict(design: DesignExpressions, starts: Sequence[Array]) -> str:
    """Return a sentence that names the conflicting limits, and how far each alone would have to be relaxed.

    Every limit in turn is relaxed as little as a local search finds possible while all other limits hold. The
    sentence is "" where the limits turn out to be compatible.
    """
    relaxation = ca.SX.sym("relaxation", len(design.terms.rows))
    program = Program(
        design,
        objective=-ca.sum1(relaxation) - 1e-6 * ca.sumsqr(design.terms.unknowns),
        auxiliary=relaxation,
        equalities=ca.SX(0, 1),
        floors=ca.SX(0, 1),
        relaxing=True,
        options={"ipopt.max_iter": 150},
    )
    limits, phrases = design.problem.limits, []
    for place, (limit, rows) in enumerate(zip(limits, design.terms.rows, strict=True)):
        share = _smallest_relaxation(program, starts, place)
        if share is None:
            continue
        if share < NEGLIGIBLE:
            return ""
        # The relaxation of the rows in the units of the limit.
        amount = excess_text(limit.amount(share * rows.size), rows.unit, degrees=limit.in_degrees)
        phrases.append(f"{words(limit.name)} (by at most {amount})")
    if not phrases:
        names = ", ".join(words(limit.name) for limit in limits)
        return f"The limits {names} conflict; loosening a single one was not found to be enough."
    if len(phrases) == 1:
        return f"One limit is in the way and would have to be loosened: {phrases[0]}."
    return f"These limits conflict, and loosening any one of them is enough: {', '.join(phrases)}."


def _smallest_relaxation(program: Program, starts: Sequence[Array], place: int) -> float | None:
    # Smallest relaxation of one limit with all others satisfied, as a share of its size, from the first start
    # that leads to such a drive.
    design = program.design
    exchange, count = Exchange(design.problem, design.terms), len(design.terms.rows)
    upper = np.where(np.arange(count) == place, np.inf, 0.0)

    def solve(
        begin: Array, after: IpoptOutcome | None, chosen: ChosenRows | None, loosely: bool
    ) -> IpoptOutcome:
        return program.solve(
            begin,
            np.minimum(upper, 1.0) if after is None else after.auxiliary,
            auxiliary_lower=np.zeros(count),
            auxiliary_upper=upper,
            after=after,
            chosen=chosen,
        )

    for start in starts:
        first = exchange.first_instants()
        # What is infeasible with some instants is so with all.
        outcome, _ = exchange.solve(solve, start, None, first, design.trajectory, persistent=False)
        # Any point where all other limits hold is a witness, wherever Ipopt stopped.
        _, excess = design.score_many(outcome.unknowns[None, :])
        if np.delete(excess[0], place).max(initial=0.0) < NEGLIGIBLE:
            return float(excess[0, place])
    return None
