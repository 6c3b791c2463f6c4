"""First guesses of where every segment of a log begins."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from oed.calibration.layout import Layout
from oed.models.model import Model

Array = npt.NDArray[np.float64]


def first_starts(robot: Model, layout: Layout, paths: Callable[[Array], Array]) -> Array:
    """States (S, states) at which the segments begin, near enough for a search to start from.

    A heading that is not read is the one that turns the predicted path onto the positions best.

    Args:
        robot: whose states they are.
        layout: the segments.
        paths: readings (S, n + 1, quantities) predicted for starts (S, states).
    """
    starts = np.zeros((layout.count, len(robot.states)))
    for place, name in enumerate(layout.quantities):
        starts[:, robot.states.index(name)] = layout.readings[:, 0, place]
    if "heading" in layout.quantities or not {"x", "y"} <= set(layout.quantities):
        return starts
    places = [layout.quantities.index("x"), layout.quantities.index("y")]
    starts[:, 2] = _turns(paths(starts)[..., places], layout.readings[..., places], layout.valid)
    return starts


def _turns(predicted: Array, measured: Array, valid: npt.NDArray[np.bool_]) -> Array:
    # The rotation of least squares about the mean [Horn, Closed-form solution of absolute orientation, 1987].
    weight = valid[..., None] / valid.sum(axis=1)[:, None, None]
    paths = []
    for path in (predicted, measured):
        centred = (path - (path * weight).sum(axis=1, keepdims=True)) * (weight > 0)
        paths.append(centred[..., 0] + 1j * centred[..., 1])
    return np.asarray(np.angle((paths[1] * paths[0].conj()).sum(axis=1)))
