"""A robot's twist and its coefficients in numbers."""

from __future__ import annotations

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.robots.models.model import Model


def asked_twists(model: Model, inputs: Array) -> Array:
    """The twists (K, 3) that inputs (K, inputs) ask for, whether or not the robot follows them at once."""
    symbols = ca.SX.sym("inputs", len(model.inputs))
    function = ca.Function("asked", [symbols], [model.twist(symbols, ca.DM(model.nominal))])
    return np.array(function.map(len(inputs))(inputs.T)).T


def moves_sideways(model: Model) -> bool:
    """Whether any drive of the robot has a lateral speed."""
    inputs, parameters = ca.SX.sym("inputs", len(model.inputs)), ca.SX.sym("p", len(model.parameters))
    return not model.twist(inputs, parameters)[1].is_zero()


def coefficient_values(model: Model, parameters: Array) -> tuple[tuple[str, ...], Array, Array]:
    """Names (q,), values (q,) and derivatives (q, p) of a robot's coefficients at parameter values (p,), SI.

    Nothing for a robot whose twist is not linear in coefficients.
    """
    names = tuple(name for row in model.coefficient_names for name in row)
    if not names:
        return (), np.zeros(0), np.zeros((0, len(parameters)))
    symbols = ca.SX.sym("p", len(parameters))
    entries = ca.vec(model.coefficients(symbols).T)
    function = ca.Function("coefficients", [symbols], [entries, ca.densify(ca.jacobian(entries, symbols))])
    values, slopes = function(parameters)
    return names, np.array(values).ravel(), np.array(slopes)
