"""What several drives of one design say together: each of them anew, what is known beforehand once."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from oed.foundation.arrays import ROUNDING
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import resolved
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.problem import Problem
from oed.kernel.scorer import full_information

MOST = 2**30
"""Drives, beyond which no number of them is enough."""


def standard_errors(problem: Problem, information: Mapping[str, SquareRoot], drives: int) -> dict[str, float]:
    """Standard errors [SI] of each estimated parameter after several drives: F = n F_drive + prior.

    Args:
        problem: that says what is estimated, and what is known beforehand.
        information: of one drive without that, by block; see `information_of`.
        drives: n, each from a pose of its own and with nuisances of its own.
    """
    found = dict[str, float]()
    for one in problem.any_estimations:
        rows = math.sqrt(drives) * information[one.block.name].rows
        if one.prior is not None:
            rows = np.vstack([rows, SquareRoot.of_matrix(one.prior).rows])
        variances = np.diag(SquareRoot.of_rows(rows).covariance)
        found |= zip(one.parameters, np.sqrt(variances).tolist(), strict=True)
    return found


def information_of(problem: Problem, trajectory: Trajectory) -> dict[str, SquareRoot]:
    """What one drive says of each block's estimated parameters, SI, without what is known beforehand.

    Raises:
        NotFinite: a drive, or what is measured of it, that is not finite.
    """
    alone = replace(problem, prior=None, robust=None)
    return full_information(resolved(alone, trajectory), trajectory)


def drives_needed(
    problem: Problem, information: Mapping[str, SquareRoot], wanted: Mapping[str, float]
) -> int | None:
    """The fewest drives whose standard errors are those wanted; None where no number of them is enough.

    Args:
        problem: that says what is estimated, and what is known beforehand.
        information: of one drive without that, by block; see `information_of`.
        wanted: standard errors [SI] by parameter.
    """

    def enough(drives: int) -> bool:
        errors = standard_errors(problem, information, drives)
        return all(errors[name] <= (1 + ROUNDING) * size for name, size in wanted.items())

    several = 1
    while not enough(several):
        several *= 2
        if several > MOST:
            return None
    return bisect_left(range(1, several), True, key=enough) + 1
