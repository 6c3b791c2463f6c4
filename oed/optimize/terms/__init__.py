"""Terms: a drive's information and limit rows as functions of the unknowns, with their derivatives.

`base` says what they are. `unrolled` writes the whole drive out; `pieces` puts it together: a `cell` is one
sample, a `kernel` the samples of a piece (`layout` cuts them), a `link` what a piece hands on (by the chain
rule of `carry`), `condensing` goes from pieces to the drive, `totals` from there to the matrices; `plan` has
them all, and `passes` is one evaluation, forwards and back. `needs` finds what each limit looks at:
`fixed_rows` are those of splines and, by `whole_rows`, of whole runs; `instants` has those of one instant, of
which `slots` takes as many as are chosen, around what has `begun` where their samples begin.
"""

from __future__ import annotations

from typing import Any

from oed.kernel.problem import Problem
from oed.optimize.terms.base import Terms
from oed.optimize.terms.layout import divisible
from oed.optimize.terms.pieces import Pieces
from oed.optimize.terms.unrolled import Unrolled

_KEPT: list[tuple[tuple[Any, ...], Terms]] = []
"""Terms written in this process with what they are of, the newest first."""
_MOST = 2
"""Terms held at once: of all samples and of the search's fewer."""


def terms_of(problem: Problem, refine: int = 1) -> Terms:
    """The terms of a problem, written once in a process for all criteria of the same matrices: from pieces
    where its drives can be cut into them, else unrolled.

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
    layout = divisible(problem)
    terms = Unrolled(problem, refine) if layout is None else Pieces(problem, layout, refine)
    _KEPT.insert(0, (same, terms))
    del _KEPT[_MOST:]
    return terms
