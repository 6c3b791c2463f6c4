"""From what robots log of their wheels - ticks, angles, speeds - to the time integral of each input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.errors import FileIssue
from oed.logs.log import Finding
from oed.logs.series import Series

Held = Literal["next", "previous", "between"]

UNCLEAR = 0.45
"""Share of a counter's range: after a longer step nobody knows which way the wheel turned."""

USUAL_WRAPS = (360.0, 2 * np.pi, *(float(2**bits) for bits in (8, 10, 12, 13, 14, 15, 16, 24, 32)))
"""Ranges after which counters begin anew: degrees, radians, and registers of so many bits."""


@dataclass(frozen=True)
class Turned:
    """The time integral of one input since the first row.

    Attributes:
        integral: (n,), in the unit of the input times s.
        bridges: whether it is right across missing rows, as that of a counter that adds up is.
        wraps: how often the counter began anew.
        issues: in the readings.
        found: of them.
    """

    integral: Array
    bridges: bool = False
    wraps: int = 0
    issues: tuple[FileIssue, ...] = ()
    found: tuple[Finding, ...] = ()


def held_integral(times: Array, values: Array, held: Held) -> Array:
    """Integral (n,) of logged values since the first time.

    Args:
        times: (n,) [s].
        values: (n,); the last is not used where values hold to the next row, the first where they are
            means since the row before.
        held: "next", "previous" or "between" (straight lines between rows).
    """
    each = {
        "next": values[:-1],
        "previous": values[1:],
        "between": (values[:-1] + values[1:]) / 2,
    }[held]
    return np.concatenate([[0.0], np.cumsum(each * np.diff(times))])


def summed(values: Array) -> Array:
    """Running sum (n,) of counts since the row before; those of the first row belong to no step."""
    return np.concatenate([[0.0], np.cumsum(values[1:])])


def counted(series: Series, place: int, key: str, wrap: float | None) -> Turned:
    """What a counter has counted since the first row, unwrapped over its range.

    Args:
        series: with the counter's readings.
        place: of their column in its values.
        key: name for issues.
        wrap: range after which the counter begins anew; None for one that does not.
    """
    values = series.values[:, place]
    steps = np.diff(values)
    if wrap is None:
        return Turned(values - values[0], True, 0, tuple(_jumps(series, place, key)))
    issues = _out_of_range(series, place, key, wrap)
    around = np.round(steps / wrap)
    steps = steps - wrap * around
    unclear = np.flatnonzero(np.abs(steps) > UNCLEAR * wrap)
    issues += [_unclear(series, place, key, int(row), wrap) for row in unclear]
    integral = np.concatenate([[0.0], np.cumsum(steps)])
    return Turned(integral, True, int(np.count_nonzero(around)), tuple(issues))


def _out_of_range(series: Series, place: int, key: str, wrap: float) -> list[FileIssue]:
    # Named is the first reading that is outside of where counters count, from 0 or to both sides of it.
    values = series.values[:, place]
    span = float(np.ptp(values))
    if span <= wrap * (1 + 1e-9):
        return []
    outside = [(values < low) | (values > low + wrap) for low in (0.0, -wrap / 2)]
    row = int(np.argmax(min(outside, key=np.count_nonzero)))
    text = (
        f"the counter reads {values[row]:.10g}, and its readings span {span:.10g}, more than "
        f"`wrap: {wrap:.10g}` allows"
    )
    return [series.issue(row, key, text)]


def _unclear(series: Series, place: int, key: str, row: int, wrap: float) -> FileIssue:
    before, after = series.values[row : row + 2, place]
    text = (
        f"the counter jumps by about half of its range {wrap:.10g}, from {before:.10g} to {after:.10g}, "
        "so that its direction is not known; cut the log here or log more often"
    )
    return series.issue(row + 1, key, text)


def _jumps(series: Series, place: int, key: str) -> list[FileIssue]:
    # A jump across most of all readings, far longer than usual steps, is a counter that began anew.
    values = series.values[:, place]
    sizes = np.abs(np.diff(values))
    moving = sizes[sizes > 0]
    if len(moving) < 5:
        return []
    rows = np.flatnonzero((sizes > np.ptp(values) / 2) & (sizes > 10 * np.median(moving)))
    return [_jump(series, place, key, int(row), float(np.median(moving))) for row in rows]


def _jump(series: Series, place: int, key: str, row: int, usual: float) -> FileIssue:
    before, after = series.values[row : row + 2, place]
    near = [wrap for wrap in USUAL_WRAPS if abs(abs(after - before) - wrap) < max(0.1 * wrap, 3 * usual)]
    advice = f"say `wrap: {near[0]:.6g}`" if near else "say after how much with `wrap:`"
    text = (
        f"the counter jumps from {before:.10g} to {after:.10g}, where steps of {usual:.3g} are usual; "
        f"if it begins anew, {advice}, and if it was reset, cut the log here"
    )
    return series.issue(row + 1, key, text)


def on_one_clock(parts: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Integrals that were logged on several clocks, on all their times within the span of all.

    Args:
        parts: times (n_i,) and integral (n_i,) of each input.

    Returns:
        Times (n,) and integrals (n, inputs), 0 at the first.
    """
    first, last = max(times[0] for times, _ in parts), min(times[-1] for times, _ in parts)
    together = np.unique(np.concatenate([times for times, _ in parts]))
    together = together[(together >= first) & (together <= last)]
    columns = [np.interp(together, times, integral) for times, integral in parts]
    stacked = np.column_stack(columns)
    return together, stacked - stacked[:1]
