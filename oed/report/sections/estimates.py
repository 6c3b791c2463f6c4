"""Simulated estimates as clouds of dots with their ellipses: figures of the validation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from oed.foundation.text import Unit, common_units, readable, unit_text, words
from oed.records.record import Record
from oed.report.parts.reading import Cloud
from oed.report.parts.section import Picture

Outcome = Mapping[str, Any]
Pair = tuple[str, str]

MOST_CLOUDS = 4
"""Results whose estimates are drawn."""
MOST_PAIRS = 3
"""Pairs of parameters that are drawn."""
COEFFICIENTS = (("c21", "c22"), ("c11", "c12"))
"""Pairs of the coefficient matrix, whose rows are estimated together."""


def units_of(record: Record, entry: Outcome) -> dict[str, Unit]:
    """The unit, and its factor from SI, in which deviations are shown: as suits one simulated drive."""
    units = {parameter["name"]: str(parameter["unit"]) for parameter in record.data["parameters"]}
    promised = np.sqrt(np.diag(entry["promised_covariance"]))
    sizes = {name: float(size) for name, size in zip(entry["parameters"], promised, strict=True)}
    return common_units(sizes, units)


def clouds(
    record: Record, entries: Sequence[Outcome], chosen: Sequence[Outcome], several: bool
) -> tuple[Picture, ...]:
    """A figure for each pair of parameters: the design by every estimator first, then other drives.

    All panels of a figure are on one scale.
    """
    first = chosen[0].get("estimator")
    others = [
        entry
        for entry in entries
        if not any(entry is one for one in chosen)
        and "same_length" not in entry["name"]
        and entry.get("estimator") == first
    ]
    drawn = [*chosen, *others][:MOST_CLOUDS]
    pairs = _pairs([str(name) for name in chosen[0]["parameters"]])
    return tuple(_picture(record, drawn, pair, several) for pair in pairs)


def _pairs(names: Sequence[str]) -> list[Pair]:
    known = [pair for pair in COEFFICIENTS if set(pair) <= set(names)]
    return known or list(pairwise(names))[:MOST_PAIRS]


def _picture(record: Record, drawn: Sequence[Outcome], pair: Pair, several: bool) -> Picture:
    told = f"{words(pair[0])} and {words(pair[1])}"
    axes = _axes(record, drawn[0], pair)
    drawings = [_cloud(entry, axes, several) for entry in drawn]
    errors = ", less the true ones," if any(axis.errors for axis in axes) else ""
    caption = (
        f"Estimates of {told}{errors} from the first simulated experiments (dots), the true values "
        "(cross), and the ellipses that should hold 95 %: promised (solid) and simulated (dashed)."
    )
    alt = f"Simulated estimates of {told} with 95 % ellipses"
    return Picture(f"estimates_{pair[0]}_{pair[1]}", alt, caption, partial(_draw, drawings))


@dataclass(frozen=True)
class _Axis:
    # Errors are drawn instead of estimates where these differ in their last digits only.
    name: str
    unit: str
    factor: float
    errors: bool

    @property
    def label(self) -> str:
        title = f"error of {words(self.name)}" if self.errors else words(self.name)
        return f"{title} [{unit_text(self.unit)}]" if self.unit else title


def _axes(record: Record, entry: Outcome, pair: Pair) -> tuple[_Axis, ...]:
    units = {parameter["name"]: str(parameter["unit"]) for parameter in record.data["parameters"]}
    chosen = units_of(record, entry)
    return tuple(
        _Axis(name, *chosen[name], chosen[name][0] != readable(1.0, units[name])[1]) for name in pair
    )


def _cloud(entry: Outcome, axes: tuple[_Axis, ...], several: bool) -> Cloud:
    indices = [entry["parameters"].index(axis.name) for axis in axes]
    picked = np.ix_(indices, indices)
    factors = np.array([axis.factor for axis in axes])
    true = np.array(entry["true"])[indices]
    origin = np.where([axis.errors for axis in axes], true, 0.0)
    return Cloud(
        title=f"{entry['name']}\n{words(entry['estimator'])}" if several else str(entry["name"]),
        labels=tuple(axis.label for axis in axes),
        points=factors * (np.array(entry["estimates"])[:, indices] - origin),
        true=factors * (true - origin),
        promised=np.outer(factors, factors) * np.array(entry["promised_covariance"])[picked],
        sampled=np.outer(factors, factors) * np.array(entry["sampled_covariance"])[picked],
        alike=axes[0].unit == axes[1].unit,
    )


def _draw(drawings: Any) -> Any:
    from oed.report.figures import panels

    return panels.clouds(drawings)
