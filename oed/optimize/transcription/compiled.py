"""Generated C for functions that are called very often, where there is a compiler; the numbers stay the same.

What was compiled is kept for later processes in the user's cache folder (`XDG_CACHE_HOME`, else `~/.cache`).
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
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


def compiler() -> str | None:
    """The C compiler's path: that of the variable CC, or the system's; None where there is none."""
    return shutil.which(os.environ.get("CC") or "cc") or shutil.which("gcc") or shutil.which("clang")


def compiled(function: ca.Function, *, anew: bool = True) -> ca.Function:
    """A function in machine code; itself where it cannot be compiled.

    Args:
        function: to be compiled.
        anew: whether to compile what was not compiled before; else it stays itself, too.
    """
    tool = compiler()
    if tool is None:
        return function
    try:
        with tempfile.TemporaryDirectory(prefix="oed-") as folder:
            generator = ca.CodeGenerator("generated.c")
            generator.add(function)
            source = Path(generator.generate(folder + os.sep))
            library = _kept(source.read_bytes(), tool)
            if not library.exists() and not (anew and _compile(tool, source, library)):
                return function
    except OSError:
        # No room for the source.
        return function
    return ca.external(function.name(), str(library))


def _kept(source: bytes, tool: str) -> Path:
    asked = subprocess.run([tool, "-dumpfullversion", "-dumpmachine"], capture_output=True, check=False)  # noqa: S603
    parts = [source, *(flag.encode() for flag in FLAGS), tool.encode(), asked.stdout, ca.__version__.encode()]
    name = hashlib.sha256(b"\0".join(parts)).hexdigest()
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "oed" / f"{name}.so"


def _compile(tool: str, source: Path, library: Path) -> bool:
    # Under another name first: another process may be making the same.
    try:
        library.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=library.parent, suffix=".part", delete=False) as part:
            made = Path(part.name)
    except OSError:
        return False
    try:
        command = [tool, *FLAGS, str(source), "-o", str(made), "-lm"]
        subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE)  # noqa: S603
        made.replace(library)
    except (OSError, subprocess.SubprocessError):
        return False
    finally:
        made.unlink(missing_ok=True)
    return True
