"""Bounds on D and A from bounds on the information about combinations of parameters.

For a positive definite sum of matrices Z with bounds on tr(Z F), the concave conjugate of a criterion bounds
that criterion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from oed.bounds.certificate import Bound
from oed.foundation.arrays import Array
from oed.kernel.criteria import Criterion
from oed.kernel.problem import Problem

LEAST = 1e-8
"""Least share tried, for slopes are infinite where the sum is singular; what ends there counts as 0."""
OPTIONS = {"ftol": 1e-15, "maxiter": 1000}
"""Options of the minimiser: it ends at changes near rounding."""


def combined_bounds(problem: Problem, bounds: Sequence[Bound]) -> Iterator[Bound]:
    """Yield the lowest bound that bounds on tr(Z F) give together on a criterion with a smooth conjugate.

    There is none if the bounds leave some combination of parameters free that the criterion needs.

    Args:
        problem: problem with the criterion.
        bounds: bounds on tr(Z F) with their Z of trace 1; those without are left out.
    """
    value, used, multiplier = 0.0, list[Bound](), None
    for estimation in problem.any_estimations:
        block = [bound for bound in bounds if bound.block == estimation.block.name]
        # Scaled so that tr(Z F) <= 1.
        scaled = [
            (bound, bound.multiplier / max(bound.value, np.finfo(float).tiny))
            for bound in block
            if bound.multiplier is not None
        ]
        if not scaled:
            return
        matrices = np.stack([matrix for _, matrix in scaled])
        shares = best_shares(problem.criterion, matrices)
        multiplier = np.tensordot(shares, matrices, axes=1)
        # The criterion adds up over blocks.
        value += problem.criterion.trace_bound(multiplier, 1.0)
        used += [bound for (bound, _), share in zip(scaled, shares, strict=True) if share]
    if multiplier is not None and np.isfinite(value):
        methods = dict.fromkeys(bound.method for bound in used)
        assumptions = dict.fromkeys(text for bound in used for text in bound.assumptions)
        single = multiplier / np.trace(multiplier) if len(problem.any_estimations) == 1 else None
        yield Bound(value, "; and ".join(methods), tuple(assumptions), single)


def best_shares(criterion: Criterion, matrices: Array) -> Array:
    """Return the shares of the sum of Z that bounds a criterion lowest.

    The bound is quasiconvex in the shares, so a descent from equal shares ends at the lowest one.

    Args:
        criterion: criterion D or A.
        matrices: matrices Z (n, p, p) with tr(Z F) <= 1.
    """
    equal = np.full(len(matrices), 1 / len(matrices))
    values, vectors = np.linalg.eigh(matrices.mean(axis=0))
    # Only combinations of parameters that some Z bounds.
    basis = vectors[:, values > np.finfo(float).eps * len(values) * values[-1]]
    inner = basis.T @ matrices @ basis

    def bound(shares: Array) -> float:
        return criterion.trace_bound(np.tensordot(shares, inner, axes=1), 1.0)

    def slope(shares: Array) -> Array:
        by_matrix = criterion.trace_slope(np.tensordot(shares, inner, axes=1), 1.0)
        assert by_matrix is not None
        return np.asarray(np.tensordot(inner, by_matrix, axes=2))

    # Change of the bound per relative change of the information.
    first, scale = bound(equal), -float(equal @ slope(equal))
    solution = scipy.optimize.minimize(
        lambda shares: ((bound(shares) - first) / scale, slope(shares) / scale),
        equal,
        jac=True,
        method="SLSQP",
        bounds=[(LEAST, 1.0)] * len(equal),
        constraints={"type": "eq", "fun": lambda shares: shares.sum() - 1, "jac": np.ones_like},
        options=OPTIONS,
    )
    trial = np.where(solution.x > 2 * LEAST, solution.x, 0.0)
    return np.asarray(min(equal, trial / trial.sum(), key=bound))
