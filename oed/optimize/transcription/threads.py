"""One thread for the linear algebra inside a solve.

How many threads multiply two small matrices changes their last digits, and with them the design on which
a flat problem's search ends. Solves therefore use one thread each, in this process as in every worker;
parallel work is done by processes.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import casadi

Control = tuple[Callable[[], int], Callable[[int], Any]]


@contextmanager
def one_thread() -> Iterator[None]:
    """Let CasADi's own OpenBLAS use one thread while the context lasts."""
    control = _openblas()
    if control is None:
        yield
        return
    get, put = control
    before = get()
    put(1)
    try:
        yield
    finally:
        put(before)


@cache
def _openblas() -> Control | None:
    # Packages of CasADi bring an OpenBLAS under a name of their own; one built from source may not.
    # The name with one version number is the one that Ipopt links; another name may be another copy.
    for file in sorted(Path(casadi.__file__).parent.glob("libcasadi*openblas*.so.[0-9]")):
        library = ctypes.CDLL(str(file))
        for suffix in ("", "64_"):
            get = getattr(library, f"openblas_get_num_threads{suffix}", None)
            put = getattr(library, f"openblas_set_num_threads{suffix}", None)
            if get is not None and put is not None:
                return get, put
    return None
