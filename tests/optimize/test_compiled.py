"""Generated C, where this machine has a compiler."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from builders import BOX, SPEED, problem_of
from some_instants import SLOTS, numbers_of

from oed.kernel.dynamics.compiled import MANY, Making, compiled, compiler
from oed.kernel.dynamics.space import Spline
from oed.kernel.problem import Problem
from oed.optimize.ipopt import Ipopt
from oed.optimize.local import LocalSearch
from oed.optimize.terms.unrolled import Unrolled
from oed.optimize.transcription.program import slots_for
from oed.robots.sensors import Displacements

SETTINGS = Ipopt(max_iterations=200)

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler on this machine")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "oed"


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache for what the tests of searches compile, one and the same."""
    return tmp_path_factory.mktemp("shared")


def example(factor: float = 2.0) -> ca.Function:
    x = ca.SX.sym("x", 3)
    turned = ca.sin(x[0] * factor) / x[1] + x[1] * x[2] - ca.sqrt(x[2])
    return ca.Function("example", [x], [turned, ca.vertcat(x[0] * x[1] + x[2], turned * turned)])


@needs_compiler
@pytest.mark.slow
def test_the_numbers_are_the_same_to_the_last_bit(cache: Path):
    plain = example()
    quick = compiled(plain)
    assert quick.class_name() == "External" or quick.is_a("External")
    for point in np.random.default_rng(0).uniform(0.1, 2, (100, 3)):
        for found, expected in zip(quick(point), plain(point), strict=True):
            np.testing.assert_array_equal(np.array(found), np.array(expected))


@needs_compiler
@pytest.mark.slow
def test_what_was_compiled_is_kept_and_used_again(cache: Path, monkeypatch: pytest.MonkeyPatch):
    compiled(example())
    (library,) = cache.iterdir()
    before = library.stat().st_mtime_ns
    compiled(example())
    compiled(example(3.0))
    assert len(list(cache.iterdir())) == 2
    assert library.stat().st_mtime_ns == before


@pytest.mark.parametrize("tool", ["/nowhere/cc", "false"])
def test_without_a_compiler_that_works_the_function_itself_serves(
    tool: str, cache: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("CC", tool)
    if tool.startswith("/"):
        monkeypatch.setenv("PATH", "")
    plain = example()
    assert compiled(plain) is plain
    assert not cache.exists() or not list(cache.iterdir())


@needs_compiler
def test_a_cache_that_cannot_be_written_is_done_without(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    plain = example()
    assert compiled(plain) is plain


def problem() -> Problem:
    """One whose drives are written out: its segments are not of equal length."""
    return problem_of(
        samples=12,
        spline=Spline(degree=1, coefficients=4),
        measurement=Displacements(segments=5),
        limits=(SPEED, BOX),
    )


@needs_compiler
@pytest.mark.slow
def test_what_a_search_calls_is_the_same_to_the_last_bit(shared: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(shared))
    search = LocalSearch(problem(), SETTINGS)
    terms, slots = search.design.terms, slots_for(len(search.first_instants()))
    plain = list(vars(terms.functions(slots)).values())
    making = Making(plain)
    making.wait()
    quick = making.functions()
    assert quick is not None
    assert len(list((shared / "oed").iterdir())) == 1
    rng = np.random.default_rng(0)
    for _ in range(20):
        given = [rng.uniform(-0.5, 0.5, terms.size), numbers_of(terms, rng, slots)]
        weights = [rng.normal(size=plain[2].size1_in(place)) for place in (2, 3)]
        for one, other, more in zip(plain, quick, ([], [], weights), strict=True):
            for expected, found in zip(one.call([*given, *more]), other.call([*given, *more]), strict=True):
                np.testing.assert_array_equal(np.array(found), np.array(expected))


@needs_compiler
@pytest.mark.slow
def test_a_search_ends_where_it_does_without(shared: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(shared))
    ends = []
    for compiling in (False, True):
        search = LocalSearch(replace(problem(), name=f"{compiling}"), SETTINGS)
        terms = search.design.terms
        if compiling:
            slots, binary = search.compile(np.inf)
            terms.compiled()
            assert binary is not None
            assert terms.functions(slots).values.is_a("External")
            other = Unrolled(search.problem)
            other.take(slots, binary)
            assert other.functions(slots).hessian.is_a("External")
        else:
            assert not terms.functions(SLOTS).values.is_a("External")
        ends.append(search.maximise(np.full(terms.size, 0.1)).unknowns)
    np.testing.assert_array_equal(*ends)


@needs_compiler
@pytest.mark.slow
def test_long_lists_are_compiled_as_they_stand(cache: Path):
    x = ca.SX.sym("x", 20)
    total = sum(ca.sin(one) * other for one in ca.vertsplit(x) for other in ca.vertsplit(x**2))
    plain = ca.Function("long", [x], [total, ca.hessian(total, x)[0]])
    wrapped = ca.Function("wrapped", [symbol := ca.MX.sym("x", 20)], plain.call([symbol]))
    assert plain.n_instructions() > MANY
    quick = compiled(wrapped)
    assert quick.is_a("External")
    point = np.random.default_rng(0).normal(size=20)
    for found, expected in zip(quick(point), wrapped(point), strict=True):
        np.testing.assert_array_equal(np.array(found), np.array(expected))


@needs_compiler
@pytest.mark.slow
def test_what_takes_longer_than_it_spares_is_not_compiled(
    cache: Path, shared: Path, monkeypatch: pytest.MonkeyPatch
):
    terms = Unrolled(problem())
    slots = slots_for(len(LocalSearch(problem(), SETTINGS).first_instants()))
    assert terms.compile(slots, spared=0.1) is None
    assert terms.compile(slots, spared=1.5) is not None
    terms.compiled()
    assert not cache.exists() or not list(cache.iterdir())
    assert not terms.functions(slots).values.is_a("External")
    # Where it turns out later that it pays, it is begun.
    monkeypatch.setenv("XDG_CACHE_HOME", str(shared))
    terms.compile(slots)
    terms.compiled()
    assert terms.functions(slots).values.is_a("External")


def test_what_is_long_is_not_even_written_down(monkeypatch: pytest.MonkeyPatch):
    def never(*_: object, **__: object) -> None:
        raise AssertionError("looked for")

    monkeypatch.setattr("oed.optimize.terms.generated.Making", never)
    terms = Unrolled(problem())
    monkeypatch.setattr("oed.optimize.terms.generated.LARGEST", terms.written - 1)
    assert terms.compile(SLOTS) is None
