"""Courses of states and readings with their bands, responses over a setting, and weights of readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import words
from oed.report.figures import spec
from oed.report.figures.spec import FAINT, FIRST, INK, SECOND, Look, line_look, mark, stroke

BAND: Look = {"color": FIRST, "alpha": 0.22, "linewidth": 0, "zorder": 1}
"""Of what estimates leave open."""
NOISE: Look = {"colors": FAINT, "linewidth": 0.9, "zorder": 2}
"""Of a reading's standard deviation."""
MOST_MARKS = 101
"""Readings that are marked one by one."""
TAKEN = 1e-3
"""Weight, as a share of the most, from which a reading counts as taken."""


@dataclass(frozen=True)
class Scale:
    """How a quantity is shown.

    Attributes:
        unit: that is shown.
        factor: to it from SI.
    """

    unit: str
    factor: float = 1.0


@dataclass(frozen=True)
class Band:
    """A quantity with what the estimates leave open of it, as shown.

    Attributes:
        title: of the quantity.
        scale: how it is shown.
        places: times or settings, as shown.
        values: SI.
        spread: one standard deviation of what estimates leave open, SI; None where that is not known.
        read: places at which it is read.
        readings: values there, SI.
        noise: standard deviation of a reading, SI; None where it is not known.
    """

    title: str
    scale: Scale
    places: Array
    values: Array
    spread: Array | None = None
    read: Array | None = None
    readings: Array | None = None
    noise: float | None = None


def bands(shown: Sequence[Band], across: spec.Axis) -> spec.Plot:
    """A panel for each quantity: its course, its band of one standard error, and where it is read."""
    columns = 1 if len(shown) == 1 else 2
    panels = [spec.Panel(_band(one), across, spec.Axis(one.title, one.scale.unit)) for one in shown]
    keys = [spec.Key("as predicted", line_look(0))]
    if any(one.spread is not None for one in shown):
        keys.append(spec.Key("± 1 standard error of what is estimated", BAND, patch=True))
    if any(one.read is not None and 0 < len(one.read) <= MOST_MARKS for one in shown):
        keys.append(spec.Key("read, ± its noise", mark("o", 5, "white", 1.2)))
    height = (3.0 if columns == 1 else 2.6) * -(-len(shown) // columns)
    return spec.Plot(panels, columns, height=height, labels="each", legend=spec.Legend(keys, most=3))


def _band(shown: Band) -> list[spec.Part]:
    factor, values = shown.scale.factor, shown.scale.factor * shown.values
    parts: list[spec.Part] = [spec.Line(shown.places, values, {**line_look(0), "zorder": 3})]
    if shown.spread is not None and np.all(np.isfinite(shown.spread)):
        half = factor * shown.spread
        parts.insert(0, spec.Call("fill_between", (shown.places, values - half, values + half), BAND))
    if shown.read is not None and shown.readings is not None and len(shown.read) <= MOST_MARKS:
        at = factor * shown.readings
        if shown.noise is not None:
            noise = factor * shown.noise
            parts.append(spec.Call("vlines", (shown.read, at - noise, at + noise), NOISE))
        parts.append(spec.Line(shown.read, at, mark("o", 5, "white", 1.2, 4)))
    return parts


@dataclass(frozen=True)
class Sensitivity:
    """How much a quantity changes with each parameter, by its nominal size.

    Attributes:
        title, scale: of the quantity.
        places: times or settings, as shown.
        values: (n, p), SI.
    """

    title: str
    scale: Scale
    places: Array
    values: Array


def sensitivities(
    shown: Sequence[Sensitivity], parameters: Sequence[str], across: spec.Axis, chosen: Sequence[float] = ()
) -> spec.Plot:
    """A panel for each quantity: its derivatives by every parameter, times the parameter's size.

    Args:
        shown: quantities.
        parameters: their names.
        across: the axis of times or settings.
        chosen: places that are read, as lines across.
    """
    columns = 1 if len(shown) == 1 else 2
    panels = []
    for one in shown:
        lines = [
            spec.Line(one.places, one.scale.factor * column, {**line_look(index), "zorder": 3})
            for index, column in enumerate(one.values.T)
        ]
        marks = [spec.Call("axvline", (place,), stroke(FAINT, 0.9, 1, (3, 2))) for place in chosen]
        y = spec.Axis("per parameter", one.scale.unit)
        panels.append(spec.Panel([*marks, *lines], across, y, one.title))
    keys = [spec.Key(words(name), line_look(index)) for index, name in enumerate(parameters)]
    height = (3.0 if columns == 1 else 2.6) * -(-len(shown) // columns)
    return spec.Plot(panels, columns, height=height, labels="each", legend=spec.Legend(keys, most=4))


@dataclass(frozen=True)
class Stems:
    """Weights of readings, and what decides about them.

    Attributes:
        title: of what is read.
        places: times or numbers of readings, as shown.
        weights: that they have.
        derivatives: of the criterion by each, for a unit of its budget, as shares of the least one that is
            taken.
        most: largest weight.
    """

    title: str
    places: Array
    weights: Array
    derivatives: Array
    most: float


def stems(shown: Sequence[Stems], across: spec.Axis) -> spec.Plot:
    """Two panels for each group of readings: weights as stems, and below them the directional derivative
    against its bound.
    """
    panels = []
    for one in shown:
        taken = one.weights > TAKEN * one.most
        dots = spec.Line(one.places[taken], one.weights[taken], mark("o", 3.5, FIRST, 0.6, 4, FIRST))
        lines = spec.Call("vlines", (one.places, 0.0, one.weights), {"colors": FIRST, "linewidth": 1.1})
        top = 1.15 * max(float(one.weights.max()), 1e-12)
        panels.append(spec.Panel([lines, dots], across, spec.Axis("weight", ends=(0.0, top)), one.title))
    for one in shown:
        course = spec.Line(one.places, one.derivatives, {**line_look(0), "zorder": 3})
        bound = spec.Call("axhline", (1.0,), stroke(SECOND, 1.4, 2, (4, 2)))
        taken = one.weights > TAKEN * one.most
        dots = spec.Line(one.places[taken], one.derivatives[taken], mark("o", 3.5, "white", 1.0, 4, INK))
        panels.append(spec.Panel([bound, course, dots], across, spec.Axis("directional derivative")))
    keys = [
        spec.Key("directional derivative", line_look(0)),
        spec.Key("level from which readings are taken", stroke(SECOND, 1.4, 2, (4, 2))),
        spec.Key("taken", mark("o", 3.5, "white", 1.0)),
    ]
    columns = len(shown)
    return spec.Plot(panels, columns, height=4.6, labels="each", legend=spec.Legend(keys, most=3))
