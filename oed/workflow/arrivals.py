"""Logs that come into a folder while somebody drives: which are there, and which of them are complete."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from oed.logs import BagForm, CsvForm, LogForm
from oed.logs.form import is_bag

UNFINISHED = (".part", ".partial", ".tmp", ".crdownload", "~")
"""Endings of files that something else is still writing."""

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
        beside = {other for one in places for other in self._beside(one)}
        signs = {one.name: _sign([one, *self._beside(one)]) for one in places if one not in beside}
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

    def _beside(self, log: Path) -> Iterator[Path]:
        # A file of poses or of other sensors is part of the log that it lies beside.
        if isinstance(self.form, CsvForm):
            yield from (found for found in self.form.beside(log).values() if found != log)


def _sign(parts: Sequence[Path]) -> Sign | None:
    # Of a file or a folder, and of what lies beside; None of what is empty, or gone by now.
    with suppress(OSError):
        files = [one for part in parts for one in ([part] if part.is_file() else part.rglob("*"))]
        stats = [one.stat() for one in files if one.is_file()]
        size = sum(one.st_size for one in stats)
        return (size, max(one.st_mtime_ns for one in stats)) if size else None
    return None
