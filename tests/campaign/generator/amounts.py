"""Amounts: SI numbers of any dimension, written in units that are drawn factor by factor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from .quantities import Quantity, one_of

Dimension = tuple[tuple[str, Fraction], ...]
"""Powers of SI base units, in the order of `NAMES`."""
NAMES: dict[str, dict[str, float]] = {
    "kg": {"kg": 1.0, "g": 1e-3},
    "A": {"A": 1.0, "mA": 1e-3},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "s": {"s": 1.0, "min": 60.0, "h": 3600.0, "ms": 1e-3},
    "mol": {"mol": 1.0, "mmol": 1e-3},
    "K": {"K": 1.0},
}
"""Units of each base unit's dimension, with their factors."""


def dimension(**powers: Fraction | int) -> Dimension:
    """Of powers of base units."""
    return tuple((name, Fraction(powers[name])) for name in NAMES if powers.get(name))


PLAIN = dimension()
RATE = dimension(s=-1)
TIME = dimension(s=1)
TEMPERATURE = dimension(K=1)


def product(one: Dimension, other: Dimension, power: Fraction | int = 1) -> Dimension:
    """Of a product with a power of another."""
    found = dict(one)
    for name, exponent in other:
        found[name] = found.get(name, Fraction(0)) + power * exponent
    return dimension(**found)


def si_text(of: Dimension) -> str:
    """The SI unit as text."""
    return _joined(((name, power) for name, power in of), slashes=True)


class Amount(Quantity):
    """A number in SI with its dimension."""

    dimension: Dimension

    def __new__(cls, value: float, of: Dimension) -> Amount:
        """Keep the dimension."""
        made = super().__new__(cls, value, si_text(of))
        made.dimension = of
        return made

    def __getnewargs__(self) -> tuple[float, Dimension]:  # type: ignore[override]
        """For copies."""
        return float(self), self.dimension

    def text(self, rng: np.random.Generator) -> Any:
        """In units drawn at random; plain numbers bare, or as a share of 100."""
        if not self.dimension:
            return float(self) if rng.random() < 0.8 else f"{float(self) * 100!r} %"
        own = [(one_of(rng, NAMES[name]), name, power) for name, power in self.dimension]
        factor = float(np.prod([NAMES[name][unit] ** float(power) for unit, name, power in own]))
        unit = _joined(((unit, power) for unit, _, power in own), slashes=rng.random() < 0.7)
        return f"{float(self) / factor!r} {unit}"


class Deviation(Amount):
    """An amount that is never written in %: of what would it be a share?"""

    def text(self, rng: np.random.Generator) -> Any:
        """In units drawn at random; plain numbers bare."""
        return super().text(rng) if self.dimension else float(self)


def _joined(factors: Iterator[tuple[str, Fraction]], *, slashes: bool) -> str:
    # mol/m^3/s, or mol m^-3 s^-1.
    own = list(factors)
    if not slashes and all(power.denominator == 1 for _, power in own):
        return " ".join(_power(unit, power) for unit, power in own)
    over = " ".join(_power(unit, power) for unit, power in own if power > 0)
    under = "".join(f"/{_power(unit, -power)}" for unit, power in own if power < 0)
    return f"{over or '1'}{under}" if own and under else over


def _power(unit: str, power: Fraction) -> str:
    if power == 1:
        return unit
    return f"{unit}^{power}" if power.denominator == 1 else f"{unit}^({power})"


def shuffled(rng: np.random.Generator, entries: Mapping[str, Any]) -> dict[str, Any]:
    """The same in another order."""
    names = list(entries)
    return {names[place]: entries[names[place]] for place in rng.permutation(len(names))}
