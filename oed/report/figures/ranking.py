"""The figure that ranks drives: a dot for each of them, labelled, on one axis for each number."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from oed.report.figures import spec
from oed.report.figures.chart import DECADE
from oed.report.figures.spec import FAINT, FIRST, INK, Look, mark, stroke

DESIGN = mark("o", 9, FIRST, 1.0, 4, FIRST)
OTHER = mark("o", 7, "white", 1.5, 4, INK)
THREAD = stroke("#dddddd", 0.9, 1)
TEXT: Look = {"va": "center", "fontsize": "small", "color": INK, "zorder": 5}
ROOM = 0.3
"""Of an axis, kept free for the labels beside its dots."""
ROW, FRAME = 0.34, 0.95
"""Height of a row, and of what surrounds them [inch]."""
TITLE = 0.2
"""Height of the panels' titles [inch]."""


@dataclass(frozen=True)
class Scale:
    """A number of every drive.

    Attributes:
        title, unit: of the axis.
        panel: above it: what the number is of; "" for nothing.
        values: of the drives, as shown; None where there is none.
        texts: beside the dots, or in their place.
    """

    title: str
    unit: str
    values: tuple[float | None, ...]
    texts: tuple[str, ...]
    panel: str = ""


def ranking(names: Sequence[str], designs: Sequence[bool], scales: Sequence[Scale]) -> spec.Plot:
    """A row for each drive, the first on top, and a panel for each number.

    Args:
        names: of the drives.
        designs: whether each was designed.
        scales: the numbers.
    """
    count = len(names)
    rows = [(float(count - 1 - at), name) for at, name in enumerate(names)]
    y = spec.Axis(ends=(-0.6, count - 0.4), ticks=rows, grid=False)
    panels = [_panel(one, designs, [place for place, _ in rows], y) for one in scales]
    height = FRAME + ROW * count + (TITLE if any(one.panel for one in scales) else 0.0)
    return spec.Plot(panels, len(panels), height=height, share="y", labels="outer")


def _panel(scale: Scale, designs: Sequence[bool], rows: Sequence[float], y: spec.Axis) -> spec.Panel:
    known = [value for value in scale.values if value is not None]
    logarithmic = bool(known) and min(known) > 0 and max(known) >= DECADE * min(known)
    low, high = _ends(known, logarithmic)
    parts: list[spec.Part] = [spec.Call("axhline", (place,), THREAD) for place in rows]
    for value, text, design, place in zip(scale.values, scale.texts, designs, rows, strict=True):
        look = {**TEXT, "fontweight": "bold" if design else "normal"}
        if value is None:
            parts.append(spec.Note(text, (low, place), (6, 0), {**look, "color": FAINT, "style": "italic"}))
            continue
        parts.append(spec.Line([value], [place], DESIGN if design else OTHER))
        parts.append(spec.Note(text, (value, place), (8, 0), look))
    x = spec.Axis(scale.title, scale.unit, (low, high), logarithmic, most=4)
    return spec.Panel(parts, x, y, scale.panel)


def _ends(known: Sequence[float], logarithmic: bool) -> tuple[float, float]:
    # From nothing on, or from below the least, with room for the labels.
    if not known:
        return 0.0, 1.0
    if not logarithmic:
        return 0.0, (1.0 + 1.6 * ROOM) * max(known) or 1.0
    span = math.log10(max(known) / min(known))
    return min(known) / 10 ** (0.12 * span), max(known) * 10 ** (ROOM * 1.6 * span)
