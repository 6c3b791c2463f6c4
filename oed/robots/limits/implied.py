"""Bounds on inputs that limits on the body's motion imply, as body_speed does of a speed that is an input."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.kernel.limit import Limit
from oed.robots.models.model import Model, follows_state

Array = npt.NDArray[np.float64]

ROUNDING = 1e-9
"""By how much more than what a linear program finds an input may be, relative to it."""


def implied_bounds(model: Model, limits: Sequence[Limit], known: Array, share: float = 0.0) -> Array:
    """Bounds (inputs, 2) of inputs from limits on the motion that they make; infinite where none follow.

    Parts of the twist that are linear in the inputs count: low <= a'u + b <= high bounds u together with what
    is known of it. Of a robot whose motion follows its inputs with a lag nothing is known but that.

    Args:
        model: the robot, at its nominal parameters.
        limits: all that it has to keep to.
        known: bounds (inputs, 2) that limits set on the inputs themselves; infinite where they set none.
        share: of their sizes, by which limits may be exceeded.
    """
    rows = [] if follows_state(model) else _linear_rows(model, limits, share)
    if not rows or np.isfinite(known).all():
        return known
    table, low, high = (np.array(column) for column in zip(*rows, strict=True))
    return np.array(
        [
            pair if np.isfinite(pair).all() else _reach(table, low, high, known, place)
            for place, pair in enumerate(known)
        ]
    )


def _linear_rows(model: Model, limits: Sequence[Limit], share: float) -> list[tuple[Array, float, float]]:
    # a (inputs,), and the bounds of a'u.
    inputs = ca.SX.sym("inputs", len(model.inputs))
    twist = model.twist(inputs, ca.DM(model.nominal))
    slopes = ca.jacobian(twist, inputs)
    at_rest = ca.Function("at_rest", [inputs], [slopes, twist])(0)
    table, offset = np.array(at_rest[0]), np.array(at_rest[1]).ravel()
    bounds = [(row, *pair) for limit in limits for row, pair in limit.motion_bounds().items()]
    spares = [share * max(abs(low), abs(high)) for _, low, high in bounds]
    return [
        (table[row], low - spare - offset[row], high + spare - offset[row])
        for (row, low, high), spare in zip(bounds, spares, strict=True)
        if not ca.depends_on(slopes[row, :], inputs) and np.isfinite([*table[row], offset[row]]).all()
    ]


def _reach(table: Array, low: Array, high: Array, known: Array, place: int) -> list[float]:
    # The least and the largest that one input can be.
    from scipy.optimize import linprog

    ends = []
    for sign in (1.0, -1.0):
        goal = sign * np.eye(len(known))[place]
        found = linprog(goal, np.vstack([table, -table]), np.concatenate([high, -low]), bounds=known)
        end = float(sign * found.fun) if found.status == 0 else -sign * np.inf
        ends.append(end - sign * ROUNDING * abs(end))
    return ends
