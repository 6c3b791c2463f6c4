"""Calls of functions on NumPy's own memory, in machine code where they are called for long."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from oed.kernel.dynamics import direct_call as module
from oed.kernel.dynamics.compiled import compiler
from oed.kernel.dynamics.direct_call import DirectCall

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(module, "PAYS", 0.0)
    return tmp_path / "oed"


def example() -> ca.Function:
    x, y = ca.SX.sym("x", 3, 2), ca.SX.sym("y", 2)
    return ca.Function("example", [x, y], [ca.densify(ca.sin(x) @ y), ca.dot(y, y) * ca.cos(x)])


def called(call: DirectCall) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return call(rng.normal(size=(2, 3)), rng.normal(size=2))


@needs_compiler
def test_what_is_called_for_long_is_compiled_to_the_same_bits(cache: Path):
    call = DirectCall(example())
    expected = called(call)
    assert call._making is not None
    call._making.wait()
    called(call)
    assert call._spent == -np.inf
    assert len(list(cache.glob("*.so"))) == 1
    for found, one in zip(called(call), expected, strict=True):
        np.testing.assert_array_equal(found, one)


def test_without_a_compiler_that_works_it_stays_as_it_is(cache: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("CC", "false")
    call = DirectCall(example())
    expected = called(call)
    if call._making is not None:
        call._making.wait()
    for found, one in zip(called(call), expected, strict=True):
        np.testing.assert_array_equal(found, one)
    assert call._spent == -np.inf


def test_long_functions_are_not_compiled(cache: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "MOST", 3)
    call = DirectCall(example())
    called(call)
    assert call._making is None
    assert call._spent == -np.inf
    assert not cache.exists()
