"""Motions that a sensor read of itself, as scan matching gives them, and the path that they are together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import FileIssue
from oed.logs.series import Rows, Series, time_text

QUANTITIES = ("x", "y", "heading")
"""What is read of a motion."""
PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Entries of a covariance that columns hold, in their order."""
SINGULAR = 1e-9
"""Least eigenvalue of correlations that is more than rounding of a file's numbers."""
SUREST, SURER = 1e-9, 1e3
"""Least deviation of a motion that is measured [m, rad], and by how many times one may be surer than is usual
in a log: beyond, it counts for a million others."""
APART = 0.05
"""Share of a motion's duration that the next may begin later or earlier and follow it all the same."""


class Path(NamedTuple):
    """The path that motions make up.

    Attributes:
        times: (n,) [s].
        poses: of the sensor, from x = y = heading = 0, (n, 3).
        begins: of the times those at which it begins anew, for no motion leads there, (k,) [s].
        motions: the index of the motion that each pose belongs to, (n,).
    """

    times: Array
    poses: Array
    begins: Array
    motions: Rows


@dataclass(frozen=True)
class Motions:
    """How a sensor moved, read between pairs of times.

    Attributes:
        times: of beginning and end, (m, 2) [s], by their ends.
        values: x, y [m] and heading [rad] of the sensor at the end, seen from where it began, (m, 3).
        covariances: of their errors, (m, 3, 3); None where nobody gives them.
        begins: the times at which the path that they are together begins anew (k,) [s].
    """

    times: Array
    values: Array
    covariances: Array | None = None
    begins: Array | None = None

    def __len__(self) -> int:
        """How many there are."""
        return len(self.times)

    def rows(self, chosen: Bools) -> Motions:
        """Some of them."""
        covariances = None if self.covariances is None else self.covariances[chosen]
        return replace(self, times=self.times[chosen], values=self.values[chosen], covariances=covariances)

    @property
    def lengths(self) -> Array:
        """Their durations, (m,) [s]."""
        return np.asarray(self.times[:, 1] - self.times[:, 0])

    @cached_property
    def following(self) -> Rows:
        """Indices of those that make up one path, each at or after the end of the one before, (n,)."""
        chosen, end = list[int](), -np.inf
        for index, (first, last) in enumerate(self.times.tolist()):
            if first >= end - APART * (last - first):
                chosen.append(index)
                end = last
        return np.array(chosen, dtype=np.intp)

    def path(self) -> Path:
        """Those that follow each other, one after the other."""
        own = self.following
        times, values, late = self.times[own], self.values[own], APART * self.lengths[own]
        anew = np.concatenate([[True], times[1:, 0] > times[:-1, 1] + late[1:]])
        headings = np.concatenate([[0.0], np.cumsum(values[:, 2])])
        moves = (values[:, 0] + 1j * values[:, 1]) * np.exp(1j * headings[:-1])
        places = np.concatenate([[0.0], np.cumsum(moves)])
        poses = np.column_stack([places.real, places.imag, headings])
        # Where it begins anew there are two times at one pose.
        rows = np.repeat(np.arange(len(own)), 1 + anew)
        first = anew[rows] & np.concatenate([[True], np.diff(rows) > 0])
        moments = np.where(first, times[rows, 0], times[rows, 1])
        return Path(moments, poses[rows + ~first], moments[first], own[rows])


def inverted(values: Array) -> Array:
    """Motions (m, 3) the other way: the pose at the beginning, seen from the end."""
    moved = -(values[:, 0] + 1j * values[:, 1]) * np.exp(-1j * values[:, 2])
    return np.column_stack([moved.real, moved.imag, -values[:, 2]])


def motions_of(series: Series, *, follows: bool) -> tuple[Motions | None, list[FileIssue]]:
    """The motions in the rows of a log, by their ends, and what is wrong with them; None where any is.

    Args:
        series: at the motions' ends: when they began, x, y, heading, entries of the covariance; SI.
        follows: whether each began at the row before, so that the first is none.
    """
    issues = _order_issues(series, follows) + _covariance_issues(series)
    rows = series.values[:, 0] < series.times
    if issues or not rows.any():
        return None, issues
    kept = series.rows(rows)
    order = np.argsort(kept.times, kind="stable")
    times = np.column_stack([kept.values[:, 0], kept.times])[order]
    values = kept.values[order]
    if np.abs(values[:, 3]).max() <= 2 * np.pi:
        values[:, 3] = np.angle(np.exp(1j * values[:, 3]))
    covariances = _matrices(values[:, 4:]) if values.shape[1] > 4 else None
    return Motions(times, values[:, 1:4], covariances), []


def _order_issues(series: Series, follows: bool) -> list[FileIssue]:
    if follows:
        return []
    wrong = np.flatnonzero(~(series.values[:, 0] < series.times)).tolist()
    swapped = "; are t0 and t1 exchanged?" if len(wrong) == len(series) else ""
    return [
        series.issue(
            row,
            "t0",
            f"the motion begins at {time_text(series.values[row, 0])} s, not before its end at "
            f"{time_text(series.times[row])} s{swapped}",
        )
        for row in wrong
    ]


def _covariance_issues(series: Series) -> list[FileIssue]:
    if series.values.shape[1] <= 4:
        return []
    matrices = _matrices(series.values[:, 4:])
    variances = np.diagonal(matrices, axis1=1, axis2=2)
    least = np.linalg.eigvalsh(_correlations(matrices))[:, 0]
    wrong = [
        "the covariance is not positive definite" if not least > 0 else _too_sure(least, deviation)
        for least, deviation in zip(least.tolist(), np.sqrt(variances.clip(min=0)).min(axis=1), strict=True)
    ]
    if not any(wrong):
        wrong = _surer_than_usual(matrices / np.sqrt(_outer(np.median(variances, axis=0))))
    return [series.issue(row, "covariance", text) for row, text in enumerate(wrong) if text]


def _too_sure(least: float, deviation: float) -> str:
    # What is wrong with a covariance by the least eigenvalue of its correlations and the least deviation.
    if least < SINGULAR:
        return (
            f"the covariance is singular but for rounding (least eigenvalue {least:.2g} of its correlations, "
            f"at least {SINGULAR:g} is expected)"
        )
    if deviation < SUREST:
        return (
            f"the covariance says that the motion is known to {deviation:.2g} (m or rad); nothing is "
            f"measured to better than {SUREST:g}: what units are its entries in?"
        )
    return ""


def _surer_than_usual(matrices: Array) -> list[str]:
    # Of covariances in units of their usual variances; "" of those that are like others.
    least = np.linalg.eigvalsh(matrices)[:, 0]
    times = np.sqrt(np.median(least) / least)
    text = (
        "the covariance says that the motion is known {:.2g} times as surely as is usual in this log: it "
        "would decide the estimate alone"
    )
    return [text.format(one) if one > SURER else "" for one in times.tolist()]


def _matrices(entries: Array) -> Array:
    # (m, 3, 3) of the entries of their upper halves (m, 6).
    found = np.zeros((len(entries), 3, 3))
    for place, (row, column) in enumerate(PAIRS):
        found[:, row, column] = found[:, column, row] = entries[:, place]
    return found


def _correlations(matrices: Array) -> Array:
    # Free of units; those of variances that are none stay as they are.
    variances = np.diagonal(matrices, axis1=1, axis2=2)
    sizes = np.sqrt(np.where(variances > 0, variances, 1.0))
    return np.asarray(matrices / _outer(sizes))


def _outer(sizes: Array) -> Array:
    # Products of each two of (..., n), (..., n, n).
    return np.asarray(sizes[..., :, None] * sizes[..., None, :])
