"""Cross-validation: what the other logs say of a log, and how well dead reckoning by them predicts it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oed.estimation.assessment.dead_reckoning import DeadReckoning, dead_reckoned
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.knowledge import inverse_of_sum
from oed.logs.log import Log
from oed.robots.models.model import Model

Array = npt.NDArray[np.float64]

FOLDS = 12
"""Parts that many logs are left out in."""


@dataclass(frozen=True)
class HeldOut:
    """Dead reckoning of logs that the estimate does not know.

    Attributes:
        names: of the logs.
        values: parameters estimated without them, (p,), SI: all of the robot's.
        before, after: with nominal parameters, and with these, log by log.
    """

    names: tuple[str, ...]
    values: Array
    before: tuple[DeadReckoning, ...]
    after: tuple[DeadReckoning, ...]


def cross_validated(fit: Fit) -> tuple[HeldOut, ...]:
    """Each log (or part of many logs) against the estimate from all others; () for a single log."""
    count = len(fit.layout.logs)
    if count < 2:
        return ()
    folds = np.array_split(np.arange(count), min(count, FOLDS))
    return tuple(_fold(fit, fold) for fold in folds)


def _fold(fit: Fit, fold: npt.NDArray[np.int64]) -> HeldOut:
    values = values_without(fit, fold)
    parameters, place, _ = fit.unknowns.parts(values)
    logs = [fit.layout.logs[index] for index in fold]
    # The clocks are the logs' own business: theirs are as the whole fit has them.
    clocks = [float(fit.clock_offsets[fit.layout.clocks.index(log.file)]) for log in logs]
    return held_out(fit.unknowns.robot, logs, parameters, place, clocks)


def values_without(fit: Fit, fold: npt.NDArray[np.int64]) -> Array:
    """The unknowns (q,) without the logs in `fold`, by one Gauss-Newton step from the whole solution."""
    kept = ~np.isin(fit.layout.owner, fold)
    inverse = inverse_of_sum(fit.curvature[kept].sum(axis=0), fit.knowledge)
    # At the solution what was known before pulls as hard as all scores together.
    pull = fit.scores[kept].sum(axis=0) - fit.scores.sum(axis=0)
    return np.asarray(fit.values + inverse @ pull)


def held_out(
    robot: Model,
    logs: Sequence[Log],
    parameters: Array,
    place: Array,
    clocks: Sequence[float],
) -> HeldOut:
    """Dead reckoning of logs with a robot's nominal parameters, and with others (p,).

    Args:
        robot: that drove.
        logs: with positions.
        parameters: (p,), SI.
        place: of the pose sensor, (3,).
        clocks: offset of each log's clocks [s].
    """
    nominal = np.array(robot.nominal, dtype=float)
    before, after = (
        tuple(
            dead_reckoned(robot, log, values, place, clock) for log, clock in zip(logs, clocks, strict=True)
        )
        for values in (nominal, parameters)
    )
    return HeldOut(tuple(log.name for log in logs), parameters, before, after)
