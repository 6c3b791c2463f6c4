"""Generated C for functions that are called very often, where there is a compiler; the numbers stay the same.

What was compiled is kept for later processes in the user's cache folder (`XDG_CACHE_HOME`, else `~/.cache`).
"""

from __future__ import annotations

import atexit
import hashlib
import os
import platform
import re
import shutil
import signal
import subprocess
import tempfile
import time
import weakref
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import casadi as ca

# No contraction to fused operations and no fast mathematics: with them the last digits, and so the designs
# that a search finds, would depend on whether there is a compiler. Long lists of operations gain by vectors
# and little else, and a compiler at work beside the search takes twice as long with all that it knows.
FLAGS = (
    *("-O1", "-ftree-vectorize", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared"),
    # Only what CasADi loads is seen from outside, so that all else is inlined.
    *("-fvisibility=hidden", "-DGCC_HASCLASSVISIBILITY"),
)
PATIENCE = 120.0
"""Time [s] after which a compiler is given up."""
SOURCES = "oed-compiling-"
"""Prefix of the temporary folders that hold sources."""
KNOWN = 10.0
"""Time [s] after which a compiler that does not say its version is none."""
SEAL = hashlib.sha256
"""Hash that stands behind a library's code: a library that was cut short or changed crashes or errs."""
MANY = 5000
"""Statements of a function from which it is translated as it stands: a compiler would look longer for what
such a list has in common than a search takes; and it is called once where those of samples are called often.
"""


def compiler() -> str | None:
    """The C compiler's path: that of the variable CC, or the system's; None where there is none."""
    return shutil.which(os.environ.get("CC") or "cc") or shutil.which("gcc") or shutil.which("clang")


def compiled(function: ca.Function) -> ca.Function:
    """Return a function in machine code; the function itself where it cannot be compiled."""
    making = Making([function])
    making.wait()
    functions = making.functions()
    return functions[0] if functions else function


def is_compiled(function: ca.Function) -> bool:
    """Return whether a function is one of generated C, which `is_a` does not know before CasADi 3.8.1."""
    return bool(function.class_name().endswith("External"))


class Making:
    """Machine code of functions, which a compiler is at work on in a process of its own.

    Attributes:
        binary: path of the library; None where there is no compiler, or no room for the source.
    """

    def __init__(self, functions: Sequence[ca.Function]) -> None:
        """Begin, unless it is there from before.

        Args:
            functions: functions of different names.
        """
        self.binary: Path | None = None
        self._names = [function.name() for function in functions]
        self._process: subprocess.Popen[bytes] | None = None
        # A process forked from this one has no part in it.
        self._owner = os.getpid()
        tool = compiler()
        if tool is None:
            return
        # No room for the source, or for the code, or nobody's home: then there is none.
        with suppress(OSError, RuntimeError), ExitStack() as stack:
            folder = tempfile.mkdtemp(prefix=SOURCES)
            stack.callback(shutil.rmtree, folder, ignore_errors=True)
            source = _written(functions, folder)
            self.binary = _binary_path(source.read_bytes(), tool)
            if not self.binary.exists():
                self.binary.parent.mkdir(parents=True, exist_ok=True)
                _clear(self.binary.parent)
                self._begin(tool, source)
                # The source stays for as long as the compiler needs it.
                self._left = stack.pop_all()

    def _begin(self, tool: str, source: Path) -> None:
        assert self.binary is not None
        # Under another name first: another process may be making the same.
        with tempfile.NamedTemporaryFile(dir=self.binary.parent, suffix=".part", delete=False) as part:
            self._part = Path(part.name)
        command = [tool, *FLAGS, str(source), "-o", str(self._part), "-lm"]
        self._began = time.monotonic()
        quiet = subprocess.DEVNULL
        try:
            # A session of its own: what a compiler starts is stopped with it, and leaves nothing elsewhere.
            self._process = subprocess.Popen(  # noqa: S603
                command,
                stdin=quiet,
                stdout=quiet,
                stderr=quiet,
                env={**os.environ, "TMPDIR": str(source.parent)},
                start_new_session=True,
            )
        except OSError:
            self._part.unlink(missing_ok=True)
            raise
        _AT_WORK.add(self)

    def wait(self) -> None:
        """Wait until the compiler has ended, well or not, or is given up."""
        if self._running is not None:
            try:
                self._running.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                _end(self._running)
            self._ended(self._running)

    def functions(self) -> list[ca.Function] | None:
        """The functions in machine code; None as long as there is none."""
        self._look()
        return None if self.binary is None else taken(self.binary, self._names)

    @property
    def ended(self) -> bool:
        """True if no compiler is at work any more: then all processes find what it has made."""
        self._look()
        return self._running is None

    def _look(self) -> None:
        if self._running is not None and self._running.poll() is not None:
            self._ended(self._running)
        elif self._running is not None and time.monotonic() - self._began > PATIENCE:
            self.stop()

    @property
    def _running(self) -> subprocess.Popen[bytes] | None:
        return self._process if self._owner == os.getpid() else None

    def stop(self) -> None:
        """Give it up, if it is not there yet."""
        if self._running is not None:
            _end(self._running)
            self._ended(self._running)

    def _ended(self, process: subprocess.Popen[bytes]) -> None:
        assert self.binary is not None
        try:
            if process.returncode == 0:
                with self._part.open("ab") as part:
                    part.write(SEAL(self._part.read_bytes()).digest())
                self._part.replace(self.binary)
        except OSError:
            pass
        finally:
            self._part.unlink(missing_ok=True)
            self._process = None
            self._left.close()

    def __del__(self) -> None:
        """No compiler is left at work for nobody."""
        if getattr(self, "_process", None) is not None:
            self.stop()


_AT_WORK: weakref.WeakSet[Making] = weakref.WeakSet()


def at_work() -> bool:
    """Return whether any compiler is at work for this process."""
    return not all(making.ended for making in list(_AT_WORK))


@atexit.register
def stop_all() -> None:
    """Stop every compiler that is at work: what nobody collects at the end is not left at work either."""
    for making in list(_AT_WORK):
        making.stop()


def _clear(cache: Path) -> None:
    # What processes have left that were killed, there and of sources.
    old = time.time() - 2 * PATIENCE
    for path in (*cache.glob("*.part"), *Path(tempfile.gettempdir()).glob(f"{SOURCES}*")):
        with suppress(OSError):
            if path.stat().st_mtime < old:
                shutil.rmtree(path) if path.is_dir() else path.unlink()


def taken(binary: Path, names: Sequence[str]) -> list[ca.Function] | None:
    """Functions of a compiled file; None where there is none.

    Args:
        binary: a file.
        names: names of the functions.
    """
    try:
        content = binary.read_bytes()
    except OSError:
        return None
    size = SEAL().digest_size
    if SEAL(content[:-size]).digest() != content[-size:]:
        with suppress(OSError):
            binary.unlink()
        return None
    # Whole, it may still lie where nothing may be executed.
    with suppress(RuntimeError):
        return [ca.external(name, str(binary)) for name in names]
    return None


def _written(functions: Sequence[ca.Function], folder: str) -> Path:
    generator = ca.CodeGenerator("generated.c")
    for function in functions:
        generator.add(function)
    source = Path(generator.generate(folder + os.sep))
    source.write_text(_as_they_stand(source.read_text()))
    return source


def _as_they_stand(source: str) -> str:
    # The longest functions by the compiler without its optimisation; one that knows no such wish ignores it.
    begins = [match.start() for match in re.finditer(r"^static int casadi_f\d+\(.*\{$", source, re.MULTILINE)]
    edges = [0, *begins, len(source)]
    parts = [source[first:last] for first, last in pairwise(edges)]
    light = '__attribute__((optimize("O0"))) '
    return parts[0] + "".join(light * (part.count(";") > MANY) + part for part in parts[1:])


@lru_cache(maxsize=4)
def _version(tool: str) -> bytes | None:
    # What it says; None of one that does not. It is asked once, for one that hangs costs time.
    pipe, quiet = subprocess.PIPE, subprocess.DEVNULL
    command = [tool, "--version"]
    with subprocess.Popen(  # noqa: S603
        command, stdin=quiet, stdout=pipe, stderr=quiet, start_new_session=True
    ) as process:
        try:
            return process.communicate(timeout=KNOWN)[0]
        except subprocess.TimeoutExpired:
            # With what it has started, which may hold the pipe.
            _end(process)
            return None


def _end(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _binary_path(source: bytes, tool: str) -> Path:
    version = _version(tool)
    if version is None:
        raise OSError(f"{tool} does not say its version")
    made_by = [tool, *FLAGS, platform.system(), platform.machine(), ca.__version__]
    parts = [source, *(part.encode() for part in made_by), version]
    name = hashlib.sha256(b"\0".join(parts)).hexdigest()
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "oed" / f"{name}.so"
