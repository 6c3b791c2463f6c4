"""Dimensions of quantities: powers of SI base units, from units and for messages.

Angles are a dimension, as they are at the package's doors: "10 Hz" is no value of what is in rad/s. In
equations radians count as plain numbers, as in SI, or a torque over an inertia would be no angular
acceleration and v = r omega no speed: there dimensions are compared by `fits`, which looks past angles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import inf

from oed.foundation.quantities import NUMBER, base_units, parse_quantity, unit_issue, unit_meaning

BASE = ("kg", "A", "rad", "m", "s", "mol", "K")
"""SI base units, in the order in which texts have them."""
_NAMES = ("gram", "ampere", "radian", "meter", "second", "mole", "kelvin")
_ANGLE = BASE.index("rad")
FINEST = 1_000_000
"""Largest denominator of a power: what is nearest is meant, 0.333... being 1/3."""
SIZES = (0.0, 1e100)
"""What magnitudes of values in equations lie between, in their unit: nothing small is rounding's."""
GRAM = 1e-3
"""[kg]."""
NAMED = {
    name: tuple(Fraction(powers.get(unit, 0)) for unit in BASE)
    for name, powers in {
        "N": {"kg": 1, "m": 1, "s": -2},
        "Pa": {"kg": 1, "m": -1, "s": -2},
        "J": {"kg": 1, "m": 2, "s": -2},
        "W": {"kg": 1, "m": 2, "s": -3},
        "V": {"kg": 1, "A": -1, "m": 2, "s": -3},
    }.items()
}
"""Units with names of their own, by their powers."""


@dataclass(frozen=True)
class Dimension:
    """Powers of the SI base units `BASE`; those of a plain number by default."""

    powers: tuple[Fraction, ...] = (Fraction(0),) * len(BASE)

    @property
    def plain(self) -> bool:
        """Whether it is that of plain numbers, or of angles."""
        return self.fits(PLAIN)

    @property
    def text(self) -> str:
        """In SI units, as a unit is written: "mol/m^3/s", "W/K", "rad/s", ""; by a name where that is
        all of it but what it is per kelvin or mole.
        """
        name, rest = "", self.powers
        for one, powers in NAMED.items():
            left = tuple(own - power for own, power in zip(self.powers, powers, strict=True))
            if all(
                power == 0 or (unit in ("mol", "K") and power < 0)
                for unit, power in zip(BASE, left, strict=True)
            ):
                name, rest = one, left
        over = " ".join(filter(None, [name, *_factors(rest, 1)]))
        under = "".join(f"/{factor}" for factor in _factors(rest, -1))
        return f"{over or '1'}{under}" if under else over

    @property
    def words(self) -> str:
        """What something of this dimension is: "in mol/m^3/s", or "a plain number"."""
        return f"in {self.text}" if self.text else "a plain number"

    def fits(self, other: Dimension) -> bool:
        """Whether both are of one dimension, radians counting as plain numbers."""
        return self._without_angle() == other._without_angle()

    def __mul__(self, other: Dimension) -> Dimension:
        """That of a product."""
        return Dimension(tuple(one + two for one, two in zip(self.powers, other.powers, strict=True)))

    def __truediv__(self, other: Dimension) -> Dimension:
        """That of a quotient."""
        return self * other**-1

    def __pow__(self, power: Fraction | float) -> Dimension:
        """That of a power."""
        exact = Fraction(power).limit_denominator(FINEST)
        return Dimension(tuple(own * exact for own in self.powers))

    def __str__(self) -> str:
        """In SI base units."""
        return self.text

    def _without_angle(self) -> tuple[Fraction, ...]:
        return self.powers[:_ANGLE] + self.powers[_ANGLE + 1 :]


def _factors(powers: tuple[Fraction, ...], sign: int) -> Iterator[str]:
    # Those above the line, or those below it.
    for unit, power in zip(BASE, powers, strict=True):
        size = sign * power
        if size > 0:
            whole = size.denominator == 1
            yield unit if size == 1 else f"{unit}^{size}" if whole else f"{unit}^({size})"


PLAIN = Dimension()
"""Of plain numbers."""
ANGLE = Dimension(tuple(Fraction(unit == "rad") for unit in BASE))
"""Of angles."""
TIME = Dimension(tuple(Fraction(unit == "s") for unit in BASE))
"""Of times."""


@lru_cache(maxsize=256)
def parse_unit(text: str) -> tuple[float, Dimension]:
    """The factor to SI and the dimension of a unit: "mol/l", "1/s", "m^2", "K", "J/mol/K", "%", "".

    Raises:
        ValueError: no unit, or a temperature in degrees Celsius.
    """
    issue = unit_issue(text.strip()) if text.strip() else ""
    if issue:
        raise ValueError(f"unit {issue}")
    try:
        factor, powers = base_units(text.strip())
        found = tuple(Fraction(powers.get(name, 0.0)).limit_denominator(FINEST) for name in _NAMES)
        # The registry counts in grams.
        factor *= GRAM ** float(found[0])
    except OverflowError:
        factor = inf
    if not 1 / SIZES[1] <= factor <= SIZES[1]:
        raise ValueError(f"unit {text!r} is absurdly large or small")
    return factor, Dimension(found)


def parse_value(value: object, unit: str) -> float:
    """The SI value of a quantity of an equation: "0.7 1/min", or 0.7 in the unit that was declared.

    Args:
        value: a number (taken to be in `unit`) or a string with a unit.
        unit: that was declared, e.g. "1/h"; "" for a plain number.

    Raises:
        ValueError: no unit, or a value that is not finite, absurdly large or of another dimension.
    """
    factor, dimension = parse_unit(unit)
    shown = f" [{unit.strip()}]" if unit.strip() else ""
    number = parse_quantity(value, unit.strip(), SIZES, f"{unit_meaning(dimension.text)}{shown}")
    # Never -0.
    return number * factor + 0.0


def quantity(value: object) -> tuple[float, Dimension]:
    """The SI value and the dimension of a quantity with the unit that it names: "0.7 1/min", "25", 25.

    Raises:
        ValueError: no number, no unit, or a value that is not finite or absurdly large.
    """
    found = NUMBER.match(value) if isinstance(value, str) else None
    unit = value[found.end() :].strip() if found is not None and isinstance(value, str) else ""
    return parse_value(value, unit), parse_unit(unit)[1]


def unit_of(text: str) -> tuple[str, float]:
    """The unit that a quantity is written with, and the factor to it from SI.

    Raises:
        ValueError: no quantity.
    """
    found = NUMBER.match(text)
    unit = text[found.end() :].strip() if found is not None else ""
    return unit, 1 / parse_unit(unit)[0]
