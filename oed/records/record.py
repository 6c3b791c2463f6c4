"""Everything a study produced, and what logs said of a robot: saved as JSON, and a report's only input."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import reduce
from pathlib import Path
from typing import Any

from oed.foundation.arguments import typed
from oed.foundation.errors import UserMistake
from oed.foundation.files import inside, write_text
from oed.foundation.work.folders import in_order, interrupted_runs
from oed.records.stored.consistency import require_one_study
from oed.records.stored.door import checked, read_echo, read_file, read_object
from oed.records.stored.estimate import EstimateRecord as EstimateRecord
from oed.records.stored.loop import StoredLoop
from oed.records.stored.plan import PlannedPoint, StoredPlan
from oed.records.stored.study_record import Record as Record
from oed.records.stored.sweep import StoredSweep

FILE, ESTIMATE_FILE = "record.json", "estimate.json"
SWEEP_FILE, PLAN_FILE, LOOP_FILE = "sweep.json", "plan.json", "loop.json"
REPORT, ESTIMATE = "report", "estimate"
"""Names, without suffix, of the pages on a design and on an estimate; the latter's figures begin with it."""
FIGURE_FORMATS = ("pdf", "png")
"""In which figures may be had beside the SVG of each."""
RESULTS = (FILE, ESTIMATE_FILE, SWEEP_FILE, PLAN_FILE, LOOP_FILE)
"""Names of the files that hold what a run, an estimate, a sweep, a plan and a loop found."""


@typed
def save_record(record: Record, folder: str | Path) -> Path:
    """Write record.json into `folder`; returns the file."""
    path = Path(folder) / FILE
    write_text(path, record.to_json())
    return path


def estimate_files(record: EstimateRecord) -> dict[str, str]:
    """The file of an estimate, by its name."""
    return {ESTIMATE_FILE: record.to_json()}


def require_no_results(path: str | Path) -> None:
    """Refuse to have a file of another kind take the place of results.

    Raises:
        UserMistake: it would.
    """
    if Path(path).name.lower() in RESULTS and os.path.lexists(path):
        raise UserMistake(f"{path}: cannot be written: it holds results, which would be lost; name another")


@typed
def load_record(folder: str | Path) -> Record:
    """Read the record in `folder` (or the record file itself); no code that it names is run.

    Raises:
        RecordError: no record there, or one with keys that are missing or something else than they are to be.
    """
    path = saved_file(folder, FILE)
    hint = "" if path.exists() else beside(folder) or _only_estimated(path.parent)
    return known_record(read_file(path, "a record", "oed run", "results", hint), path)


def _only_estimated(folder: Path) -> str:
    # What to do where a folder holds an estimate alone.
    path = folder / ESTIMATE_FILE
    if not path.exists():
        return ""
    text = "; there is an estimate alone: `oed run` the study that it was made with"
    study = read_object(path, "", "expected an estimate").get("study")
    designs = isinstance(study, dict) and study.get("trajectory")
    return text if designs else f"{text}, once `trajectory` and `limits` in it say which drives there can be"


def known_record(data: Mapping[str, Any], path: Path) -> Record:
    """What record.json holds as this version knows it, defaults filled in.

    Raises:
        RecordError: as `load_record` does.
    """
    found = checked(Record, data, path)
    found = found.of_study(read_echo(found.echo, path)).at(path)
    require_one_study(found, path)
    return found


@typed
def load_estimate(folder: str | Path) -> EstimateRecord:
    """Read the estimate in `folder` (or the file itself).

    Raises:
        RecordError: no estimate there, or not one of this format.
    """
    path = saved_file(folder, ESTIMATE_FILE)
    return known_estimate(read_file(path, "an estimate", "oed estimate", "parameters"), path)


def known_estimate(data: Mapping[str, Any], path: Path) -> EstimateRecord:
    """What estimate.json holds as this version knows it.

    Raises:
        RecordError: as `load_estimate` does.
    """
    found = checked(EstimateRecord, data, path)
    if found.study is not None:
        found = found.model_copy(update={"study": read_echo(found.study, path, designs=False).echo()})
    return found.at(path)


def load_sweep(folder: str | Path) -> StoredSweep:
    """The sweep in `folder`.

    Raises:
        RecordError: none there, or not one of this format.
    """
    path = saved_file(folder, SWEEP_FILE)
    return checked(StoredSweep, read_file(path, "a sweep", "oed sweep", "points"), path)


def load_plan(folder: str | Path) -> StoredPlan:
    """The plan in `folder`.

    Raises:
        RecordError: none there, or not one of this format.
    """
    path = saved_file(folder, PLAN_FILE)
    return checked(StoredPlan, read_file(path, "a plan", "oed plan", "aims"), path)


def load_loop(folder: str | Path) -> StoredLoop:
    """The loop in `folder`.

    Raises:
        RecordError: none there, or not one of this format.
    """
    path = saved_file(folder, LOOP_FILE)
    return checked(StoredLoop, read_file(path, "a loop", "oed loop", "rounds"), path)


def point_folder(folder: str | Path, point: PlannedPoint) -> Path:
    """Where the drive of a plan's point is: a folder in one of the folders of the plan's own.

    Raises:
        UserMistake: that is elsewhere.
    """
    return reduce(inside, point.folder.split("/"), Path(folder))


def saved_file(folder: str | Path, name: str) -> Path:
    """The file of that name in a folder, or the file itself where it is given.

    A folder that a process was about to swap when it was killed is put in order first.
    """
    path = in_order(folder)
    return path / name if path.is_dir() else path


def beside(folder: str | Path) -> str:
    """That runs that were cut short are kept beside a folder, in words; "" where there are none."""
    kept = ", ".join(map(str, interrupted_runs(folder)))
    return f"; a run that was cut short is kept in {kept}" if kept else ""


def pages(folder: Path, name: str = REPORT) -> set[str]:
    """Names, relative to a folder, of the files of a report (or an estimate's page) that is there."""
    figures = {
        path.relative_to(folder).as_posix()
        for figure in folder.glob("figures/*.svg")
        for path in (figure, *(figure.with_suffix(f".{one}") for one in FIGURE_FORMATS))
        if path.name.startswith(f"{ESTIMATE}_") == (name == ESTIMATE) and path.exists()
    }
    return figures | {file for file in (f"{name}.html", f"{name}.md") if (folder / file).exists()}
