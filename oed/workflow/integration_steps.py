"""Integration steps of a study: as fine as its designs need, and what is said of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from oed.kernel.cards import steps_text
from oed.kernel.solution import Solution
from oed.study.study import Study


def with_enough_steps(study: Study, solutions: Sequence[Solution]) -> Study:
    """The study with integration steps that are fine enough for solutions of it.

    Args:
        study: whose problem scored them.
        solutions: with their evaluations.
    """
    scored = [one.evaluation.steps for one in solutions if one.evaluation is not None]
    times = max((steps.enough for steps in scored if steps is not None), default=1)
    return study if times == 1 else replace(study, problem=study.problem.refined(times))


def integration_notes(best: Solution | None) -> list[str]:
    """What a reader is to know of the integration of the best design; [] where the study's steps will do.

    Args:
        best: design.
    """
    steps = None if best is None or best.evaluation is None else best.evaluation.steps
    return list(filter(None, [steps_text(steps)]))
