"""Which rows of a table are wanted: those of a type, and those that a study keeps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from oed.foundation.arrays import Bools
from oed.foundation.component import Component
from oed.foundation.errors import LogError
from oed.foundation.quantities import plain_number
from oed.foundation.text import did_you_mean
from oed.logs.series import NotInLog
from oed.logs.tables.columns import ColumnPlace, Wanted
from oed.logs.tables.table import Table, even

Type = float | Annotated[str, Field(min_length=1)]
TYPES, OFTEN = 10, 3
"""How many types of a file are shown, and how many rows each of them has: other text is nobody's business."""


class Records(Component):
    """Rows of several types in one file, each with columns of its own.

    Attributes:
        column: that says of which type a row is.
        inputs: type of the rows with the inputs.
        poses: type of those with the poses; the inputs' rows have them, too, where none is given.
    """

    column: ColumnPlace
    inputs: Type
    poses: Type | None = None


def of_type(table: Table, records: Records, which: str) -> Table:
    """The rows of one type.

    Args:
        table: with rows of any.
        records: which types there are.
        which: "inputs" or "poses".

    Raises:
        LogError: no such column or type, rows with more cells than the first of their type.
    """
    wanted = getattr(records, which)
    cells = table.texts(table.place(records.column, "records", "column"))
    chosen = np.array([_is(cell, wanted) for cell in cells])
    if chosen.any():
        return even(table.only(chosen))
    known = {name: count for name, count in Counter(cells).most_common(TYPES) if count >= OFTEN and name}
    shown = ", ".join(f"{name} ({count} rows)" for name, count in known.items())
    types = f"; the types are {shown}" if shown else ""
    text = f"no row is of type {_plain(wanted)}{types}{did_you_mean(str(wanted), known)}"
    raise LogError([NotInLog(table.file, 0, 0, "records", text, ("log", "records", which))])


def _is(cell: str, wanted: Type) -> bool:
    return cell == wanted if isinstance(wanted, str) else plain_number(cell) == wanted


def _plain(wanted: Type) -> str:
    return repr(wanted) if isinstance(wanted, str) else f"{wanted:g}"


def kept_rows(table: Table, keep: Mapping[str, Wanted], skip: bool, *key: str) -> Bools:
    """Which rows have what a study keeps, (rows,).

    Args:
        table: of the log.
        keep: values, or ranges, by the column.
        skip: whether cells that are no numbers are none of these, instead of refused.
        key: path of the study's key `keep` within `log`.

    Raises:
        LogError: no such column, cells that are no numbers, or no such rows.
    """
    kept = np.ones(len(table.rows), dtype=bool)
    for name, wanted in keep.items():
        place = table.place(name, *key, name)
        if isinstance(wanted, str):
            kept &= np.array([cell == wanted for cell in table.texts(place)])
            continue
        low, high = wanted if isinstance(wanted, tuple) else (wanted, wanted)
        values = table.finite(place, skip)
        kept &= (values >= low) & (values <= high)
    if not kept.any():
        said = (f"{name} {_in_words(one)}" for name, one in keep.items())
        text = f"no row has {' and '.join(said)}"
        raise LogError([NotInLog(table.file, 0, 0, ".".join(key), text, ("log", *key))])
    return kept


def _in_words(wanted: Wanted) -> str:
    if isinstance(wanted, tuple):
        return f"from {wanted[0]:g} to {wanted[1]:g}"
    return f"= {wanted}" if isinstance(wanted, str) else f"= {wanted:g}"


def without(table: Table, kept: Bools, labels: list[str] | None) -> Table:
    """A table without the rows that are not kept, which it counts.

    Args:
        table: of the log.
        kept: (rows,).
        labels: the run of each row; None of a single one.
    """
    if kept.all():
        return table
    runs = np.zeros(len(kept), dtype=np.intp) if labels is None else np.unique(labels, return_inverse=True)[1]
    order = np.argsort(runs, kind="stable")
    left_out = np.empty(len(kept), dtype=np.intp)
    left_out[order] = np.cumsum(~kept[order])
    return replace(table, left_out=left_out).only(kept)
