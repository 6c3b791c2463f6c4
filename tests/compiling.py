"""Functions in machine code, at once."""

from __future__ import annotations

import casadi as ca

from oed.kernel.dynamics.compiled import Compilation


def compiled(function: ca.Function) -> ca.Function:
    """A function in machine code; the function itself where it cannot be compiled."""
    compilation = Compilation(function)
    compilation.wait()
    return compilation.function() or function
