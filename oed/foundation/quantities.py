"""Physical quantities at the doors: strings with a unit become SI numbers.

Inside the package every number is SI (m, rad, s, kg, K, mol, A). Angles are a dimension of their own here,
so that a speed in Hz or a bare 1/s is not mistaken for rad/s.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from oed.foundation.shown import written

if TYPE_CHECKING:
    import pint

_DEFINITIONS = (
    "micro- = 1e-6 = u- = µ- = μ-",
    "milli- = 1e-3 = m-",
    "centi- = 1e-2 = c-",
    "deci- = 1e-1 = d-",
    "kilo- = 1e3 = k-",
    "nano- = 1e-9 = n-",
    "pico- = 1e-12 = p-",
    "meter = [length] = m = metre",
    "second = [time] = s = sec",
    "radian = [angle] = rad",
    "gram = [mass] = g",
    f"degree = {math.pi / 180!r} * radian = deg = °",
    f"revolution = {2 * math.pi!r} * radian = rev = turn",
    "minute = 60 * second = min",
    "hour = 3600 * second = h",
    "rpm = revolution / minute",
    "hertz = 1 / second = Hz",
    "inch = 0.0254 * meter = in",
    "foot = 0.3048 * meter = ft",
    "percent = 0.01 = %",
    "kelvin = [temperature] = K",
    "mole = [substance] = mol",
    "ampere = [current] = A",
    "day = 24 * hour = d",
    "liter = 1e-3 * meter ** 3 = l = L = litre",
    "molar = mole / liter = M",
    "newton = kilogram * meter / second ** 2 = N",
    "newtonmeter = newton * meter = Nm",
    "pascal = newton / meter ** 2 = Pa",
    "hectopascal = 100 * pascal = hPa",
    "megapascal = 1e6 * pascal = MPa",
    "bar = 1e5 * pascal",
    "joule = newton * meter = J",
    "megajoule = 1e6 * joule = MJ",
    "watt = joule / second = W",
    "megawatt = 1e6 * watt = MW",
    "watthour = watt * hour = Wh",
    "coulomb = ampere * second = C",
    "volt = watt / ampere = V",
    "ohm = volt / ampere",
    "siemens = 1 / ohm = S",
    "farad = coulomb / volt = F",
    "henry = volt * second / ampere = H",
)
"""No prefix mega: "Mm" and "Ms" are mistyped, and M is molar."""

_COMMON = {
    "%": (0.01, (0, 0, 0)),
    "m": (1.0, (1, 0, 0)),
    "cm": (1e-2, (1, 0, 0)),
    "mm": (1e-3, (1, 0, 0)),
    "km": (1e3, (1, 0, 0)),
    "rad": (1.0, (0, 1, 0)),
    "mrad": (1e-3, (0, 1, 0)),
    "deg": (math.pi / 180, (0, 1, 0)),
    "s": (1.0, (0, 0, 1)),
    "ms": (1e-3, (0, 0, 1)),
    "min": (60.0, (0, 0, 1)),
}
"""What studies are mostly written in: factor to SI, and powers of length, angle and time."""
UNITS_BY_NAME = {"position": "m", "heading": "rad"}
"""SI units of quantities that files speak of by their name alone."""
_QUOTIENT = re.compile(rf"({'|'.join(_COMMON)})(?:/(m|s)(?:\^([23]))?)?")
"""One of those, or a quotient such as "deg/s" and "m/s^2"; others are read by pint, which is slow to load."""

SMALLEST, LARGEST = 1e-12, 1e12
"""What a robot's quantities lie between, SI: what is larger is refused, what is smaller counts as 0."""
Sizes = tuple[float, float]
"""What the magnitudes of a quantity lie between, as `SMALLEST` and `LARGEST` of a robot's."""
_POWER = r"\s*(?:\^|\*\*)\s*(?:[+-]?[0-9]|\(\s*[+-]?[0-9]\s*(?:/\s*[1-9]\s*)?\))"
_FACTOR = rf"(?:[^\W\d_⁰¹²³⁴-⁹]+|[%°]|1)(?:{_POWER}|⁻?[¹²³⁴-⁹])?"
_TIMES = r"(?:\s*[*/]\s*|\s+)"
_PRODUCT = rf"{_FACTOR}(?:{_TIMES}{_FACTOR}){{0,7}}"
_GROUP = rf"(?:{_FACTOR}|\(\s*{_PRODUCT}\s*\)(?:{_POWER})?)"
_UNIT = re.compile(rf"{_GROUP}(?:{_TIMES}{_GROUP}){{0,7}}")
"""Names and their small powers, multiplied and divided. pint would take any arithmetic, and compute it."""

NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")

_COMMA = re.compile(r",\d")
_SEVERAL_SYMBOLS = re.compile(r"[A-Z][^\W\d_]*s(?![^\W\d_])")
"""What pint takes for several: "Pas" for pascals, though it is meant to be pascal seconds."""
_SCALE = re.compile(r"(?<![^\W\d_])(?:deg|°)\s?[CF](?![^\W\d_])|celsius|fahrenheit", re.IGNORECASE)
_CELSIUS = re.compile(r"(?:deg|°)\s?C|(?:degrees?\s)?celsius", re.IGNORECASE)
_FRACTION = re.compile(r"(?:\^|\*\*)\s*[+-]?[0-9]*(?:\.|/)[0-9]")
ZERO_CELSIUS = 273.15
"""[K]."""

_MEANINGS = {
    "m": "a length",
    "rad": "an angle",
    "s": "a time",
    "rad/s": "an angular speed",
    "rad/s^2": "an angular acceleration",
    "rad/s^3": "an angular jerk",
    "m/s": "a speed",
    "m/s^2": "an acceleration",
    "": "a plain number or a percentage",
    "m^2": "an area",
    "m^3": "a volume",
    "m^3/s": "a flow",
    "kg": "a mass",
    "kg/s": "a flow of mass",
    "kg/m^3": "a concentration by mass",
    "K": "a temperature",
    "mol": "an amount",
    "mol/m^3": "a concentration",
    "1/s": "a rate",
    "A": "a current",
    "V": "a voltage",
    "N": "a force",
    "Pa": "a pressure",
    "J": "an energy",
    "W": "a power",
}


@lru_cache(maxsize=1)
def _registry() -> pint.UnitRegistry[float]:
    import pint

    registry: pint.UnitRegistry[float] = pint.UnitRegistry(None)
    for definition in _DEFINITIONS:
        registry.define(definition)
    return registry


def parse_quantity(value: object, unit: str, sizes: Sizes = (SMALLEST, LARGEST), meaning: str = "") -> float:
    """The SI value of a quantity such as "4.9 cm" or 0.049, expected in the dimension of `unit`.

    Magnitudes below the smallest are rounding's, and count as 0: what must be positive is refused for it.

    Args:
        value: a number (taken to be in `unit`) or a string with a unit.
        unit: the SI unit expected, e.g. "rad/s"; "" for a plain number.
        sizes: smallest and largest magnitude; those of a robot unless others are given.
        meaning: what is expected, for errors, where `unit` need not be SI.

    Raises:
        ValueError: not a finite number, one beyond the largest, an unknown unit, or a unit of another
            dimension.
    """
    smallest, largest = sizes
    expected = f"expected {meaning or _meaning(unit)}"
    value = value.item() if isinstance(value, np.integer | np.floating) else value
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"{expected}, got {written(value)}")
    number = _parse_string(value, unit, expected) if isinstance(value, str) else value
    if isinstance(number, float) and not math.isfinite(number):
        raise ValueError(f"{expected} that is finite, got {written(value)}")
    if abs(number) > largest:
        units = "" if meaning else " in SI units"
        raise ValueError(f"{expected} of at most {largest:g}{units}, got {written(value)}")
    return float(number) if abs(number) >= smallest else 0.0


def parse_size(value: object, nominal: float, unit: str, what: str = "amount") -> float:
    """The SI value of a positive size: a quantity such as "1 mm", or a share of a nominal value as "2 %".

    Args:
        value: a number (taken as SI) or a string.
        nominal: what a share is of, SI.
        unit: the SI unit expected.
        what: it is, for errors.

    Raises:
        ValueError: not positive, a share of nothing, or as `parse_quantity` has it.
    """
    size = parse_quantity(value, "") * abs(nominal) if is_share(value) else parse_quantity(value, unit)
    if is_share(value) and not nominal:
        raise ValueError(
            f"a share of a nominal value of 0 is nothing; give an amount{unit and f' in {unit}'}"
        )
    if not size > 0:
        raise ValueError(f"expected a positive {what}, got {written(value)}{counts_as_zero(value)}")
    return size


def is_share(value: object) -> bool:
    """Whether a quantity is written as a percentage."""
    return isinstance(value, str) and value.strip().endswith("%")


def plain_number(text: str) -> float | None:
    """The number that a text is, not-a-number and infinities included; None if none.

    Nor are "1_0" and foreign digits, which only Python takes for numbers.
    """
    try:
        return float(text) if text.isascii() and "_" not in text else None
    except ValueError:
        return None


def too_large(value: float) -> str:
    """Why a number beyond `LARGEST` is refused."""
    return f"expected a number of at most {LARGEST:g} in SI units, got {value:.3g}"


def counts_as_zero(value: object) -> str:
    """Why a number above 0 is refused as if it were 0; "" where that is not so."""
    match = NUMBER.match(str(value)) if isinstance(value, int | float | str) else None
    above = match is not None and float(match.group()) > 0
    return f"; less than {SMALLEST:g} in SI units counts as 0" if above else ""


def _parse_string(text: str, unit: str, expected: str) -> float:
    match = NUMBER.match(text)
    if match is None:
        raise ValueError(f"{expected}, got {text!r}, which does not begin with a number")
    number, unit_text = float(match.group()), text[match.end() :].strip()
    if not unit_text:
        return number
    factor = _common_factor(unit_text, unit)
    return number * (_factor(text, unit_text, unit, expected) if factor is None else factor)


def _common_factor(text: str, unit: str) -> float | None:
    # To `unit` of units such as "cm", "deg/s" or "rad/s^2" in its dimension; None for any other text.
    found, wanted = _common_unit(text), _common_unit(unit or "%")
    if found is None or wanted is None or found[1] != wanted[1]:
        return None
    return found[0] / wanted[0] if unit else found[0]


@lru_cache(maxsize=256)
def _common_unit(text: str) -> tuple[float, tuple[int, int, int]] | None:
    # Factor to SI, and powers of length, angle and time.
    match = _QUOTIENT.fullmatch(text)
    if match is None:
        return None
    numerator, denominator, power = match.groups()
    factor, (length, angle, time) = _COMMON[numerator]
    times = int(power or 1) if denominator else 0
    return factor, (length - times * (denominator == "m"), angle, time - times * (denominator == "s"))


def _factor(text: str, unit_text: str, unit: str, expected: str) -> float:
    issue = unit_issue(unit_text)
    if issue:
        celsius = _CELSIUS.fullmatch(unit_text) and NUMBER.match(text)
        instead = f": {float(celsius.group()) + ZERO_CELSIUS:.10g} K" if celsius else ""
        raise ValueError(f"{expected}, got {text!r}, whose unit {issue}{instead}")
    # Imported late, for it takes longer than all the rest of reading a study.
    import pint

    try:
        return float(_one(unit_text).to(unit or "dimensionless").magnitude)
    except pint.DimensionalityError:
        raise ValueError(f"{expected}, got {text!r}, whose unit is of another kind") from None
    except Exception:
        # What is expected is no unit itself.
        raise ValueError(f"{expected}, got {text!r}, whose unit {unit_text!r} is not known") from None


def unit_issue(text: str) -> str:
    """What is wrong with the text of a unit, to be put after "unit"; "" if it is one."""
    if _SCALE.search(text):
        return f"{text!r} is no multiple of a unit; write temperatures in K"
    unknown = f"{text!r} is not known"
    if _COMMA.match(text):
        return f"{unknown}; decimals need a point"
    if _FRACTION.search(text):
        return f"{unknown}; powers are whole numbers, or written as m^(1/2)"
    if _SEVERAL_SYMBOLS.search(text):
        return f"{unknown}; products are written with a space, as 'Pa s'"
    if _UNIT.fullmatch(text) is None:
        return unknown
    try:
        _one(text)
    except Exception:
        # pint reports malformed unit text with a variety of exceptions, tokenizer errors among them.
        return unknown
    return ""


def base_units(text: str) -> tuple[float, dict[str, float]]:
    """Of a valid unit, the factor to the registry's base units, and the powers of these by name."""
    one = _one(text).to_base_units()
    return float(one.magnitude), {str(name): float(str(power)) for name, power in one.unit_items()}


def _one(unit_text: str) -> pint.Quantity[float]:
    registry = _registry()
    return registry.Quantity(1.0, registry.parse_units(unit_text))


def unit_meaning(unit: str) -> str:
    """What has this SI unit: "a length", "a quantity in m/K"."""
    return _MEANINGS.get(unit, f"a quantity in {unit}")


def _meaning(unit: str) -> str:
    return f"{unit_meaning(unit)} [{unit}]" if unit else unit_meaning(unit)


@dataclass(frozen=True)
class Unit:
    """Pydantic annotation: a float given as SI number or as a string with a unit of this dimension."""

    si: str
    example: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Parse the unit before the float's own validation."""
        return core_schema.no_info_before_validator_function(
            lambda value: parse_quantity(value, self.si), handler(source)
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> Mapping[str, Any]:
        """A number or a string, for editors."""
        bounds = handler(schema)
        number = {key: bounds[key] for key in bounds if key != "title"}
        description = f"{_meaning(self.si)}, for instance {self.example!r}; a bare number is SI"
        return {"anyOf": [number, {"type": "string"}], "description": description}


Length = Annotated[float, Unit("m", "4.9 cm")]
Angle = Annotated[float, Unit("rad", "10 deg")]
Duration = Annotated[float, Unit("s", "20 s")]
AngularSpeed = Annotated[float, Unit("rad/s", "10 rad/s")]
LengthPerYawRate = Annotated[float, Unit("m*s/rad", "3 mm*s/rad")]
Ratio = Annotated[float, Unit("", "5 %")]
Size = Annotated[float, Field(strict=True)] | str
"""What `parse_size` takes, once it is known of what."""


def require_covariance(rows: Sequence[Sequence[float]]) -> None:
    """Check that nested rows are a covariance matrix.

    Raises:
        ValueError: not square, not finite, not symmetric or not positive definite.
    """
    if any(len(row) != len(rows) for row in rows):
        raise ValueError(f"expected a square matrix, got rows of {sorted({len(row) for row in rows})}")
    matrix = np.array(rows, dtype=float)
    sizes = np.sqrt(np.abs(np.diag(matrix)))
    if np.all(np.isfinite(matrix)) and np.all(sizes > 0):
        # Scaled alike, so that units do not matter.
        scaled = matrix / np.outer(sizes, sizes)
        if np.allclose(scaled, scaled.T, atol=1e-9) and np.linalg.eigvalsh(scaled)[0] > 0:
            return
    raise ValueError("expected a symmetric, positive definite covariance matrix of finite numbers")
