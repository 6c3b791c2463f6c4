"""The figures of an estimate: residuals in panels, and driven paths beside their dead reckoning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oed.records.stored.estimate import ReckonedPath
from oed.report.figures import spec
from oed.report.figures.residuals import Residuals, ResidualSeries
from oed.report.figures.spec import FAINT, FIRST, INK, SECOND, WIDTH, Array, Look, mark, stroke

SHADES = (FIRST, "#8fa9c2")
"""Of logs one after the other."""
SIZE = {**mark("o", 3, INK, 1.0, 5), "color": INK, "linestyle": "-", "linewidth": 1.2}
EXPECTED = stroke("#b35c00", 1.2, 4, (4, 2))
NUMBER: Look = {"ha": "center", "va": "bottom", "fontsize": "small", "color": FAINT}
PATHS: dict[str, Look] = {
    "reference": stroke(INK, 1.0, 2),
    "dead reckoning, nominal": stroke(SECOND, 1.2, 3, (4, 1.8)),
    "dead reckoning, estimated": stroke("#2f7fc4", 1.7, 4, (1.2, 1.1)),
}
"""Measured, and before and after the estimate."""
START = mark("o", 5, "white", 1.0, 5)
SPREAD = 7.0
"""Typical sizes of residuals beyond which they are drawn as triangles."""
MOST_DOTS = 1000
"""Dots of a panel."""
GAP = 0.01
"""Between logs on the axis of time, as a share of all."""
LETTERS = 26
"""Of a panel's title."""
TITLES = (10.0, 9.5, 8.5)
"""Sizes of titles by the number of columns."""


def residuals(one: Residuals) -> spec.Plot:
    """Residuals over time, quantity by quantity, and below against speed, a normal and later residuals."""
    limit, count = _limit(one.everything.values), len(one.quantities)
    times = [
        _over_time(name, logs, one, limit, first=place == 0, last=place == count - 1)
        for place, (name, logs) in enumerate(one.quantities.items())
    ]
    below = [_over_speed(one, limit), _against_normal(one), *([_later(one)] if len(one.correlations) else [])]
    heights = [*[1.25] * count, 2.2]
    return spec.Plot(
        [*times, *below], 3, height=1.25 * count + 2.5, labels="each", wide=count, heights=heights
    )


def _limit(values: Array) -> float:
    typical = float(np.quantile(np.abs(values), 0.68))
    largest = float(np.abs(values).max())
    return 1.05 * (min(largest, SPREAD * typical) or 1.0)


def _within(x: Array, y: Array, limit: float, colour: str, most: int = MOST_DOTS) -> list[spec.Part]:
    # Triangles at the edges stand for what lies beyond.
    x, y = thinned(x, y, most)
    inside = np.abs(y) <= limit
    parts: list[spec.Part] = [spec.Dots(x[inside], y[inside], colour)]
    for sign, marker in ((1, "^"), (-1, "v")):
        beyond = x[sign * y > limit]
        parts.append(
            spec.Line(beyond, np.full(len(beyond), sign * 0.95 * limit), mark(marker, 3, INK, 1.0, 3))
        )
    return parts


def thinned(x: Array, y: Array, most: int = MOST_DOTS) -> tuple[Array, Array]:
    """So many of the points, at random but always the same: regular ones would meet the logs' own rhythm.

    Args:
        x: of the points.
        y: of the points.
        most: points that are kept.
    """
    if len(x) <= most:
        return x, y
    kept = np.sort(np.random.default_rng(0).choice(len(x), most, replace=False))
    return x[kept], y[kept]


def _begins(logs: Sequence[ResidualSeries]) -> list[float]:
    # Where on a common axis of time each log begins, its times counted from its own beginning.
    ends = np.array([log.end for log in logs])
    gap = GAP * ends.sum() / max(len(logs) - 1, 1)
    return [0.0, *map(float, np.cumsum(ends[:-1] + gap))]


def _over_time(
    name: str, logs: Sequence[ResidualSeries], one: Residuals, limit: float, *, first: bool, last: bool
) -> spec.Panel:
    placed = list(zip(_begins(logs), logs, strict=True))
    shades, parts = SHADES[: len(logs)], list[spec.Part]()
    for place, shade in enumerate(shades):
        every = placed[place :: len(SHADES)]
        times = np.concatenate([begin + log.times for begin, log in every])
        values = np.concatenate([log.values for _, log in every])
        parts += _within(times, values, limit, shade, MOST_DOTS // len(shades))
    if first and one.numbered and len(logs) > 1:
        middles = enumerate((begin + log.end / 2 for begin, log in placed), 1)
        parts += [spec.Note(str(number), (middle, limit), (0, 2), NUMBER) for number, middle in middles]
    begin, end = placed[-1]
    title = "time [s], one log after the other" if last else ""
    x, y = (
        spec.Axis(title, ends=(0.0, (begin + end.end) or 1.0)),
        spec.Axis(name, one.unit, (-limit, limit), most=4),
    )
    return spec.Panel(parts, x, y)


def _over_speed(one: Residuals, limit: float) -> spec.Panel:
    speeds, expected = one.noise_by_speed()
    parts = [
        *_within(np.abs(one.everything.speeds), one.everything.values, limit, SHADES[1]),
        *(spec.Line(speeds, sign * expected, EXPECTED) for sign in (-1, 1)),
        spec.Line(*one.by_speed(), SIZE),
    ]
    x = spec.Axis("speed", "m/s", (0.0, float(speeds[-1])), most=4)
    return spec.Panel(parts, x, spec.Axis("residual", one.unit, (-limit, limit)))


def _against_normal(one: Residuals) -> spec.Panel:
    normal, found = one.against_normal()
    reach = float(np.abs(normal).max())
    height = 1.05 * max(reach, float(np.abs(found).max()))
    diagonal = spec.Line([-reach, reach], [-reach, reach], {**EXPECTED, "zorder": 3})
    x = spec.Axis("normal quantile", ends=(-1.05 * reach, 1.05 * reach))
    y = spec.Axis("residual / noise", ends=(-height, height))
    return spec.Panel([diagonal, spec.Dots(normal, found, SHADES[0], 2.4)], x, y)


def _later(one: Residuals) -> spec.Panel:
    values, bounds = np.nan_to_num(one.correlations), [] if one.bound is None else [-one.bound, one.bound]
    parts: list[spec.Part] = [
        spec.Bars(np.arange(1, len(values) + 1), values, 0.65, {"color": SHADES[0], "zorder": 2}),
        spec.Limit(0.0, stroke(INK, 0.8, 3)),
        *(spec.Limit(bound, EXPECTED) for bound in bounds),
    ]
    ends = min(1.15 * float(values.min()), -0.1), max(1.15 * float(values.max()), 0.25)
    x = spec.Axis("readings later", ends=(0.4, len(values) + 0.6), most=5, whole=True)
    return spec.Panel(parts, x, spec.Axis("correlation", ends=ends))


def paths(drawn: Sequence[ReckonedPath]) -> spec.Plot:
    """One panel per log: its measured path, and dead reckoning before and after."""
    columns = 1 if len(drawn) == 1 else 2 if len(drawn) in (2, 4) else 3
    panel = WIDTH / columns * (0.6 if columns == 1 else 1.0)
    shape = float(np.clip(np.median([_shape(one) for one in drawn]), 0.4, 1.2))
    rows = -(-len(drawn) // columns)
    keys = [spec.Key(label, look) for label, look in {**PATHS, "start": START}.items()]
    return spec.Plot(
        [_panel(one, TITLES[columns - 1]) for one in drawn],
        columns,
        height=rows * (max(panel * shape, 1.3) + 0.45) + 0.5,
        labels="outer ticks",
        legend=spec.Legend(keys, 4, handle=0.3, options={"handlelength": 3.0}),
    )


def _panel(one: ReckonedPath, size: float) -> spec.Panel:
    measured = one.paths[0]
    begin = measured[np.isfinite(measured).all(axis=1)][:1]
    lines = [spec.Line.through(path, look) for path, look in zip(one.paths, PATHS.values(), strict=True)]
    x, y = (spec.Axis(name, "m", most=5) for name in "xy")
    title = shortened(one.log)
    return spec.Panel([*lines, spec.Line.through(begin, START)], x, y, title, "ends", size, margin=0.06)


def shortened(name: str, letters: int = LETTERS) -> str:
    """A name with its middle left out where it is too long."""
    half = (letters - 1) // 2
    return name if len(name) <= letters else f"{name[:half]}…{name[-half:]}"


def _shape(one: ReckonedPath) -> float:
    # Height over width.
    every = np.concatenate(one.paths)
    width, height = np.maximum(np.nanmax(every, axis=0) - np.nanmin(every, axis=0), 1e-3)
    return float(height / width)
