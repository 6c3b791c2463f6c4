"""The objective that a search maximises: the criterion of one robot, or of all the robots that are judged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.criteria.criterion import lifted
from oed.kernel.dynamics.expression import Expression
from oed.kernel.problem import Problem


@dataclass(frozen=True)
class Objective:
    """What a search maximises, as smooth optimisation.

    Attributes:
        maximised: scalar expression.
        variables: auxiliary unknowns, (k,).
        equalities: expressions that must vanish, (e,).
        floors: expressions that must not be negative, (f,).
        initial: values (k,) of the auxiliary unknowns for the numeric matrices of every robot judged.
    """

    maximised: Expression
    variables: Expression
    equalities: Expression
    floors: Expression
    initial: Callable[[Sequence[Sequence[Array]]], Array]


def objective_of(problem: Problem, robots: Sequence[Sequence[Expression]]) -> Objective:
    """A problem's objective, of the matrices of each robot judged."""
    each = [problem.objective.epigraph(matrices) for matrices in robots]
    alone = len(each) == 1
    mean = alone or (problem.robust is not None and problem.robust.objective == "mean")
    objectives = ca.vertcat(*(one.objective for one in each))
    level = ca.SX(0, 1) if mean else ca.SX.sym("level")

    def initial(numeric: Sequence[Sequence[Array]]) -> Array:
        begun = [one.initial(matrices) for one, matrices in zip(each, numeric, strict=True)]
        # A level from which to begin is finite, also where a drive has next to no information.
        positive = [] if mean else [[lifted(matrix) for matrix in matrices] for matrices in numeric]
        worst = [min(float(problem.objective.value(matrices)) for matrices in positive)] if positive else []
        return np.concatenate([worst, *begun])

    return Objective(
        maximised=ca.sum1(objectives) / len(each) if mean else level,
        variables=ca.vertcat(level, *(one.variables for one in each)),
        equalities=ca.vertcat(*(one.equalities for one in each)),
        floors=ca.vertcat(*(one.floors for one in each), ca.SX(0, 1) if mean else objectives - level),
        initial=initial,
    )
