"""Drives of a few samples, in which longer ones are written."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from oed.kernel.dynamics.embedding import Bounding
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive, roll_out
from oed.kernel.problem import Problem


def small_drive(
    problem: Problem, held: Expression, start: Expression, parameters: Expression | None = None
) -> Drive:
    """Return the drive of a few samples with held inputs from a state.

    Args:
        problem: problem with the system.
        held: inputs, (n, inputs).
        start: state, (states,).
        parameters: parameters of the system, (p,); the nominal ones by default.
    """
    return roll_out(
        problem.system,
        inputs=held,
        start=start,
        parameters=ca.SX(ca.DM(problem.system.nominal)) if parameters is None else parameters,
        period=ca.SX(problem.design.period),
    )


def splines_of(drive: Drive, bounding: Bounding) -> Drive:
    """The drive with what bounds its inputs and their derivatives at all times."""
    return replace(
        drive, input_values=bounding.values, input_rates=bounding.rates, input_jerks=bounding.jerks
    )
