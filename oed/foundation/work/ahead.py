"""Load in the meantime what is needed later."""

from __future__ import annotations

import threading
from contextlib import suppress
from importlib import import_module


def load_ahead(*modules: str) -> None:
    """Load modules beside other work, which solvers outside of Python leave time for.

    Args:
        modules: by their full names; what cannot be loaded says so where it is needed.
    """

    def load() -> None:
        for one in modules:
            with suppress(Exception):
                import_module(one)

    threading.Thread(target=load, daemon=True).start()
