"""The figures of an estimate's residuals, in panels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.text import unit_for, unit_text, words
from oed.records.stored.estimate import Correlations, EstimateRecord, FoundNoise
from oed.records.stored.estimate import Residuals as StoredResiduals
from oed.report.figures import spec
from oed.report.figures.spec import FAINT, FIRST, INK, Look, mark, stroke

SHADES = (FIRST, "#8fa9c2")
"""Of logs one after the other."""
SIZE = {**mark("o", 3, INK, 1.0, 5), "color": INK, "linestyle": "-", "linewidth": 1.2}
EXPECTED = stroke("#b35c00", 1.2, 4, (4, 2))
NUMBER: Look = {"ha": "center", "va": "bottom", "fontsize": "small", "color": FAINT}
SPREAD = 7.0
"""Typical sizes of residuals beyond which they are drawn as triangles."""
MOST_DOTS = 1000
"""Dots of a panel."""
GAP = 0.01
"""Between logs on the axis of time, as a share of all."""
MOST_NUMBERS = 12
"""Logs that are numbered in a figure."""
BINS, FEWEST = 8, 12
"""Classes of speed, and the fewest residuals whose size says something."""
QUANTILES = 120
"""Points of a figure of residuals over those of a normal distribution, at most: more are one line."""
POSITION = {"x", "y"}


@dataclass(frozen=True)
class ResidualSeries:
    """Residuals of one quantity in one log: times [s], values in the figure's unit, speeds [m/s] and yaw
    rates [rad/s].
    """

    times: Array
    values: Array
    speeds: Array
    yaw_rates: Array

    @property
    def end(self) -> float:
        """The last time [s]."""
        return float(self.times.max(initial=0.0))


@dataclass(frozen=True)
class Residuals:
    """What a figure shows of the readings that share their noise.

    Attributes:
        about: the noise's name.
        unit: of the values.
        quantities: by name, log by log.
        at_rest, per_speed, per_yaw_rate: the noise, None or 0 where it is not known.
        correlations: with later residuals.
        bound: of 95 % of white ones' correlations, None where it is not known.
        filtered: whether these correlations are those of a filter's innovations.
    """

    about: str
    unit: str
    quantities: Mapping[str, Sequence[ResidualSeries]]
    at_rest: float | None
    per_speed: float
    per_yaw_rate: float
    correlations: Array
    bound: float | None
    filtered: bool = False

    @property
    def numbered(self) -> bool:
        """Whether the logs are few enough to be numbered."""
        return max(len(logs) for logs in self.quantities.values()) <= MOST_NUMBERS

    @property
    def everything(self) -> ResidualSeries:
        """All readings one after the other."""
        parts = [part for logs in self.quantities.values() for part in logs]
        columns = zip(
            *((part.times, part.values, part.speeds, part.yaw_rates) for part in parts), strict=True
        )
        return ResidualSeries(*map(np.concatenate, columns))

    def size(self, speeds: Array, yaw_rates: Array) -> Array:
        """The noise at those speeds and yaw rates; all residuals' size where none is known."""
        rest = self.at_rest
        if not rest and not self.per_speed and not self.per_yaw_rate:
            rest = float(np.sqrt(np.mean(self.everything.values**2))) or 1.0
        still = np.hypot(rest or 0.0, self.per_speed * speeds)
        return np.asarray(np.hypot(still, self.per_yaw_rate * yaw_rates))

    def by_speed(self) -> tuple[Array, Array]:
        """Speeds, and the size (RMS) of the residuals thereabouts."""
        return binned(np.abs(self.everything.speeds), self.everything.values)

    def noise_by_speed(self) -> tuple[Array, Array]:
        """Speeds, and the noise there at the yaw rates (RMS) that were driven thereabouts."""
        speeds, turning = np.abs(self.everything.speeds), self.everything.yaw_rates
        drawn = np.linspace(0.0, float(speeds.max(initial=0.0)) or 1.0, 60)
        middle, sizes = binned(speeds, turning)
        usual = np.interp(drawn, middle, sizes) if len(middle) else np.zeros_like(drawn)
        return drawn, self.size(drawn, usual)

    def against_normal(self) -> tuple[Array, Array]:
        """Normal quantiles, and those of the residuals in units of the noise."""
        whole = self.everything
        sizes = self.size(np.abs(whole.speeds), whole.yaw_rates)
        ratios = whole.values / np.where(sizes > 0, sizes, 1.0)
        # Evenly spaced on the normal's own axis, so that the tails are seen as well as the middle.
        reach = NormalDist().inv_cdf(1 - 0.5 / max(len(ratios), 2))
        normal = np.linspace(-reach, reach, max(min(QUANTILES, len(ratios)), 2))
        return normal, np.quantile(ratios, [NormalDist().cdf(float(z)) for z in normal])


def binned(rates: Array, values: Array) -> tuple[Array, Array]:
    """Rates (mean of a class each), and the size (RMS) of the values there, of classes with enough."""
    edges = np.linspace(0.0, float(rates.max()) or 1.0, BINS + 1)
    owner = np.clip(np.digitize(rates, edges) - 1, 0, BINS - 1)
    full = [owner == index for index in range(BINS) if (owner == index).sum() >= FEWEST]
    middle = [float(rates[own].mean()) for own in full]
    return np.array(middle), np.array([float(np.sqrt(np.mean(values[own] ** 2))) for own in full])


def residuals_of(record: EstimateRecord) -> list[Residuals]:
    """What there is to draw, kind by kind of reading."""
    groups: dict[str, list[StoredResiduals]] = {}
    for one in record.residuals:
        groups.setdefault("position" if one.quantity in POSITION else one.quantity, []).append(one)
    found = (_group(record, about, group) for about, group in groups.items())
    return [one for one in found if one is not None]


def _group(record: EstimateRecord, about: str, group: Sequence[StoredResiduals]) -> Residuals | None:
    values = np.array([value for one in group for value in one.value if value is not None])
    if len(values) < 2:
        return None
    shown, factor = unit_for([float(np.sqrt(np.mean(values**2)))], group[0].unit or "")
    # Of motion over windows, and of what is off the most likely path, the poses' noise is but a part.
    filtered = bool(record.log_errors)
    noises = [] if record.by_windows or filtered else record.noise
    noise = next((one for one in noises if one.about == about), FoundNoise(about=about))
    unknown = Correlations(about=about, values=[])
    tested = next((one for one in record.correlations if one.about == about), unknown)
    quantities: dict[str, list[ResidualSeries]] = {}
    for one in group:
        quantities.setdefault(words(one.quantity), []).append(_readings(one, factor))
    return Residuals(
        about=about,
        unit=unit_text(shown),
        quantities=quantities,
        at_rest=None if noise.at_rest is None else noise.at_rest * factor,
        per_speed=(noise.per_speed or 0.0) * factor,
        per_yaw_rate=(noise.per_yaw_rate or 0.0) * factor,
        correlations=np.array(tested.values, dtype=float),
        bound=tested.bound,
        filtered=filtered,
    )


def _readings(one: StoredResiduals, factor: float) -> ResidualSeries:
    columns = np.array([one.t, one.value, one.speed], dtype=float)
    turning = np.array(one.yaw_rate or np.zeros(len(one.t)), dtype=float)
    known = np.isfinite(columns).all(axis=0)
    times, values, speeds = columns[:, known]
    return ResidualSeries(times, values * factor, speeds, np.abs(np.nan_to_num(turning[known])))


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
    x, y = _thinned(x, y, most)
    inside = np.abs(y) <= limit
    parts: list[spec.Part] = [spec.Dots(x[inside], y[inside], colour)]
    for sign, marker in ((1, "^"), (-1, "v")):
        beyond = x[sign * y > limit]
        parts.append(
            spec.Line(beyond, np.full(len(beyond), sign * 0.95 * limit), mark(marker, 3, INK, 1.0, 3))
        )
    return parts


def _thinned(x: Array, y: Array, most: int) -> tuple[Array, Array]:
    # So many of the points, at random but always the same: regular ones would meet the logs' own rhythm.
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
    y = spec.Axis("residual / size" if one.at_rest is None else "residual / noise", ends=(-height, height))
    return spec.Panel([diagonal, spec.Dots(normal, found, SHADES[0], 2.4)], x, y)


def _later(one: Residuals) -> spec.Panel:
    values, bounds = np.nan_to_num(one.correlations), [] if one.bound is None else [-one.bound, one.bound]
    parts: list[spec.Part] = [
        spec.Call("bar", (np.arange(1, len(values) + 1), values, 0.65), {"color": SHADES[0], "zorder": 2}),
        spec.Call("axhline", (0.0,), stroke(INK, 0.8, 3)),
        *(spec.Call("axhline", (bound,), EXPECTED) for bound in bounds),
    ]
    ends = min(1.15 * float(values.min()), -0.1), max(1.15 * float(values.max()), 0.25)
    x = spec.Axis("readings later", ends=(0.4, len(values) + 0.6), most=5, whole=True)
    return spec.Panel(parts, x, spec.Axis("correlation", ends=ends))
