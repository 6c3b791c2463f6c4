"""What saved data is made of: parts with keys, numbers of a sane size, tables of one width."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from oed.foundation.names import identifier_flaw, name_flaw
from oed.foundation.quantities import LARGEST as FARTHEST

LARGEST = 1e100
"""Of any number: its square is one as well."""


class Stored(BaseModel):
    """A part of a saved file: no number passes for a text, and keys of later versions are kept."""

    model_config = ConfigDict(strict=True, extra="allow", frozen=True, allow_inf_nan=False, defer_build=True)

    def plain(self) -> dict[str, Any]:
        """As plain data, with what files of earlier versions leave out."""
        return self.model_dump()


class Keyed(Stored, Mapping[str, Any]):
    """A part that is read by its keys too, as the plain data that it stands for."""

    def __getitem__(self, key: str) -> Any:
        """What stands under a key."""
        if key in type(self).model_fields:
            return getattr(self, key)
        return (self.model_extra or {})[key]

    def __iter__(self) -> Iterator[str]:  # type: ignore[override]
        """The keys."""
        return iter((*type(self).model_fields, *(self.model_extra or {})))

    def __len__(self) -> int:
        """How many keys there are."""
        return len(type(self).model_fields) + len(self.model_extra or {})


def _name(text: str) -> str:
    flaw = name_flaw(text)
    if flaw:
        raise ValueError(flaw)
    return text


def _identifier(text: str) -> str:
    flaw = identifier_flaw(text)
    if flaw:
        raise ValueError(flaw)
    return text


Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Size = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]
"""A length or another size that is drawn: as large as a study's may be [SI]."""
Positive = Annotated[float, Field(ge=0, le=LARGEST)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0, le=10**12)]
Seed = Annotated[int, Field(ge=0)]
Name = Annotated[str, AfterValidator(_name)]
"""What files are named after."""
Identifier = Annotated[str, AfterValidator(_identifier)]
"""The name of a parameter, an input or of what it is, which files and figures are named after too."""
Numbers = list[Number]
Matrix = list[Numbers]
Sizes = list[list[Size]]
Point = Annotated[list[Size], Field(min_length=2, max_length=2)]
Line = Annotated[list[Point], Field(min_length=1)]
"""Where something is, or goes along [m]."""
Interval = Annotated[list[Number | None], Field(min_length=2, max_length=2)]


def require_table(what: str, rows: Sequence[Sequence[Any]], count: int | None, width: int | None) -> None:
    """Refuse what is no table of so many rows and columns, None for any number.

    Raises:
        ValueError: says what was expected.
    """
    if count is not None and len(rows) != count:
        raise ValueError(f"{what}: expected {count} rows, got {len(rows)}")
    if width is None:
        return
    for place, row in enumerate(rows):
        if len(row) != width:
            raise ValueError(f"{what}.{place}: expected {width} numbers, got {len(row)}")


def require_alike(count: int, **lists: Sequence[Any]) -> None:
    """Refuse lists that have not so many entries each.

    Raises:
        ValueError: names the first that has not.
    """
    for what, values in lists.items():
        if len(values) != count:
            raise ValueError(f"{what}: expected {count} of them, got {len(values)}")


def require_known(what: str, names: Iterable[str], known: Iterable[str]) -> None:
    """Refuse names that nothing has.

    Raises:
        ValueError: names the first, and those that there are.
    """
    there = list(known)
    for name in names:
        if name not in there:
            raise ValueError(f"{what}: expected one of {', '.join(there) or 'none'}, got {name!r}")


def require_different(what: str, names: Sequence[str]) -> None:
    """Refuse a name given twice.

    Raises:
        ValueError: names it.
    """
    twice = next((name for place, name in enumerate(names) if name in names[:place]), None)
    if twice is not None:
        raise ValueError(f"{what}: a second one named {twice!r}")


def require_pairs(
    what: str, table: Iterable[tuple[str, str]], one: Sequence[str], other: Sequence[str]
) -> None:
    """Refuse a table by pairs of names in which one is missing.

    Raises:
        ValueError: names the pair.
    """
    there = set(table)
    for pair in ((first, second) for first in one for second in other):
        if pair not in there:
            raise ValueError(f"{what}: expected one of {pair[0]!r} and {pair[1]!r}, got none")
