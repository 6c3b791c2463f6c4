"""Terms: a drive's information and limit rows as functions of the unknowns, with their derivatives.

`base` says what they are. `unrolled` writes the whole drive out; `condensed`, beside this folder, puts it
together from a `cell` for one sample, which hands on what `carry` says. `needs` finds what each limit looks
at: `fixed_rows` are those of splines and, by `whole_rows`, of whole runs; `instants` has those of one
instant, of which `slots` takes as many as are chosen, around what has `begun` where their samples begin.
"""

from __future__ import annotations

from typing import Any

from oed.kernel.problem import Problem
from oed.optimize.condensed.terms import Condensed, condensable
from oed.optimize.terms.base import Terms
from oed.optimize.terms.unrolled import Unrolled

_KEPT: list[tuple[tuple[Any, ...], Terms]] = []
"""Terms written in this process with what they are of, the newest first."""
_MOST = 2
"""Terms held at once: of all samples and of the search's fewer."""


def terms_of(problem: Problem, refine: int = 1) -> Terms:
    """The terms of a problem, written once in a process for all criteria of the same matrices: condensed
    where its samples add up, else unrolled.

    Args:
        problem: whose terms they are.
        refine: points of the path per sample.
    """
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
    terms = Condensed(problem, refine) if condensable(problem) else Unrolled(problem, refine)
    _KEPT.insert(0, (same, terms))
    del _KEPT[_MOST:]
    return terms
