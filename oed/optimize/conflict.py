"""Why no feasible drive was found: which limits stand against each other, and by how much."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import excess_text, words
from oed.optimize.exchange import Exchange
from oed.optimize.terms.slots import Chosen
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.program import Outcome, Program

NEGLIGIBLE = 1e-4
"""Relaxation, as a share of a limit's size, below which the limit counts as satisfied."""


def describe_conflict(design: DesignExpressions, starts: Sequence[Array]) -> str:
    """A sentence naming the limits of which one has to give way, and how far each alone would have to.

    Every limit in turn is relaxed as little as a local search finds possible while the others hold. ""
    where the limits turn out to agree.
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
    exchange = Exchange(design.problem, design.terms)
    needed = [
        _relaxed_alone(program, exchange, design, starts, index) for index in range(len(design.terms.rows))
    ]
    if any(amount is not None and amount < NEGLIGIBLE for amount in needed):
        return ""
    limits = design.problem.limits
    # What the rows exceed by share of their size, as the limit itself is measured.
    phrases = [
        f"{words(limit.name)} (by at most "
        f"{excess_text(limit.amount(share * rows.size), rows.unit, degrees=limit.in_degrees)})"
        for limit, rows, share in zip(limits, design.terms.rows, needed, strict=True)
        if share is not None
    ]
    if not phrases:
        names = ", ".join(words(limit.name) for limit in limits)
        return f"The limits {names} conflict; loosening a single one was not found to be enough."
    if len(phrases) == 1:
        return f"One limit is in the way and would have to be loosened: {phrases[0]}."
    return f"These limits conflict, and loosening any one of them is enough: {', '.join(phrases)}."


def _relaxed_alone(
    program: Program, exchange: Exchange, design: DesignExpressions, starts: Sequence[Array], index: int
) -> float | None:
    # A small relaxation of one limit with the others satisfied, from the first start that finds one.
    count = len(design.terms.rows)
    upper = np.zeros(count)
    upper[index] = np.inf
    for start in starts:
        initial = np.where(upper > 0, 1.0, 0.0)
        solve = partial(_solve, program, initial, upper)
        outcome, _ = exchange.solved(solve, start, None, exchange.begun(), design.trajectory)
        # Wherever Ipopt stopped: if all other limits hold there, it is a witness.
        _, violations = design.score_many(outcome.unknowns[None, :])
        if np.delete(violations[0], index).max(initial=0.0) < NEGLIGIBLE:
            return float(violations[0, index])
    return None


def _solve(
    program: Program,
    relaxed: Array,
    upper: Array,
    begin: Array,
    after: Outcome | None,
    chosen: Chosen | None,
    loosely: bool,
) -> Outcome:
    return program.solve(
        begin,
        relaxed if after is None else after.auxiliary,
        auxiliary_lower=np.zeros(len(upper)),
        auxiliary_upper=upper,
        after=after,
        chosen=chosen,
    )
