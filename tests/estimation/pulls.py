"""Whether standard errors are those of the estimates: by errors of simulated sets of logs in units of them.

Of 120 sets that says as much as how many of 200 have the truth in their 95 % intervals: what is as it should
be is refused as seldom, and errors of 1.35 times what is said are found in five of six cases either way.
"""

from __future__ import annotations

import numpy as np
import scipy

SETS = 120
"""Of logs, each with errors of its own."""
REFUSED = 2.6e-5
"""Probability on either side that a parameter is refused whose errors are as said."""


def require_pulls(pulls: np.ndarray) -> None:
    """Errors (sets, p), in standard errors, are standard normal."""
    squares = (pulls**2).sum(axis=0)
    assert squares.max() < scipy.stats.chi2.isf(REFUSED, len(pulls)), np.sqrt(squares / len(pulls))
    assert squares.min() > scipy.stats.chi2.ppf(REFUSED, len(pulls)), np.sqrt(squares / len(pulls))
