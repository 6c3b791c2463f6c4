"""Saving a run: what is done is kept as it comes, put in place when all of it is there, and never given up
while anything can still be written somewhere.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from oed.foundation.errors import Failure, OedError, RecordError
from oed.foundation.files import write_files
from oed.foundation.work.folders import Draft, drafted, updated
from oed.records.record import (
    ESTIMATE,
    ESTIMATE_FILE,
    FILE,
    EstimateRecord,
    Record,
    estimate_files,
    known_estimate,
    known_record,
    load_record,
    pages,
)

Files = Mapping[str, str]
"""Texts by file name."""
Contents = Mapping[str, str | bytes]
"""Texts and other contents by file name."""


class NotSaved(Failure):
    """Results that could not be written where they should be; they are in `found` all the same."""

    def __init__(self, message: str, found: Any) -> None:
        """Keep what was found."""
        self.found = found
        super().__init__(message)


class RunFolder:
    """Where the results of a run go.

    Attributes:
        draft: what its folder is to hold; None for a run that writes nothing.
    """

    def __init__(self, draft: Draft | None, *, whole: bool = True) -> None:
        """Fill a draft; and publish it at the end, unless it is only part of something larger."""
        self.draft, self._whole = draft, whole

    def keep(self, files: Callable[[], Files]) -> None:
        """Keep what is done by now, lest the process be killed."""
        if self.draft is not None:
            # What does not fit now is named at the end.
            with suppress(OedError):
                self.draft.write(files())

    def finish(self, record: Record, files: Files) -> Record:
        """The record with where it is saved, None where nothing is.

        Raises:
            NotSaved: as `put`.
        """
        if self.draft is None:
            return record
        interrupted, nothing = record.interrupted, all(one.drive is None for one in record.results)
        if interrupted and self._whole and nothing and (self.draft.target / FILE).exists():
            self.draft.discard()
            return record
        drop = outdated(self.draft.target, record)
        return record.saved_in(self.put(files, record, drop, interrupted=interrupted))

    def put(
        self, files: Files, found: Any, drop: Collection[str] = (), *, interrupted: bool = False
    ) -> Path | None:
        """Put files in the folder; beside it where a run that was cut short would take the place of another.
        Returns where they are.

        Args:
            files: the last ones; those kept before are part of the whole.
            found: what they hold.
            drop: names of files in the folder that mean nothing beside these.
            interrupted: whether the run was cut short.

        Raises:
            NotSaved: they could not be written there, or not be read again; says where they are instead.
        """
        draft = self.draft
        if draft is None:
            return None
        try:
            require_readable(files, draft.target)
            draft.write(files)
            if not self._whole:
                return draft.target
            if interrupted and (draft.target / FILE).exists():
                return draft.put_aside()
            return draft.publish(drop)
        except OedError as error:
            raise NotSaved(rescued(draft.target, error, files, draft), found) from None


def save_into(draft: Draft, record: Record) -> Record:
    """Put a record in the place of the one in a folder, whose drives it has; with where it is saved.

    Raises:
        NotSaved: it could not be written there; says where it is instead.
    """
    return RunFolder(draft).finish(record, {FILE: record.to_json()})


@contextmanager
def run_folder(out: str | Path | Draft | None) -> Iterator[RunFolder]:
    """The folder of a run: refused at once where it cannot be written to.

    Raises:
        UserMistake: it cannot be written to, or another process is writing there.
    """
    if out is None or isinstance(out, Draft):
        yield RunFolder(out, whole=False)
        return
    with drafted(out) as draft:
        yield RunFolder(draft)


def save_estimate(record: EstimateRecord, folder: str | Path) -> Path:
    """Write estimate.json into `folder`, where the page of an earlier one goes, and whose other files have
    nothing to do with it; returns the file.

    Raises:
        NotSaved: it could not be written there; says where it is instead.
    """
    target, files = Path(folder), estimate_files(record)
    try:
        with updated(target) as draft:
            require_readable(files, target)
            draft.write(files)
            draft.publish(pages(target, ESTIMATE))
    except OedError as error:
        raise NotSaved(rescued(target, error, files), record) from None
    return target / ESTIMATE_FILE


def require_readable(files: Files, folder: Path) -> dict[str, Any]:
    """Refuse a record or an estimate that the reader of such files would refuse, before it is saved; returns
    those there are, as read again, by the names of their files.

    Raises:
        Failure: says which keys are in the way.
    """
    readers: dict[str, Callable[..., Any]] = {FILE: known_record, ESTIMATE_FILE: known_estimate}
    try:
        there = [name for name in readers if name in files]
        return {name: readers[name](json.loads(files[name]), folder / name) for name in there}
    except RecordError as error:
        reasons = "; ".join(map(str, error.issues))
        raise Failure(f"not saved, for it could not be read again: {reasons}") from None


def outdated(folder: Path, record: Record | None) -> set[str]:
    """Names of files of a folder that mean nothing beside a new record, or without the old one: the old
    one's drives and report.
    """
    drives: set[str] = set()
    # What a damaged record may name is left.
    with suppress(RecordError):
        drives = {str(one.trajectory) for one in load_record(folder).results}
    drives = {name for name in drives if name.endswith(".csv") and Path(name).name == name}
    kept = set() if record is None else {one.trajectory for one in record.results}
    return pages(folder) | (drives - kept)


def rescued(folder: Path, error: Exception, files: Contents, draft: Draft | None = None) -> str:
    """Write results that do not fit in their folder wherever they can be; return what to say of them.

    Args:
        folder: where they should be.
        error: why they are not.
        files: the results, by name.
        draft: what there is of them beside the folder; discarded when they are complete elsewhere.
    """
    text = str(error)
    if folder.exists():
        text += f"; what was in {folder} is as it was"
    elsewhere = _written_elsewhere(folder.name or "results", files)
    if elsewhere is not None:
        if draft is not None:
            draft.discard()
        return f"{text}. The results are in {elsewhere} instead"
    kept = None if draft is None else _what_fits(draft, files)
    text += ". They could be written nowhere else either: make room, and have them printed with --json"
    return text if kept is None else f"{text}. What there was room for is in {kept}"


def _written_elsewhere(name: str, files: Contents) -> Path | None:
    for place in (tempfile.gettempdir, Path.home, Path.cwd):
        with suppress(OSError, RuntimeError):
            folder = Path(tempfile.mkdtemp(dir=place(), prefix=f"oed-{name}-"))
            try:
                write_files(folder, files)
            except OedError:
                shutil.rmtree(folder, ignore_errors=True)
            else:
                return folder
    return None


def _what_fits(draft: Draft, files: Contents) -> Path | None:
    for name, text in files.items():
        with suppress(OedError):
            draft.write({name: text})
    with suppress(OSError):
        return draft.put_aside()
    return None
