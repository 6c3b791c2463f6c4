"""Drives of a few samples, in which longer ones are written."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from oed.kernel.dynamics.embedding import Bounding
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive, roll_out
from oed.kernel.problem import Problem


def small_drive(problem: Problem, held: Expression, start: Expression) -> Drive:
    """The drive of a few samples with `held` inputs (n, inputs) from a state.

    Args:
        problem: whose robot drives.
        held: inputs, (n, inputs).
        start: state, (states,).
    """
    return roll_out(
        problem.system,
        inputs=held,
        start=start,
        parameters=ca.SX(ca.DM(problem.system.nominal)),
        period=ca.SX(problem.design.period),
    )


def splines_of(drive: Drive, bounding: Bounding) -> Drive:
    """The drive with what bounds its inputs and their derivatives at all times."""
    return replace(
        drive, input_values=bounding.values, input_rates=bounding.rates, input_jerks=bounding.jerks
    )
