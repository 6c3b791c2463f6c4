"""The index of a folder: a table of the runs in it, which a click on a column's heading sorts."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from oed.foundation.errors import RecordError, UserMistake
from oed.foundation.files import inside
from oed.foundation.shown import page_text
from oed.foundation.text import MISSING, Unit, deviation_text, significant, words
from oed.foundation.work.folders import updated
from oed.records.record import (
    ESTIMATE,
    ESTIMATE_FILE,
    FILE,
    LOOP_FILE,
    PLAN_FILE,
    REPORT,
    RESULTS,
    SWEEP_FILE,
    Record,
    beside,
    load_estimate,
    load_loop,
    load_plan,
    load_record,
    load_sweep,
    point_folder,
)
from oed.records.stored.plan import PlannedPoint
from oed.records.stored.study_record import Provenance
from oed.records.stored.sweep import SweptPoint
from oed.report.contenders import relative_deviations
from oed.report.page import address_of, templates
from oed.report.parts.section import percent, sort_key

NAME = "index"
"""Of the index's files, without suffix."""
MADE = '<meta name="generator" content="oed report">'
"""By which an index is known that may be replaced."""
HTML, MARKDOWN = "index.html.jinja", "index.md.jinja"
DEEPEST = 6
"""Folders within folders that are looked into."""
LEAST = 0.001
"""Smallest share that is written as a number [%]."""
NO_DRIVE = "no drive found"
SUBJECTS = {("robots",): "Robot", ("systems",): "System", ("robots", "systems"): "Robot or system"}
"""What runs are about, by their domains."""
NAMED = 3
"""Runs that cannot be read and are named where none can be."""

Shares = Mapping[str, float | None]


@dataclass(frozen=True)
class Run:
    """One run of a folder, as a row of the index says it.

    Attributes:
        folder: of the run, relative to the folder that the index is of.
        kind: design, estimate, sweep, plan or loop; and whether it was cut short.
        study: its name.
        robot: kind of the robot, or of another system; "" where it is not known.
        precision: standard errors of the parameters, shares of their values [%]; of a sweep its best's, of
            a plan those of the study's own drive.
        errors: the same in words, in the parameters' units; or that there is no drive.
        gap: of the best design to the bound [%]; None where there is none.
        date: when it was finished, ISO 8601; "" where it is not known.
        page: of the run; None where none is written.
        domain: of its study.
    """

    folder: str
    kind: str
    study: str
    robot: str
    precision: Shares
    errors: tuple[str, ...] = ()
    gap: float | None = None
    date: str = ""
    page: Path | None = None
    domain: str = "robots"

    @property
    def worst(self) -> float | None:
        """The largest of the standard errors [%]; None where none is known."""
        return max((size for size in self.precision.values() if size is not None), default=None)


@dataclass(frozen=True)
class Cell:
    """A cell as it is printed, line by line, and what it is sorted by: "" comes last."""

    heading: str
    lines: tuple[str, ...]
    key: str
    numeric: bool = False
    address: str = ""


def write_index(folder: str | Path, out: str | Path | None = None) -> Path:
    """Write index.html and index.md of the runs in a folder, and in folders in it; returns index.html.

    Args:
        folder: that is looked through.
        out: where to write; the folder itself by default.

    Raises:
        UserMistake: there are no runs that can be read, or an index.html that is something else.
    """
    source, target = Path(folder), Path(folder if out is None else out)
    runs, unreadable = runs_in(source)
    if not runs:
        raise UserMistake(_nothing(source, unreadable))
    page = target / f"{NAME}.html"
    if page.exists() and MADE not in page.read_text(encoding="utf-8", errors="replace"):
        raise UserMistake(
            f"{page}: cannot be written: it is no index of runs; name another folder with --out"
        )
    runs.sort(key=lambda one: (one.date, one.folder), reverse=True)
    subject = SUBJECTS[tuple(sorted({one.domain for one in runs}))]
    rows = [list(_cells(one, target, subject)) for one in runs]
    content = {
        "title": f"Runs in {source.resolve().name}",
        "rows": rows,
        "unreadable": unreadable,
        "made": MADE,
    }
    html, markdown = (
        page_text(templates().get_template(template).render(content)) for template in (HTML, MARKDOWN)
    )
    with updated(target) as draft:
        draft.write({f"{NAME}.md": markdown, f"{NAME}.html": html})
        draft.publish({page.name for page in target.glob(f"{NAME}.*") if page.suffix in (".md", ".html")})
    return page


def _nothing(source: Path, unreadable: Sequence[tuple[str, str]]) -> str:
    if not unreadable:
        expected = f"{', '.join(RESULTS[:-1])} or {RESULTS[-1]}"
        return (
            f"{source}: no run in it or in its folders: expected {expected}; "
            f"`oed run STUDY --out {shlex.quote(str(source))}` writes one{beside(source)}"
        )
    why = "\n".join(f"{name}: {reason}" for name, reason in unreadable[:NAMED])
    return f"{source}: none of its {len(unreadable)} runs can be read:\n{why}"


def runs_in(folder: Path) -> tuple[list[Run], list[tuple[str, str]]]:
    """The runs in a folder and in folders in it, and those that cannot be read, by name, each with why.

    The points of sweeps and plans, and the rounds of loops, are no runs of their own; hidden folders and
    links are left alone.
    """
    runs: list[Run] = []
    unreadable: list[tuple[str, str]] = []
    for place, read in _found(folder):
        name = place.relative_to(folder).as_posix()
        try:
            runs.append(read(place, name))
        except RecordError as error:
            unreadable.append((name, str(error)))
    return runs, unreadable


Reader = Callable[[Path, str], Run]


def _found(folder: Path) -> Iterator[tuple[Path, Reader]]:
    for at, folders, files in os.walk(folder):
        place = Path(at)
        deep = len(place.relative_to(folder).parts)
        points = _points(place, files)
        folders[:] = sorted(
            one for one in folders if deep < DEEPEST and not one.startswith(".") and one not in points
        )
        # A loop's estimate is what the loop says.
        own = [name for name in files if name != ESTIMATE_FILE or LOOP_FILE not in files]
        yield from ((place, read) for name, read in READERS.items() if name in own)


def _points(place: Path, files: Sequence[str]) -> set[str]:
    try:
        points: list[SweptPoint | PlannedPoint] = []
        if LOOP_FILE in files:
            return set(load_loop(place).folders)
        if SWEEP_FILE in files:
            points += load_sweep(place).points
        if PLAN_FILE in files:
            points += (one for axis in load_plan(place).axes for one in axis.points)
        return {one.folder.split("/")[0] for one in points}
    except RecordError:
        # Its records are then runs like any others.
        return set()


def _design(place: Path, name: str) -> Run:
    record = load_record(place)
    return Run(
        name,
        _kind("design" if record.study.robust is None else "robust design", cut=record.interrupted),
        record.study.name,
        record.study.called,
        relative_deviations(record),
        _predicted(record),
        None if record.certificate is None else percent(record.certificate.gap),
        _finished(record.provenance),
        _page(place, REPORT),
        record.study.domain,
    )


def _predicted(record: Record) -> tuple[str, ...]:
    if record.best is None:
        return (record.study.vocabulary.said(NO_DRIVE),)
    known = record.best.standard_deviations
    return tuple(
        _error(one.name, known[one.name], one.unit, record.shown_unit(one.name, one.unit))
        for one in record.parameters
        if one.name in known
    )


def _error(name: str, size: float | None, unit: str | None, own: Unit | None = None) -> str:
    return f"{words(name)} {'not identifiable' if size is None else deviation_text(size, unit or '', own)}"


def _estimate(place: Path, name: str) -> Run:
    record = load_estimate(place)
    values = record.values
    shares = {
        one.name: 100 * one.standard_error / abs(values[one.name])
        for one in record.parameters
        if one.standard_error is not None and values[one.name]
    }
    errors = tuple(_error(one.name, one.standard_error, one.unit) for one in record.parameters)
    date, page = _finished(record.provenance), _page(place, ESTIMATE)
    return Run(name, "estimate", record.title, record.robot, shares, errors, date=date, page=page)


def _sweep(place: Path, name: str) -> Run:
    found = load_sweep(place)
    kind = _kind(f"sweep of {len(found.points)} points", cut=found.interrupted)
    page = _page(place, REPORT)
    known = [one for one in found.points if one.record is not None]
    point = next((one for one in known if one.folder == found.best), known[0] if known else None)
    if point is None:
        return Run(name, kind, found.name, "", {}, (NO_DRIVE,), page=page)
    best = _design(inside(place, point.folder), name)
    return replace(best, kind=kind, study=found.name, gap=percent(point.gap), page=page)


def _plan(place: Path, name: str) -> Run:
    found = load_plan(place)
    run = Run(name, _kind("plan", cut=found.interrupted), found.name, "", {}, page=_page(place, REPORT))
    if found.own is None:
        return run
    own = _design(point_folder(place, found.own), name)
    return replace(run, robot=own.robot, precision=own.precision, errors=own.errors, date=own.date)


def _loop(place: Path, name: str) -> Run:
    found = load_loop(place)
    kind = "loop" if found.finished else "loop, not finished"
    page = _page(place, REPORT)
    if not found.driven:
        return Run(name, kind, found.name, "", {}, page=page)
    return replace(_estimate(place, name), kind=kind, study=found.name, page=page)


READERS: Mapping[str, Reader] = {
    FILE: _design,
    ESTIMATE_FILE: _estimate,
    SWEEP_FILE: _sweep,
    PLAN_FILE: _plan,
    LOOP_FILE: _loop,
}
"""By the names of the files that they read."""


def _kind(kind: str, *, cut: bool) -> str:
    return f"{kind}, cut short" if cut else kind


def _finished(made: Provenance | None) -> str:
    return "" if made is None else made.finished


def _page(place: Path, name: str) -> Path | None:
    file = place / f"{name}.html"
    return file if file.is_file() else None


def _cells(run: Run, target: Path, subject: str) -> Iterator[Cell]:
    # Of what it is about, which is what `subject` says.
    address = "" if run.page is None else address_of(run.page, target)
    yield Cell("Study", (run.study,), run.study.casefold())
    yield Cell("Run", (run.folder,), run.folder.casefold(), address=address)
    yield Cell("What", (run.kind,), run.kind)
    yield Cell(subject, (words(run.robot) or MISSING,), run.robot)
    yield Cell("Standard errors", run.errors or (MISSING,), sort_key(run.worst))
    yield Cell("Gap to the bound", (_share(run.gap),), sort_key(run.gap), numeric=True)
    yield Cell("Finished", (run.date[:16].replace("T", " ") or MISSING,), run.date)


def _share(size: float | None) -> str:
    if size is None:
        return MISSING
    # Below what anybody would act on, just that.
    return f"< {LEAST:g} %" if 0 < size < LEAST else f"{significant(2)(size)} %"
