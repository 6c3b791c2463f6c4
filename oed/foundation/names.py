"""Names that files give: as names of files, and as they may be shown in a terminal."""

from __future__ import annotations

import re
import unicodedata

from oed.foundation.errors import UserMistake
from oed.foundation.shown import shown, written

TAKEN = 255
"""Bytes of a file's name that every common file system takes."""
LONGEST = 180
"""Bytes of a name, so that there is room for endings."""
SEPARATORS = '/\\:*?"<>|'
"""What divides paths, or cannot stand in the name of a file on some system."""
DEVICES = frozenset(
    ("con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(10)))
)
"""What Windows opens instead of a file of that name."""

_IDENTIFIER = re.compile(r"\w[\w.]*")


def identifier_flaw(name: object) -> str:
    """Why a robot's parameter, input or state cannot have that name; "" where it can."""
    if isinstance(name, str) and _IDENTIFIER.fullmatch(name) and len(name.encode()) <= LONGEST:
        return ""
    text = f"expected a name of letters, digits, underscores and dots, of at most {LONGEST} bytes"
    return f"{text}, got {written(name)}"


def name_flaw(name: str, longest: int = LONGEST) -> str:
    """Why files cannot be named after `name`, of `longest` bytes at most; "" where they can."""
    if not name.strip():
        return "expected a name, got nothing"
    found = next((char for char in name if char in SEPARATORS or shown(char) != char), "")
    if found:
        return f"expected a name that files can have, without {shown(found)}, got '{shown(name)}'"
    if unicodedata.normalize("NFKC", name)[0] in ".-" or name[-1] in ". ":
        return f"expected a name that begins with no dot or dash and ends with no dot, got '{name}'"
    if name.partition(".")[0].strip().lower() in DEVICES:
        return f"expected a name that files can have on every system, got '{name}'"
    if len(name.encode()) > longest:
        return f"expected a name of at most {longest} bytes, got {len(name.encode())}"
    return ""


def file_stem(name: str) -> str:
    """The stem of the files of what has that name: itself, blanks as underscores.

    Raises:
        UserMistake: no file may have that name.
    """
    flaw = name_flaw(name)
    if flaw:
        raise UserMistake(f"name: {flaw}")
    return name.replace(" ", "_")
