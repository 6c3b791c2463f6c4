"""Terms: a drive's information and limit rows as functions of the unknowns, with their derivatives.

`unknowns` says what these are, `needs` what each limit looks at. `cell` is one sample: `sample_cell` adds
to the information, by sensitivities as `carry` hands them on; `motion_cell` has the motion alone. `runs`
rolls cells out over all samples and differentiates them by a run's unknowns. `information` makes the judged
matrices of what samples add, `whole_rows` and `whole` have what needs a whole drive, `judged` is either.
`watched` says which systems keep limits on instants, `instants` has the rows of one, of which `slots` takes
as many as are chosen; `fixed_rows` and `rows` lay all rows out. `point` is one evaluation of everything, with
derivatives in NumPy; `terms` is what a search asks for.
"""

from __future__ import annotations

from typing import Any

from oed.kernel.problem import Problem
from oed.optimize.terms.terms import Terms

_KEPT: list[tuple[tuple[Any, ...], Terms]] = []
"""Terms written in this process with what they are of, the newest first."""
_MOST = 2
"""Terms held at once: of all samples and of the search's fewer."""


def terms_of(problem: Problem, refine: int = 1) -> Terms:
    """The terms of a problem, written once in a process for all criteria of the same matrices.

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
    terms = Terms(problem, refine)
    _KEPT.insert(0, (same, terms))
    del _KEPT[_MOST:]
    return terms
