"""How many robots leave the workspace or hit an obstacle on the drives of a study, in numbers and words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from oed.foundation.text import given_text, listing, size_text, words
from oed.records.stored.parts import (
    Count,
    Name,
    Number,
    Seed,
    Share,
    Stored,
    require_different,
    require_known,
)
from oed.records.stored.simulation import Paths, Uncertain

MOST_LEAVING = 0.01
"""Share of robots that may leave without a warning."""
NEARLY_ALL = 99.0
"""Per cent of robots from which three digits are given."""
ALIKE = 1e-9
"""Share by which two ends of a range may differ in size and count as the same."""
ACTIONS = {"workspace": "leave the workspace", "obstacles": "hit an obstacle"}
"""What robots do that exceed a limit, by its name."""


class Departing(Stored):
    """Robots that leave on a drive.

    Attributes:
        name: of the result that has the drive.
        share: of the robots simulated.
        interval: of the probability, 95 %.
        distance: 95th percentile, among the robots that leave, of how far they get outside [m]; None where it
            is not finite.
    """

    name: Name
    share: Share
    interval: Annotated[list[Share], Field(min_length=2, max_length=2)]
    distance: Number | None


class StoredDepartures(Stored):
    """A record's `departures`.

    Attributes:
        usual: whether the ranges are usual ones; else they are the study's.
        robust: whether the study tightens its limits for such robots.
        uncertain: quantities and ranges that robots are drawn from.
        limits: names of the limits on positions.
        draws, seed: of the simulation.
        results: drive by drive.
        bundle: paths of some of the robots on the best drive; None where `robustness` has them.
    """

    usual: bool
    robust: bool
    uncertain: list[Uncertain]
    limits: list[str]
    draws: Count
    seed: Seed
    results: list[Departing]
    bundle: Paths | None = None

    def of_result(self, name: str) -> Departing | None:
        """Return the entry of a result, None where it was not simulated."""
        return next((entry for entry in self.results if entry.name == name), None)

    def warns(self, name: str) -> bool:
        """Tell whether so many robots leave on a result's drive that a reader has to know it first."""
        entry = self.of_result(name)
        return entry is not None and entry.share > MOST_LEAVING

    def sentence(self, name: str) -> str:
        """Return how many robots leave on a result's drive and by how much, in words; "" where unknown.

        Above 1 % it is a warning that says what to do.
        """
        entry = self.of_result(name)
        if entry is None:
            return ""
        text = f"{_share_text(entry.share)} of {self.draws:,} robots with {self._ranges} {self._action}"
        if entry.share:
            text += f", {_distance_text(entry.distance)}"
        if not self.warns(name):
            return f"{text}."
        return f"Warning: {text}; {self._remedy}."

    def exported(self, name: str) -> dict[str, Any] | None:
        """Return what is known of a result's drive as plain data, with its sentence; None for nothing."""
        entry = self.of_result(name)
        if entry is None:
            return None
        shared = {key: value for key, value in self.plain().items() if key not in ("results", "bundle")}
        return {**shared, **entry.plain(), "sentence": self.sentence(name)}

    @property
    def _action(self) -> str:
        actions = [ACTIONS.get(name, f"violate {words(name)}") for name in self.limits]
        return " or ".join(actions)

    @property
    def _remedy(self) -> str:
        keys = [*(["`uncertainty`"] if self.usual else []), *([] if self.robust else ["`robust`"])]
        room = "leave that much room around it"
        return f"add {listing(keys)} to the study, or {room}" if keys else room

    @property
    def _ranges(self) -> str:
        alike: dict[str, list[str]] = {}
        for quantity in self.uncertain:
            alike.setdefault(_range_text(quantity), []).append(quantity.name)
        return ", ".join(f"{_names_text(names)} {text}" for text, names in alike.items())

    def _require(self) -> None:
        names = [entry.name for entry in self.results]
        require_different("results", names)
        require_known("bundle", [] if self.bundle is None else [self.bundle.name], names)


def _share_text(share: float) -> str:
    if share in (0.0, 1.0):
        return "All" if share else "None"
    size = 100 * share
    return f"{size:.3g} %" if size >= NEARLY_ALL else f"{size:.2g} %"


def _distance_text(distance: float | None) -> str:
    if distance is None:
        return "some of them without end"
    return f"by up to {size_text(distance, 'm', 2)} in 95 % of these cases"


def _names_text(names: Sequence[str]) -> str:
    radii = [name for name in names if name.startswith("wheel_radius")]
    if len(radii) < 2:
        return listing([words(name) for name in names])
    return listing(["wheel radii", *(words(name) for name in names if name not in radii)])


def _range_text(quantity: Uncertain) -> str:
    below, above = quantity.nominal - quantity.low, quantity.high - quantity.nominal
    if not math.isclose(below, above, rel_tol=ALIKE):
        low, high = (_size_text(end, quantity.unit) for end in (quantity.low, quantity.high))
        return f"{low} to {high}"
    shared = quantity.nominal and quantity.unit != "rad"
    size = f"{100 * above / abs(quantity.nominal):.3g} %" if shared else _size_text(above, quantity.unit)
    return f"±{size}" if quantity.uniform else f"±{size} (standard deviation)"


def _size_text(size: float, unit: str) -> str:
    return given_text(size, unit) if unit else f"{size:.3g}"
