"""Units are followed through expressions; what does not go together is named, and where it stands."""

from __future__ import annotations

import pytest

from oed.equations.dimensions import Dimension, parse_unit
from oed.equations.grammar import ExpressionError, parse

UNITS = {
    "x": "mol/l/s", "y": "mol/l", "tau": "s", "n": "", "T": "K", "E": "J/mol", "R": "J/mol/K", "theta": "rad",
    "omega": "rad/s", "r": "m", "v": "m/s", "g": "m/s^2", "M": "N m", "J": "kg m^2", "f": "Hz", "zeta": "%",
}  # fmt: skip
DIMENSIONS = {name: parse_unit(unit)[1] for name, unit in UNITS.items()}


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("x * tau + y", "mol/l"),
        ("n*x*exp(-E/(R*T))", "g mol/l/s/g"),
        ("2*y + 0", "mol/l"),
        ("0 - y", "mol/l"),
        ("max(0, y, -y)", "mol/l"),
        ("sqrt(y)*y^0.5", "mol/l"),
        ("y^(1/3)*y^(2/3)", "mol/l"),
        ("y^-2", "l^2/mol^2"),
        ("(x*tau/y)^n", ""),
        ("n^theta", ""),
        ("abs(-y)/y", ""),
        ("log10(y/(x*tau)) + zeta", ""),
        ("1 + sin(theta) + cos(n) + tan(omega*tau)", ""),
        ("asin(n) + acos(n) + theta", "rad"),
        ("atan2(y, x*tau)", "rad"),
        ("v + r*omega", "m/s"),
        ("-g/r*sin(theta)", "rad/s^2"),
        ("M/J", "rad/s^2"),
        ("omega + 2*pi*f", "rad/s"),
        ("sqrt(g/r)", "1/s"),
        ("0*r", "m"),
        ("0^2 + sqrt(4)", ""),
    ],
)
def test_dimensions(text: str, unit: str):
    expected = parse_unit(unit)[1]
    found = parse(text).dimension(DIMENSIONS)
    assert isinstance(found, Dimension)
    assert found.fits(expected)
    parse(text).require(expected, DIMENSIONS)


@pytest.mark.parametrize("text", ["0", "-0.0", "sqrt(0) + abs(0)", "min(0, -0)"])
def test_a_bare_0_suits_any_dimension(text: str):
    assert parse(text).dimension({}) is None
    parse(text).require(DIMENSIONS["x"], {})


@pytest.mark.parametrize(
    ("text", "offending", "message"),
    [
        ("x / tau + y", "y", "x / tau is in mol/m^3/s^2, y is in mol/m^3: they cannot be added"),
        ("2*(y -\n x)", "x)", "y is in mol/m^3, x is in mol/m^3/s: they cannot be subtracted"),
        ("y + 1", "1", "y is in mol/m^3, 1 is a plain number: they cannot be added"),
        ("0 + n + y", "y", "n is a plain number, y is in mol/m^3: they cannot be added"),
        ("v + omega", "omega", "v is in m/s, omega is in rad/s: they cannot be added"),
        ("min(0, y, x)", "x)", "y is in mol/m^3, x is in mol/m^3/s: they cannot be compared"),
        ("1 + atan2(x, y)", "y)", "x is in mol/m^3/s, y is in mol/m^3: they cannot be compared"),
        ("exp(-E/R)", "-E/R", "-E/R is in K: exp takes a plain number"),
        ("3*log(y)", "y)", "y is in mol/m^3: log takes a plain number"),
        ("sin(tau)", "tau", "tau is in s: sin takes an angle or a plain number"),
        ("tanh(1) * asin( v )", "v )", "v is in m/s: asin takes a plain number"),
        ("n^y", "y", "y is in mol/m^3: an exponent is a plain number"),
        ("y^n", "n", "y is in mol/m^3: its exponent must be a number, not n"),
        ("y^(2*n)", "2*n", "y is in mol/m^3: its exponent must be a number, not 2*n"),
        ("y^1000", "1000", "y is in mol/m^3: its exponent must be a number of at most 100, not 1000"),
        ("n^(y + x)", "x)", "y is in mol/m^3, x is in mol/m^3/s: they cannot be added"),
        ("tau - sqrt(y)", "sqrt", "tau is in s, sqrt(y) is in mol^(1/2)/m^(3/2): they cannot be subtracted"),
        ("tau*tau*tau*tau*tau*tau*tau*tau*tau*tau*tau*tau + n", "n",
         "tau*tau*tau*tau*tau*tau*tau*tau*tau*t... is in s^12, n is a plain number: they cannot be added"),
    ],
)  # fmt: skip
def test_what_does_not_go_together_is_refused(text: str, offending: str, message: str):
    with pytest.raises(ExpressionError) as caught:
        parse(text).dimension(DIMENSIONS)
    assert caught.value.message == message
    assert text[caught.value.offset :].startswith(offending)


def test_another_dimension_than_expected_is_refused():
    for text, expected, message in (
        (" x / tau", "y", "x / tau is in mol/m^3/s^2, expected mol/m^3"),
        (" r", "n", "r is in m, expected a plain number"),
        (" 1", "v", "1 is a plain number, expected m/s"),
    ):
        with pytest.raises(ExpressionError) as caught:
            parse(text).require(DIMENSIONS[expected], DIMENSIONS)
        assert (caught.value.message, caught.value.offset) == (message, 1)
