"""The rounds of a local search: which of them counts, and what it says of the search."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from oed.kernel.results import Evaluation
from oed.kernel.solution import Status
from oed.optimize.local_results import Local
from oed.optimize.transcription.program import OUT_OF_TIME, Outcome

Round: TypeAlias = tuple[Outcome, Evaluation]

ROUNDING = 1e-9
"""Share of the objective that a design must be better by to replace one found before (or after)."""

_STATUS = {
    "Solve_Succeeded": Status.CONVERGED,
    "Solved_To_Acceptable_Level": Status.ACCEPTABLE,
    "Feasible_Point_Found": Status.ACCEPTABLE,
    "Search_Direction_Becomes_Too_Small": Status.ACCEPTABLE,
    "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": Status.TIME_LIMIT,
    OUT_OF_TIME: Status.TIME_LIMIT,
    "Infeasible_Problem_Detected": Status.INFEASIBLE,
    "Restoration_Failed": Status.INFEASIBLE,
}


def surely_better(objective: float, standing: float) -> bool:
    """Whether an objective is larger than another by more than rounding."""
    return bool(np.isfinite(objective)) and objective > standing + ROUNDING * abs(objective)


def chosen_of(rounds: Sequence[Round]) -> int:
    """The best of all rounds' ends, for the last one need not be; of equal ones the last."""
    chosen, standing = len(rounds) - 1, -np.inf
    for place in range(len(rounds) - 1, -1, -1):
        evaluation = rounds[place][1]
        if evaluation.feasible and surely_better(evaluation.objective, standing):
            chosen, standing = place, evaluation.objective
    return chosen


def judged(rounds: Sequence[Round], chosen: int, seconds: float, broken: str = "") -> Local:
    """What a search comes to.

    A drive that does not identify what is asked for is a design, if of no use: the search says so in the end.

    Args:
        rounds: of the search.
        chosen: which of them counts.
        seconds: that it took [s].
        broken: why the round after them was not finite, if one was not.
    """
    outcome, evaluation = rounds[chosen]
    status = _STATUS.get(outcome.return_status, Status.FAILED)
    found = evaluation.feasible and (np.isfinite(evaluation.objective) or not evaluation.identifiable)
    if not found:
        status = status if status is Status.INFEASIBLE else Status.FAILED
    elif status in (Status.INFEASIBLE, Status.FAILED) or broken or chosen < len(rounds) - 1:
        # A feasible end is a design, whatever made Ipopt stop there, or went wrong from there.
        status = Status.ACCEPTABLE
    return Local(
        outcome.unknowns,
        evaluation if found else None,
        status,
        sum(one.iterations for one, _ in rounds),
        sum(one.evaluations for one, _ in rounds),
        seconds,
        "" if found else broken,
    )
