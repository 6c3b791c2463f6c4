"""What saved data is made of: parts with keys, numbers of a sane size, tables of one width.

The fields of a part say what its file holds: reading checks them (pydantic), and `Stored.of` writes them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Annotated, Any, Self, TypeVar, get_args

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator
from pydantic.fields import FieldInfo

from oed.foundation.files import identifier_issue, name_issue
from oed.foundation.presenting import brief
from oed.foundation.quantities import LARGEST as FARTHEST
from oed.foundation.tidy import Tidy

Kind = TypeVar("Kind")

LARGEST = 1e100
"""Of any number: its square is one as well."""


def plain(value: Any, digits: int | None = None) -> Any:
    """A value as JSON holds it: arrays as lists, members of enumerations as their values, null where a
    number is not finite; numbers to so many decimals, None for all of them.
    """
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", by_alias=True)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray | np.generic):
        rounded = value if digits is None else np.round(value, digits)
        # Most are whole tables of finite numbers, which are to be kept as they are: no look at each.
        if rounded.dtype == float and np.isfinite(rounded).all():
            return rounded.tolist()
        return plain(rounded.tolist())
    if isinstance(value, Mapping):
        return {key: plain(entry, digits) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry, digits) for entry in value]
    if not isinstance(value, float):
        return value
    return None if not math.isfinite(value) else value if digits is None else round(value, digits)


class Stored(Tidy):
    """A part of a saved file: no number passes for a text, and keys of later versions are kept."""

    model_config = ConfigDict(strict=True, extra="allow", frozen=True, allow_inf_nan=False, defer_build=True)

    @classmethod
    def of(cls, *sources: object, **given: Any) -> Self:
        """The part that a file is to hold of objects, with numbers as JSON has them.

        Args:
            sources: a field is the attribute of its name that the first of them has; those that hold parts
                are made of the objects there alike.
            given: values of fields that are not simply such attributes.

        Raises:
            TypeError: a field that is nowhere and has no default, or a value of no field.
        """
        forms = _forms(cls)
        if not given.keys() <= forms.keys():
            raise TypeError(f"{cls.__name__} has no {', '.join(given.keys() - forms.keys())}")
        found: dict[str, Any] = {}
        for name, form in forms.items():
            own = (getattr(one, name) for one in sources if hasattr(one, name))
            value = given[name] if name in given else next(own, _ABSENT)
            if value is not _ABSENT:
                found[name] = form.made(value)
            elif form.required:
                raise TypeError(f"{cls.__name__}: expected {name}")
        return super(Tidy, cls).model_construct(**found)

    def __repr__(self) -> str:
        """Its kind and keys, large ones by their size only."""
        each = ((name, getattr(self, name, None)) for name in type(self).model_fields)
        return f"{type(self).__name__}({', '.join(f'{name}={brief(value)}' for name, value in each)})"

    __str__ = __repr__

    @model_validator(mode="after")
    def _checked(self) -> Self:
        self._require()
        return self

    def _require(self) -> None:
        # Of what has to fit together in a part: raises ValueError.
        return

    def plain(self) -> dict[str, Any]:
        """As plain data, with what files of earlier versions leave out."""
        # What does not fit is said by the reader, by its key.
        return self.model_dump(by_alias=True, warnings=False)


_ABSENT = object()


@dataclass(frozen=True)
class Rounded:
    """Marks numbers that are written to so many decimals only: drawn, or shown, not computed with."""

    digits: int


@dataclass(frozen=True)
class _Form:
    """How a field is written.

    Attributes:
        required: whether it has no default.
        part: what it holds: one, a list of them or some by name; None where it holds plain values.
        digits: decimals of its numbers, None for all of them.
        real: whether a whole number is written as any other.
    """

    required: bool
    part: type[Stored] | None
    digits: int | None
    real: bool

    def made(self, value: Any) -> Any:
        if self.part is None or value is None:
            found = plain(value, self.digits)
            return float(found) if self.real and type(found) is int else found
        if isinstance(value, Mapping):
            return {name: self._part(one) for name, one in value.items()}
        return [self._part(one) for one in value] if isinstance(value, list | tuple) else self._part(value)

    def _part(self, value: Any) -> Any:
        return value if self.part is None or isinstance(value, self.part) else self.part.of(value)


@cache
def _forms(kind: type[Stored]) -> dict[str, _Form]:
    return {name: _form(field) for name, field in kind.model_fields.items()}


def _form(field: FieldInfo) -> _Form:
    said = [*_said(field.annotation), *field.metadata]
    parts = (one for one in said if isinstance(one, type) and issubclass(one, Stored))
    return _Form(
        required=field.is_required(),
        part=next(parts, None),
        digits=next((one.digits for one in said if isinstance(one, Rounded)), None),
        real=float in said and int not in said,
    )


def _said(annotation: Any) -> Iterator[Any]:
    # A type, and everything that it is made of.
    yield annotation
    for inner in get_args(annotation):
        yield from _said(inner)


def _without(issue_of: Callable[[str], str]) -> AfterValidator:
    def sound(text: str) -> str:
        issue = issue_of(text)
        if issue:
            raise ValueError(issue)
        return text

    return AfterValidator(sound)


Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Size = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]
"""A length or another size that is drawn: as large as a study's may be [SI]."""
Positive = Annotated[float, Field(ge=0, le=LARGEST)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0, le=10**12)]
Seed = Annotated[int, Field(ge=0)]
Seconds = Annotated[Positive, Rounded(6)]
"""A time that was measured."""
Name = Annotated[str, _without(name_issue)]
"""What files are named after."""
Identifier = Annotated[str, _without(identifier_issue)]
"""The name of a parameter, an input or of what it is, which files and figures are named after too."""
Numbers = list[Number]
Matrix = list[Numbers]
Sizes = list[list[Size]]
Point = Annotated[list[Size], Field(min_length=2, max_length=2)]
Line = Annotated[list[Point], Field(min_length=1)]
"""Where something is, or goes along [m]."""


Entries = Annotated[
    list[Kind], BeforeValidator(lambda found: [] if found is None else found), Field(default_factory=list)
]
"""A list that older files leave out."""
Maybe = Number | None
Column = list[Maybe]
Place = Annotated[Column, Rounded(5)]
"""Coordinates of a path [m], or times [s]."""
Interval = Annotated[Column, Field(min_length=2, max_length=2)]


def require_table(what: str, rows: Sequence[Sequence[Any]], count: int | None, width: int | None) -> None:
    """Refuse what is no table of so many rows and columns, None for any number.

    Args:
        what: its name.
        rows: of the table.
        count: of rows.
        width: columns of each.

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

    Args:
        what: what names them.
        names: that are used.
        known: that there are.

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
