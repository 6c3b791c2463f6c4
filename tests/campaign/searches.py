"""Searches with little time, from nowhere or from a drive that is known to be feasible."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

import oed
from oed.kernel.identifiability import require_identifiable
from oed.kernel.solution import scored
from oed.optimize.lifted import lift

from .cases import Verdict
from .generator.quantities import one_of

Rng = np.random.Generator

KEPT = "a search keeps its best"
SAME = 1e-6
"""Share of an objective that a search may give up of what it started from."""
GIVEN = "given"
LONGEST = 15.0
"""Of a search or a bound [s]: some systems that are drawn take a second for an iteration."""
FROM_NOWHERE = (
    {"starts": 1, "perturbations": 0, "max_iterations": 40, "second_stage": "none"},
    {"starts": 2, "perturbations": 1, "max_iterations": 25},
    {"starts": "auto", "iterations": 20, "max_iterations": 40, "second_stage": "none"},
)


def searched(
    rng: Rng, problem: oed.Problem, drives: Sequence[oed.Trajectory]
) -> tuple[oed.Trajectory | None, list[Verdict]]:
    """A search's design, and whether it is worth what it started from; `drives` of the problem's space may be
    starts.
    """
    try:
        require_identifiable(problem)
    except oed.UserMistake:
        return None, []
    known = [scored(problem, drive, GIVEN) for drive in drives]
    known = [one for one in known if one.evaluation.feasible and _is_design(one.evaluation.objective)]
    seed, options = int(rng.integers(1000)), dict[str, Any](one_of(rng, FROM_NOWHERE))
    # Searches of readings or the duration along with inputs take no start.
    if known and lift(problem) is None:
        options = {**one_of(rng, (FROM_NOWHERE[0], FROM_NOWHERE[2])), "start_from": GIVEN}
    earlier = {one.name: one for one in known[:1]} if "start_from" in options else {}
    found = oed.solve(
        problem, oed.Ipopt(**options, time_limit=LONGEST), seed=seed, workers=1, earlier=earlier
    )
    return found.trajectory, [_worth(found, start) for start in earlier.values()]


def _is_design(objective: float) -> bool:
    # Not one that leaves what is asked for undetermined.
    return math.isfinite(objective) and objective != 0


def _worth(found: oed.Solution, start: oed.Solution) -> Verdict:
    least = start.evaluation.objective
    if found.evaluation is None or not found.evaluation.feasible:
        return Verdict(KEPT, f"no design from a feasible start of {least:.6g}: {found.status.value}")
    reached = found.evaluation.objective
    lost = reached < least - SAME * abs(least)
    return Verdict(KEPT, f"{reached:.6g} from a feasible start of {least:.6g}" if lost else "")
