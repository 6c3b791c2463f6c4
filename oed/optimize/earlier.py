"""Designs of earlier searches, as starts of others."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

from oed.foundation.arrays import Array
from oed.foundation.errors import Failure, ProblemError
from oed.kernel.solution import Solution
from oed.optimize.transcription.design import DesignExpressions


def earlier_design(earlier: Mapping[str, Solution], name: str, design: DesignExpressions) -> Array:
    """Unknowns of an earlier search's design; where it refined its spline, of the finest that can be driven
    here.

    Args:
        earlier: solutions by name.
        name: of the search.
        design: expressions of the problem that it is a start for.

    Raises:
        ProblemError: no search of that name.
        Failure: it found no design.
        ValueError: a design of splines that are not those of the problem.
    """
    solution = earlier.get(name)
    if solution is None:
        known = ", ".join(earlier) or "none"
        text = f"expected the name of an earlier search ({known}), got {name!r}"
        raise ProblemError.about(("solvers", "start_from"), text)
    if solution.trajectory is None:
        raise Failure(f"{name} found no design to start from: {solution.message}")
    *finer, coarsest = solution.designs
    for trajectory in finer:
        with suppress(ValueError):
            return design.unknowns_of(trajectory)
    return design.unknowns_of(coarsest)
