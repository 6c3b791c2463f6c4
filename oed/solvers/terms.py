"""Which terms a problem gets: from pieces where its drive can be cut into them, else unrolled."""

from __future__ import annotations

from typing import Any

from oed.problem import Problem
from oed.solvers.base import Terms
from oed.solvers.pieces import Pieces, divisible
from oed.solvers.unrolled import Unrolled

_KEPT: list[tuple[tuple[Any, ...], Terms]] = []
_MOST = 2


def terms_of(problem: Problem, refine: int = 1) -> Terms:
    """The terms of a problem, written once in a process for all criteria of the same matrices."""
    criterion = problem.criterion
    same = (
        problem.model,
        problem.design,
        problem.measurement,
        problem.limits,
        problem.estimate,
        problem.prior,
        problem.uncertainty,
        problem.robust,
        criterion.scaling,
        criterion.subset,
        refine,
    )
    for key, terms in _KEPT:
        if key == same:
            return terms
    layout = divisible(problem, refine)
    terms = Unrolled(problem, refine) if layout is None else Pieces(problem, layout)
    _KEPT.insert(0, (same, terms))
    del _KEPT[_MOST:]
    return terms
