"""Numbers on one clock, each with the line it stands in, so that whatever is wrong can be pointed at."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import FileIssue, LogError
from oed.foundation.quantities import LARGEST, too_large

Rows = npt.NDArray[np.intp]

MOST_OF_A_KIND = 10
"""Issues of one kind that are named one by one; the rest is counted."""

SHORTEST = 1e-9
"""A step in time that is none [s]."""
RARE = 1e-3
"""Share of rows up to which times that stand still are slips of a logger, of which the later row counts."""

EXACT = 9
"""Decimals of a second beyond which times differ by rounding."""

_VARYING = re.compile(r"'[^']*'|[-+]?\d[\d.e+-]*")
"""What differs between issues of one kind: quoted texts and numbers."""


def time_text(time: float) -> str:
    """A time [s] as messages write it: two that differ are not written alike."""
    return repr(round(float(time), EXACT)).removesuffix(".0")


@dataclass(frozen=True)
class NotInLog(FileIssue):
    """What a study names and a log has not; `named` is the path of the study's key that names it."""

    named: tuple[str, ...] = ()


@dataclass(frozen=True)
class Series:
    """Rows of a file on one clock.

    Attributes:
        file: it was read from.
        clock: name of the column (or topic) of the times.
        times: (n,) [s].
        values: (n, columns).
        lines: where each row stands, from 1.
        counted: what `lines` counts, "line" in a text file, "message" in a bag.
        skipped: where rows stood that are left out, for some of their numbers are none.
        arrived: how many rows there were with those; 0 where none is left out.
    """

    file: str
    clock: str
    times: Array
    values: Array
    lines: Rows
    counted: str = "line"
    skipped: tuple[int, ...] = ()
    arrived: int = 0

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.times)

    def rows(self, chosen: Bools | Rows | slice) -> Series:
        """Some of the series' rows."""
        return replace(self, times=self.times[chosen], values=self.values[chosen], lines=self.lines[chosen])

    def with_values(self, values: Array) -> Series:
        """Other values (n, columns) at the same times."""
        return replace(self, values=values)

    def emptied(self, invalid: Bools, *, own_clock: bool = True) -> Series:
        """With nothing in some rows, which count as skipped.

        Args:
            invalid: which, (n,).
            own_clock: whether the times are those of nothing else, and go with the values.
        """
        if not invalid.any():
            return self
        values = np.where(invalid[:, None], np.nan, self.values)
        times = np.where(invalid, np.nan, self.times) if own_clock else self.times
        skipped = tuple(self.lines[invalid].tolist())
        return replace(self, times=times, values=values, skipped=skipped, arrived=len(self))

    def finite(self, skip: bool) -> Series:
        """The rows whose values are all finite.

        Raises:
            LogError: there are others, and they are not to be skipped, or there is no other.
        """
        valid = np.isfinite(self.values)
        invalid = np.asarray(~valid.all(axis=1))
        if invalid.any() and (not skip or invalid.all()):
            wrong = {row: self.values[row][~valid[row]][0] for row in np.flatnonzero(invalid).tolist()}
            text = "expected a finite number, got '{}'"
            raise LogError([self.issue(row, self.clock, text.format(wrong[row])) for row in wrong])
        return self.emptied(invalid).rows(~invalid)

    def at(self, row: int) -> str:
        """A row's time and place, for messages."""
        return f"t = {time_text(self.times[row])} s ({self.counted} {self.lines[row]})"

    def issue(self, row: int, key: str, message: str) -> FileIssue:
        """An issue in a row.

        Args:
            row: from 0.
            key: the column or what else is wrong there.
            message: why.
        """
        line = int(self.lines[row])
        if self.counted == "line":
            return FileIssue(self.file, line, 0, key, message)
        about = "" if key in ("", self.clock) else f"{key}: "
        return FileIssue(self.file, 0, 0, self.clock, f"{self.counted} {line}: {about}{message}")

    def without_repeats(self) -> Series:
        """Without rows that repeat the one before them, time and all."""
        same = (np.diff(self.times) == 0) & np.all(np.diff(self.values, axis=0) == 0, axis=1)
        return self.rows(np.concatenate([[True], ~same])) if len(self) else self

    def without_slips(self) -> Series:
        """Without rows at whose time there is a later one, where these are rare."""
        return self.rows(np.append(~self._slips, True)) if self._slips.any() else self

    @property
    def _slips(self) -> Bools:
        # Rows (n - 1,) that the next one follows at the same time; none where there are many of them.
        same = np.abs(np.diff(self.times)) <= SHORTEST
        return np.asarray(same & (same.sum() <= RARE * len(self)))

    def clock_issues(self) -> list[FileIssue]:
        """Every row whose time does not rise, but for rare slips."""
        issues = []
        for row in np.flatnonzero((np.diff(self.times) <= SHORTEST) & ~self._slips).tolist():
            before, after = self.times[row], self.times[row + 1]
            before_it = f"({self.counted} {self.lines[row]})"
            if before <= after:
                text = f"time stands still: {time_text(after)} s, the same as in the row before {before_it}"
            else:
                text = f"time goes back: {time_text(after)} s after {time_text(before)} s {before_it}"
            issues.append(self.issue(row + 1, self.clock, text))
        return issues

    def too_large(self, names: Sequence[str]) -> Iterator[FileIssue]:
        """The first number of each column beyond what a robot's can be, SI; `names` are the columns'."""
        table = np.column_stack([self.times, self.values])
        beyond = ~(np.abs(table) <= LARGEST)
        for place in np.flatnonzero(beyond.any(axis=0)).tolist():
            row = int(np.argmax(beyond[:, place]))
            yield self.issue(row, (self.clock, *names)[place], too_large(table[row, place]))


def shortened(issues: Iterable[FileIssue]) -> list[FileIssue]:
    """Files in their order, lines in theirs; few issues of each kind are named, the rest is counted."""
    once = list(dict.fromkeys(issues))
    files = {name: number for number, name in enumerate(dict.fromkeys(issue.file for issue in once))}

    def place(issue: FileIssue) -> tuple[int, int, int]:
        return files[issue.file], issue.line, issue.column

    kinds: dict[tuple[str, str, str], list[FileIssue]] = {}
    for issue in sorted(once, key=place):
        kind = (issue.file, issue.key, _VARYING.sub("#", issue.message))
        kinds.setdefault(kind, []).append(issue)
    return sorted((issue for alike in kinds.values() for issue in _first(alike)), key=place)


def _first(alike: Sequence[FileIssue]) -> list[FileIssue]:
    shown, more = list(alike[:MOST_OF_A_KIND]), len(alike) - MOST_OF_A_KIND
    if more > 0:
        shown[-1] = replace(shown[-1], message=f"{shown[-1].message} (and {more} more like it)")
    return shown


def together(work: Iterable[Callable[[], Any]]) -> list[Any]:
    """What several pieces of work give, each of which may fail without stopping the others.

    Raises:
        LogError: every issue of any of them.
    """
    found, issues = list[Any](), list[FileIssue]()
    for one in work:
        try:
            found.append(one())
        except LogError as error:
            issues += error.issues
    if issues:
        raise LogError(shortened(issues))
    return found
