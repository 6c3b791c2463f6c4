"""The coefficients that the twists of most robots are linear in."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Parameter

if TYPE_CHECKING:
    from oed.robots.models.model import Model

ROUNDING = 1e-12
"""Share of the largest coefficient of its row below which one is rounding of the geometry."""


def coefficient_twist(model: Model, inputs: Expression, parameters: Expression) -> Expression:
    """The twist (3,) of a robot whose [yaw rate; forward speed] is c @ effective inputs [Choi, eq. 5].

    A third row of c gives the lateral speed, which is 0 without it.

    Args:
        model: the robot.
        inputs: of one sample, (inputs,), SI.
        parameters: values, (p,), SI.
    """
    product = model.coefficients(parameters) @ model.effective_inputs(inputs, parameters)
    return ca.vertcat(product[1], product[2] if product.shape[0] == 3 else 0, product[0])


def nominal_coefficients(model: Model) -> Array:
    """The matrix c at the nominal parameter values; what is 0 by the robot's geometry is exactly 0."""
    values = np.asarray(ca.evalf(model.coefficients(ca.DM(model.nominal))), dtype=float)
    largest = np.abs(values).max(axis=1, keepdims=True)
    return np.where(np.abs(values) > ROUNDING * largest, values, 0.0)


@lru_cache(maxsize=32)
def coefficient_parameters(model: Model) -> tuple[Parameter, ...]:
    """The coefficients at their nominal values, row by row: yaw rate [1], then forward and lateral speed [m].

    The precision of one that is 0 by the robot's geometry refers to the largest of its unit.
    """
    nominal = nominal_coefficients(model)
    turning, moving = (float(np.abs(rows).max(initial=0.0)) for rows in (nominal[:1], nominal[1:]))
    return tuple(
        Parameter(name, float(value), unit, 0.0 if value else largest)
        for names, values, unit, largest in zip(
            model.coefficient_names,
            nominal,
            ("", "m", "m"),
            (turning, moving, moving),
            strict=False,
        )
        for name, value in zip(names, values, strict=True)
    )
