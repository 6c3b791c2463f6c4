"""Dead reckoning of logs: how far wrong the robot is when it relies on its wheels alone.

By nominal parameters, by an estimate, or by what the other logs say of a log (cross-validation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from oed.estimation.methods.fit import Fit
from oed.estimation.prediction.layout import SegmentLayout, cut
from oed.estimation.prediction.logged_readings import LoggedReadings
from oed.estimation.setup.unknowns import PLACE, Unknowns, inverse_of_sum
from oed.foundation.arrays import Array, Places
from oed.logs.log import Log
from oed.robots.models.model import Model

PIECE = 1.0
"""Length of the pieces that drift is measured over [m]."""
OPENING = 0.1
"""Share of a path, of a piece's length at least, that shows where a robot faces at first if no heading is
read: the whole path would be turned to fit what it is compared with."""
FOLDS = 12
"""Parts that many logs are left out in."""


@dataclass(frozen=True)
class DeadReckoning:
    """Dead reckoning of one log against its reference; SI. What the log does not hold is None.

    Attributes:
        length: of the reference path [m].
        rmse_position: root mean square of the distance to the reference, started on its first pose, as evo's
            absolute pose error aligned at the origin [m].
        rmse_aligned: the same after the rigid motion that fits best, as evo's absolute pose error aligned
            [m].
        rmse_heading: root mean square of the heading's error, started alike [rad].
        end_position, end_heading: at the log's end [m, rad].
        drift_position, drift_heading: root mean square of the relative pose error over pieces of 1 m of
            path, one after the other [m per m, rad per m]; where no stretch is that long, its end's, per
            metre.
        times: of the poses [s].
        reference, path: x, y by the reference and by dead reckoning, (n, 2); NaN between stretches.
        turns: headings [rad] by the reference and by dead reckoning, (n, 2); NaN between stretches, and where
            the log has none.
    """

    length: float
    rmse_position: float | None
    rmse_aligned: float | None
    rmse_heading: float | None
    end_position: float | None
    end_heading: float | None
    drift_position: float | None
    drift_heading: float | None
    times: Array
    reference: Array
    path: Array
    turns: Array


@dataclass(frozen=True)
class _Stretch:
    # Measured and dead reckoned x + j y, headings, of one stretch without gaps.
    times: Array
    truth: npt.NDArray[np.complex128]
    guess: npt.NDArray[np.complex128]
    heading: Array
    turned: Array

    @property
    def length(self) -> float:
        return float(np.abs(np.diff(self.truth)).sum())

    def turns(self, known: bool) -> Array:
        measured = self.heading if known else np.full_like(self.heading, np.nan)
        return np.column_stack([measured, self.turned])


def dead_reckoned(robot: Model, log: Log, parameters: Array, place: Array, offset: float) -> DeadReckoning:
    """Dead reckoning of a log, started on its first pose; where no headings are read, in the direction that
    fits the opening of the path best.

    Args:
        robot: that drove.
        log: with positions.
        parameters: (p,), SI.
        place: of the pose sensor on the robot, (3,).
        offset: of the log's clocks [s].
    """
    stretches = _stretches(robot, log, parameters, place, offset)
    with_heading = "heading" in log.quantities
    off = [np.abs(one.guess - one.truth) for one in stretches]
    turned = [one.turned - one.heading for one in stretches]
    # A stretch of a few centimetres shows noise, not drift.
    pieces = [_pieces(one) for one in stretches if one.length >= PIECE] or [_pieces(one) for one in stretches]
    gap = np.full((1, 2), np.nan)
    return DeadReckoning(
        length=sum(one.length for one in stretches),
        rmse_position=_rms(off),
        rmse_aligned=_rms([np.abs(_aligned(one.guess, one.truth) - one.truth) for one in stretches]),
        rmse_heading=_rms(turned) if with_heading else None,
        end_position=float(off[-1][-1]) if off else None,
        end_heading=float(abs(turned[-1][-1])) if turned and with_heading else None,
        drift_position=_rms([position for position, _ in pieces]),
        drift_heading=_rms([heading for _, heading in pieces]) if with_heading else None,
        times=np.concatenate([np.append(one.times, np.nan) for one in stretches] or [np.zeros(0)]),
        reference=np.vstack([row for one in stretches for row in (_xy(one.truth), gap)] or [gap]),
        path=np.vstack([row for one in stretches for row in (_xy(one.guess), gap)] or [gap]),
        turns=np.vstack([row for one in stretches for row in (one.turns(with_heading), gap)] or [gap]),
    )


def _stretches(robot: Model, log: Log, parameters: Array, place: Array, offset: float) -> list[_Stretch]:
    layout, names = cut([log], np.inf, [offset]), tuple(parameter.name for parameter in robot.parameters)
    readings = LoggedReadings.of(layout, Unknowns(robot, names, PLACE, 0), np.array([offset]))
    values = np.concatenate([parameters, place])
    begun = replace(readings, layout=_opening(layout)) if "heading" not in layout.quantities else readings
    found = readings.reading("x", "y", "heading")(values, begun.first_starts(values))
    read = {name: layout.readings[..., index] for index, name in enumerate(log.quantities)}
    heading = read.get("heading", found[..., 2])
    compared = [place for place, name in enumerate(log.quantities) if name in ("x", "y", "heading")]
    return [
        _Stretch(
            layout.times[row][valid],
            (read["x"] + 1j * read["y"])[row][valid],
            (found[row, :, 0] + 1j * found[row, :, 1])[valid],
            heading[row][valid],
            found[row, :, 2][valid],
        )
        for row, valid in enumerate(layout.read_together(compared))
    ]


def _opening(layout: SegmentLayout) -> SegmentLayout:
    # Without what is read after the opening of each stretch.
    places = [layout.quantities.index(name) for name in ("x", "y")]
    valid = layout.valid.copy()
    for row, read in enumerate(layout.read_together(places)):
        path = layout.readings[row][read][:, places]
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        valid[row, np.flatnonzero(read)[along > max(PIECE, OPENING * along[-1])]] = False
    return replace(layout, valid=valid)


def _aligned(
    guess: npt.NDArray[np.complex128], truth: npt.NDArray[np.complex128]
) -> npt.NDArray[np.complex128]:
    # The rigid motion of least squares, without scale [Umeyama, Least-squares estimation, 1991].
    centred, wanted = guess - guess.mean(), truth - truth.mean()
    turn = np.exp(1j * np.angle((wanted * centred.conj()).sum()))
    return np.asarray(turn * centred + truth.mean())


def _pieces(one: _Stretch) -> tuple[Array, Array]:
    # Relative pose errors per metre over successive pieces of the reference path.
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(one.truth)))])
    if along[-1] == 0:
        return np.zeros(0), np.zeros(0)
    marks = [0]
    while (after := int(np.searchsorted(along, along[marks[-1]] + PIECE))) < len(along):
        marks.append(after)
    if len(marks) == 1:
        marks.append(len(along) - 1)
    edges = np.array(marks)
    truth, guess = (
        np.diff(path[edges]) * np.exp(-1j * heading[edges[:-1]])
        for path, heading in ((one.truth, one.heading), (one.guess, one.turned))
    )
    turned = np.diff(one.turned[edges]) - np.diff(one.heading[edges])
    lengths = np.diff(along[edges])
    return np.abs(guess - truth) / lengths, turned / lengths


def _rms(parts: list[Array]) -> float | None:
    values = np.concatenate(parts) if parts else np.zeros(0)
    return float(np.sqrt(np.mean(values**2))) if len(values) else None


def _xy(path: npt.NDArray[np.complex128]) -> Array:
    return np.column_stack([path.real, path.imag])


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


def _fold(fit: Fit, fold: Places) -> HeldOut:
    # The clocks are the logs' own business: theirs are as the whole fit has them.
    logs = [fit.layout.logs[index] for index in fold]
    return held_out(fit, values_without(fit, fold), logs, fit.clocks_of(logs))


def values_without(fit: Fit, fold: Places) -> Array:
    """The unknowns (q,) without the logs in `fold`, by one Gauss-Newton step from the whole solution."""
    kept = ~np.isin(fit.layout.owner, fold)
    inverse = inverse_of_sum(fit.curvature[kept].sum(axis=0), fit.knowledge)
    # At the solution what was known before pulls as hard as all scores together.
    pull = fit.scores[kept].sum(axis=0) - fit.scores.sum(axis=0)
    return np.asarray(fit.values + inverse @ pull)


def held_out(fit: Fit, values: Array, logs: Sequence[Log], clocks: Sequence[float]) -> HeldOut:
    """Dead reckoning of logs with the nominal parameters of a fit's robot, and with others.

    Args:
        fit: says what the unknowns are.
        values: of the unknowns, (q,).
        logs: with positions.
        clocks: offset of each log's clocks [s].
    """
    robot, (parameters, place, _) = fit.unknowns.robot, fit.unknowns.parts(values)
    nominal = np.array(robot.nominal, dtype=float)
    before, after = (
        tuple(dead_reckoned(robot, log, own, place, clock) for log, clock in zip(logs, clocks, strict=True))
        for own in (nominal, parameters)
    )
    return HeldOut(tuple(log.name for log in logs), parameters, before, after)
