"""The budget of iterations that the searches of one study share."""

from __future__ import annotations

from collections.abc import Sequence

from oed.optimize.exploration import BUDGET
from oed.optimize.ipopt import Ipopt
from oed.optimize.solver import Solver


def with_shared_budget(solvers: Sequence[Solver]) -> tuple[Solver, ...]:
    """Solvers of one study: `BUDGET` in equal shares of those with `starts: auto` and no `iterations` of
    their own. What one does not spend is lost, so that no search depends on those before it.

    Args:
        solvers: as the study gives them.
    """
    sharing = [_shares(one) for one in solvers]
    share = BUDGET // max(sum(sharing), 1)
    return tuple(
        one.model_copy(update={"iterations": max(share, 1)}) if shares else one
        for one, shares in zip(solvers, sharing, strict=True)
    )


def _shares(solver: Solver) -> bool:
    return isinstance(solver, Ipopt) and solver.starts == "auto" and solver.iterations is None
