"""Whether a study's own integration is fine enough: the best design, integrated again by CVODES or IDAS."""

from __future__ import annotations

from oed.equations.integration_error import validate_integration
from oed.equations.system import Equations
from oed.foundation.errors import Failure, NotFinite
from oed.kernel.solution import Solution
from oed.study.study import Study

COARSE = 1e-3
"""Share of the information from which an integration error is worth a word."""


def integration_notes(study: Study, best: Solution | None) -> list[str]:
    """What is to be known of the integration of the best design; [] where it is fine, or there is none.

    Args:
        study: of the system.
        best: design.
    """
    problem = study.problem
    if best is None or best.trajectory is None:
        return []
    if not isinstance(problem.model, Equations) or not problem.model.states:
        return []
    try:
        error = validate_integration(problem, best.trajectory)
    except (Failure, NotFinite) as failed:
        return [f"Whether the integration is fine enough is not known: {failed}."]
    if error.information <= COARSE:
        return []
    return [f"The integration is coarse: {error.sentence}. Take more samples or `substeps`."]
