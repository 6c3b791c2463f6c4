"""What a search has reached, said while it goes on: nobody need wait for its end to see what to expect."""

from __future__ import annotations

from oed.foundation.text import deviation_text, listing, significant, words
from oed.foundation.work.progress import announce
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.optimize.solver import Context


def announce_drive(context: Context, problem: Problem, evaluation: Evaluation, seconds: float) -> None:
    """Tell whoever listens of a feasible drive.

    Args:
        context: of the search.
        problem: that is searched.
        evaluation: of the drive.
        seconds: since the search began [s].
    """
    if evaluation.identifiable:
        first = (
            "first feasible drive" if problem.robust is None else "first drive, untried with other robots,"
        )
        after = f"{first} after {significant(2)(seconds)} s"
        announce(context.progress, f"{after}: {_worth(problem, evaluation)}; {_sought(problem)}")


def _sought(problem: Problem) -> str:
    # A later drive may be better by the criterion, and yet less precise about some parameter.
    names = [words(name) for one in problem.any_estimations for name in one.judged]
    what = problem.criterion.standard_error(names)
    goes_on = "the search for a better one goes on"
    return f"{goes_on}: to make {what} as small as possible" if what else goes_on


def _worth(problem: Problem, evaluation: Evaluation) -> str:
    errors = evaluation.standard_deviations
    units = {
        name: unit
        for one in problem.any_estimations
        for name, unit in zip(one.parameters, one.units, strict=True)
    }
    own = problem.model.shown_units
    said = [
        f"{words(name)} {deviation_text(size, units[name], own.get(name))}" for name, size in errors.items()
    ]
    return f"standard errors {listing(said)}" if said else f"objective {significant(4)(evaluation.objective)}"
