"""Code of the user's own is run with care: its errors in words, its streams not the program's."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

from oed.foundation.own.modules import PREFIX

LONGEST = 300
"""Characters of an error that are shown."""


def in_words(error: BaseException, longest: int = LONGEST) -> str:
    """An error that code of the user's own raises, on one line, with its own line in their file."""
    try:
        said = str(error)
    except Exception:
        # Even that is their code.
        said = ""
    words = " ".join(f"{type(error).__name__}: {said}".split())
    words = words if len(words) <= longest else f"{words[: longest - 3]}..."
    return words + _place(error)


def _place(error: BaseException) -> str:
    # The deepest line of a module that stands in a folder of the user's.
    frames = [
        (frame.f_code.co_filename, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if str(frame.f_globals.get("__name__")).startswith(PREFIX)
    ]
    return f" ({Path(frames[-1][0]).name}, line {frames[-1][1]})" if frames else ""


@contextmanager
def lent_streams() -> Iterator[None]:
    """While the user's code runs, standard output is standard error, and neither can be closed or taken away:
    what the program itself prints may be read by another.
    """
    lent: Any = _Lent(sys.stderr or StringIO())
    with redirect_stdout(lent), redirect_stderr(lent):
        yield


class _Lent:
    # A stream as it is, except that it stays open.
    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def close(self) -> None:
        pass

    def __enter__(self) -> _Lent:
        return self

    def __exit__(self, *_: object) -> None:
        pass
