"""Courses of states and readings with their bands, responses over a setting, and weights of readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import words
from oed.report.figures import spec
from oed.report.figures.chart import ends_within, limit_lines
from oed.report.figures.spec import FAINT, FIRST, INK, SECOND, Look, line_look, mark, stroke
from oed.report.parts.reading import TAKEN

BAND: Look = {"color": FIRST, "alpha": 0.22, "linewidth": 0, "zorder": 1}
"""Of what estimates leave open."""
NOISE: Look = {"colors": FAINT, "linewidth": 0.9, "zorder": 2}
"""Of a reading's standard deviation."""
SAME = 1e-6
"""Change, as a share of the size, that is none."""
MOST_MARKS = 150
"""Readings of a panel that are marked one by one."""


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

    @property
    def open(self) -> bool:
        """Whether it is known how much the estimates leave open."""
        return self.spread is not None and bool(np.all(np.isfinite(self.spread)))


def marked(shown: Sequence[Band]) -> bool:
    """Whether the readings of a panel are few enough to be marked one by one."""
    return 0 < sum(len(one.read) for one in shown if one.read is not None) <= MOST_MARKS


def bands(
    shown: Sequence[Sequence[Band]],
    across: spec.Axis,
    trials: Sequence[str] = (),
    width: float = spec.WIDTH,
) -> spec.Plot:
    """A panel for each quantity: its courses, with bands of one standard error, and where it is read.

    Args:
        shown: of every quantity its course in each trial.
        across: the axis of times or settings.
        trials: their names; () of a single one.
        width: of the figure [inch].
    """
    columns = 1 if len(shown) == 1 else 2
    panels = [
        spec.Panel(
            [part for index, one in enumerate(each) for part in _band(one, line_look(index), marked(each))],
            across,
            spec.Axis(each[0].title, each[0].scale.unit, _flat(each)),
        )
        for each in shown
    ]
    every = [one for each in shown for one in each]
    keys = [spec.Key(name, line_look(index)) for index, name in enumerate(trials or ["as predicted"])]
    if any(one.open for one in every):
        keys.append(spec.Key("± 1 standard error of what is estimated", BAND, patch=True))
    if any(map(marked, shown)):
        keys.append(spec.Key("read, ± its noise", mark("o", 5, "white", 1.2)))
    height = (3.0 if columns == 1 else 2.6) * -(-len(shown) // columns)
    return spec.Plot(panels, columns, width, height, labels="each", legend=spec.Legend(keys, most=4))


def _flat(shown: Sequence[Band]) -> spec.Ends | None:
    # Of what is constant but for rounding an axis that shows it so.
    every = shown[0].scale.factor * np.concatenate([one.values for one in shown])
    size = float(np.abs(every).max())
    still = float(np.ptp(every)) <= SAME * size
    room = 0.1 * (size or 1.0)
    return (float(every.min()) - room, float(every.max()) + room) if still else None


def _band(shown: Band, look: Look, marks: bool) -> list[spec.Part]:
    factor, values = shown.scale.factor, shown.scale.factor * shown.values
    parts: list[spec.Part] = [spec.Line(shown.places, values, {**look, "zorder": 3})]
    if shown.open:
        half, band = factor * np.asarray(shown.spread), {**BAND, "color": look["color"]}
        parts.insert(0, spec.Call("fill_between", (shown.places, values - half, values + half), band))
    if marks and shown.read is not None and shown.readings is not None:
        at = factor * shown.readings
        if shown.noise is not None:
            noise = factor * shown.noise
            parts.append(spec.Call("vlines", (shown.read, at - noise, at + noise), NOISE))
        parts.append(spec.Line(shown.read, at, mark("o", 4, "white", 1.1, 4, look["color"])))
    return parts


@dataclass(frozen=True)
class Spread:
    """What a state of systems other than the nominal one does, as shown.

    Attributes:
        title, unit: of the state.
        nominal: of every run times and values, (n, 2).
        inside: alike of systems that satisfy the limits.
        outside: of those that violate them.
        bounds: that the state is to keep; None for none.
    """

    title: str
    unit: str
    nominal: Sequence[Array]
    inside: Sequence[Array]
    outside: Sequence[Array]
    bounds: spec.Ends | None = None


INSIDE, OUTSIDE = stroke("#9db4cc", 0.7, 1), stroke(SECOND, 0.9, 2, (4, 2))


def spreads(shown: Sequence[Spread], across: spec.Axis) -> spec.Plot:
    """A panel for each state: its courses in systems other than the nominal one.

    Args:
        shown: states.
        across: the axis of times.
    """
    columns = 1 if len(shown) == 1 else 2
    panels = []
    for one in shown:
        looks = ((one.inside, INSIDE), (one.outside, OUTSIDE), (one.nominal, {**line_look(0), "zorder": 3}))
        lines = [spec.Line.through(line, look) for some, look in looks for line in some]
        every = np.concatenate([line[:, 1] for some, _ in looks for line in some])
        ends = ends_within(float(every.min()), float(every.max()), one.bounds)
        y = spec.Axis(one.title, one.unit, ends)
        panels.append(spec.Panel([*lines, *limit_lines(one.bounds, one.unit)], across, y))
    keys = [
        spec.Key("nominal", line_look(0)),
        spec.Key("others", INSIDE),
        *([spec.Key("others that violate the limits", OUTSIDE)] if any(one.outside for one in shown) else []),
    ]
    height = (3.0 if columns == 1 else 2.6) * -(-len(shown) // columns)
    return spec.Plot(panels, columns, height=height, labels="each", legend=spec.Legend(keys, most=3))


@dataclass(frozen=True)
class Held:
    """An input that is held in every period of a trial, as shown.

    Attributes:
        title: of the input.
        unit: that is shown.
        edges: of the periods, (K + 1,).
        values: in them, (K,).
        bounds: its limits; None where it has none.
    """

    title: str
    unit: str
    edges: Array
    values: Array
    bounds: spec.Ends | None = None


def held(
    shown: Sequence[Sequence[Held]], across: spec.Axis, trials: Sequence[str] = (), width: float = spec.WIDTH
) -> spec.Plot:
    """A panel for each input, one below the other: its steps between its limits.

    Args:
        shown: of every input its steps in each trial.
        across: the axis of times.
        trials: their names; () of a single one.
        width: of the figure [inch].
    """
    panels = [_held(each, across if each is shown[-1] else spec.Axis()) for each in shown]
    keys = [spec.Key(name, line_look(index)) for index, name in enumerate(trials)]
    height = 0.7 + (2.4 if len(shown) == 1 else 1.8) * len(shown)
    return spec.Plot(panels, 1, width, height, labels="each", share="x", legend=spec.Legend(keys, most=4))


def _held(shown: Sequence[Held], across: spec.Axis) -> spec.Panel:
    first = shown[0]
    lines: list[spec.Part] = [
        spec.Line(
            one.edges,
            np.append(one.values, one.values[-1:]),
            {**line_look(index), "drawstyle": "steps-post", "zorder": 3},
        )
        for index, one in enumerate(shown)
    ]
    every = np.concatenate([one.values for one in shown])
    ends = ends_within(float(every.min()), float(every.max()), first.bounds)
    y = spec.Axis(first.title, first.unit, ends, most=5)
    return spec.Panel([*lines, *limit_lines(first.bounds, first.unit)], across, y)


def settings(
    places: Array, labels: Sequence[str], across: spec.Axis, upward: spec.Axis, width: float = spec.WIDTH
) -> spec.Plot:
    """Settings of two inputs as dots in their plane.

    Args:
        places: of the dots, as shown, (n, 2).
        labels: beside each; "" for none.
        across: the axis of the first input.
        upward: the axis of the other.
        width: of the figure [inch].
    """
    dots = spec.Line(places[:, 0], places[:, 1], mark("o", 8, FIRST, 0.6, 4, FIRST))
    notes = [
        spec.Note(text, (float(x), float(y)), (7, 7), {"fontsize": "small", "zorder": 5})
        for (x, y), text in zip(places, labels, strict=True)
        if text
    ]
    return spec.Plot([spec.Panel([dots, *notes], across, upward)], width=width, height=3.4)


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
    shown: Sequence[Sensitivity],
    parameters: Sequence[str],
    across: spec.Axis,
    chosen: Sequence[float] = (),
    columns: int = 0,
) -> spec.Plot:
    """A panel for each quantity: its derivatives by every parameter, times the parameter's size.

    Args:
        shown: quantities.
        parameters: their names.
        across: the axis of times or settings.
        chosen: places that are read, as lines across.
        columns: of panels; one or two by default.
    """
    columns = columns or (1 if len(shown) == 1 else 2)
    panels = []
    for one in shown:
        lines = [
            spec.Line(one.places, one.scale.factor * column, {**line_look(index), "zorder": 3})
            for index, column in enumerate(one.values.T)
        ]
        marks = [spec.Call("axvline", (place,), stroke(FAINT, 0.9, 1, (3, 2))) for place in chosen]
        y = spec.Axis("scaled sensitivity", one.scale.unit, most=5)
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
