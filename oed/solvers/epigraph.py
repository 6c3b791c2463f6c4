"""The objective that a search maximises: the criterion of one robot, or of all the robots that are judged."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.criteria.criterion import Epigraph
from oed.expression import Expression
from oed.problem import Problem

Array = npt.NDArray[np.float64]


def epigraph_of(problem: Problem, robots: Sequence[Sequence[Expression]]) -> Epigraph:
    """A problem's objective as smooth optimisation, of the matrices of each robot judged.

    Its `initial` takes the matrices of all robots, one robot after the other.
    """
    each = [problem.objective.epigraph(matrices) for matrices in robots]
    if len(each) == 1:
        return each[0]
    mean = problem.robust is not None and problem.robust.objective == "mean"
    objectives = ca.vertcat(*(one.objective for one in each))
    level = ca.SX(0, 1) if mean else ca.SX.sym("level")

    def initial(numeric: Sequence[Array]) -> Array:
        rest = iter(numeric)
        own = [list(islice(rest, len(matrices))) for matrices in robots]
        begun = [one.initial(matrices) for one, matrices in zip(each, own, strict=True)]
        worst = min(float(problem.objective.value(matrices)) for matrices in own)
        return np.concatenate([[] if mean else [worst], *begun])

    return Epigraph(
        objective=ca.sum1(objectives) / len(each) if mean else level,
        variables=ca.vertcat(level, *(one.variables for one in each)),
        equalities=ca.vertcat(*(one.equalities for one in each)),
        initial=initial,
        floors=ca.vertcat(*(one.floors for one in each), ca.SX(0, 1) if mean else objectives - level),
    )
