"""What a model could predict at best: the error that it has on drives when fitted to these drives themselves,
without noise. A calibration from another drive has that error and an excess.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.optimize import least_squares

from oed.estimation.assessment.dead_reckoning import dead_reckoned
from oed.estimation.methods.fitting import Fitting
from oed.foundation.arrays import Array
from oed.logs.log import Log

ORIGIN = np.zeros(3)
"""Where on the robot poses are read."""
SIGNED = ("m", "s")
"""Units of parameters that are lengths and times: fits keep their sign."""
LEAST_SHARE = 0.01
"""Of such a parameter's nominal value that a fit leaves."""


def overall(along: Array) -> Array:
    """Root mean square over drives (..., drives) of their root mean squares [m], (...)."""
    return np.asarray(np.sqrt(np.mean(along**2, axis=-1)))


def attainable_error(fitting: Fitting, logs: Sequence[Log], starts: Iterable[Array]) -> float:
    """The least root mean square distance, all along drives and over them, between where the robot truly was
    and where dead reckoning has it [m]: of the parameters that a model estimates, by nonlinear least squares.

    It is a local minimum, reached from the best of `starts`: no more than what any of these has.

    Args:
        fitting: of the model: which of its parameters are estimated.
        logs: of the true motions.
        starts: parameters of the robot, all of them (p,), SI; the nominal ones are tried besides.
    """
    robot = fitting.robot
    table = [one for one in robot.parameters if one.name in fitting.parameters]
    free = [one.name in fitting.parameters for one in robot.parameters]
    nominal = np.array(robot.nominal, dtype=float)
    scales = np.array([one.scale or 1.0 for one in table])

    def off(changes: Array) -> Array:
        values = nominal.copy()
        values[free] += scales * changes
        each = [_distances(fitting, one, values) for one in logs]
        return np.asarray(np.concatenate(each) / np.sqrt(len(logs)))

    tried = [(one - nominal)[free] / scales for one in (nominal, *starts)]
    bounds = np.array(
        [_bounds(one.nominal, one.unit, scale) for one, scale in zip(table, scales, strict=True)]
    )
    inside = [np.clip(one, bounds[:, 0], bounds[:, 1]) for one in tried]
    best = min(inside, key=lambda changes: float(np.sum(off(changes) ** 2)))
    found = least_squares(off, best, bounds=bounds.T, x_scale=LEAST_SHARE)
    return float(np.sqrt(2.0 * found.cost))


def _bounds(nominal: float, unit: str, scale: float) -> tuple[float, float]:
    # Of a parameter's change in its scale.
    if unit not in SIGNED or nominal == 0.0:
        return -np.inf, np.inf
    most = (1 - LEAST_SHARE) * abs(nominal) / scale
    return (-most, np.inf) if nominal > 0 else (-np.inf, most)


def _distances(fitting: Fitting, log: Log, parameters: Array) -> Array:
    # Differences in x and y, whose squares add up to the mean square of the distance.
    found = dead_reckoned(fitting.robot, log, parameters, ORIGIN, 0.0)
    off = (found.path - found.reference)[np.isfinite(found.path).all(axis=1)]
    return np.asarray(off.ravel() / np.sqrt(len(off)))
