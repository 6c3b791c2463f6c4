"""First guesses of where every segment of a log begins."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.prediction.segments import SegmentReadings
from oed.estimation.setup.unknowns import PLACE
from oed.kernel.dynamics.system import follows_state
from oed.robots.models.model import Model

Array = npt.NDArray[np.float64]

SETTLED = 100.0
"""Time after which a robot follows inputs that are held [s]."""


def first_starts(
    robot: Model, layout: SegmentLayout, paths: Callable[[Array], Array], place: Array, further: Array
) -> Array:
    """States (S, states) at which the segments begin, near enough for a search to start from.

    A heading that is not read is the one that turns the predicted path onto the positions best.

    Args:
        robot: whose states they are.
        layout: the segments.
        paths: readings (S, n + 1, quantities) predicted for starts (S, states).
        place: of the pose sensor: ahead, to the left [m], turned [rad], (3,).
        further: states after the pose, where they are not read, (S, states - 3).
    """
    starts = np.pad(further, ((0, 0), (3, 0)))
    for column, name in enumerate(layout.quantities):
        starts[:, robot.states.index(name)] = layout.readings[:, 0, column]
    if "heading" in layout.quantities:
        starts[:, 2] -= place[2]
    elif {"x", "y"} <= set(layout.quantities):
        places = [layout.quantities.index("x"), layout.quantities.index("y")]
        starts[:, 2] = _turns(paths(starts)[..., places], layout.readings[..., places], layout.valid)
    # The robot's origin stands off the sensor by the lever arm.
    arm = (place[0] + 1j * place[1]) * np.exp(1j * starts[:, 2])
    starts[:, :2] -= np.column_stack([arm.real, arm.imag])
    return starts


def further_starts(
    robot: Model,
    layout: SegmentLayout,
    offsets: Array,
    parameters: Array,
    inputs: Array | None = None,
) -> Array:
    """States after the pose (S, states - 3) at which segments begin, by the inputs before them.

    A log's robot rests before its inputs begin. They are 0 of a robot that moves by its inputs alone: nothing
    depends on them.

    Args:
        robot: whose states they are.
        layout: the segments.
        offsets: of the clocks, (clocks,) [s].
        parameters: (p,), SI.
        inputs: instead of the logged ones, (S, n, inputs): they are taken to be held before as they begin.
    """
    starts = np.zeros((layout.count, len(robot.states)))
    if not follows_state(robot):
        return starts[:, 3:]
    if inputs is None:
        held, times = layout.before(offsets)
    else:
        held, times = inputs[:, :1], np.full((layout.count, 1), SETTLED)
    driven = SegmentReadings.logged(robot, robot.states[3:], *times.shape)
    return driven(starts, held, times, parameters, np.zeros(len(PLACE)))[:, -1]


def _turns(predicted: Array, measured: Array, valid: npt.NDArray[np.bool_]) -> Array:
    # The rotation of least squares about the mean [Horn, Closed-form solution of absolute orientation, 1987].
    weight = valid[..., None] / valid.sum(axis=1)[:, None, None]
    paths = []
    for path in (predicted, measured):
        centred = (path - (path * weight).sum(axis=1, keepdims=True)) * (weight > 0)
        paths.append(centred[..., 0] + 1j * centred[..., 1])
    return np.asarray(np.angle((paths[1] * paths[0].conj()).sum(axis=1)))
