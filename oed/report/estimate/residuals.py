"""Residuals as they are drawn: in readable units, thinned, by quantity and log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.foundation.text import unit_text, words
from oed.report.estimate.numbers import known, unit_for
from oed.report.estimate.reading import Data, by_windows, entries

Array = npt.NDArray[np.float64]

MOST_DOTS = 1000
"""Dots of a panel."""
MOST_NUMBERS = 12
"""Logs that are numbered in a figure."""
BINS, FEWEST = 8, 12
"""Classes of speed, and the fewest residuals whose size says something."""
QUANTILES = 120
POSITION = {"x", "y"}
GAP = 0.01
"""Between logs on the axis of time, as a share of all."""


@dataclass(frozen=True)
class Readings:
    """Residuals of one quantity in one log: times [s], values in the figure's unit, speeds [m/s] and yaw
    rates [rad/s].
    """

    times: Array
    values: Array
    speeds: Array
    yaw_rates: Array


@dataclass(frozen=True)
class Residuals:
    """What a figure shows of the readings that share their noise.

    Attributes:
        about: the noise's name.
        unit: of the values.
        quantities: by name, log by log.
        at_rest, per_speed, per_yaw_rate: the noise, None or 0 where it is not told.
        correlations: with later residuals.
        bound: of 95 % of white ones' correlations, None where it is not told.
        numbered: whether the logs are few enough to be numbered.
    """

    about: str
    unit: str
    quantities: Mapping[str, Sequence[Readings]]
    at_rest: float | None
    per_speed: float
    per_yaw_rate: float
    correlations: Array
    bound: float | None
    numbered: bool

    @property
    def everything(self) -> Readings:
        """All readings one after the other."""
        parts = [part for logs in self.quantities.values() for part in logs]
        return Readings(
            np.concatenate([part.times for part in parts]),
            np.concatenate([part.values for part in parts]),
            np.concatenate([part.speeds for part in parts]),
            np.concatenate([part.yaw_rates for part in parts]),
        )

    def size(self, speeds: Array, yaw_rates: Array) -> Array:
        """The noise at those speeds and yaw rates; all residuals' size where none is told."""
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
        count = min(QUANTILES, len(ratios))
        shares = _even_shares(count, len(ratios))
        normal = np.array([NormalDist().inv_cdf(float(share)) for share in shares])
        return normal, np.quantile(ratios, shares)


def binned(rates: Array, values: Array) -> tuple[Array, Array]:
    """Rates (mean of a class each), and the size (RMS) of the values there, of classes with enough."""
    edges = np.linspace(0.0, float(rates.max()) or 1.0, BINS + 1)
    owner = np.clip(np.digitize(rates, edges) - 1, 0, BINS - 1)
    full = [index for index in range(BINS) if (owner == index).sum() >= FEWEST]
    middle = [float(rates[owner == index].mean()) for index in full]
    sizes = [float(np.sqrt(np.mean(values[owner == index] ** 2))) for index in full]
    return np.array(middle), np.array(sizes)


def _even_shares(count: int, size: int) -> Array:
    # Evenly spaced on the normal's own axis, so that the tails are seen as well as the middle.
    reach = NormalDist().inv_cdf(1 - 0.5 / max(size, 2))
    return np.array([NormalDist().cdf(float(z)) for z in np.linspace(-reach, reach, max(count, 2))])


def residuals_of(data: Data) -> list[Residuals]:
    """What there is to draw, kind by kind of reading."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for one in entries(data, "residuals"):
        about = "position" if one["quantity"] in POSITION else str(one["quantity"])
        groups.setdefault(about, []).append(one)
    found = (_group(data, about, group) for about, group in groups.items())
    return [one for one in found if one is not None]


def _group(data: Data, about: str, group: Sequence[Mapping[str, Any]]) -> Residuals | None:
    sizes = [_column(one, "value") for one in group]
    told = np.concatenate([size[np.isfinite(size)] for size in sizes])
    if len(told) < 2:
        return None
    unit = str(group[0].get("unit") or "")
    shown, factor = unit_for([float(np.sqrt(np.mean(told**2)))], unit)
    # Of motion over windows the poses' noise is but a part.
    noise = {} if by_windows(data) else _about(data, "noise", about)
    tested = _about(data, "correlations", about)
    rest = known(noise.get("at_rest"))
    quantities: dict[str, list[Readings]] = {}
    for one in group:
        quantities.setdefault(words(str(one["quantity"])), []).append(_readings(one, factor))
    return Residuals(
        about=about,
        unit=unit_text(shown),
        quantities=quantities,
        at_rest=None if rest is None else rest * factor,
        per_speed=(known(noise.get("per_speed")) or 0.0) * factor,
        per_yaw_rate=(known(noise.get("per_yaw_rate")) or 0.0) * factor,
        correlations=_column(tested, "values"),
        bound=known(tested.get("bound")),
        numbered=max(len(logs) for logs in quantities.values()) <= MOST_NUMBERS,
    )


def _about(data: Data, key: str, about: str) -> Mapping[str, Any]:
    return next((one for one in entries(data, key) if one["about"] == about), {})


def _column(one: Mapping[str, Any], key: str) -> Array:
    return np.array(one.get(key) or [], dtype=float)


def _readings(one: Mapping[str, Any], factor: float) -> Readings:
    columns = [_column(one, key) for key in ("t", "value", "speed")]
    told = np.all(np.isfinite(columns), axis=0)
    times, values, speeds = (column[told] for column in columns)
    turning = np.nan_to_num(_column(one, "yaw_rate"))[told] if one.get("yaw_rate") else np.zeros_like(times)
    return Readings(times, values * factor, speeds, np.abs(turning))


def thinned(x: Array, y: Array, most: int = MOST_DOTS) -> tuple[Array, Array]:
    """So many of the points, at random but always the same: regular ones would meet the logs' own rhythm."""
    if len(x) <= most:
        return x, y
    kept = np.sort(np.random.default_rng(0).choice(len(x), most, replace=False))
    return x[kept], y[kept]


def one_after_the_other(logs: Sequence[Readings]) -> list[tuple[float, Readings]]:
    """Where on a common axis of time each log begins, its times counted from its own beginning."""
    ends = [float(log.times.max()) if len(log.times) else 0.0 for log in logs]
    gap = GAP * sum(ends) / max(len(logs) - 1, 1)
    begins = np.concatenate([[0.0], np.cumsum(np.array(ends[:-1]) + gap)]) if ends else np.zeros(0)
    return list(zip(map(float, begins), logs, strict=True))
