"""Bounds on D and A from bounds on the information about combinations of parameters.

For a positive definite sum of matrices Z with bounds on tr(Z F), the concave conjugate of a criterion bounds
that criterion.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import scipy

from oed.bounds.certificate import Bound
from oed.foundation.arrays import Array
from oed.kernel.criteria import Criterion
from oed.kernel.problem import Problem

SLIGHT = 1e-6
"""Share of a matrix in the sum below which it is left out."""
OUTSIDE = 1e9
"""Excess for singular sums of Z, which give no bound."""
OPTIONS = {"gtol": 1e-12}
"""Options of the minimiser: it ends at slopes near rounding."""


def combined_bounds(problem: Problem, bounds: Sequence[Bound]) -> Iterator[Bound]:
    """Yield the lowest bound that bounds on tr(Z F) give together on a criterion with a smooth conjugate.

    There is none if the bounds leave some combination of parameters free.

    Args:
        problem: problem with the criterion.
        bounds: bounds on tr(Z F) with their Z of trace 1; those without are left out.
    """
    names = [estimation.block.name for estimation in problem.any_estimations]
    bounds = [bound for bound in bounds if bound.multiplier is not None]
    by_block = [
        _combine_block(problem.criterion, [bound for bound in bounds if bound.block == name])
        for name in names
    ]
    combined = [bound for bound in by_block if bound is not None]
    if len(combined) == len(names):
        # Both criteria add up over the blocks.
        yield Bound(
            sum(bound.value for bound in combined),
            _join_methods(bound.method for bound in combined),
            tuple(dict.fromkeys(text for bound in combined for text in bound.assumptions)),
            combined[0].multiplier if len(combined) == 1 else None,
        )


def _combine_block(criterion: Criterion, bounds: Sequence[Bound]) -> Bound | None:
    if not bounds:
        return None
    matrices = np.stack([bound.multiplier for bound in bounds if bound.multiplier is not None])
    # Scaled so that tr(Z F) <= 1.
    matrices = matrices / np.maximum([bound.value for bound in bounds], np.finfo(float).tiny)[:, None, None]
    shares = _best_shares(criterion, matrices)
    multiplier = np.tensordot(shares, matrices, axes=1)
    value = criterion.trace_bound(multiplier, 1.0)
    if not np.isfinite(value):
        return None
    used = [bound for bound, share in zip(bounds, shares, strict=True) if share]
    assumptions = tuple(dict.fromkeys(text for bound in used for text in bound.assumptions))
    return Bound(
        value, _join_methods(bound.method for bound in used), assumptions, multiplier / np.trace(multiplier)
    )


def _join_methods(methods: Iterable[str]) -> str:
    return "; and ".join(dict.fromkeys(methods))


def _best_shares(criterion: Criterion, matrices: Array) -> Array:
    # Shares (n,) in the sum of Z (n, p, p) with tr(Z F) <= 1. The bound is quasiconvex in the shares, so a
    # descent from equal shares ends at the lowest bound; logarithms keep the shares positive.
    def bound(shares: Array) -> tuple[float, Array | None]:
        total = np.tensordot(shares, matrices, axes=1)
        value = criterion.trace_bound(total, 1.0)
        return value, criterion.trace_slope(total, 1.0) if np.isfinite(value) else None

    equal = np.full(len(matrices), 1 / len(matrices))
    first, first_slope = bound(equal)
    if first_slope is None or len(equal) == 1:
        return equal
    # Change of the bound per relative change of the information.
    scale = -float(np.sum(first_slope * np.tensordot(equal, matrices, axes=1)))

    def excess(logs: Array) -> tuple[float, Array]:
        shares = _shares(logs)
        value, slope = bound(shares)
        if slope is None:
            return OUTSIDE, np.zeros(len(shares))
        derivatives = np.tensordot(matrices, slope, axes=2)
        return (value - first) / scale, shares * (derivatives - shares @ derivatives) / scale

    solution = scipy.optimize.minimize(excess, np.zeros(len(equal)), jac=True, method="BFGS", options=OPTIONS)
    trial = _shares(solution.x)
    trial = np.where(trial > SLIGHT, trial, 0.0)
    return np.asarray(min(equal, trial / trial.sum(), key=lambda shares: bound(shares)[0]))


def _shares(logs: Array) -> Array:
    exponentials = np.exp(logs - logs.max())
    return np.asarray(exponentials / exponentials.sum())
