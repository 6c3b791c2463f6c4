"""Expressions mean what NumPy makes of them; whatever is none is refused with where it goes wrong."""

from __future__ import annotations

import math
import pickle
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from oed.equations.dimensions import PLAIN
from oed.equations.functions import FUNCTIONS
from oed.equations.grammar import DEEPEST, LONGEST, RESERVED, ExpressionError, name_issue, parse

Tree = tuple[Any, ...]
NUMPY = {
    **{name: getattr(np, name) for name in ("exp", "log", "log10", "sqrt", "sin", "cos", "tan")},
    **{name: getattr(np, name) for name in ("sinh", "cosh", "tanh", "abs")},
    **{"asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "atan2": np.arctan2},
    **{"min": np.minimum, "max": np.maximum},
}
SIGNS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "^": np.power}
LEVELS = {"+": (1, 1, 2), "-": (1, 1, 2), "*": (2, 2, 3), "/": (2, 2, 3), "^": (4, 5, 3), "neg": (3, 3)}
"""How strongly each binds, and how strongly its operands must to need no parentheses."""
NAMES = ("x", "_y1", "Tau")

LEAVES = st.one_of(
    st.sampled_from(["1", "2", "3.", ".5", "0.25", "1e-1", "2.5E+1", "pi"]).map(
        lambda text: ("number", text)
    ),
    st.sampled_from(NAMES).map(lambda name: ("name", name)),
)


def grown(inner: st.SearchStrategy[Tree]) -> st.SearchStrategy[Tree]:
    pairs = [name for name in FUNCTIONS if FUNCTIONS[name].least == 2]
    singles = [name for name in FUNCTIONS if FUNCTIONS[name].least == 1]
    return st.one_of(
        st.tuples(st.sampled_from(list(SIGNS)), inner, inner),
        st.tuples(st.just("neg"), inner),
        st.tuples(st.sampled_from(singles), inner),
        st.tuples(st.sampled_from(pairs), inner, inner),
    )


TREES = st.recursive(LEAVES, grown, max_leaves=12)
VALUES = st.lists(st.floats(-3, 3).filter(lambda value: abs(value) > 1e-2), min_size=3, max_size=3)


def written(tree: Tree, glue: str, power: str, needed: int = 0) -> str:
    """With as few parentheses as will do."""
    kind, *rest = tree
    if kind in ("number", "name"):
        return str(rest[0])
    if kind in NUMPY:
        return f"{kind}({glue}{f'{glue},'.join(written(one, glue, power) for one in rest)})"
    level, *levels = LEVELS[kind]
    parts = [written(one, glue, power, least) for one, least in zip(rest, levels, strict=True)]
    sign = f"{glue}{power if kind == '^' else kind}{glue}"
    text = f"-{glue}{parts[0]}" if kind == "neg" else sign.join(parts)
    return f"({text})" if level < needed else text


def computed(tree: Tree, values: dict[str, float], jitter: np.random.Generator | None = None) -> Any:
    """By NumPy; with relative errors of 1e-12 in every step, if `jitter` is given."""
    kind, *rest = tree
    if kind == "number":
        return np.float64(math.pi if rest[0] == "pi" else float(rest[0]))
    if kind == "name":
        return np.float64(values[rest[0]])
    parts = [computed(one, values, jitter) for one in rest]
    found = -parts[0] if kind == "neg" else (SIGNS | NUMPY)[kind](*parts)
    return found if jitter is None else found * (1 + 1e-12 * jitter.uniform(-1, 1))


def constants(tree: Tree) -> bool:
    return tree[0] != "name" and (tree[0] == "number" or all(map(constants, tree[1:])))


def endless(tree: Tree) -> bool:
    """Whether some part without names is no finite number."""
    if tree[0] in ("number", "name"):
        return False
    return (constants(tree) and not np.isfinite(computed(tree, {}))) or any(map(endless, tree[1:]))


def evaluated(text: str, kind: Any, values: dict[str, float]) -> float:
    expression = parse(text)
    if kind is ca.DM:
        return float(expression.casadi(values))
    symbols = {name: kind.sym(name) for name in values}
    function = ca.Function("f", list(symbols.values()), [expression.casadi(symbols)])
    return float(function(*values.values()))


@pytest.mark.slow
@settings(max_examples=100)
@given(
    TREES, VALUES, st.sampled_from(["", " ", "\n  ", "\t"]), st.sampled_from(["^", "**"]), st.integers(0, 99)
)
def test_expressions_are_what_numpy_computes(
    tree: Tree, numbers: list[float], glue: str, power: str, seed: int
):
    text, values = written(tree, glue, power), dict(zip(NAMES, numbers, strict=True))
    jitter = np.random.default_rng(seed)
    with np.errstate(all="ignore"):
        if endless(tree):
            with pytest.raises(ExpressionError, match="no finite number"):
                parse(text)
            return
        expected = computed(tree, values)
        others = [computed(tree, values, jitter) for _ in range(5)]
    assume(np.isfinite(expected))
    # Where rounding decides there is nothing to compare.
    spread = max(abs(one - expected) for one in others)
    assume(spread <= 1e-8 * (1 + abs(expected)))
    for kind in (ca.SX, ca.MX, ca.DM):
        assert evaluated(text, kind, values) == pytest.approx(expected, rel=1e-12, abs=10 * spread + 1e-300)


def test_powers_and_signs_bind_as_in_python():
    for text in (
        "-2**2",
        "2**-1",
        "2**3**2",
        "-2**-2",
        "1-2-3",
        "8/4/2",
        "8/4*2",
        "2*-3",
        "- -1",
        "+1-+1",
        "2--1",
    ):
        assert parse(text).constant == eval(text)


@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
def test_derivatives_are_differences(kind: Any):
    wrong = [text for text in SLOPING if not slopes_are_differences(text, kind)]
    assert wrong == []


SLOPING = [
    *(f"{name}(x)" for name in FUNCTIONS if FUNCTIONS[name].most == 1),
    "atan2(x, 0.3)", "atan2(0.3, x)", "min(x, 0.2, 0.9)", "max(0.35, x)", "x^3", "x^-2", "x^0.5", "2^x",
    "x^x", "1/x", "abs(-x)",
]  # fmt: skip


def slopes_are_differences(text: str, kind: Any) -> bool:
    x = kind.sym("x")
    expression = parse(text).casadi({"x": x})
    value, slope = (ca.Function("f", [x], [one]) for one in (expression, ca.jacobian(expression, x)))
    return all(
        float(slope(point))
        == pytest.approx(float(value(point + 1e-5) - value(point - 1e-5)) / 2e-5, rel=1e-6, abs=1e-8)
        for point in (0.1, 0.3, 0.7)
    )


def test_powers_of_negative_numbers_have_derivatives():
    x = ca.SX.sym("x")
    slope = ca.Function("f", [x], [ca.jacobian(parse("x^3 - x^2").casadi({"x": x}), x)])
    assert [float(slope(point)) for point in (-1.0, 0.0)] == [5.0, 0.0]


def test_the_least_and_largest_of_several():
    values = {"x": 3.0, "y": -2.0, "z": 1.0}
    assert [float(parse(f"{name}(y, z, x)").casadi(values)) for name in ("min", "max")] == [-2.0, 3.0]
    assert [float(parse(f"{name}(z, x, y)").casadi(values)) for name in ("min", "max")] == [-2.0, 3.0]


def test_a_number_is_one_in_casadi_too():
    found = parse("2*pi").casadi({})
    assert isinstance(found, ca.DM)
    assert parse("2*pi").constant == float(found) == 2 * math.pi
    assert parse("x + 1").constant is None
    assert float(parse("x*y").casadi({"x": 2, "y": 0.5})) == 1.0


def test_names_and_where_they_are_first():
    expression = parse("k*exp(-E/(R*T)) *\n c - k + lambda")
    assert expression.names == {"k": 0, "E": 7, "R": 10, "T": 12, "c": 19, "lambda": 27}
    assert list(expression.names) == ["k", "E", "R", "T", "c", "lambda"]


def test_expressions_and_their_errors_go_to_other_processes():
    expression = parse("sqrt(x) + 1")
    assert pickle.loads(pickle.dumps(expression)) == expression
    error = pickle.loads(pickle.dumps(ExpressionError("no", 3)))
    assert (error.message, error.offset, str(error)) == ("no", 3, "no")


REFUSED = [
    ("", 0, "expected a number, a name or '(', got the end"),
    (" \n ", 0, "expected a number, a name or '(', got the end"),
    ("x +", 3, "expected a number, a name or '(', got the end"),
    ("x + \n * y", 6, "expected a number, a name or '(', got '*'"),
    ("()", 1, "expected a number, a name or '(', got ')'"),
    ("x//y", 2, "expected a number, a name or '(', got '/'"),
    ("2 x", 2, "expected a sign between '2' and 'x'; products are written 2*x"),
    ("1_000", 1, "expected a sign between '1' and '_000'"),
    ("0x10", 1, "expected a sign between '0' and 'x10'"),
    ("1j", 1, "expected a sign between '1' and 'j'"),
    ("1.2.3", 3, "expected a sign between '1.2' and '.3'"),
    ("x if y else z", 2, "expected a sign between 'x' and 'if'"),
    ("not x", 4, "expected a sign between 'not' and 'x'"),
    ("lambda: x", 6, "':' has no meaning here"),
    ("(x := 1)", 3, "':' has no meaning here"),
    ("(x", 0, "'(' is never closed"),
    ("2 + min(1, (2)", 7, "'(' is never closed"),
    ("x)", 1, "')' closes nothing"),
    ("1,5", 1, "',' has no meaning here; decimals need a point"),
    ("(x, y)", 2, "',' has no meaning here; decimals need a point"),
    ("2*sin", 5, "sin is a function: expected '(' after it"),
    ("sin x", 3, "sin is a function: expected '(' after it"),
    ("sin()", 0, "sin takes 1 argument, got 0"),
    ("sin(x, y)", 0, "sin takes 1 argument, got 2"),
    ("1 + atan2(x)", 4, "atan2 takes 2 arguments, got 1"),
    ("min(x)", 0, "min takes 2 to 100 arguments, got 1"),
    ("min(" + "x," * 100 + "x)", 0, "min takes 2 to 100 arguments, got 101"),
    ("ln(x)", 0, "'ln' is no function; did you mean log?"),
    ("pow(x, 2)", 0, "'pow' is no function; did you mean ^?"),
    ("Exp(x)", 0, "'Exp' is no function; did you mean exp?"),
    ("2*k(x + 1)", 2, "'k' is no function; products are written k*(...)"),
    ("pi(x)", 0, "'pi' is no function"),
    ("y = x", 2, "'=' has no meaning here; an expression is one side of an equation"),
    ("x < 1", 2, "'<' has no meaning here; nothing is compared here"),
    ("x[0]", 1, "'[' has no meaning here; nothing has an index"),
    ("[x for x in y]", 0, "'[' has no meaning here; nothing has an index"),
    ("x.__class__", 1, "'.' has no meaning here; nothing has parts"),
    ("().__class__", 2, "'.' has no meaning here; nothing has parts"),
    ("__import__('os')", 11, '"\'" has no meaning here; texts are no numbers'),
    ("x # a note", 2, "'#' has no meaning here; there are no comments inside"),
    ("x % y", 2, "'%' has no meaning here; write shares as 0.05"),
    ("x @ y", 2, "'@' has no meaning here"),
    ("{x}", 0, "'{' has no meaning here"),
    ("x +\\\n y", 3, "'\\\\' has no meaning here"),
    ("x; y", 1, "';' has no meaning here"),
    ("x\x00", 1, "'\\x00' has no meaning here"),
    ("x·y", 1, "'·' has no meaning here; write *"),
    ("x²", 1, "'²' has no meaning here; write ^2"),
    ("1 − x", 2, "'−' has no meaning here; write -"),
    ("x\u00a0+ 1", 1, "'\\xa0' (NO-BREAK SPACE) has no meaning here; names are of letters A to Z"),
    ("b + \u0430", 4, "'\\u0430' (CYRILLIC SMALL LETTER A) has no meaning here; names are of letters A to Z"),
    ("\ufb01", 0, "'\\ufb01' (LATIN SMALL LIGATURE FI) has no meaning here"),
    ("\uff11", 0, "'\\uff11' (FULLWIDTH DIGIT ONE) has no meaning here"),
    ("\u0663", 0, "'\\u0663' (ARABIC-INDIC DIGIT THREE) has no meaning here"),
    ("\ud800", 0, "'\\ud800' (a character without a name) has no meaning here"),
    ("1e999", 0, "1e999 is no finite number"),
    ("x + 9**9**9", 4, "9**9**9 is no finite number"),
    ("9^9^9^9^9^9", 6, "9^9^9 is no finite number"),
    ("x*(1/0)", 3, "1/0 is no finite number"),
    ("2*log(0)", 2, "log(0) is no finite number"),
    ("sqrt(-1)", 0, "sqrt(-1) is no finite number"),
    ("(-8)^(1/3)", 0, "(-8)^(1/3) is no finite number"),
    ("1e-400", 0, "1e-400 is too small a number"),
    ("9" * 400, 0, "is no finite number"),
    ("-" * 5000 + "x", DEEPEST, f"nested more than {DEEPEST} deep"),
    ("(" * 4000 + "x" + ")" * 4000, DEEPEST, f"nested more than {DEEPEST} deep"),
    ("x^" * 4000 + "x", 2 * DEEPEST, f"nested more than {DEEPEST} deep"),
    ("sin(" * 2000 + "x", 4 * DEEPEST, f"nested more than {DEEPEST} deep"),
    ("x" * (LONGEST + 1), LONGEST, f"expected at most {LONGEST} characters, got {LONGEST + 1}"),
]  # fmt: skip


def refusal_of(text: str) -> ExpressionError | None:
    try:
        parse(text)
    except ExpressionError as error:
        return error
    return None


def test_what_is_no_expression_is_refused():
    wrong = []
    for text, offset, message in REFUSED:
        error = refusal_of(text)
        told = error is not None and message in error.message and error.offset == offset
        short = told and len(error.message) < 150
        if not short or not (error.message.isascii() or text[offset] in error.message):
            wrong.append((text[:40], error and (error.offset, error.message)))
    assert wrong == []


@pytest.mark.slow
@settings(max_examples=200)
@given(st.text(st.sampled_from("x2. +-*/^(),esinpi_\n'=é\u0430\x00\ud800"), max_size=20))
def test_any_text_is_read_or_refused(text: str):
    try:
        expression = parse(text)
    except ExpressionError as error:
        offset = error.offset
    else:
        offset = 0
        expression.casadi(dict.fromkeys(expression.names, ca.SX.sym("x")))
    assert 0 <= offset <= len(text)


@pytest.mark.slow
def test_what_is_as_long_and_as_deep_as_may_be_is_read():
    x = ca.SX.sym("x")
    parse("+".join(["x"] * (LONGEST // 2))).casadi({"x": x})
    deep = "-(2*" * (DEEPEST // 2 - 1) + "x^x" + "+x)" * (DEEPEST // 2 - 1)
    parse(deep).casadi({"x": x})
    assert parse(deep).dimension({"x": PLAIN}) == PLAIN


def test_unknown_names_are_refused_with_what_was_meant():
    for use in (
        lambda one: one.casadi({"tau": 1, "x": 2}),
        lambda one: one.dimension({"tau": PLAIN, "x": PLAIN}),
    ):
        for text, offset, message in (
            ("x / tua", 4, "unknown name 'tua'; did you mean tau?"),
            ("2*\nwarmth", 3, "unknown name 'warmth'; known here: tau, x"),
        ):
            with pytest.raises(ExpressionError) as caught:
                use(parse(text))
            assert (caught.value.message, caught.value.offset) == (message, offset)
    with pytest.raises(ExpressionError, match=r"^unknown name 'x'; known here: a1, .*, a12, \.\.\.$"):
        parse("x").casadi({f"a{number}": 1 for number in range(1, 20)})


@pytest.mark.parametrize("name", ["x", "_", "T_in", "lambda", "k1"])
def test_names(name: str):
    assert name_issue(name) == ""


def test_what_is_no_name():
    for name in ("", "1x", "x y", "\u0430", "x\n", "é", "x.y"):
        assert "is no name" in name_issue(name)
    assert name_issue("pi") == "'pi' is a function or a constant already"
    assert all(name_issue(name) for name in RESERVED)
