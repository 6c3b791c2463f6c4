"""Logs that come into a folder while somebody drives: which are there, and which of them are complete."""

from __future__ import annotations

import filecmp
import hashlib
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from oed.logs import BagForm, CsvForm, LogForm
from oed.logs.form import is_bag

UNFINISHED = (".part", ".partial", ".tmp", ".crdownload", "~")
"""Endings of files that something else is still writing."""

FINGERPRINT = 32
"""Letters of the fingerprint of a log."""
Sign = tuple[int, int]
"""Size [bytes] of a log, and when it was last changed [ns]."""


@dataclass(frozen=True)
class LogFolder:
    """A folder that logs come into.

    Attributes:
        folder: it.
        form: how its logs are read; of bags it takes bags alone, else files alone.
        pattern: of their names, as a shell has it; None for any.
    """

    folder: Path
    form: LogForm
    pattern: str | None = None

    def path(self, name: str) -> Path:
        """The log of that name."""
        return self.folder / name

    def found(self) -> dict[str, Sign]:
        """All logs by their names, complete or not."""
        places = [one for one in sorted(self.folder.iterdir()) if self._fits(one)]
        beside = {other for one in places for other in beside_of(one, self.form)}
        signs = {one.name: _sign(one, self.form) for one in places if one not in beside}
        return {name: sign for name, sign in signs.items() if sign is not None}

    def new(self, known: Mapping[str, Sign]) -> dict[str, Sign]:
        """Logs that are not known, or have changed since."""
        return {name: sign for name, sign in self.found().items() if known.get(name) != sign}

    def complete(self, known: Mapping[str, Sign], poll: float, settle: float) -> dict[str, Sign]:
        """Wait for new logs, until none of them changes any more.

        Args:
            known: logs by their names, as they were.
            poll: time between looks [s].
            settle: for which they have to stay as they are [s].
        """
        before, since = dict[str, Sign](), time.monotonic()
        while True:
            new = self.new(known)
            if new != before:
                before, since = new, time.monotonic()
            elif new and time.monotonic() - since >= settle:
                return new
            time.sleep(poll)

    def _fits(self, place: Path) -> bool:
        name = place.name
        if name.startswith(".") or name.endswith(UNFINISHED):
            return False
        if self.pattern is not None and not fnmatch(name, self.pattern):
            return False
        # A bag that is being recorded has no metadata yet.
        return is_bag(place) if isinstance(self.form, BagForm) else place.is_file()


def _sign(log: Path, form: LogForm) -> Sign | None:
    # Of all its files; None of what is empty, or gone by now.
    with suppress(OSError):
        stats = [one.stat() for one in _files(log, form)]
        size = sum(one.st_size for one in stats)
        return (size, max(one.st_mtime_ns for one in stats)) if size else None
    return None


def _files(log: Path, form: LogForm) -> list[Path]:
    # A log's own, or those of its folder, and what lies beside it.
    parts = (log, *beside_of(log, form))
    each = (one for part in parts for one in ([part] if part.is_file() else sorted(part.rglob("*"))))
    return [one for one in each if one.is_file()]


def beside_of(log: Path, form: LogForm) -> Iterator[Path]:
    """Files of poses or of other sensors that are part of a log, which they lie beside.

    Args:
        log: a file.
        form: how it is read.
    """
    if isinstance(form, CsvForm):
        yield from (found for found in form.beside(log).values() if found != log)


def twin_of(log: Path, others: Iterable[Path], form: LogForm) -> Path | None:
    """The first of other logs that is a log to the byte, with all that is read beside it; None if none is.

    Args:
        log: a file, or a bag's folder.
        others: that it may be a copy of.
        form: how they are read.
    """
    return next((other for other in others if _alike(log, other, form)), None)


def fingerprint_of(log: Path, form: LogForm) -> str:
    """A number that logs share which are alike to the byte, with all that is read beside them.

    Args:
        log: a file, or a bag's folder.
        form: how it is read.

    Raises:
        OSError: it cannot be read.
    """
    whole = hashlib.sha256()
    for one in _files(log, form):
        with one.open("rb") as file:
            whole.update(hashlib.file_digest(file, "sha256").digest())
    return whole.hexdigest()[:FINGERPRINT]


def _alike(log: Path, other: Path, form: LogForm) -> bool:
    # What cannot be read is refused where it is read.
    with suppress(OSError):
        one, two = (_files(each, form) for each in (log, other))
        pairs = zip(one, two, strict=False)
        return 0 < len(one) == len(two) and all(filecmp.cmp(*pair, shallow=False) for pair in pairs)
    return False
