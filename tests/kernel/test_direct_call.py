"""Calls of functions on NumPy's own memory, in machine code where they are called for long."""

from __future__ import annotations

import pickle
import subprocess
import time
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from oed.kernel.dynamics import direct_call as module
from oed.kernel.dynamics.compiled import Making, compiled, compiler
from oed.kernel.dynamics.direct_call import DirectCall, direct_call

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


def test_what_is_sent_to_a_process_again_and_again_is_one_call_there():
    call = DirectCall(example())
    sent = pickle.dumps(call)
    one, other = pickle.loads(sent), pickle.loads(sent)
    assert one is other
    assert one is not call
    for found, expected in zip(called(one), called(call), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_calls_of_what_is_called_once_are_not_compiled(cache: Path):
    rng = np.random.default_rng(0)
    direct_call(example(), rng.normal(size=(2, 3)), rng.normal(size=2))
    assert not cache.exists()


@needs_compiler
def test_what_is_compiled_already_stays_as_it_is(cache: Path):
    call = DirectCall(compiled(example()).map(4))
    call(np.ones((4, 2, 3)), np.ones((4, 2)))
    assert call._making is None
    assert call._spent == -np.inf


@needs_compiler
def test_a_damaged_library_is_cleared_away_and_made_again(cache: Path):
    making = Making([example()])
    making.wait()
    assert making.binary is not None
    making.binary.write_bytes(b"no library")
    call = DirectCall(example())
    expected = called(call)
    assert call._spent == -np.inf
    assert not making.binary.exists()
    again = DirectCall(example())
    called(again)
    assert again._making is not None
    again._making.wait()
    for found, one in zip(called(again), expected, strict=True):
        np.testing.assert_array_equal(found, one)
    assert making.binary.exists()


def test_where_nobody_has_a_home_nothing_is_compiled(monkeypatch: pytest.MonkeyPatch):
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    assert Making([example()]).binary is None


@needs_compiler
def test_a_compiler_that_is_stopped_leaves_nothing_at_work(cache: Path, tmp_path: Path, monkeypatch):
    tool = tmp_path / "cc"
    lines = [
        "#!/bin/sh",
        "[ $1 = -dumpfullversion ] && exit",
        "sleep 60 &",
        f"echo $! > {tmp_path}/own",
        "wait",
    ]
    tool.write_text("\n".join(lines))
    tool.chmod(0o755)
    monkeypatch.setenv("CC", str(tool))
    making = Making([example()])
    while not (tmp_path / "own").exists() or not (tmp_path / "own").read_text().strip():
        time.sleep(0.01)
    own = int((tmp_path / "own").read_text())
    making.stop()
    for _ in range(500):
        if not _at_work(own):
            break
        time.sleep(0.01)
    assert not _at_work(own)
    assert not list(cache.glob("*.part"))


def _at_work(process: int) -> bool:
    found = subprocess.run(["ps", "-o", "stat=", "-p", str(process)], capture_output=True, text=True)
    return bool(found.stdout.strip()) and not found.stdout.strip().startswith("Z")
