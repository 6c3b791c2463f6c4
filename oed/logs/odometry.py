"""Odometry that exists only as poses: the speed and the yaw rate that led from each pose to the next."""

from __future__ import annotations

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.errors import Issue
from oed.kernel.dynamics.system import System, label_of
from oed.logs.findings import odometry_jump
from oed.logs.integrals import Turned
from oed.logs.log import Finding
from oed.logs.series import Series

QUANTITIES = {"commanded_speed": 0, "commanded_yaw_rate": 1}
"""What poses say of a robot's inputs: the way along their arcs, and the angle turned."""
UNITS = {"x": "m", "y": "m", "heading": "rad"}
"""SI units of such poses."""
SIDEWAYS = 0.05
"""Share of the way across the arcs beyond which odometry is none of a robot that rolls ahead."""


def odometry_issues(model: System) -> list[Issue]:
    """That a robot's inputs are no speed and yaw rate, as poses of odometry are."""
    if {entry.quantity for entry in model.inputs} <= set(QUANTITIES):
        return []
    text = (
        "poses of odometry stand for a speed and a yaw rate, and the inputs of "
        f"{label_of(model)} are {', '.join(model.input_names)}; take `robot: {{kind: unicycle}}`"
    )
    return [Issue(("log", "inputs", "form"), text)]


def rolled(poses: Series, model: System) -> tuple[list[Turned], tuple[Finding, ...]]:
    """Way [m] and angle [rad] since the first pose, by the robot's inputs, and what is to be said of them.

    Args:
        poses: x, y [m], heading [rad], which may jump by full turns, (n, 3).
        model: the robot.
    """
    along, across, turns = _arcs(poses.values)
    sums = [np.concatenate([[0.0], np.cumsum(steps)]) for steps in (along, turns)]
    found = [odometry_jump(poses, poses.values[:, :2]), _sideways(along, across)]
    turned = [Turned(sums[QUANTITIES[entry.quantity]], True) for entry in model.inputs]
    return turned, tuple(one for one in found if one is not None)


def _arcs(poses: Array) -> tuple[Array, Array, Array]:
    # Length of the arc ahead that each step is, what of it is across, and its turn: between two poses on an
    # arc the chord points half the turn beside the first heading, and is sin(a / 2) / (a / 2) times as long.
    turns = np.angle(np.exp(1j * np.diff(poses[:, 2])))
    steps = np.diff(poses[:, 0] + 1j * poses[:, 1]) * np.exp(-1j * (poses[:-1, 2] + turns / 2))
    arcs = steps / np.sinc(turns / (2 * np.pi))
    return arcs.real, arcs.imag, turns


def _sideways(along: Array, across: Array) -> Finding | None:
    share = float(np.abs(across).sum() / max(np.abs(along).sum(), np.finfo(float).tiny))
    if share <= SIDEWAYS:
        return None
    text = (
        f"the odometry's poses move sideways by {100 * min(share, 1):.0f} % of their way: is it odometry of "
        "wheels, and its heading in the right unit, and to the left?"
    )
    return Finding("odometry_sideways", text, doubtful=True)
