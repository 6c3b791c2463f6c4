"""What a record says of a certificate: the gap between the bound and the best design."""

from __future__ import annotations

from collections.abc import Sequence

from oed.bounds import LATTICE, Certificate
from oed.kernel.solution import Solution
from oed.optimize import SOLVERS
from oed.records.outcomes import certificate_of
from oed.records.stored.study_record import StoredCertificate
from oed.study.study import Study


def certified(
    study: Study, certificate: Certificate, solutions: Sequence[Solution]
) -> StoredCertificate | None:
    """Return a certificate with its gap to the best feasible of the solutions.

    Args:
        study: whose problem the certificate is about.
        certificate: upper bound on the objective.
        solutions: designs that the bound is compared with.
    """
    samples = study.problem.design.all_samples
    # A path of the user's own with other samples is measured otherwise, and the bound is not about it.
    feasible = [
        (solution.evaluation, solution.kind)
        for solution in solutions
        if solution.evaluation is not None and solution.evaluation.feasible
        if solution.trajectory is not None and solution.trajectory.samples == samples
    ]
    searched = {solver.model_fields["kind"].default for solver in SOLVERS}
    splines = [evaluation.objective for evaluation, kind in feasible if kind in searched]
    return certificate_of(
        certificate,
        max(
            (evaluation for evaluation, _ in feasible),
            key=lambda evaluation: evaluation.objective,
            default=None,
        ),
        LATTICE if any(solution.kind == LATTICE for solution in solutions) else None,
        max(splines, default=None),
    )
