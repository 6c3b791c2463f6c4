"""Generated C for functions that are called very often, where there is a compiler; the numbers stay the same.

What was compiled is kept for later processes in the user's cache folder (`XDG_CACHE_HOME`, else `~/.cache`).
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from itertools import pairwise
from pathlib import Path

import casadi as ca

# No contraction to fused operations and no fast mathematics: with them the last digits, and so the designs
# that a search finds, would depend on whether there is a compiler.
FLAGS = (
    *("-O3", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared"),
    # Only what CasADi loads is seen from outside, so that all else is inlined.
    *("-fvisibility=hidden", "-DGCC_HASCLASSVISIBILITY"),
)
PATIENCE = 120.0
"""Time [s] after which a compiler is given up."""
MANY = 5000
"""Statements of a function from which it is translated as it stands: a compiler would look longer for what
such a list has in common than a search takes; and it is called once where those of samples are called often.
"""


def compiler() -> str | None:
    """The C compiler's path: that of the variable CC, or the system's; None where there is none."""
    return shutil.which(os.environ.get("CC") or "cc") or shutil.which("gcc") or shutil.which("clang")


def compiled(function: ca.Function, *, anew: bool = True) -> ca.Function:
    """A function in machine code; itself where it cannot be compiled.

    Args:
        function: to be compiled.
        anew: whether to compile what was not compiled before; else it stays itself, too.
    """
    making = Making([function], anew=anew)
    making.wait()
    found = making.functions()
    return found[0] if found else function


class Making:
    """Machine code of functions, which a compiler is at work on in a process of its own.

    Attributes:
        binary: where it will be; None where there is no compiler, or no room for the source.
        anew: whether what was not compiled before is compiled.
    """

    def __init__(self, functions: Sequence[ca.Function], *, anew: bool = True) -> None:
        """Begin, unless it is there from before.

        Args:
            functions: of different names.
            anew: whether to compile what was not compiled before.
        """
        self.anew = anew
        self.binary: Path | None = None
        self._names = [function.name() for function in functions]
        self._process: subprocess.Popen[bytes] | None = None
        tool = compiler()
        if tool is None:
            return
        # No room for the source, or for the code, or nobody's home: then there is none.
        with suppress(OSError, RuntimeError), ExitStack() as stack:
            folder = tempfile.mkdtemp(prefix="oed-")
            stack.callback(shutil.rmtree, folder, ignore_errors=True)
            source = _written(functions, folder)
            self.binary = _kept(source.read_bytes(), tool)
            if not self.binary.exists() and anew:
                self.binary.parent.mkdir(parents=True, exist_ok=True)
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
        # A session of its own: what a compiler starts is stopped with it, and leaves nothing elsewhere.
        self._process = subprocess.Popen(  # noqa: S603
            command,
            stdin=quiet,
            stdout=quiet,
            stderr=quiet,
            env={**os.environ, "TMPDIR": str(source.parent)},
            start_new_session=True,
        )

    def wait(self) -> None:
        """Until the compiler has ended, well or not."""
        if self._process is not None:
            try:
                self._process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self._kill()
            self._ended()

    def functions(self) -> list[ca.Function] | None:
        """The functions in machine code; None as long as there is none."""
        if self._process is not None and self._process.poll() is not None:
            self._ended()
        elif self._process is not None and time.monotonic() - self._began > PATIENCE:
            self.stop()
        return None if self.binary is None else taken(self.binary, self._names)

    @property
    def ended(self) -> bool:
        """Whether no compiler is at work any more."""
        return self._process is None

    def stop(self) -> None:
        """Give it up, if it is not there yet."""
        if self._process is not None:
            self._kill()
            self._ended()

    def _kill(self) -> None:
        assert self._process is not None
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _ended(self) -> None:
        assert self._process is not None
        assert self.binary is not None
        try:
            if self._process.returncode == 0:
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


def taken(binary: Path, names: Sequence[str]) -> list[ca.Function] | None:
    """Functions of a compiled file; None where there is none.

    Args:
        binary: a file.
        names: of the functions.
    """
    if not binary.exists():
        return None
    try:
        return [ca.external(name, str(binary)) for name in names]
    except RuntimeError:
        # Damaged, of another machine, or where nothing may be executed.
        with suppress(OSError):
            binary.unlink()
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
    begins = [found.start() for found in re.finditer(r"^static int casadi_f\d+\(.*\{$", source, re.MULTILINE)]
    edges = [0, *begins, len(source)]
    parts = [source[first:last] for first, last in pairwise(edges)]
    light = '__attribute__((optimize("O0"))) '
    return parts[0] + "".join(light * (part.count(";") > MANY) + part for part in parts[1:])


def _kept(source: bytes, tool: str) -> Path:
    asked = subprocess.run([tool, "-dumpfullversion", "-dumpmachine"], capture_output=True, check=False)  # noqa: S603
    parts = [source, *(flag.encode() for flag in FLAGS), tool.encode(), asked.stdout, ca.__version__.encode()]
    name = hashlib.sha256(b"\0".join(parts)).hexdigest()
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "oed" / f"{name}.so"
