"""The page of names that have changed, from the package's own table of them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from gallery import keep

from oed.foundation import moved

SAID = """\
# Names that have changed

Public names go on working by their old ones until 2.0, with a warning (`DeprecationWarning`). Attributes and
modules fail by their old names, and say the new ones. Saved records are read whatever their age.
"""


def write(file: Path) -> None:
    """Write the page: public names, attributes, modules."""
    attributes = [
        (f"{kind}.{old}", f"{kind}.{new}")
        for kind, names in sorted(moved.ATTRIBUTES.items())
        for old, new in names.items()
    ]
    modules = [(f"oed.{old}", f"oed.{new}") for old, new in sorted(moved.PLACES.items())]
    parts = [
        ("Public names", [(f"oed.{old}", f"oed.{new}") for old, new in moved.NAMES.items()]),
        ("Attributes", attributes),
        ("Modules, which are private: import public names from `oed`", modules),
    ]
    file.parent.mkdir(parents=True, exist_ok=True)
    keep(file, "\n".join([SAID, *(_table(title, rows) for title, rows in parts)]))


def _table(title: str, rows: Iterable[tuple[str, str]]) -> str:
    lines = [f"| `{old}` | `{new}` |" for old, new in rows]
    return "\n".join([f"## {title}", "", "| before | now |", "|---|---|", *lines, ""])
