"""Text tables as robots log them: the delimiter and the header found, the cells turned into numbers."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import FileIssue, LogError
from oed.foundation.files import text_of
from oed.foundation.quantities import plain_number
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean
from oed.logs.series import NotInLog, Rows, shortened

Delimiter = Literal[",", ";", "\t", " ", "|", "tab", "blanks"]
BLANKS = " "
"""Stands for any number of blanks between cells."""
DELIMITERS = {"tab": "\t", "blanks": BLANKS}
"""Names in study files of those that are hard to see."""

COMMENT, QUOTE = ("#", "%"), '"'
LARGEST = 1e30
"""No number of a robot is larger, in any unit; what is stands for a missing one."""

MOST_LOG_BYTES = 2**30
"""Bytes of a log: days of driving."""

NAMES = 40
"""Columns of a header that are shown."""

MAY_BE_HEADER = "its first row has numbers, and so is no header; where it is one, say `header: true`"
"""Of a file whose first row has other cells as well."""

MAY_BE_COMMENT = " (the line has as many cells as a row; where it is a comment, say `comment: '{}'`)"
"""Of a row that begins as comments do."""

MOST = 0.5
"""Share of the lines beyond which what they have in common is their delimiter."""
_LOOKED_AT = 20
"""Rows by which the delimiter and the header are found."""
_NAME = re.compile(r"[\w ./()\[\]{}<>^°%#*+-]{0,60}")
"""What columns are called; other text has more signs and no end."""
_COMMA = re.compile(r"[-+]?\d*,\d*(e[-+]?\d+)?", re.IGNORECASE)
"""A number with a comma for its point."""
_FIGURES = re.compile(r"[-+\d.,: ]*")
"""What numbers and times may be written with."""

Cells = Callable[[str], list[str]]
"""The cells of a row's text."""


@dataclass(frozen=True)
class Table:
    """A text table: rows, the lines they stand in, and the names of the columns.

    Attributes:
        file: its name.
        header: names of the columns; empty where the file has none.
        lines: of the rows, from 1.
        rows: their text; cells are taken from it as they are asked for, for logs may be long.
        cells: of a row's text.
        plain: the delimiter of rows without quotes, which need no more than to be cut at it; None where
            some have quotes.
        cut_off: whether the last line was left out because the file breaks off in it.
        header_in_doubt: whether the first row was taken for one of numbers though it has other cells as well.
        left_out: how many rows before each, of its run, a study leaves out; None where it leaves out none.
    """

    file: str
    header: tuple[str, ...]
    lines: Rows
    rows: list[str]
    cells: Cells
    plain: str | None
    cut_off: bool = False
    header_in_doubt: bool = False
    left_out: Rows | None = None

    def only(self, chosen: Bools) -> Table:
        """The table with some of its rows."""
        rows = np.flatnonzero(chosen)
        left_out = None if self.left_out is None else self.left_out[rows]
        in_doubt = self.header_in_doubt and bool(chosen[0])
        own = [self.rows[row] for row in rows]
        return replace(self, rows=own, lines=self.lines[rows], left_out=left_out, header_in_doubt=in_doubt)

    @cached_property
    def width(self) -> int:
        """Number of columns."""
        return len(self.header) or max((len(self.cells(row)) for row in self.rows), default=0)

    def label(self, place: int) -> str:
        """A column's name, or its number from 0."""
        return self.header[place] if place < len(self.header) and self._is_header else f"column {place}"

    @property
    def _is_header(self) -> bool:
        # Another text's first line is nobody's business.
        return len(self.header) > 1 and all(map(_NAME.fullmatch, self.header))

    def _known_beside(self, column: str) -> str:
        if not self._is_header:
            return "; its first line does not look like one: is it the right file?"
        rest, hint = len(self.header) - NAMES, did_you_mean(column, self.header)
        known = f"it has {', '.join(self.header[:NAMES])}" + (f" and {rest} more" if rest > 0 else "")
        return f"{hint or ';'} {known}"

    def place(self, column: int | str, *key: str) -> int:
        """Index of a column given by its name or index, at the path `key` of the study's key `log`.

        Raises:
            LogError: there is no such column (`NotInLog`); says which there are.
        """
        reason = self._reason_against(column)
        if reason:
            shown = key[-2] if key[-1] == "column" else key[-1]
            raise LogError([NotInLog(self.file, self._first_line, 0, shown, reason, ("log", *key))])
        if isinstance(column, str) and column in self.header:
            return self.header.index(column)
        return int(column)

    def _reason_against(self, column: int | str) -> str:
        if isinstance(column, str) and self.header:
            count = self.header.count(column)
            if count > 1:
                return f"the header has {column!r} {count} times; give the column's index, from 0"
            return "" if count else f"the header lacks {column!r}{self._known_beside(column)}"
        if isinstance(column, str) and not column.isdecimal():
            doubt = f" ({MAY_BE_HEADER})" if self.header_in_doubt else ""
            return (
                f"the file has no header, so {column!r} is not known; give the column's index, from 0{doubt}"
            )
        last = self.width - 1
        return "" if int(column) <= last else f"there is no column {column}; the last one is {last}, from 0"

    @property
    def _first_line(self) -> int:
        return int(self.lines[0]) - bool(self.header) if len(self.lines) else 0

    def texts(self, place: int) -> list[str]:
        """A column's cells, "" where a row is too short."""
        rows = map(self.cells, self.rows)
        return [row[place].strip() if place < len(row) else "" for row in rows]

    def numbers(self, place: int) -> tuple[Array, list[FileIssue]]:
        """A column (rows,), not-a-number in empty cells, and an issue for each cell that is no number."""
        values = self._all_numbers(place)
        if values is not None:
            return values, []
        cells = self.texts(place)
        values = np.array([_number(cell) for cell in cells])
        wrong = [row for row in np.flatnonzero(np.isnan(values)).tolist() if cells[row]]
        if len(wrong) > 1 and not any(_is_float(cell) or _FIGURES.fullmatch(cell) for cell in cells if cell):
            text = (
                "expected finite numbers, and the column has none: is it the right one, and the right file?"
            )
            return values, [FileIssue(self.file, int(self.lines[0]), place + 1, self.label(place), text)]
        if len(wrong) > 1 and all(_COMMA.fullmatch(cells[row]) for row in wrong):
            first, got = int(self.lines[wrong[0]]), written(cells[wrong[0]])
            text = f"decimals need a point, got {len(wrong)} with a comma, such as {got}"
            return values, [FileIssue(self.file, first, place + 1, self.label(place), text)]
        return values, [self.cell_issue(row, place, cells[row]) for row in wrong]

    def finite(self, place: int, skip: bool = False) -> Array:
        """A column (rows,), not-a-number in empty cells.

        Args:
            place: of the column.
            skip: whether some other cells may be no numbers, as long as any is one.

        Raises:
            LogError: cells that are no numbers.
        """
        values, issues = self.numbers(place)
        if issues and (not skip or np.isnan(values).all()):
            raise LogError(issues)
        return values

    def _all_numbers(self, place: int) -> Array | None:
        # Almost every column of almost every log; None where cells have to be looked at one by one.
        if self.plain is None:
            return None
        delimiter = None if self.plain == BLANKS else self.plain
        try:
            values = np.loadtxt(self.rows, delimiter=delimiter, usecols=place, comments=None, ndmin=1)
        except ValueError:
            return None
        return values if (np.abs(values) < LARGEST).all() else None

    def cell_issue(self, row: int, place: int, cell: str = "") -> FileIssue:
        """A cell that is no finite number, or the row of one cell, which is none, that it would be in.

        Args:
            row: from 0.
            place: of the column, from 0.
            cell: its text; "" for none.
        """
        found = len(self.cells(self.rows[row]))
        if found == 1 < self.width:
            # Its text is nobody's business.
            return FileIssue(self.file, int(self.lines[row]), 0, "", _expected(self.width, found))
        got = f"got {written(cell)}" if cell else "the cell is empty"
        hint = " (decimals need a point)" if "," in cell else ""
        if self.rows[row].lstrip().startswith(COMMENT):
            hint = MAY_BE_COMMENT.format(self.rows[row].lstrip()[0])
        if self.header_in_doubt and not row and cell:
            hint = f" ({MAY_BE_HEADER})"
        text = f"expected a finite number, {got}{hint}"
        return FileIssue(self.file, int(self.lines[row]), place + 1, self.label(place), text)


def _expected(width: int, found: int) -> str:
    return f"expected {width} cells, as in the first line, got {found}"


def _number(cell: str) -> float:
    value = plain_number(cell)
    return value if value is not None and abs(value) < LARGEST else math.nan


def read_table(
    file: Path,
    delimiter: str | None = None,
    header: bool | None = None,
    *,
    ragged: bool = False,
    comment: str | None = None,
) -> Table:
    """Read a text table.

    Lines that begin with # or % are comments where they stand above the first row, of which the last may be
    the header, or have another number of cells than the rows: one with as many, as a spreadsheet's error
    `#DIV/0!` begins, is a row.

    Args:
        file: to read.
        delimiter: between cells, as studies name it, " " for any number of blanks; found by itself if None.
        header: whether the first row has the names; if None it does where it has names above numbers, and
            no numbers but a few whole ones, or such as count columns.
        ragged: whether rows may be of several types, each of a width of its own; `even` makes a table of one.
        comment: text that lines begin with which are comments wherever they stand.

    Raises:
        LogError: no such file, not text, or nothing in it.
    """
    # Spreadsheets begin a file with a byte-order mark.
    texts = text_of(file, LogError, "utf-8-sig", MOST_LOG_BYTES).splitlines()
    # Most lines begin with a digit, which is enough to know that they are rows.
    marks = COMMENT if comment is None else (*COMMENT, comment)
    kept = [index for index, text in enumerate(texts) if text[:1].isdigit() or _is_row(text, marks)]
    if not kept:
        raise LogError.about(file, "the file has no rows")
    first_lines = [texts[index] for index in kept[:_LOOKED_AT]]
    delimiter = DELIMITERS.get(delimiter or "", delimiter) or _delimiter(first_lines)
    kept = sorted([*kept, *_rows_like_comments(texts, kept, delimiter, comment)])
    rows, lines = [texts[index] for index in kept], np.array(kept, dtype=np.intp) + 1
    quoted = delimiter != BLANKS and any(QUOTE in row for row in rows)
    cells = partial(_quoted_cells if quoted else _plain_cells, delimiter)
    if quoted:
        _require_closed_quotes(file, rows, lines, cells)
    above = texts[kept[0] - 1] if kept[0] else ""
    first_rows = [cells(row) for row in rows[:_LOOKED_AT]]
    like, mixed = _like_header(first_rows) if header is None else (header, False)
    names, first = _header(first_rows[0], _comment_cells(above, delimiter), like, header)
    if first == len(rows):
        raise LogError.about(file, "the file has no rows after its header")
    rows, lines = rows[first:], lines[first:]
    plain, in_doubt = None if quoted else delimiter, mixed and not like
    table = Table(str(file), names, lines, rows, cells, plain, header_in_doubt=in_doubt)
    return table if ragged else even(table)


def even(table: Table) -> Table:
    """A table without half a last line.

    Raises:
        LogError: rows with more cells than the first one has.
    """
    first = table.cells(table.rows[0])
    _require_room(Path(table.file), _width(table.header, first), table.rows, table.lines, table.cells)
    if not _is_cut_off(table.rows, table.cells):
        return table
    whole = np.arange(len(table.rows)) < len(table.rows) - 1
    return replace(table.only(whole), cut_off=True)


def _is_row(text: str, marks: tuple[str, ...]) -> bool:
    return bool(text) and not text.isspace() and not text.lstrip().startswith(marks)


def _rows_like_comments(
    texts: Sequence[str], kept: Sequence[int], delimiter: str, comment: str | None
) -> list[int]:
    # Places of lines after the first row that begin as comments do and have as many cells as rows.
    widths = {len(_plain_cells(delimiter, texts[index])) for index in kept[:_LOOKED_AT]} - {1}
    marked = [
        (index, _plain_cells(delimiter, text))
        for index, text in enumerate(texts)
        if not text[:1].isdigit() and index > kept[0] and text.lstrip().startswith(COMMENT)
        if comment is None or not text.lstrip().startswith(comment)
    ]
    # Words between blanks are a comment, too, but where there are numbers among them.
    needs_number = delimiter == BLANKS
    return [
        index
        for index, cells in marked
        if len(cells) in widths and (not needs_number or any(map(_is_float, cells)))
    ]


def _is_cut_off(rows: Sequence[str], cells: Cells) -> bool:
    # A robot that is switched off writes half a line.
    first, before, last = (len(cells(rows[index])) for index in (0, max(len(rows) - 2, 0), -1))
    return len(rows) > 1 and last < min(before, first)


def _delimiter(lines: Sequence[str]) -> str:
    # The last line may be half a one, and others among them no rows at all.
    whole = lines[:-1] or lines
    shares = {mark: np.mean([mark in line for line in whole]) for mark in "\t;," if mark in whole[0]}
    likely = [mark for mark, share in shares.items() if share > MOST]
    return max(likely, key=lambda mark: shares[mark], default=BLANKS)


def _plain_cells(delimiter: str, row: str) -> list[str]:
    return row.split() if delimiter == BLANKS else row.split(delimiter)


def _quoted_cells(delimiter: str, row: str) -> list[str]:
    if QUOTE not in row:
        return row.split(delimiter)
    return next(csv.reader([row], delimiter=delimiter, skipinitialspace=True, strict=True))


def _require_closed_quotes(file: Path, rows: Sequence[str], lines: Rows, cells: Cells) -> None:
    # A quote that is not closed in its line would swallow the lines after it.
    issues = []
    for row, line in zip(rows, lines.tolist(), strict=True):
        try:
            cells(row)
        except csv.Error as error:
            stray = "a stray double quote: a cell in quotes has to end with one, in its line"
            text = f"is not a table: {error}" if "larger" in str(error) else stray
            issues.append(FileIssue(str(file), line, 0, "", text))
    if issues:
        raise LogError(shortened(issues))


def _width(names: Sequence[str], row: Sequence[str]) -> int:
    # A header may lack the name of one column, but not of as many as commas for points make.
    return len(names) if names and len(row) == 2 * len(names) else max(len(names), len(row))


def _require_room(file: Path, width: int, rows: Sequence[str], lines: Rows, cells: Cells) -> None:
    # A cell too many moves those after it into columns of others; empty ones at the end do no harm. A single
    # column is no table's.
    issues = []
    for row, line in zip(rows, lines.tolist(), strict=True) if width > 1 else ():
        found = cells(row)
        if len(found) > width and any(map(str.strip, found[width:])):
            hint = " (decimals need a point)" if len(found) == 2 * width else ""
            text = f"{_expected(width, len(found))}{hint}"
            issues.append(FileIssue(str(file), line, width + 1, "", text))
    if issues:
        raise LogError(shortened(issues))


def _comment_cells(comment: str, delimiter: str) -> list[str]:
    if not comment.lstrip().startswith(COMMENT):
        return []
    return _plain_cells(delimiter, comment.strip().lstrip("".join(COMMENT)))


def _like_header(rows: Sequence[Sequence[str]]) -> tuple[bool, bool]:
    # Whether the first row looks like names, by what it has above numbers, and whether it has both.
    first, others = rows[0], rows[1:]
    places = [place for place in range(max(map(len, rows))) if _has_numbers(others, place)]
    above = [first[place] for place in places if place < len(first)] if places else first
    above = [cell for cell in above if cell.strip()]
    numbers = [cell.strip() for cell in above if _is_float(cell)]
    names = {cell for cell in above if not _is_float(cell)}
    # Names may be numbers, but hardly broken ones, and are apart where what is missing is written alike.
    whole = all(map(str.isdecimal, numbers))
    return bool(names) and whole and (len(names) > len(numbers) or _are_counted(numbers)), bool(names)


def _has_numbers(rows: Sequence[Sequence[str]], place: int) -> bool:
    # In most of its cells.
    cells = [row[place] for row in rows if place < len(row) and row[place].strip()]
    return 2 * sum(map(_is_float, cells)) > len(cells) > 0


def _are_counted(cells: Sequence[str]) -> bool:
    # As columns without names are by other programs: 0, 1, 2.
    return len(cells) > 1 and all(int(after) == int(cell) + 1 for cell, after in pairwise(cells))


def _header(
    row: Sequence[str], comment: Sequence[str], like: bool, given: bool | None
) -> tuple[tuple[str, ...], int]:
    # The names, and which row is the first of numbers.
    above = given is not False and len(comment) == len(row)
    if not like and not above:
        return (), 0
    named = any(cell.strip() and not _is_float(cell) for cell in row)
    use_comment = above and not (like and named)
    names = comment if use_comment else row
    return tuple(name.strip() for name in names), 0 if use_comment else 1


def _is_float(cell: str) -> bool:
    # A logged "nan" or "inf" is no name of a column, nor is "1_0", which is a mistake in a row.
    try:
        float(cell)
    except ValueError:
        return False
    return True
