"""Calls of functions on NumPy's own memory, in machine code where they are called for long."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from compiling import compiled

from oed.kernel.dynamics import direct_call as module
from oed.kernel.dynamics.compiled import FOLDER, Compilation, compiler
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


@pytest.mark.slow
@needs_compiler
def test_what_is_called_for_long_is_compiled_to_the_same_bits(cache: Path):
    call = DirectCall(example())
    expected = called(call)
    assert call._compilation is not None
    call._compilation.wait()
    called(call)
    assert call._spent == -np.inf
    assert len(list(cache.glob("*.so"))) == 1
    for found, one in zip(called(call), expected, strict=True):
        np.testing.assert_array_equal(found, one)


def test_without_a_compiler_that_works_it_stays_as_it_is(cache: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("CC", "false")
    call = DirectCall(example())
    expected = called(call)
    if call._compilation is not None:
        call._compilation.wait()
    for found, one in zip(called(call), expected, strict=True):
        np.testing.assert_array_equal(found, one)
    assert call._spent == -np.inf


def test_long_functions_are_not_compiled(cache: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "MOST", 3)
    call = DirectCall(example())
    called(call)
    assert call._compilation is None
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


@pytest.mark.slow
@needs_compiler
def test_what_is_compiled_already_stays_as_it_is(cache: Path):
    call = DirectCall(compiled(example()).map(4))
    call(np.ones((4, 2, 3)), np.ones((4, 2)))
    assert call._compilation is None
    assert call._spent == -np.inf


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("share", [0.0, 0.99])
def test_a_library_cut_short_is_cleared_away_and_made_again(share: float, cache: Path):
    compilation = Compilation(example())
    compilation.wait()
    assert compilation.library is not None
    whole = compilation.library.read_bytes()
    compilation.library.write_bytes(whole[: int(share * len(whole))])
    call = DirectCall(example())
    expected = called(call)
    assert call._spent == -np.inf
    assert not compilation.library.exists()
    again = DirectCall(example())
    called(again)
    assert again._compilation is not None
    again._compilation.wait()
    for found, one in zip(called(again), expected, strict=True):
        np.testing.assert_array_equal(found, one)
    assert compilation.library.exists()


@pytest.mark.slow
@needs_compiler
def test_a_library_of_which_a_byte_has_changed_is_not_used(cache: Path):
    compilation = Compilation(example())
    compilation.wait()
    assert compilation.library is not None
    content = bytearray(compilation.library.read_bytes())
    content[len(content) // 2] ^= 1
    compilation.library.write_bytes(content)
    assert compilation.function() is None
    assert not compilation.library.exists()


@pytest.mark.slow
@needs_compiler
def test_what_was_left_of_a_compiler_that_was_killed_is_cleared_away(cache: Path):
    folders = [cache / f"{FOLDER}{name}" for name in ("old", "new")]
    for folder in folders:
        folder.mkdir(parents=True)
        (folder / "function.c").write_text("")
    os.utime(folders[0], (0, 0))
    Compilation(example()).wait()
    assert [folder.exists() for folder in folders] == [False, True]


def test_where_nobody_has_a_home_nothing_is_compiled(monkeypatch: pytest.MonkeyPatch):
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    assert Compilation(example()).library is None


@pytest.fixture
def endless(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A compiler that does not end, and the file in which it says what process is at work for it."""
    tool, own = tmp_path / "cc", tmp_path / "own"
    lines = ["#!/bin/sh", "sleep 60 &", f"echo $! > {own}", "wait"]
    tool.write_text("\n".join(lines))
    tool.chmod(0o755)
    monkeypatch.setenv("CC", str(tool))
    return own


def test_a_compiler_that_is_stopped_leaves_nothing_at_work(cache: Path, endless: Path):
    compilation = Compilation(example())
    own = _process_in(endless)
    compilation.stop()
    assert _ends(own)
    assert not list(cache.iterdir())


@pytest.mark.slow
def test_a_program_that_ends_leaves_no_compiler_at_work(cache: Path, endless: Path, tmp_path: Path):
    """Even where nothing is collected at the end, and the compiler's job is part of a cycle."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    script = (
        "import atexit, gc, pathlib, sys, time\n"
        "atexit.register(gc.freeze)\n"
        "import casadi as ca\n"
        "from oed.kernel.dynamics.compiled import Compilation\n"
        "x = ca.SX.sym('x')\n"
        "compilation = Compilation(ca.Function('f', [x], [x + 1]))\n"
        "compilation.itself = compilation\n"
        "while not pathlib.Path(sys.argv[1]).exists():\n"
        "    time.sleep(0.01)\n"
    )
    environment = {**os.environ, "TMPDIR": str(folder)}
    subprocess.run([sys.executable, "-c", script, str(endless)], env=environment, check=True)
    assert _ends(_process_in(endless))
    assert not list(cache.iterdir())
    assert not list(folder.iterdir())


@pytest.mark.slow
@needs_compiler
def test_what_a_compiler_made_is_there_for_all_processes_once_it_has_ended(cache: Path):
    compilation = Compilation(example())
    assert _becomes(lambda: compilation.ended)
    assert compilation.library is not None
    assert compilation.library.exists()


@pytest.mark.slow
@needs_compiler
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_process_leaves_the_compiler_to_its_parent(cache: Path):
    compilation = Compilation(example())
    child = os.fork()
    if child == 0:
        compilation.function()
        compilation.stop()
        os._exit(0)
    os.waitpid(child, 0)
    compilation.wait()
    assert compilation.function() is not None


def _process_in(file: Path) -> int:
    while not file.exists() or not file.read_text().strip():
        time.sleep(0.01)
    return int(file.read_text())


def _ends(process: int) -> bool:
    return _becomes(lambda: not _at_work(process))


def _becomes(asked: Callable[[], bool]) -> bool:
    for _ in range(500):
        if asked():
            return True
        time.sleep(0.01)
    return False


def _at_work(process: int) -> bool:
    found = subprocess.run(["ps", "-o", "stat=", "-p", str(process)], capture_output=True, text=True)
    return bool(found.stdout.strip()) and not found.stdout.strip().startswith("Z")
