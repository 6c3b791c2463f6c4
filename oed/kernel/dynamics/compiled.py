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
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import casadi as ca

# No contraction to fused operations and no fast mathematics: with them the last digits, and so the designs
# that a search finds, would depend on whether there is a compiler. Long lists of operations gain by vectors
# and little else, and a compiler at work beside the search takes twice as long with all that it knows.
FLAGS = (
    *("-x", "c", "-O1", "-ftree-vectorize", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared"),
    # Only what CasADi loads is seen from outside, so that all else is inlined.
    *("-fvisibility=hidden", "-DGCC_HASCLASSVISIBILITY"),
)
PATIENCE = 120.0
"""Time [s] after which a compiler is given up."""
FOLDER = "compiling-"
"""Prefix of the folders, in the cache, in each of which a compiler is at work."""
SEAL = hashlib.sha256
"""Hash that stands behind a library's code: a library that was cut short or changed crashes or errs."""
MANY = 5000
"""Statements of a function from which it is translated as it stands: a compiler would look longer for what
such a list has in common than a search takes; and it is called once where those of samples are called often.
"""


def compiler() -> str | None:
    """The C compiler's path: that of the variable CC, or the system's; None where there is none."""
    return shutil.which(os.environ.get("CC") or "cc") or shutil.which("gcc") or shutil.which("clang")


def is_compiled(function: ca.Function) -> bool:
    """Return whether a function is one of generated C, which `is_a` does not know before CasADi 3.8.1."""
    return bool(function.class_name().endswith("External"))


class Compilation:
    """Machine code of a function, which a compiler is at work on in a process of its own.

    Attributes:
        library: path of the machine code; None where there is no compiler, or no room for it.
    """

    def __init__(self, function: ca.Function) -> None:
        """Begin, unless it is there from before."""
        self.library: Path | None = None
        self._name = function.name()
        self._process: subprocess.Popen[bytes] | None = None
        # A process forked from this one has no part in it.
        self._owner = os.getpid()
        tool = compiler()
        # No room for the code, or nobody's home: then there is none.
        with suppress(OSError, RuntimeError):
            if tool is not None:
                self._begin(tool, _source(function))

    def _begin(self, tool: str, source: str) -> None:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "oed"
        made_by = "\0".join([tool, *FLAGS, platform.system(), platform.machine(), ca.__version__, source])
        library = cache / f"{hashlib.sha256(made_by.encode()).hexdigest()}.so"
        if not library.exists():
            cache.mkdir(parents=True, exist_ok=True)
            _clear(cache)
            self._folder = Path(tempfile.mkdtemp(prefix=FOLDER, dir=cache))
            try:
                self._process = self._started(tool, source)
            except OSError:
                shutil.rmtree(self._folder, ignore_errors=True)
                raise
            self._began = time.monotonic()
            _AT_WORK.add(self)
        self.library = library

    def _started(self, tool: str, source: str) -> subprocess.Popen[bytes]:
        (self._folder / "function.c").write_text(source)
        paths = [f"{self._folder / 'function.c'}", "-o", f"{self._folder / 'function.so'}"]
        quiet = subprocess.DEVNULL
        # A session of its own: what a compiler starts is stopped with it, and leaves nothing elsewhere.
        return subprocess.Popen(  # noqa: S603
            [tool, *FLAGS, *paths, "-lm"],
            stdin=quiet,
            stdout=quiet,
            stderr=quiet,
            env={**os.environ, "TMPDIR": str(self._folder)},
            start_new_session=True,
        )

    @property
    def ended(self) -> bool:
        """True if no compiler is at work any more: then all processes find what it has made."""
        if self._process is None or self._owner != os.getpid():
            return True
        if self._process.poll() is None and time.monotonic() - self._began <= PATIENCE:
            return False
        self.stop()
        return True

    def wait(self) -> None:
        """Wait until the compiler has ended, well or not, or is given up."""
        while not self.ended:
            time.sleep(0.01)

    def function(self) -> ca.Function | None:
        """The function in machine code; None as long as there is none."""
        return _loaded(self.library, self._name) if self.ended and self.library is not None else None

    def stop(self) -> None:
        """Stop a compiler that is still at work, and keep what one that has ended well has made."""
        process = self._process
        if process is None or self._owner != os.getpid():
            return
        self._process = None
        if process.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        with suppress(OSError):
            if process.returncode == 0 and self.library is not None:
                made = self._folder / "function.so"
                with made.open("ab") as file:
                    file.write(SEAL(made.read_bytes()).digest())
                made.replace(self.library)
        shutil.rmtree(self._folder, ignore_errors=True)

    def __del__(self) -> None:
        """No compiler is left at work for nobody."""
        if getattr(self, "_process", None) is not None:
            self.stop()


_AT_WORK: weakref.WeakSet[Compilation] = weakref.WeakSet()


def at_work() -> bool:
    """Return whether any compiler is at work for this process."""
    return not all(one.ended for one in list(_AT_WORK))


@atexit.register
def stop_all() -> None:
    """Stop every compiler that is at work: what nobody collects at the end is not left at work either."""
    for one in list(_AT_WORK):
        one.stop()


def _clear(cache: Path) -> None:
    # What processes have left that were killed.
    old = time.time() - 2 * PATIENCE
    for folder in cache.glob(f"{FOLDER}*"):
        with suppress(OSError):
            if folder.stat().st_mtime < old:
                shutil.rmtree(folder)


def _loaded(library: Path, name: str) -> ca.Function | None:
    # A function of a library; None where there is none.
    with suppress(OSError):
        content = library.read_bytes()
        size = SEAL().digest_size
        if SEAL(content[:-size]).digest() != content[-size:]:
            library.unlink()
            return None
        # Whole, it may still lie where nothing may be executed.
        with suppress(RuntimeError):
            return ca.external(name, str(library))
    return None


def _source(function: ca.Function) -> str:
    # The longest functions by the compiler without its optimisation; one that knows no such wish ignores it.
    generator = ca.CodeGenerator("generated.c")
    generator.add(function)
    source: str = generator.dump()
    begins = [match.start() for match in re.finditer(r"^static int casadi_f\d+\(.*\{$", source, re.MULTILINE)]
    edges = [0, *begins, len(source)]
    parts = [source[first:last] for first, last in pairwise(edges)]
    light = '__attribute__((optimize("O0"))) '
    return parts[0] + "".join(light * (part.count(";") > MANY) + part for part in parts[1:])
