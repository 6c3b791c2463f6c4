"""The figures of what is over time: inputs between their limits, and searches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oed.foundation.text import unit_text
from oed.report.figures import spec
from oed.report.figures.spec import FAINT, INK, Ends, Look, line_look, mark, stroke
from oed.report.parts.inputs import Group, Series

BEYOND = 0.3
"""How far beyond its limits a panel shows an input that breaks them, as a share of their width."""
LABELS = 0.28
"""Room for the labels of limits that all inputs satisfy."""
LONG = 22
"""Letters of a legend's entry beyond which there are fewer of them on a line."""
LONG_LINES = {"handlelength": 3.2}

Search = tuple[str, Sequence[tuple[float, float]]]
"""Name of a search, and its shortfalls [%] over its seconds."""


def series(drives: Sequence[Series], group: Group, labels: Sequence[str], bounds: Ends | None) -> spec.Plot:
    """One panel per drive: its inputs or their rates over time, between their bounds.

    Args:
        drives: that are drawn.
        group: of inputs.
        labels: of the inputs.
        bounds: of their values.
    """
    columns = 1 if len(drives) == 1 else 2
    several = any(one.breaks for one in drives)
    ends = _ends(drives, bounds)
    name = group.title + ("\n" if group.unit else "")
    panels = [
        spec.Panel(
            _inputs(one, group.unit, bounds),
            spec.Axis(
                "time [s], runs one after the other" if several else "time [s]", ends=(0.0, one.times[-1])
            ),
            spec.Axis(name, group.unit, ends),
            one.title,
        )
        for one in drives
    ]
    keys = [spec.Key(label, line_look(index)) for index, label in enumerate(labels)]
    height = (2.5 if columns == 1 else 2.1) * -(-len(drives) // columns)
    return spec.Plot(
        panels, columns, height=height, share="y", legend=spec.Legend(keys, most=4, options=LONG_LINES)
    )


def _inputs(drive: Series, unit: str, bounds: Ends | None) -> list[spec.Part]:
    steps = {"drawstyle": "steps-post"} if drive.steps else {}
    lines = [
        spec.Line(drive.times, column, {**line_look(index), **steps, "zorder": 3})
        for index, column in enumerate(drive.values.T)
    ]
    limits = [
        spec.Limit(bound, stroke(INK, 0.9, 2), f"limit {bound:g} {unit_text(unit)}", below=index == 0)
        for index, bound in enumerate(bounds or ())
    ]
    return [
        *lines,
        *(spec.Limit(end, stroke(FAINT, 0.8, 1.5), upright=True) for end in drive.breaks),
        *limits,
    ]


def _ends(drives: Sequence[Series], bounds: Ends | None) -> Ends:
    # Room beyond the bounds for their labels, and a little for what exceeds them.
    low = min(float(np.nanmin(one.values)) for one in drives)
    high = max(float(np.nanmax(one.values)) for one in drives)
    if bounds is None:
        room = 0.06 * (high - low or 1.0)
        return low - room, high + room
    within = bounds[0] <= low + 1e-9 and high <= bounds[1] + 1e-9
    room = (LABELS if within else BEYOND) * (bounds[1] - bounds[0])
    return bounds[0] - room, bounds[1] + room


def convergence(searches: Sequence[Search], apart: bool) -> spec.Plot:
    """All searches on one pair of axes: shortfall from the best [%] against seconds.

    Args:
        searches: at least one.
        apart: whether the best is that by each search's own criterion.
    """
    parts = [part for index, (_, points) in enumerate(searches) for part in _search(points, line_look(index))]
    values = [value for _, points in searches for _, value in points]
    below = "below the best by\nits own criterion" if apart else "below the best"
    x = spec.Axis("time", "s", logarithmic=True, most=1)
    y = spec.Axis(below, "%", (min(values) / 2, 2 * max(*values, 1.0)), logarithmic=True)
    keys = [spec.Key(name, line_look(index)) for index, (name, _) in enumerate(searches)]
    longest = max(len(name) for name, _ in searches)
    most = 4 if longest <= LONG else 2 if longest <= 2 * LONG else 1
    return spec.Plot(
        [spec.Panel(parts, x, y)], height=3.2, legend=spec.Legend(keys, most, options=LONG_LINES)
    )


def _search(points: Sequence[tuple[float, float]], look: Look) -> list[spec.Part]:
    seconds, shortfalls = (list(one) for one in zip(*points, strict=True))
    dot = mark("o", 5, look["color"], 1.0, 4, look["color"])
    line = spec.Line(seconds, shortfalls, {**look, "drawstyle": "steps-post", "zorder": 3})
    return [line, spec.Line(seconds[:: len(points) - 1 or 1], shortfalls[:: len(points) - 1 or 1], dot)]
