"""Steering checks: angles beyond what a robot steers, and a zero that is far off straight ahead."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import pi

import numpy as np

from oed.estimation.preprocessing.moves import FEWEST, Moves
from oed.estimation.preprocessing.wiring_checks import BAD, BETTER, worst
from oed.foundation.arrays import Array
from oed.foundation.text import size_text
from oed.kernel.limit import Limit
from oed.logs.log import Log
from oed.robots.models.model import Model

STEERED = "steered_beyond"
"""Name of what is found of steering angles beyond what the robot steers."""
ANGLE = "steering_angle"
"""The quantity of inputs that are steering angles."""
FARTHER, OFTEN = 1.25, 0.05
"""Times the robot's largest steering angle, and share of the drive's time, from which on it is too far."""
COARSE, FINE = np.radians(5.0), np.radians(1.0)
"""Steps of the search for a zero [rad]."""


def steered_beyond(log: Log, robot: Model, limits: Sequence[Limit]) -> Log:
    """The log, with a finding where it steers beyond what the robot can for much of the time.

    Args:
        log: of the robot.
        robot: whose model or limits say how far it steers.
        limits: of its drives.
    """
    steps = np.diff(log.input_times)
    for place in _steered(robot):
        entry = robot.inputs[place]
        bounds = [one.input_bounds(robot).get(entry.name, (0.0, np.inf)) for one in limits]
        most = min([entry.below, *(max(map(abs, pair)) for pair in bounds)])
        angles = np.abs(np.diff(log.integrals[:, place]) / steps)
        share = float(np.sum(steps[angles > FARTHER * most]) / np.sum(steps))
        if share > OFTEN:
            usual = size_text(float(np.median(angles)), "rad")
            text = (
                f"{entry.name} is beyond the robot's {size_text(most, 'rad')} for {100 * share:.0f} % of the "
                f"time (its median is {usual}): is its unit right, and its zero straight ahead (`zero`)?"
            )
            log = log.found(STEERED, text, doubtful=True)
    return log


def zero_fault(moves: Moves) -> tuple[str, str] | None:
    """The steering angle whose zero is off, and in words by how much, where that explains motion that the
    wheels do not explain as they were read; None where it does not.
    """
    if moves.layout.count < FEWEST:
        return None
    as_given = worst(moves, moves.inputs)
    for place in _steered(moves.robot):
        tried = [(worst(moves, _shifted(moves, place, off)), off) for off in _offsets(moves, place)]
        _, near = min(tried, default=(np.inf, 0.0))
        finer = near + np.arange(-COARSE, COARSE, FINE)
        left, off = min((worst(moves, _shifted(moves, place, one)), float(one)) for one in finer)
        if left < min(BETTER * as_given, BAD):
            before, after = (f"{100 * min(max(one, 0.0), 1.0):.0f} %" for one in (as_given, left))
            text = (
                f"its zero seems to be {size_text(-off, 'rad')} off straight ahead: that leaves "
                f"{after} of the motion unexplained instead of {before}; say what it shows "
                "straight ahead (`form: angle` or `form: ticks` with `zero`), or let the `robot` begin with "
                f"a steering_offset of {size_text(off, 'rad')}"
            )
            return moves.robot.input_names[place], text
    return None


def _steered(robot: Model) -> Iterator[int]:
    return (place for place, entry in enumerate(robot.inputs) if entry.quantity == ANGLE)


def _offsets(moves: Moves, place: int) -> Iterator[float]:
    # Those after which the robot mostly steers ahead: half a turn is as good as wheels that turn backwards.
    usual = float(np.median(moves.inputs[..., place]))
    return (
        float(off) for off in np.arange(-pi, pi, COARSE) if abs((usual + off + pi) % (2 * pi) - pi) < pi / 2
    )


def _shifted(moves: Moves, place: int, off: float) -> Array:
    inputs = moves.inputs.copy()
    inputs[..., place] += off
    return inputs
