"""Whether covariances are those of the estimates: by errors of simulated sets of logs in units of them.

Squares of each parameter's errors are summed, and those of all parameters together, without correlation. Of
30 sets and three parameters errors that are all 1.4 times as large as said are found in nine of ten cases,
those of one parameter alone from 1.6 times on in three of four. Of 20 sets the former are found in three of
four cases, the latter from 1.8 times on in four of five.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

SETS = 30
"""Of logs, each with errors of its own."""
REFUSED = 5e-4
"""Probability on either side that a sum is refused whose errors are as said."""


def require_pulls(errors: np.ndarray, covariances: Sequence[np.ndarray]) -> None:
    """Errors (sets, p) are normal, each set's of its own covariance (p, p)."""
    count, size = errors.shape
    squares = (errors**2 / np.diagonal(covariances, axis1=1, axis2=2)).sum(axis=0)
    together = np.einsum("si,sij,sj", errors, np.linalg.inv(covariances), errors)
    for found, freedom in ((squares, count), (together, count * size)):
        assert np.max(found) < scipy.stats.chi2.isf(REFUSED, freedom), np.sqrt(found / freedom)
        assert np.min(found) > scipy.stats.chi2.ppf(REFUSED, freedom), np.sqrt(found / freedom)


def fewest_held(count: int) -> float:
    """Of so many 95 % intervals hold the truth, but for the same probability."""
    return float(scipy.stats.binom.ppf(REFUSED, count, 0.95))
