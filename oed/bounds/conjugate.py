"""Bounds on D and A from what limits the information on some combinations of parameters.

Every bound on E is one of some tr(Z F), Z of trace 1. Of a sum of such Z that is positive definite, the
concave conjugate of a criterion bounds that criterion.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy

from oed.bounds.certificate import Bound
from oed.foundation.arrays import Array
from oed.kernel.criteria import A, Criterion, D, E
from oed.kernel.problem import Problem

SLIGHT = 1e-6
"""Share of the information below which a combination is left out."""
OUTSIDE = 1e9
"""Of sums that bound nothing, to rounding."""
OPTIONS = {"gtol": 1e-12}
"""Of the minimiser: slopes that it takes for none, near those of rounding."""


def traced(problem: Problem) -> Problem | None:
    """A problem with criterion E in the place of its own, D or A, which the bounds on E say something about;
    None of others.
    """
    if type(problem.criterion) not in (D, A):
        return None
    same = E(scaling=problem.criterion.scaling, subset=problem.criterion.subset)
    return replace(problem, criterion=same)


def combined_bounds(problem: Problem, bounds: Sequence[Bound]) -> Iterator[Bound]:
    """The lowest bound that bounds of some tr(Z F) give together; none where they leave a combination free.

    Args:
        problem: with criterion D or A.
        bounds: on E, each with its Z.
    """
    names = [one.block.name for one in problem.any_estimations]
    each = [
        _combined(
            problem.criterion, [one for one in bounds if one.block == name and one.multiplier is not None]
        )
        for name in names
    ]
    found = [one for one in each if one is not None]
    if len(found) == len(names):
        # Both criteria add up over the blocks.
        yield Bound(
            sum(one.value for one in found),
            _joined(one.method for one in found),
            tuple(dict.fromkeys(text for one in found for text in one.assumptions)),
            found[0].multiplier if len(found) == 1 else None,
        )


def _combined(criterion: Criterion, known: Sequence[Bound]) -> Bound | None:
    if not known:
        return None
    matrices = np.stack([one.multiplier for one in known if one.multiplier is not None])
    # Every combination has so much of the information.
    matrices = matrices / np.maximum([one.value for one in known], np.finfo(float).tiny)[:, None, None]
    shares = _lowest(criterion, matrices)
    multiplier = np.tensordot(shares, matrices, axes=1)
    value = criterion.trace_bound(multiplier, 1.0)
    if not np.isfinite(value):
        return None
    used = [one for one, share in zip(known, shares, strict=True) if share]
    assumptions = tuple(dict.fromkeys(text for one in used for text in one.assumptions))
    return Bound(value, _joined(one.method for one in used), assumptions, multiplier / np.trace(multiplier))


def _joined(methods: Iterable[str]) -> str:
    return "; and ".join(dict.fromkeys(methods))


def _lowest(criterion: Criterion, matrices: Array) -> Array:
    # Shares (n,) of the sum of Z (n, p, p), each with tr(Z F) at most 1. The bound is quasiconvex in them, so
    # a descent from equal shares ends at the lowest; along their logarithms they stay positive.
    equal = np.full(len(matrices), 1 / len(matrices))
    total = np.tensordot(equal, matrices, axes=1)
    first = criterion.trace_bound(total, 1.0)
    slope = criterion.trace_slope(total, 1.0) if np.isfinite(first) else None
    if slope is None or len(equal) == 1:
        return equal
    # What the bound changes by when the information grows by a share of itself.
    scale = -float(np.sum(slope * total))

    def excess(logs: Array) -> tuple[float, Array]:
        shares = _shares(logs)
        total = np.tensordot(shares, matrices, axes=1)
        value = criterion.trace_bound(total, 1.0)
        slope = criterion.trace_slope(total, 1.0) if np.isfinite(value) else None
        if slope is None:
            return OUTSIDE, np.zeros(len(shares))
        each = np.tensordot(matrices, slope, axes=2)
        return (value - first) / scale, shares * (each - shares @ each) / scale

    found = scipy.optimize.minimize(excess, np.zeros(len(equal)), jac=True, method="BFGS", options=OPTIONS)
    trial = _shares(found.x)
    trial = np.where(trial > SLIGHT, trial, 0.0)
    best = min(
        equal,
        trial / trial.sum(),
        key=lambda shares: criterion.trace_bound(np.tensordot(shares, matrices, axes=1), 1.0),
    )
    return np.asarray(best)


def _shares(logs: Array) -> Array:
    found = np.exp(logs - logs.max())
    return np.asarray(found / found.sum())
