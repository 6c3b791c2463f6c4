"""Weak directions: parameters, and combinations of them, that are not identifiable from logs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oed.estimation.methods.fit import Fit

Array = npt.NDArray[np.float64]

OPEN = 0.5
"""Relative standard error from which on a combination counts as not identifiable."""
PART = 0.1
"""Share of the largest from which on an unknown is part of a combination."""
TIED = 0.995
"""Correlation from which on two estimates are identifiable only together."""


def weak_directions(fit: Fit, covariance: Array) -> tuple[str, ...]:
    """Sentences on what is not identifiable from the logs; () where everything is.

    Args:
        fit: of all logs.
        covariance: of all unknowns, (q, q), SI.
    """
    found = tuple(f"{what}: {remedy}" for what, remedy in not_identified(fit, covariance))
    return found or _tied(fit.unknowns.parameters, _relative(fit, covariance))


def not_identified(fit: Fit, covariance: Array, beyond: float = OPEN) -> tuple[tuple[str, str], ...]:
    """Combinations of parameters whose relative standard errors are larger than `beyond`, in words, and what
    helps, in words.

    Args:
        fit: of all logs.
        covariance: of all unknowns, (q, q), SI.
        beyond: standard error relative to the parameters' sizes.
    """
    names, found = fit.unknowns.parameters, []
    variances, vectors = np.linalg.eigh(_relative(fit, covariance))
    for index in np.flatnonzero(variances > beyond**2):
        vector = vectors[:, index]
        involved = np.flatnonzero(np.abs(vector) > PART * np.abs(vector).max())
        found.append(_sentence([names[place] for place in involved], vector[involved]))
    return tuple(found)


def _relative(fit: Fit, covariance: Array) -> Array:
    count = len(fit.unknowns.parameters)
    scale = fit.unknowns.scale[:count]
    return np.asarray(covariance[:count, :count] / np.outer(scale, scale))


def _sentence(names: list[str], shares: Array) -> tuple[str, str]:
    if len(names) == 1:
        return f"the logs do not identify {names[0]}", "fix it (leave it out of `estimate`) or give a `prior`"
    shares = shares / np.abs(shares).max()
    changes = ", ".join(f"{name} {10 * share:+.2g} %" for name, share in zip(names, shares, strict=True))
    listed = f"{', '.join(names[:-1])} and {names[-1]}"
    what = f"the logs do not identify {listed} separately (changing {changes} together hardly shows)"
    return what, "fix one of them, give a `prior`, or drive what separates them (`oed next`)"


def _tied(names: tuple[str, ...], relative: Array) -> tuple[str, ...]:
    sizes = np.sqrt(np.diag(relative))
    ties = relative / np.outer(sizes, sizes)
    return tuple(
        f"{names[first]} and {names[second]} are identifiable only together (correlation "
        f"{ties[first, second]:+.3f}): each alone is less sure than their combination"
        for first in range(len(names))
        for second in range(first + 1, len(names))
        if abs(ties[first, second]) > TIED
    )
