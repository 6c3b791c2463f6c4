"""Bounds on D and A from what limits the information on some combinations of parameters.

Every bound on E is one of some tr(Z F), Z of trace 1. Of a sum of such Z that is positive definite, the
concave conjugate of a criterion bounds that criterion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy

from oed.bounds.certificate import Bound
from oed.foundation.arrays import Array
from oed.kernel.criteria import A, Criterion, D, E
from oed.kernel.problem import Problem

SLIGHT = 1e-6
"""Share of the information below which a combination is left out."""
SPREADS = (1.0, 1e-2, 1e2)
"""How much the first combination counts where searches for the best sum begin, beside the others."""
OPTIONS = {"xatol": 1e-8, "fatol": 1e-12, "maxiter": 2000}


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
    most = np.array([one.value for one in known])

    def value(shares: Array) -> float:
        # Every combination has so much of the information.
        counted = shares / np.maximum(most, np.finfo(float).tiny)
        return criterion.trace_bound(np.tensordot(counted, matrices, axes=1), float(counted @ most))

    shares = _lowest(value, len(known))
    if not np.isfinite(value(shares)):
        return None
    used = [one for one, share in zip(known, shares, strict=True) if share]
    multiplier = np.tensordot(shares / most, matrices, axes=1)
    assumptions = tuple(dict.fromkeys(text for one in used for text in one.assumptions))
    return Bound(
        value(shares), _joined(one.method for one in used), assumptions, multiplier / np.trace(multiplier)
    )


def _joined(methods: Iterable[str]) -> str:
    return "; and ".join(dict.fromkeys(methods))


def _lowest(value: Callable[[Array], float], count: int) -> Array:
    best = np.full(count, 1 / count)
    for place in range(count):
        for spread in SPREADS:
            start = np.zeros(count)
            start[place] = np.log(spread)
            found = scipy.optimize.minimize(
                lambda logs: _finite(value(_shares(logs))), start, method="Nelder-Mead", options=OPTIONS
            )
            trial = _shares(found.x)
            trial = np.where(trial > SLIGHT, trial, 0.0)
            best = min(best, trial / trial.sum(), key=value)
    return best


def _shares(logs: Array) -> Array:
    found = np.exp(logs - logs.max())
    return np.asarray(found / found.sum())


def _finite(value: float) -> float:
    return min(value, 1e300)
