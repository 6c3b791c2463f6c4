"""The figures of dead reckoning: paths beside the reference, and their errors over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oed.foundation.text import unit_for
from oed.records.stored.reckoned import ReckonedPath
from oed.report.figures import spec
from oed.report.figures.spec import INK, SECOND, Look, mark, stroke

BEFORE, AFTER = stroke(SECOND, 1.5, 3, (4, 1.8)), stroke("#74aede", 2.8, 2)
"""Dead reckoning with nominal and with estimated parameters."""
LOOKS: tuple[Look, ...] = (stroke(INK, 0.8, 4), BEFORE, AFTER)
"""The reference, in front of dead reckoning before and after: it is not hidden where they agree."""
NAMES = ("reference", "odometry, nominal", "odometry, estimated")
KEYS = [spec.Key(name, look) for name, look in zip(NAMES, LOOKS, strict=True)]
START = mark("o", 5, "white", 1.0, 5)
LETTERS = 26
"""Of a panel's title."""
TITLES = (10.0, 9.5, 8.5)
"""Sizes of titles by the number of columns."""
BESIDE = 6.6
"""Width of the paths, which stand beside the estimates [inch]."""
MOST_LOGS = 3
"""Logs whose errors are drawn side by side."""


def paths(drawn: Sequence[ReckonedPath]) -> spec.Plot:
    """One panel per log: its measured path, and dead reckoning before and after."""
    columns = 1 if len(drawn) == 1 else 2 if len(drawn) in (2, 4) else 3
    panel = BESIDE / columns
    shape = float(np.clip(np.median([_shape(one) for one in drawn]), 0.4, 0.75 if columns == 1 else 1.2))
    rows = -(-len(drawn) // columns)
    keys = [*KEYS, spec.Key("start", START)]
    return spec.Plot(
        [_panel(one, TITLES[columns - 1]) for one in drawn],
        columns,
        BESIDE,
        height=rows * (max(panel * shape, 1.3) + 0.45) + 0.5,
        labels="outer ticks",
        legend=_legend(keys),
    )


def _legend(keys: Sequence[spec.Key]) -> spec.Legend:
    return spec.Legend(keys, 4, handle=0.3, options={"handlelength": 3.0})


def _panel(one: ReckonedPath, size: float) -> spec.Panel:
    measured = one.paths[0]
    begin = measured[np.isfinite(measured).all(axis=1)][:1]
    lines = [spec.Line.through(path, look) for path, look in zip(one.paths, LOOKS, strict=True)]
    x, y = (spec.Axis(name, "m", most=5) for name in "xy")
    title = _shortened(one.log)
    return spec.Panel([*lines, spec.Line.through(begin, START)], x, y, title, "ends", size, margin=0.06)


def _shortened(name: str) -> str:
    # With its middle left out where it is too long.
    half = (LETTERS - 1) // 2
    return name if len(name) <= LETTERS else f"{name[:half]}…{name[-half:]}"


def _shape(one: ReckonedPath) -> float:
    # Height over width.
    every = np.concatenate(one.paths)
    width, height = np.maximum(np.nanmax(every, axis=0) - np.nanmin(every, axis=0), 1e-3)
    return float(height / width)


def errors(drawn: Sequence[ReckonedPath]) -> spec.Plot:
    """Position and heading errors over the time since each log's start, before and after: a column for each
    log with times.
    """
    timed = [one for one in drawn if one.t][:MOST_LOGS]
    rows = [[one.position_errors for one in timed]]
    turned = [found for one in timed if (found := one.heading_errors) is not None]
    if len(turned) == len(timed):
        rows.append(turned)
    panels = []
    for kind, row in zip((("position error", "m"), ("heading error", "rad")), rows, strict=False):
        unit, factor = unit_for([float(np.nanmax(np.abs(pair))) for pair in row], kind[1])
        for place, (one, pair) in enumerate(zip(timed, row, strict=True)):
            last, first = row is rows[-1], row is rows[0]
            times = np.array(one.t, dtype=float)
            times -= np.nanmin(times)
            lines = [
                spec.Line(times, factor * values, look)
                for values, look in zip(pair, (BEFORE, AFTER), strict=True)
            ]
            x = spec.Axis("time" if last else "", "s" if last else "", most=6)
            most = 1.05 * factor * float(np.nanmax(pair))
            ends = (0.0, most) if kind[1] == "m" and most > 0 else None
            y = spec.Axis("" if place else kind[0], "" if place else unit, ends, most=5)
            panels.append(spec.Panel(lines, x, y, _shortened(one.log) if first else ""))
    return spec.Plot(
        panels, len(timed), height=1.75 * len(rows) + 0.6, labels="each", legend=_legend(KEYS[1:])
    )
