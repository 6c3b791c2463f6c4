"""Text tables as robots log them: the delimiter and the header found, the cells turned into numbers."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from oed.errors import FileFlaw, LogError
from oed.logs.series import Array, Rows

BLANKS = " "
DELIMITERS = {"tab": "\t", "blanks": BLANKS}
"""Names in study files of those that are hard to see."""

COMMENT = ("#", "%")
LARGEST = 1e30
"""No number of a robot is larger, in any unit; what is stands for a missing one."""

_LOOKED_AT = 20


@dataclass(frozen=True)
class UnknownColumn(FileFlaw):
    """A column that the table has not: the study may have to say which one is meant."""


@dataclass(frozen=True)
class Table:
    """A text table: rows of cells, the lines they stand in, and the names of the columns.

    Attributes:
        file: its name.
        header: names of the columns; empty where the file has none.
        lines: of the rows, from 1.
        rows: cells as text.
        cut_off: whether the last line was left out because the file breaks off in it.
    """

    file: str
    header: tuple[str, ...]
    lines: Rows
    rows: list[list[str]]
    cut_off: bool = False

    @cached_property
    def width(self) -> int:
        """Number of columns."""
        return len(self.header) or max(map(len, self.rows), default=0)

    def label(self, place: int) -> str:
        """A column's name, or its number from 0."""
        return self.header[place] if place < len(self.header) else f"column {place}"

    def place(self, column: int | str, key: str) -> int:
        """Index of a column given by its name or index.

        Raises:
            LogError: there is no such column (an `UnknownColumn`); says which there are.
        """
        reason = self._reason_against(column)
        if reason:
            raise LogError([UnknownColumn(self.file, self._first_line, 0, key, reason)])
        if isinstance(column, str) and column in self.header:
            return self.header.index(column)
        return int(column)

    def _reason_against(self, column: int | str) -> str:
        if isinstance(column, str) and self.header:
            count = self.header.count(column)
            if count > 1:
                return f"the header has {column!r} {count} times; give the column's index, from 0"
            return "" if count else f"the header lacks {column!r}; it has {', '.join(self.header)}"
        if isinstance(column, str) and not column.isdecimal():
            return f"the file has no header, so {column!r} is not known; give the column's index, from 0"
        last = self.width - 1
        return "" if int(column) <= last else f"there is no column {column}; the last one is {last}, from 0"

    @property
    def _first_line(self) -> int:
        return int(self.lines[0]) - bool(self.header) if len(self.lines) else 0

    def texts(self, place: int) -> list[str]:
        """A column's cells, "" where a row is too short."""
        return [row[place].strip() if place < len(row) else "" for row in self.rows]

    def numbers(self, place: int) -> tuple[Array, list[FileFlaw]]:
        """A column (rows,), not-a-number in empty cells, and a flaw for each cell that is no number."""
        try:
            # Almost every column of almost every log; the rest is looked at cell by cell.
            values = np.array([float(row[place]) for row in self.rows])
            if (np.abs(values) < LARGEST).all():
                return values, []
        except (ValueError, IndexError):
            pass
        cells = self.texts(place)
        values = np.array([_number(cell) for cell in cells])
        wrong = [row for row in np.flatnonzero(np.isnan(values)).tolist() if cells[row]]
        return values, [self.cell_flaw(row, place, cells[row]) for row in wrong]

    def cell_flaw(self, row: int, place: int, cell: str = "") -> FileFlaw:
        """A cell that is no finite number."""
        got = f"got {cell!r}" if cell else "the cell is empty"
        hint = " (decimals need a point)" if "," in cell else ""
        text = f"expected a finite number, {got}{hint}"
        return FileFlaw(self.file, int(self.lines[row]), place + 1, self.label(place), text)


def _number(cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        return math.nan
    return value if abs(value) < LARGEST else math.nan


def read_table(file: Path, delimiter: str | None = None, header: bool | None = None) -> Table:
    """Read a text table.

    Args:
        file: to read; lines that begin with # or % are comments, of which one right above the first row
            may be the header.
        delimiter: between cells, " " for any number of blanks; found by itself if None.
        header: whether the first row has the names; if None it does where it is not all numbers.

    Raises:
        LogError: no such file, not text, or nothing in it.
    """
    numbered = [(number, line) for number, line in enumerate(_lines(file), start=1) if line.strip()]
    plain = [(number, line) for number, line in numbered if not line.lstrip().startswith(COMMENT)]
    if not plain:
        raise LogError([FileFlaw(str(file), 0, 0, "", "the file has no rows")])
    delimiter = delimiter or _delimiter([line for _, line in plain[:_LOOKED_AT]])
    cells = _cells(file, [line for _, line in plain], delimiter)
    lines = np.array([plain[index][0] for index, _ in cells], dtype=np.intp)
    rows = [row for _, row in cells]
    comment = next((line for number, line in numbered if number == lines[0] - 1), "")
    names, first = _header(rows, _comment_cells(comment, delimiter), header)
    rows, lines = rows[first:], lines[first:]
    if not rows:
        raise LogError([FileFlaw(str(file), 0, 0, "", "the file has no rows after its header")])
    # A robot that is switched off leaves half a line.
    cut_off = len(rows) > 1 and len(rows[-1]) < min(len(rows[-2]), len(rows[0]))
    kept = len(rows) - cut_off
    return Table(str(file), names, lines[:kept], rows[:kept], cut_off)


def _lines(file: Path) -> list[str]:
    try:
        # Spreadsheets begin a file with a byte-order mark.
        return file.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        reason = "no such file"
    except IsADirectoryError:
        reason = "expected a file, got a folder"
    except UnicodeDecodeError:
        reason = "is not a text file"
    except OSError as error:
        reason = f"cannot be read: {error.strerror}"
    raise LogError([FileFlaw(str(file), 0, 0, "", reason)])


def _delimiter(lines: Sequence[str]) -> str:
    # The last line may be half a one.
    whole = lines[:-1] or lines
    return next((mark for mark in "\t;," if all(mark in line for line in whole)), BLANKS)


def _cells(file: Path, lines: Sequence[str], delimiter: str) -> list[tuple[int, list[str]]]:
    # Each row with the index of the line it ends in.
    if delimiter == BLANKS:
        return [(index, line.split()) for index, line in enumerate(lines)]
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    try:
        return [(reader.line_num - 1, row) for row in reader]
    except csv.Error as error:
        raise LogError([FileFlaw(str(file), 0, 0, "", f"is not a table: {error}")]) from None


def _comment_cells(comment: str, delimiter: str) -> list[str]:
    if not comment.lstrip().startswith(COMMENT):
        return []
    text = comment.strip().lstrip("".join(COMMENT))
    return text.split() if delimiter == BLANKS else text.split(delimiter)


def _header(
    rows: Sequence[Sequence[str]], comment: Sequence[str], given: bool | None
) -> tuple[tuple[str, ...], int]:
    # The names, and which row is the first of numbers.
    named = any(cell.strip() and not _is_float(cell) for cell in rows[0])
    if given is False or (given is None and not named and len(comment) != len(rows[0])):
        return (), 0
    use_comment = not named and len(comment) == len(rows[0])
    names = comment if use_comment else rows[0]
    return tuple(name.strip() for name in names), 0 if use_comment else 1


def _is_float(cell: str) -> bool:
    # A logged "nan" or "inf" is no name of a column.
    try:
        float(cell)
    except ValueError:
        return False
    return True
