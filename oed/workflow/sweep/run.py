"""Running a sweep: the points over the workers, each into a folder of its own, and one table of them all."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from oed.foundation.errors import OedError, RecordError
from oed.foundation.extras import package_version
from oed.foundation.files import inside
from oed.foundation.presenting import Brief
from oed.foundation.work.folders import Draft, drafted, interrupted_runs
from oed.foundation.work.parallel import run_tasks
from oed.foundation.work.signals import interrupts_named
from oed.optimize import Progress, Silent, Workers, default_workers
from oed.records.record import FILE as RECORD
from oed.records.record import SWEEP_FILE as FILE
from oed.records.record import Record, load_record, load_sweep, pages
from oed.records.stored.door import FORMAT
from oed.records.stored.sweep import StoredSweep, SweptKey, SweptPoint
from oed.study.study import Study
from oed.workflow.runner import run
from oed.workflow.saving import Contents, NotSaved, require_readable, rescued
from oed.workflow.sweep.axes import Axis
from oed.workflow.sweep.points import Point, grid, short_names

ROUNDING = 1e-6
"""Share of the objective by which points may differ and still count as equal."""
INCOMPARABLE = ("criterion", "estimate", "measurement")
"""Parts of a study with which the meaning of its objective changes."""


@dataclass(frozen=True, repr=False)
class Swept(Brief):
    """A sweep that was run: what it found, and the folder where it is saved; None where it is nowhere."""

    found: StoredSweep
    folder: Path | None = None

    @property
    def data(self) -> dict[str, Any]:
        """What sweep.json holds."""
        return self.found.plain()


def sweep(
    file: str | Path,
    axes: Sequence[Axis],
    out: str | Path,
    *,
    seed: int | None = None,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> Swept:
    """Run a study at every combination of values.

    Points that `out`, or a sweep into it that was cut short, has a finished record of, of the same study and
    seed, are kept. Several points are shared out among the workers, each searched by one of them; the results
    are the same.

    Args:
        file: the study.
        axes: what to vary.
        out: folder for sweep.json and a folder for each point, with record.json and the trajectories. Those
            of an earlier sweep stay as they are until all of the new ones are there.
        seed: instead of the study's.
        workers: processes, or a cluster; does not change the result.
        progress: informed how far it is.

    Raises:
        UserMistake, StudyError: anything wrong with any of the combinations; then nothing is run.
        NotSaved: `out` could not be written to in the end; the error has what was found.
    """
    points, listener = grid(str(file), axes), progress or Silent()
    with drafted(out) as draft:
        done = _Sweep(Path(file), axes, points, draft, seed)
        done.run(default_workers() if workers is None else workers, listener)
        return done.finish()


@dataclass(frozen=True)
class _Task:
    study: Study
    seed: int
    workers: Workers


@dataclass(frozen=True)
class _Result:
    # The files of a run by name, for a worker may not see the folder they belong in; or why there are none.
    files: Mapping[str, str]
    failure: str = ""


def _run_point(task: _Task) -> _Result:
    with tempfile.TemporaryDirectory(prefix="oed-") as folder:
        try:
            run(task.study, folder, seed=task.seed, workers=task.workers)
        except (OedError, OSError) as error:
            return _Result({}, str(error))
        # A defect met at one point must not cost the others their results.
        except Exception as error:
            return _Result({}, f"a defect of oed ({type(error).__name__}: {error})")
        return _Result({path.name: path.read_text(encoding="utf-8") for path in Path(folder).iterdir()})


class _Sweep:
    def __init__(
        self,
        file: Path,
        axes: Sequence[Axis],
        points: Sequence[Point],
        draft: Draft,
        seed: int | None,
    ) -> None:
        self.file, self.axes, self.points, self.draft = file, axes, points, draft
        self.seeds = [point.study.seed if seed is None else seed for point in points]
        self.records: dict[int, Record] = {}
        self.failures: dict[int, str] = {}
        self.interrupted = False
        self.unsaved: OedError | None = None
        self.unwritten: dict[str, str] = {}
        for place in (draft.target, *reversed(interrupted_runs(draft.target))):
            self._keep(place)
        self.kept = sorted(self.records)

    def run(self, workers: Workers, progress: Progress) -> None:
        """Run what is not there yet; an interrupt keeps what is done."""
        left = [index for index in range(len(self.points)) if index not in self.records]
        if not left:
            return
        own = workers if len(left) == 1 else 1
        tasks = [_Task(self.points[index].study, self.seeds[index], own) for index in left]

        def take(position: int, result: _Result) -> None:
            self._take(left[position], result)
            progress.advance(self.points[left[position]].label)

        progress.begin("points", len(left))
        try:
            with interrupts_named():
                run_tasks(_run_point, tasks, workers, take)
        except KeyboardInterrupt:
            self.interrupted = True

    def _take(self, index: int, result: _Result) -> None:
        if result.failure:
            self.failures[index] = result.failure
            return
        folder = self.points[index].folder
        try:
            record: Record = require_readable(result.files, self.draft.target / folder)[RECORD]
        except OedError as error:
            self.failures[index] = str(error)
            return
        self.records[index] = record
        # The record last: where it is, everything is.
        names = sorted(result.files, key=lambda name: name == RECORD)
        files = {f"{folder}/{name}": result.files[name] for name in names}
        try:
            self.draft.write(files)
            # Lest the process be killed: what is there by now is a sweep that was cut short.
            self.draft.write(_file(self._table().model_copy(update={"interrupted": True})))
        except OedError as error:
            # Without room for this one there is none for the others.
            self.unsaved, self.unwritten = error, files
            raise KeyboardInterrupt from None
        if record.interrupted:
            raise KeyboardInterrupt

    def _keep(self, place: Path) -> None:
        for index, point in enumerate(self.points):
            folder = inside(place, point.folder)
            record = None if index in self.records else self._finished(index, folder)
            if record is not None:
                self.records[index] = record
                self.draft.adopt(folder)

    def _finished(self, index: int, folder: Path) -> Record | None:
        if not folder.is_dir():
            return None
        try:
            record = load_record(folder)
        except RecordError:
            return None
        same = record.echo == self.points[index].study.echo() and record.seed == self.seeds[index]
        finished = not record.interrupted and record.version == _version()
        return record if same and finished else None

    def finish(self) -> Swept:
        """The sweep, saved in its folder; beside it where one that was cut short would take the place of a
        finished one.
        """
        found, draft = self._table(), self.draft
        if self.unsaved is not None:
            raise self._not_saved(self.unsaved, found)
        if self.interrupted and self._in_the_way():
            if len(self.records) == len(self.kept):
                draft.discard()
                return Swept(found)
            draft.write(_file(found))
            return Swept(found, draft.put_aside())
        try:
            draft.write(_file(found))
            return Swept(found, draft.publish(pages(draft.target)))
        except OedError as error:
            raise self._not_saved(error, found) from None

    def _in_the_way(self) -> bool:
        # Whether there is a finished sweep, or a finished point that is another one now.
        with suppress(RecordError):
            if not load_sweep(self.draft.target).interrupted:
                return True
        fresh = [self.points[index].folder for index in self.records if index not in self.kept]
        return any(_is_finished(inside(self.draft.target, folder)) for folder in fresh)

    def _not_saved(self, error: OedError, table: StoredSweep) -> NotSaved:
        # All points, also the one there was no room for.
        draft = self.draft
        files: Contents = {
            path.relative_to(draft.path).as_posix(): path.read_bytes()
            for path in draft.path.rglob("*")
            if path.is_file()
        }
        files = {**files, **self.unwritten, **_file(table)}
        return NotSaved(rescued(draft.target, error, files, draft), Swept(table))

    def _table(self) -> StoredSweep:
        # The points side by side.
        rows = [self._row(index) for index in range(len(self.points))]
        comparable = all(_comparable(axis) for axis in self.axes)
        names = short_names([axis.key for axis in self.axes])
        return StoredSweep.of(
            format=FORMAT,
            oed_version=_version(),
            study=self.file.name,
            name=self.points[0].study.name.removesuffix(f" ({self.points[0].label})"),
            keys=[
                SweptKey.of(axis, name=name, values=axis.texts, numeric=axis.numbers is not None)
                for axis, name in zip(self.axes, names, strict=True)
            ],
            points=rows,
            best=_best(rows) if comparable else None,
            comparable=comparable,
            kept=len(self.kept),
            interrupted=self.interrupted,
        )

    def _row(self, index: int) -> SweptPoint:
        point, record = self.points[index], self.records.get(index)
        best = None if record is None else record.best
        certificate = None if record is None else record.certificate
        status, message = self._outcome(index, record)
        return SweptPoint.of(
            point,
            values=point.texts,
            record=None if record is None else f"{point.folder}/{RECORD}",
            status=status,
            message=message,
            seed=self.seeds[index],
            design=None if best is None else best.name,
            objective=None if best is None else best.objective,
            lambda_min=None if best is None else best.lambda_min,
            standard_deviations={} if best is None else best.standard_deviations,
            upper_bound=None if certificate is None else certificate.upper_bound,
            gap=None if certificate is None else certificate.gap,
            seconds=None if record is None else sum(one.wall_seconds for one in record.results),
        )

    def _outcome(self, index: int, record: Record | None) -> tuple[str, str]:
        # How a point ended, in a word and in a sentence.
        if index in self.failures:
            return "failed", self.failures[index]
        if record is None:
            return "not run", "The sweep was interrupted before this point was done."
        if record.best is None:
            messages = (f"{one.name}: {one.message}" for one in record.results)
            return "no feasible drive", next(messages, "")
        return record.best.status, record.best.message


def _best(rows: Sequence[SweptPoint]) -> str | None:
    # Folder of the first of those that differ by rounding only.
    known = {row.folder: row.objective for row in rows if row.objective is not None}
    largest = max(known.values(), default=0.0)
    close = largest - ROUNDING * abs(largest)
    return next((folder for folder, objective in known.items() if objective >= close), None)


def _is_finished(folder: Path) -> bool:
    with suppress(RecordError):
        return folder.is_dir() and not load_record(folder).interrupted
    return False


def _file(found: StoredSweep) -> dict[str, str]:
    return {FILE: json.dumps(found.plain(), indent=1, allow_nan=False) + "\n"}


def _comparable(axis: Axis) -> bool:
    return axis.path[0] not in INCOMPARABLE and axis.key not in ("robot.kind", "robot.preset")


def _version() -> str:
    return package_version("oed")
