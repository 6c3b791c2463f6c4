"""Generated C, where this machine has a compiler."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from oed.optimize.terms.compiled import compiled, compiler

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
