"""Quantities: SI numbers that know their dimension, so that a study may be written in any unit."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np

UNITS: dict[str, dict[str, float]] = {
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3, "inch": 0.0254},
    "rad": {"rad": 1.0, "deg": pi / 180, "mrad": 1e-3},
    "s": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "rad/s": {"rad/s": 1.0, "deg/s": pi / 180, "rpm": 2 * pi / 60},
    "rad/s^2": {"rad/s^2": 1.0, "deg/s^2": pi / 180},
    "rad/s^3": {"rad/s^3": 1.0},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "km/h": 1 / 3.6},
    "m/s^2": {"m/s^2": 1.0, "cm/s^2": 1e-2},
    "": {"": 1.0, "%": 1e-2},
}
"""Names of units by the SI unit of their dimension, with their factors."""


class Quantity(float):
    """A number in SI with the unit of its dimension."""

    unit: str

    def __new__(cls, value: float, unit: str) -> Quantity:
        """Keep the unit."""
        made = super().__new__(cls, value)
        made.unit = unit
        return made

    def text(self, rng: np.random.Generator) -> Any:
        """In a unit drawn at random, or bare."""
        names = list(UNITS[self.unit])
        name = names[rng.integers(len(names))] if rng.random() < 0.7 else ""
        return float(self) if not name else f"{float(self) / UNITS[self.unit][name]!r} {name}"

    def __getnewargs__(self) -> tuple[float, str]:  # type: ignore[override]
        """For copies."""
        return float(self), self.unit


def written(value: Any, rng: np.random.Generator) -> Any:
    """The same as plain data for YAML: quantities in units drawn at random, or bare."""
    if isinstance(value, Quantity):
        return value.text(rng)
    if isinstance(value, dict):
        return {key: written(entry, rng) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [written(entry, rng) for entry in value]
    return value


def plain(value: Any) -> Any:
    """The same as plain SI numbers."""
    if isinstance(value, Quantity):
        return float(value)
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    return [plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between two, evenly on a logarithmic scale."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def one_of(rng: np.random.Generator, choices: Any) -> Any:
    """One of several choices."""
    entries = list(choices)
    return entries[int(rng.integers(len(entries)))]
