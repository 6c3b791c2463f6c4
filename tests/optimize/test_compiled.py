"""Generated C, where this machine has a compiler."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from builders import BOX, SPEED, problem_of
from compiling import compiled
from some_instants import chosen_of
from written_out import called

from oed.kernel.dynamics import direct_call
from oed.kernel.dynamics.compiled import MANY, at_work, compiler
from oed.kernel.dynamics.space import Spline
from oed.kernel.problem import Problem
from oed.optimize.ipopt import Ipopt
from oed.optimize.local import LocalSearch
from oed.optimize.terms.terms import Terms
from oed.optimize.transcription.program import slots_for
from oed.robots.sensors import Displacements

SETTINGS = Ipopt(max_iterations=200)

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler on this machine")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "oed"


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
    return problem_of(
        samples=4,
        spline=Spline(degree=1, coefficients=4),
        measurement=Displacements(segments=2),
        limits=(SPEED, BOX),
    )


def results(terms: Terms, slots: int, seed: int) -> list[np.ndarray]:
    """Entries and rows at one point, and their derivatives."""
    rng = np.random.default_rng(seed)
    z, functions = rng.uniform(-0.5, 0.5, terms.size), called(terms, chosen_of(terms, rng, slots))
    values = functions.values(z)
    weights = [rng.normal(size=len(part)) for part in values]
    return [*values, *functions.jacobian(z), functions.hessian(z, *weights)]


@needs_compiler
@pytest.mark.slow
def test_what_a_search_calls_is_the_same_to_the_last_bit(cache: Path, monkeypatch: pytest.MonkeyPatch):
    plain, quick = Terms(problem()), Terms(problem())
    slots = slots_for(len(LocalSearch(problem(), SETTINGS).exchange.first_instants()))
    monkeypatch.setattr(direct_call, "PAYS", 0.0)
    for _ in range(2):
        results(quick, slots, 0)
        while at_work():
            time.sleep(0.05)
    assert list(cache.glob("*.so"))
    expected = [results(plain, slots, seed) for seed in range(20)]
    for seed in range(20):
        for part, other in zip(results(quick, slots, seed), expected[seed], strict=True):
            np.testing.assert_array_equal(part, other)


@needs_compiler
@pytest.mark.slow
def test_a_search_ends_where_it_does_without(cache: Path, monkeypatch: pytest.MonkeyPatch):
    ends = []
    for pays in (np.inf, 0.0):
        monkeypatch.setattr(direct_call, "PAYS", pays)
        search = LocalSearch(replace(problem(), name=f"{pays}"), SETTINGS)
        ends.append(search.maximise(np.full(search.design.terms.size, 0.1)).unknowns)
    assert list(cache.iterdir())
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
