"""Numbers and names in words: the units a reader expects, lists, plurals."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence

DEGREES = 180.0 / math.pi
"""In a radian."""

Unit = tuple[str, float]
Form = Callable[[float], str]

LADDERS: dict[str, tuple[tuple[str, float, float], ...]] = {
    "m": (("m", 1.0, 1.0), ("mm", 1e3, 1e-4), ("µm", 1e6, 0.0)),
    "s": (("s", 1.0, 1.0), ("ms", 1e3, 0.0)),
    "m/m": (("mm/m", 1e3, 0.0),),
    "rad": (("deg", DEGREES, 0.0),),
    "rad/m": (("deg/m", DEGREES, 0.0),),
    "rad/s": (("deg/s", DEGREES, 0.0),),
}
"""SI unit -> units from coarse to fine, their factors, and the least size [SI] that they suit."""
OWN_UNITS: dict[str, Unit] = {
    "m": ("mm", 1e3),
    "s": ("ms", 1e3),
    "rad": ("deg", DEGREES),
    "rad/s": ("deg/s", DEGREES),
}
"""SI unit -> unit in which parameters and their errors are shown, so that lengths compare."""
MOST_DECIMALS = 9
"""Of a number beside its error: further ones are rounding of what was computed."""
MOST_MEANT = 3
"""Of more names that may have been meant none is proposed."""
SHORT = 3
"""Letters of the shortest beginning of a word that may stand for it."""
MISSING = "–"
"""What stands where there is no number."""


def significant(digits: int) -> Form:
    """Writes a number with that many significant digits, in powers of ten where it is very large or small."""

    def write(value: float) -> str:
        if value == 0 or not math.isfinite(value):
            return _special(value)
        exponent = math.floor(math.log10(abs(value)))
        if -4 <= exponent < 6:
            return f"{value:.{max(0, digits - 1 - exponent)}f}"
        mantissa, power = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa}e{int(power)}"

    return write


def fixed(decimals: int) -> Form:
    """Writes a number with that many decimals; never "-0"."""

    def write(value: float) -> str:
        return f"{round(value, decimals) + 0.0:.{decimals}f}" if math.isfinite(value) else _special(value)

    return write


def whole(value: float) -> str:
    """A count."""
    return fixed(0)(value)


def _special(value: float) -> str:
    if value == 0:
        return "0"
    return "undefined" if math.isnan(value) else "∞" if value > 0 else "-∞"


def unit_for(sizes: Iterable[float | None], unit: str) -> Unit:
    """The unit, and its factor from SI, in which most of these sizes [SI] are easily read."""
    known = sorted(abs(size) for size in sizes if size is not None)
    size = known[len(known) // 2] if known else 0.0
    ladder = LADDERS.get(unit, ((unit, 1.0, 0.0),))
    for shown, factor, least in ladder:
        if size >= least and size > 0:
            return shown, factor
    # Of nothing at all neither the coarsest nor the finest.
    return ladder[min(1, len(ladder) - 1)][:2]


def own_unit(unit: str | None) -> Unit:
    """The unit, and its factor from SI, in which a parameter and its errors are shown."""
    return OWN_UNITS.get(unit or "", (unit or "", 1.0))


def shown_unit(unit: str | None) -> str:
    """The unit in which a parameter is shown, "1" for none."""
    return unit_text(own_unit(unit)[0]) or "1"


def decimals_of(error: float | None) -> int | None:
    """Decimals down to an error's second digit; None where the error says nothing of that."""
    if error is None or not math.isfinite(error) or error <= 0:
        return None
    exponent = int(f"{error:.1e}".split("e")[1])
    return min(max(1 - exponent, 0), MOST_DECIMALS)


def to_error(value: float | None, error: float | None, factor: float = 1.0) -> str:
    """A number rounded to its error's second digit, both [SI] shown times a factor.

    Args:
        value: [SI].
        error: its standard error [SI].
        factor: to the unit shown.
    """
    if value is None:
        return MISSING
    decimals = decimals_of(None if error is None else error * factor)
    shown = value * factor
    if decimals is None or abs(shown) >= 1e6:
        return significant(5)(shown)
    return fixed(decimals)(shown)


def error_text(error: float | None, factor: float = 1.0) -> str:
    """An error's two digits."""
    if error is None:
        return MISSING
    return significant(2)(error * factor) if error * factor >= 1e6 else to_error(error, error, factor)


def nominal_text(value: float, error: float | None = None) -> str:
    """A nominal value in its unit: as somebody gave it, or one that was computed to its error's second digit,
    four digits of it where no error is known.
    """
    text = f"{value:.6g}"
    if math.isclose(float(text), value, rel_tol=1e-9):
        return text
    return f"{value:.4g}" if decimals_of(error) is None else to_error(value, error)


def deviation_text(size: float, unit: str, own: Unit | None = None) -> str:
    """A parameter's standard deviation [SI]: `0.30 mm`.

    Args:
        size: [SI].
        unit: SI unit.
        own: the unit in which the parameter is shown, and its factor from SI; a usual one by default.
    """
    shown, factor = own or own_unit(unit)
    return f"{error_text(size, factor)} {unit_text(shown)}".strip()


def size_text(size: float, unit: str, digits: int = 3) -> str:
    """A size [SI] in the unit that suits it: `45.2 mm`.

    Args:
        size: [SI].
        unit: SI unit.
        digits: that are shown.
    """
    shown, factor = unit_for([size], unit)
    return quantity(size * factor, shown, digits)


def excess_text(amount: float, unit: str, *, degrees: bool = False) -> str:
    """By how much a limit is exceeded: `45.2 mm`, `14.8 rad/s`.

    Args:
        amount: [SI].
        unit: SI unit.
        degrees: whether its angles are shown in degrees.
    """
    if degrees:
        unit, factor = in_degrees(unit)
        amount *= factor
    return size_text(amount, unit) if unit == "m" else quantity(amount, unit)


def chance_text(share: float) -> str:
    """A probability: `0.04 %`, `93.89 %`; finer where that would be 0."""
    size = 100.0 * share
    return f"{(fixed(2) if size >= 0.005 or size == 0 else significant(1))(size)} %"


def given_text(size: float, unit: str) -> str:
    """A quantity [SI] that somebody chose, without idle digits: `10 mm`, `2.5 deg`."""
    shown, factor = unit_for([size], unit)
    return f"{size * factor:.4g} {unit_text(shown)}".strip()


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """`49.0 mm`; just the number where there is no unit.

    Args:
        value: in `unit`.
        unit: to write after it.
        digits: significant ones.
    """
    return f"{significant(digits)(value)} {unit_text(unit)}".strip()


def in_degrees(unit: str) -> Unit:
    """The unit in which an angle, or its rate, is shown in degrees, and its factor from SI."""
    return unit.replace("rad", "deg", 1), DEGREES if unit.startswith("rad") else 1.0


def unit_text(unit: str) -> str:
    """A unit with raised exponents: rad/s^2 -> rad/s²."""
    return unit.replace("^2", "²").replace("^3", "³")


def in_signs(text: str) -> str:
    """A message with the signs of formulas that a page can show: F^-1 -> F⁻¹."""
    return text.replace("F^-1", "F⁻¹").replace("+-", "±")


def words(identifier: str) -> str:
    """wheel_speed -> wheel speed."""
    return identifier.replace("_", " ")


NAME = r"^\w[\w -]*$"
"""Pattern of names of results."""


def listing(items: Sequence[str]) -> str:
    """`a, b and c`."""
    return " and ".join(filter(None, [", ".join(items[:-1]), *items[-1:]]))


def did_you_mean(given: str, known: Iterable[str], closeness: float = 0.6) -> str:
    """`; did you mean track?` where a few that are known have the words of what was given, or begin so, or
    one is spelt alike; else "".

    Args:
        given: what is not known.
        known: names.
        closeness: of the spelling, from 0 to 1.
    """
    # Only mistakes need it.
    import difflib

    names, asked = {name.lower(): name for name in known}, _words_in(given)
    pairs = [(name, _words_in(name)) for name in names]
    begun = given.lower() if len(given) > MOST_MEANT else " "
    alike = [
        name
        for name, own in pairs
        if asked and own and (_begin(asked, own) or own <= asked or name.startswith(begun))
    ]
    alike = [name for name in alike if name == given.lower()] or alike
    if not 0 < len(alike) <= MOST_MEANT:
        alike = difflib.get_close_matches(given.lower(), names, n=1, cutoff=closeness)
    return f"; did you mean {' or '.join(names[name] for name in alike)}?" if alike else ""


def _begin(asked: set[str], own: set[str]) -> bool:
    # Whether every word that was asked for is a word of a name, or the beginning of one: diff_drive.
    return all(
        any(one == word or (len(word) >= SHORT and one.startswith(word)) for one in own) for word in asked
    )


def _words_in(name: str) -> set[str]:
    return set(re.findall(r"[^\W_]+", name.lower()))


def count(number: int, noun: str) -> str:
    """`1 start`, `12 starts`."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def slug(title: str) -> str:
    """A title as an anchor: lower case, words joined by hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")
