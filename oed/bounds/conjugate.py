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

SLIGHT = 1e-6
"""Share of a matrix in the sum below which it is left out."""
OUTSIDE = 1e9
"""Excess for singular sums of Z, which give no bound on D."""
OPTIONS = {"gtol": 1e-12}
"""Options of the minimiser: it ends at slopes near rounding."""


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

    The bound is quasiconvex in the shares, so a descent from equal shares ends at the lowest one; logarithms
    keep the shares positive.

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

    def excess(logs: Array) -> tuple[float, Array]:
        shares = _normalised(logs)
        value = bound(shares)
        if not np.isfinite(value):
            return OUTSIDE, np.zeros(len(shares))
        by_share = slope(shares)
        return (value - first) / scale, shares * (by_share - shares @ by_share) / scale

    solution = scipy.optimize.minimize(excess, np.zeros(len(equal)), jac=True, method="BFGS", options=OPTIONS)
    trial = _normalised(solution.x)
    trial = np.where(trial > SLIGHT, trial, 0.0)
    return np.asarray(min(equal, trial / trial.sum(), key=bound))


def _normalised(logs: Array) -> Array:
    exponentials = np.exp(logs - logs.max())
    return np.asarray(exponentials / exponentials.sum())
