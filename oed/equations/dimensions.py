"""Dimensions of quantities: powers of SI base units, from units and for messages.

Angles are a dimension, as they are at the package's doors: "10 Hz" is no value of what is in rad/s. In
equations radians count as plain numbers, as in SI, or a torque over an inertia would be no angular
acceleration and v = r omega no speed: there dimensions are compared by `fits`, which looks past angles.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from math import inf

from oed.foundation.quantities import NUMBER, base_units, parse_quantity, unit_issue, unit_meaning

BASE = ("kg", "A", "rad", "m", "s", "mol", "K")
"""SI base units, in the order in which texts have them."""
_NAMES = ("gram", "ampere", "radian", "meter", "second", "mole", "kelvin")
FINEST = 1_000_000
"""Largest denominator of a power: 0.333... means 1/3."""
SIZES = (0.0, 1e100)
"""Smallest and largest magnitude of values in equations, in their unit: small ones are no rounding errors."""
GRAM = 1e-3
"""Mass of a gram [kg]."""
Quantity = float | str
"""A number, or text with a unit."""


@dataclass(frozen=True)
class Dimension:
    """Powers of the SI base units `BASE`; those of a plain number by default."""

    powers: tuple[Fraction, ...] = (Fraction(0),) * len(BASE)

    @property
    def plain(self) -> bool:
        """True for plain numbers and for angles."""
        return self.fits(PLAIN)

    @cached_property
    def text(self) -> str:
        """SI unit as it is written: "mol/m^3/s", "W/K", "rad/s", ""; with the unit's own name where there is
        nothing else but "per kelvin" or "per mole".
        """
        names, rest = list[str](), self
        for name, named in NAMED.items():
            quotient = self / named
            if all(
                power == 0 or (power < 0 and unit in ("mol", "K"))
                for unit, power in zip(BASE, quotient.powers, strict=True)
            ):
                names, rest = [name], quotient
        over, under = names, list[str]()
        for unit, power in zip(BASE, rest.powers, strict=True):
            size = abs(power)
            exponent = f"^{size}" if size.denominator == 1 else f"^({size})"
            if power:
                (over if power > 0 else under).append(unit if size == 1 else unit + exponent)
        return "/".join([" ".join(over) or "1", *under]) if under else " ".join(over)

    @property
    def words(self) -> str:
        """Unit in a sentence: "in mol/m^3/s", or "a plain number"."""
        return f"in {self.text}" if self.text else "a plain number"

    def fits(self, expected: Dimension) -> bool:
        """Compare two dimensions, radians counting as plain numbers."""
        powers = zip(BASE, (self / expected).powers, strict=True)
        return not any(power for unit, power in powers if unit != "rad")

    def __mul__(self, factor: Dimension) -> Dimension:
        """Return the dimension of a product."""
        pairs = zip(self.powers, factor.powers, strict=True)
        return Dimension(tuple(first + second for first, second in pairs))

    def __truediv__(self, divisor: Dimension) -> Dimension:
        """Return the dimension of a quotient."""
        pairs = zip(self.powers, divisor.powers, strict=True)
        return Dimension(tuple(first - second for first, second in pairs))

    def __pow__(self, power: Fraction | float) -> Dimension:
        """Return the dimension of a power."""
        exact = Fraction(power).limit_denominator(FINEST)
        return Dimension(tuple(exact * exponent for exponent in self.powers))

    def __str__(self) -> str:
        """Write the SI unit."""
        return self.text


def _dimension(**powers: int) -> Dimension:
    return Dimension(tuple(Fraction(powers.get(unit, 0)) for unit in BASE))


PLAIN = Dimension()
"""Dimension of plain numbers."""
ANGLE, TIME = _dimension(rad=1), _dimension(s=1)
NAMED = {
    "N": _dimension(kg=1, m=1, s=-2),
    "Pa": _dimension(kg=1, m=-1, s=-2),
    "J": _dimension(kg=1, m=2, s=-2),
    "W": _dimension(kg=1, m=2, s=-3),
    "V": _dimension(kg=1, A=-1, m=2, s=-3),
}
"""Units with names of their own, and their dimensions."""


@lru_cache(maxsize=256)
def parse_unit(text: str) -> tuple[float, Dimension]:
    """Return the factor to SI and the dimension of a unit: "mol/l", "1/s", "m^2", "K", "J/mol/K", "%", "".

    Raises:
        ValueError: no unit, or a temperature in degrees Celsius.
    """
    unit = text.strip()
    issue = unit_issue(unit) if unit else ""
    if issue:
        raise ValueError(f"unit {issue}")
    try:
        factor, powers = base_units(unit)
        exact = [Fraction(powers.get(name, 0.0)).limit_denominator(FINEST) for name in _NAMES]
        # The registry counts in grams.
        factor *= GRAM ** float(exact[0])
    except OverflowError:
        factor = inf
    if not 1 / SIZES[1] <= factor <= SIZES[1]:
        raise ValueError(f"unit {text!r} is absurdly large or small")
    return factor, Dimension(tuple(exact))


def quantity(value: object) -> tuple[float, Dimension]:
    """Return the SI value and the dimension of a quantity with its unit: "0.7 1/min", "25", 25.

    Raises:
        ValueError: no number, no unit, or a value that is not finite or absurdly large.
    """
    unit = _unit_in(value)
    factor, dimension = parse_unit(unit)
    meaning = unit_meaning(dimension.text) + (unit and f" [{unit}]")
    # Never -0.
    return parse_quantity(value, unit, SIZES, meaning) * factor + 0.0, dimension


def expect_quantity(value: Quantity, expected: Dimension, message: str) -> float:
    """Return the SI value of a quantity that must have a dimension.

    Args:
        value: the quantity as it is written.
        expected: the dimension.
        message: error with the gaps {expected} and {got} for both dimensions.

    Raises:
        ValueError: no quantity, or one of another dimension.
    """
    number, dimension = quantity(value)
    if not dimension.fits(expected):
        raise ValueError(message.replace("{expected}", expected.words).replace("{got}", dimension.words))
    return number


def rising(sides: Quantity | tuple[Quantity, Quantity]) -> tuple[float, float]:
    """Return the SI values of a range; one quantity stands for both directions.

    Raises:
        ValueError: no quantities, or the second is not the larger.
    """
    if not isinstance(sides, tuple):
        largest, _ = quantity(sides)
        if not largest > 0:
            raise ValueError(f"expected a value above 0, got {sides}")
        return -largest, largest
    low, high = (quantity(side)[0] for side in sides)
    if not low < high:
        raise ValueError(f"expected [least, largest], got {list(sides)}")
    return low, high


def unit_of(text: str) -> tuple[str, float]:
    """Return the unit that a quantity is written with, and the factor to it from SI.

    Raises:
        ValueError: no quantity.
    """
    unit = _unit_in(text)
    return unit, 1 / parse_unit(unit)[0]


def _unit_in(value: object) -> str:
    number = NUMBER.match(value) if isinstance(value, str) else None
    return number.string[number.end() :].strip() if number else ""
