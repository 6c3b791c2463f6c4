"""Residuals as they are drawn: in readable units, by quantity and log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from oed.foundation.text import unit_for, unit_text, words
from oed.records.stored.estimate import Correlations, EstimateRecord, FoundNoise
from oed.records.stored.estimate import Residuals as StoredResiduals

Array = npt.NDArray[np.float64]

MOST_NUMBERS = 12
"""Logs that are numbered in a figure."""
BINS, FEWEST = 8, 12
"""Classes of speed, and the fewest residuals whose size says something."""
QUANTILES = 120
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
    """

    about: str
    unit: str
    quantities: Mapping[str, Sequence[ResidualSeries]]
    at_rest: float | None
    per_speed: float
    per_yaw_rate: float
    correlations: Array
    bound: float | None

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
    # Of motion over windows the poses' noise is but a part.
    noises = [] if record.by_windows else record.noise
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
    )


def _readings(one: StoredResiduals, factor: float) -> ResidualSeries:
    columns = np.array([one.t, one.value, one.speed], dtype=float)
    turning = np.array(one.yaw_rate or np.zeros(len(one.t)), dtype=float)
    known = np.isfinite(columns).all(axis=0)
    times, values, speeds = columns[:, known]
    return ResidualSeries(times, values * factor, speeds, np.abs(np.nan_to_num(turning[known])))
