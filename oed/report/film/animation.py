"""A record's drives as a film: the robot along its path, in real time or faster."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from oed.foundation.arguments import typed
from oed.foundation.errors import FileIssue, RecordError, UserMistake
from oed.foundation.work.progress import Progress
from oed.records.record import FILE, Record, load_record
from oed.records.stored.result import Result
from oed.report.film.cast import Cast
from oed.report.film.writing import (
    FPS,
    film_rate,
    heard,
    require_format,
    require_speed,
    write_frames,
)
from oed.report.parts.prose import Prose
from oed.report.parts.reading import called, with_drive
from oed.report.parts.section import Film, Section

SAY = Prose("drives")
NAME = "drive.gif"
"""Of the film that a report shows."""
MOST_DRIVES = 4
"""Drives beside each other."""
REST = 1.5
"""Rest at the end, before the film begins again [s of the film]."""
MARK = "oed "
"""What the comment in a film that was made here begins with."""


@dataclass(frozen=True)
class MadeFilm:
    """A film that was written.

    Attributes:
        file: it.
        results: names of what it shows.
        frames: their number.
        seconds: how long it plays.
        fps: frames a second.
        speed: how much faster than the robot.
    """

    file: Path
    results: tuple[str, ...]
    frames: int
    seconds: float
    fps: float
    speed: float


@typed
def animate(
    source: Record | str | Path,
    file: str | Path | None = None,
    *,
    results: Sequence[str] = (),
    speed: float = 1.0,
    fps: float | None = None,
    progress: Progress | None = None,
) -> MadeFilm:
    """Write a film of a record's drives: the robot in its room, its path and a clock.

    Args:
        source: a record, or the folder of a saved one.
        file: ends in .gif, or in .mp4, which needs ffmpeg; `drive.gif` in the record's folder by default.
        results: names of results, shown side by side, at most four; the best one by default.
        speed: how much faster than the robot.
        fps: frames a second, of a GIF at most 50; by default 20, and fewer of a long film, down to 10.
        progress: listener.

    Returns:
        What was written.

    Raises:
        RecordError: no record there, no such result, a result without a drive.
        UserMistake: more than four results, a file that is neither GIF nor MP4, no ffmpeg, a rate or a speed
            that cannot be shown, too many frames, a place that cannot be written to.
        Failure: ffmpeg could not write it.
    """
    require_speed(speed)
    record = source if isinstance(source, Record) else load_record(source)
    record.require_robot()
    target = _target(source, file)
    require_format(target, FPS if fps is None else fps)
    chosen = _chosen(record, source, results)
    length = max(Cast.of(one).length(speed) for one in chosen)
    rate = film_rate(length, target, fps)
    names = tuple(one.name for one in chosen)
    times = [min(number / rate, length) for number in range(math.ceil(length * rate - 1e-6) + 1)]
    times += [length] * round(REST * rate)
    # Imported late: the drawing library takes longer to load than the rest.
    from oed.report.film.stage import Stage

    stage = Stage(record, chosen, speed)
    frames = heard(map(stage.frame, times), len(times), target, progress)
    colours, comment = stage.colours(length), _mark(record, names)
    count = write_frames(frames, target, rate, colours=colours, comment=comment)
    return MadeFilm(target, names, count, round(count / rate, 3), rate, speed)


def _target(source: Record | str | Path, file: str | Path | None) -> Path:
    if file is not None:
        return Path(file)
    if isinstance(source, Record):
        raise UserMistake("file: expected a name to write to, as the record comes from no folder")
    return folder_of(source) / NAME


def folder_of(place: str | Path) -> Path:
    """The folder of a saved record, given as the folder or as the file."""
    path = Path(place)
    return path.parent if path.is_file() else path


def _chosen(record: Record, source: Record | str | Path, names: Sequence[str]) -> list[Result]:
    asked: list[str | None] = list(dict.fromkeys(names)) or [None]
    if len(asked) > MOST_DRIVES:
        raise UserMistake(f"results: expected at most {MOST_DRIVES}, got {len(asked)}")
    place = Path(FILE) if isinstance(source, Record) else folder_of(source) / FILE
    return [driven_result(record, name, place) for name in asked]


def driven_result(record: Record, name: str | None, place: Path) -> Result:
    """The result of that name, the best for None, which has a drive.

    Args:
        record: that has the results.
        name: of one; the best for None.
        place: where the mistake would be, for errors.

    Raises:
        RecordError: there is none; names those that there are, and the file.
    """
    result = record.result(name)
    if result is not None and result.drive is not None:
        return result
    there = ", ".join(one.name for one in with_drive(record)) or "none"
    missing = "no feasible result" if name is None else f"no drive of the name {name!r}"
    raise RecordError([FileIssue(str(place), 0, 0, "", f"{missing}; the record has {there}")])


def _mark(record: Record, names: Sequence[str]) -> str:
    # Kept in the film, so that a report knows whether it shows the drives of its record.
    return MARK + json.dumps({"results": list(names), "drives": _digest(record, names)})


def _digest(record: Record, names: Sequence[str]) -> str:
    study = record.study.model_dump(mode="json", exclude_none=True, include={"robot", "limits"})
    results = [record.result(name) for name in names]
    drives = [None if one is None or one.drive is None else one.drive.plain() for one in results]
    shown = [study["robot"], study["limits"], drives]
    return hashlib.sha256(json.dumps(shown, sort_keys=True).encode()).hexdigest()[:16]


def with_film(section: Section, record: Record, folder: Path) -> Section:
    """A section whose drives are played, with the film of them that lies in `folder`, or how to make one.

    Args:
        section: whose drives are played.
        record: that has them.
        folder: where films lie.
    """
    if section.animation is None:
        return section
    file = folder / NAME
    comment = _comment(file)
    if comment is None:
        return replace(section, commands=(*section.commands, (SAY("no_film", NAME), "oed animate .")))
    found = _marked(comment)
    names = [] if found is None else list(map(str, found["results"]))
    if found is not None and found["drives"] != _digest(record, names):
        return replace(section, notices=(*section.notices, SAY("old_film", NAME)))
    shown = [called(record, one) for one in map(record.result, names) if one is not None]
    return replace(section, film=Film(file, SAY("film", shown), SAY("film_note", NAME, shown)))


def _comment(file: Path) -> str | None:
    # The comment of a GIF, "" without one; None where there is no GIF.
    from PIL import Image

    if not file.is_file():
        return None
    try:
        with Image.open(file, formats=["GIF"]) as image:
            comment = image.info.get("comment", b"")
    except OSError:
        return None
    return comment.decode(errors="replace") if isinstance(comment, bytes) else str(comment)


def _marked(comment: str) -> Mapping[str, Any] | None:
    # What a film that was made here says of itself; None of any other.
    if not comment.startswith(MARK):
        return None
    try:
        found = json.loads(comment.removeprefix(MARK))
    except (ValueError, RecursionError):
        return None
    fits = isinstance(found, dict) and isinstance(found.get("results"), list) and "drives" in found
    return found if fits else None
