"""How long, or how many drives, for a wanted precision: a study swept over duration, room and noise."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from oed.foundation.errors import RecordError, StudyError, UserMistake
from oed.foundation.extras import package_version
from oed.foundation.files import inside, write_text
from oed.foundation.presenting import Brief
from oed.foundation.text import count, quantity, significant
from oed.kernel.dynamics.trajectory import Trajectory
from oed.optimize import Progress, Workers
from oed.records.record import PLAN_FILE as FILE
from oed.records.record import load_plan, load_record, point_folder
from oed.records.stored.door import FORMAT
from oed.records.stored.plan import PlannedAim, PlannedAxis, PlannedPoint, StoredPlan
from oed.records.stored.sweep import StoredSweep
from oed.robots.limits.workspace import workspace_of
from oed.study.study import Study, of_robot
from oed.workflow.aims import aims_of, stretch
from oed.workflow.repeated import drives_needed, information_of, standard_errors
from oed.workflow.studies import load_study
from oed.workflow.sweep import Axis, Point, grid, sweep

DURATIONS = (0.5, 2.0)
"""Durations that are tried beside the study's, as shares of it."""
ROOMS = (2 / 3, 1.5)
"""Sizes of rooms that are tried beside the study's, as shares of it."""
NOISES = (0.5, 2.0)
"""Sizes of the noise with which the study's own drive is measured, as shares of its own."""
BARE = {"baselines": [], "bound": False, "validation": None, "physics": None, "calibration": None}
"""Keys of a study whose search alone is wanted."""
FREE = 3
"""Spline coefficients beyond the degree that a drive at rest at both ends needs at least."""


@dataclass(frozen=True, repr=False)
class Planned(Brief):
    """A plan, and the folder where it is saved; None where it would take the place of a finished one."""

    found: StoredPlan
    folder: Path | None = None

    @property
    def data(self) -> dict[str, Any]:
        """What plan.json holds."""
        return self.found.plain()


def plan(
    file: str | Path,
    targets: Mapping[str, str],
    out: str | Path,
    *,
    durations: Sequence[float] = (),
    seed: int | None = None,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> Planned:
    """How long, or how many drives, for wanted standard errors.

    Drives are designed for several durations, and for smaller and larger rooms, each alone; the study's own
    is measured with less and more noise. Information of several drives adds up, what is known beforehand
    counts once. What `out` has of an earlier plan of the same study is kept; a plan that is cut short does
    not take the place of a finished one.

    Args:
        file: the study.
        targets: standard errors wanted, by parameter, with a unit ("0.2 mm") or relative ("0.1 %").
        out: folder for plan.json, and for the sweeps.
        durations: of one drive, to be tried beside the study's [s]; half and twice that by default.
        seed: instead of the study's.
        workers: processes, or a cluster; does not change the result.
        progress: informed how far it is.

    Raises:
        StudyError: the study designs no drive.
        UserMistake: nothing wanted, or of what the study does not estimate, a study without noise.
        NotSaved: `out` could not be written to in the end.
    """
    study, folder = load_study(file), Path(out)
    of_robot(study.file)
    study.require_designed()
    aims = _aims(study, targets)
    axes, interrupted = list[PlannedAxis](), False
    for axis, base in _axes(study, durations):
        name = axis.key.rpartition(".")[2]
        place = inside(folder, name)
        done = sweep(file, [axis], place, seed=seed, workers=workers, progress=progress)
        points = _points(done.found, grid(study.source, [axis]), aims, done.folder or place)
        axes.append(PlannedAxis(name=name, unit=axis.unit, base=base, points=points))
        interrupted = done.found.interrupted
        if interrupted:
            break
    found = _planned(study, aims, axes, interrupted)
    if found.own is not None and not interrupted:
        found = found.model_copy(update={"axes": [*axes, _noise(study, aims, found.own, folder)]})
    if interrupted and _is_finished(folder):
        return Planned(found)
    write_text(folder / FILE, json.dumps(found.plain(), indent=1, allow_nan=False) + "\n")
    return Planned(found, folder)


def _is_finished(folder: Path) -> bool:
    with suppress(RecordError):
        return not load_plan(folder).interrupted
    return False


def _aims(study: Study, targets: Mapping[str, str]) -> list[PlannedAim]:
    known = {
        name: (nominal, unit)
        for one in study.problem.any_estimations
        for name, nominal, unit in zip(one.parameters, one.nominal, one.units, strict=True)
    }
    if any(one.block.noise is None for one in study.problem.any_estimations):
        raise UserMistake(
            "without noise there are no standard errors: give the study's key measurement.noise"
        )
    found = []
    for name, aim in aims_of(study, targets, "--to").items():
        nominal, unit = known[name]
        if not aim.size(nominal) > 0:
            raise UserMistake(
                f"--to {name}: it is nominally 0 and has no share; give a size in {unit or '1'}"
            )
        found.append(PlannedAim(name=name, unit=unit, nominal=nominal, wanted=aim.size(nominal)))
    if not found:
        raise UserMistake("nothing is wanted: give --to, e.g. --to 'track 0.1 %'")
    return found


def _axes(study: Study, durations: Sequence[float]) -> Iterator[tuple[Axis, float]]:
    # What to vary, and the study's own value of it. What makes no study, as a room too small for the robot,
    # is left out.
    own = study.file.space.duration
    # The longest first: it takes longest, and what is left is shared out meanwhile.
    times = sorted({own, *(durations or [share * own for share in DURATIONS])}, reverse=True)
    texts, studies = tuple(f"{time:g} s" for time in times), tuple(_lasting(study, time) for time in times)
    yield Axis("trajectory.duration", texts, tuple(times), "s", studies), own
    room = workspace_of(study.problem.limits)
    if room is not None:
        x_min, x_max, y_min, y_max = room.extent
        side = max(x_max - x_min, y_max - y_min)
        rooms = [(share * side, _in_room(study, share)) for share in ROOMS]
        yield from ((axis, side) for axis in _readable(study, "limits.room", "m", rooms))


def _readable(
    study: Study, key: str, unit: str, values: Iterable[tuple[float, Mapping[str, Any]]]
) -> Iterator[Axis]:
    kept = []
    for value, keys in values:
        axis = Axis(key, (f"{value:.3g} {unit}".strip(),), (value,), unit, (keys,))
        try:
            grid(study.source, [axis])
        except StudyError:
            continue
        kept.append(axis)
    if kept:
        texts, numbers, studies = (
            tuple(entry for axis in kept for entry in getattr(axis, name) or ())
            for name in ("texts", "numbers", "studies")
        )
        yield Axis(key, texts, numbers, unit, studies)


def _bare(study: Study) -> dict[str, Any]:
    data = {**study.echo(), **copy.deepcopy(BARE)}
    if data.get("robust"):
        data["robust"]["compare"] = False
    return data


def _lasting(study: Study, duration: float) -> dict[str, Any]:
    data = _bare(study)
    longer, spline = duration / data["trajectory"]["duration"], data["trajectory"]["spline"]
    before = spline["coefficients"]
    stretch(data["trajectory"], duration)
    if before != "auto":
        spline["coefficients"] = max(spline["coefficients"], min(before, spline["degree"] + FREE))
    segments = data["measurement"].get("segments")
    if isinstance(segments, int):
        data["measurement"]["segments"] = max(1, round(longer * segments))
    return data


def _in_room(study: Study, share: float) -> dict[str, Any]:
    # All that has a place in it moves along.
    data = _bare(study)
    limits = data["limits"]
    for key in ("workspace", "obstacles"):
        if key in limits:
            limits[key] = _scaled(limits[key], share)
    start = data["trajectory"].get("start")
    starts = start if isinstance(start, list) else [start] if isinstance(start, dict) else []
    for one in starts:
        one.update({name: share * one[name] for name in ("x", "y") if name in one})
    for sensor in data["measurement"].get("sensors", [data["measurement"]]):
        if "beacons" in sensor:
            sensor["beacons"] = _scaled(sensor["beacons"], share)
    return data


def _noisy(study: Study, share: float) -> dict[str, Any]:
    data = _bare(study)
    for sensor in data["measurement"].get("sensors", [data["measurement"]]):
        if "noise" in sensor:
            sensor["noise"] = _scaled(sensor["noise"], share, square=("covariance",))
    return data


def _scaled(value: Any, share: float, square: Sequence[str] = ()) -> Any:
    # All numbers times a share, those of squares times its square.
    if isinstance(value, dict):
        own = {key: share**2 if key in square else share for key in value}
        return {key: _scaled(one, own[key], square) for key, one in value.items()}
    if isinstance(value, list):
        return [_scaled(one, share, square) for one in value]
    return share * value if isinstance(value, int | float) and not isinstance(value, bool) else value


def _points(
    done: StoredSweep, studies: Sequence[Point], aims: Sequence[PlannedAim], folder: Path
) -> list[PlannedPoint]:
    (axis,) = done.keys
    found = []
    for one, point in zip(done.points, studies, strict=True):
        drive = _drive(inside(folder, one.folder)) if one.design is not None else None
        origin, value = (f"{folder.name}/{one.folder}", one.status), one.numbers[axis.key] or 0.0
        found.append(_point(value, one.values[axis.key], origin, point.study, drive, aims))
    return sorted(found, key=lambda one: one.value)


def _drive(folder: Path) -> Trajectory | None:
    best = load_record(folder).best
    return None if best is None or best.drive is None else best.drive.trajectory


def _noise(study: Study, aims: Sequence[PlannedAim], own: PlannedPoint, folder: Path) -> PlannedAxis:
    # The study's own drive, measured less and more noisily: no other is better by more than a prior makes it.
    drive, points = _drive(point_folder(folder, own)), []
    for share in NOISES:
        axis = Axis("measurement.noise", (f"{share:g}",), (share,), "", (_noisy(study, share),))
        (point,) = grid(study.source, [axis])
        points.append(_point(share, f"{share:g}", (own.folder, own.status), point.study, drive, aims))
    return PlannedAxis(name="noise", unit="", base=1.0, points=points)


def _point(
    value: float,
    text: str,
    origin: tuple[str, str],
    study: Study,
    drive: Trajectory | None,
    aims: Sequence[PlannedAim],
) -> PlannedPoint:
    # What a drive, of which `origin` says where it is and how its search ended, says in a study.
    wanted, known, drives = {aim.name: aim.wanted for aim in aims}, dict[str, float](), None
    if drive is not None:
        information = information_of(study.problem, drive)
        errors = standard_errors(study.problem, information, 1)
        known = {name: errors[name] for name in wanted if math.isfinite(errors[name])}
        drives = drives_needed(study.problem, information, wanted) if len(known) == len(aims) else None
    whole = len(known) == len(aims)
    return PlannedPoint(
        value=value,
        text=text,
        folder=origin[0],
        status=origin[1],
        errors=known,
        worst=max(known[name] / size for name, size in wanted.items()) if whole else None,
        drives=drives,
    )


def _planned(
    study: Study, aims: Sequence[PlannedAim], axes: Sequence[PlannedAxis], interrupted: bool
) -> StoredPlan:
    own = study.file.space.duration
    found = sorted(
        ((one.value, one.worst, one.drives) for one in axes[0].points if one.worst is not None),
        key=lambda entry: entry[0],
    )
    if not found and not interrupted:
        status = ", ".join(sorted({one.status for one in axes[0].points}))
        answer = f"No drive of these durations was found that makes them identifiable ({status})."
        return _stored(study, aims, axes, (None, None, answer), interrupted)
    base = min(found, key=lambda entry: abs(entry[0] - own), default=(own, None, None))
    one = _reaching([(value, worst) for value, worst, _ in found if worst is not None])
    return _stored(study, aims, axes, (one, base[2], _answer(found, one, base)), interrupted, base[0])


def _stored(
    study: Study,
    aims: Sequence[PlannedAim],
    axes: Sequence[PlannedAxis],
    said: tuple[float | None, int | None, str],
    interrupted: bool,
    duration: float | None = None,
) -> StoredPlan:
    one_drive, drives, answer = said
    return StoredPlan(
        format=FORMAT,
        oed_version=package_version("oed"),
        study=Path(study.source).name,
        name=study.name,
        aims=list(aims),
        axes=list(axes),
        duration=duration or study.file.space.duration,
        one_drive=one_drive,
        drives=drives,
        answer=answer,
        interrupted=interrupted,
    )


def _reaching(points: Sequence[tuple[float, float]]) -> float | None:
    # Where the worst error, a straight line between logarithms, comes down to what is wanted: the shortest
    # duration tried where that is enough, None where the longest is not.
    if not points:
        return None
    if points[0][1] <= 1:
        return points[0][0]
    for (short, above), (long, below) in pairwise(points):
        if below <= 1:
            share = math.log(above) / (math.log(above) - math.log(below))
            return float(short * (long / short) ** share)
    return None


def _answer(
    found: Sequence[tuple[float, float | None, int | None]],
    one: float | None,
    base: tuple[float, float | None, int | None],
) -> str:
    # One drive of 34 s, or 3 of 20 s.
    if not found:
        return "Interrupted before a drive was found."
    own, drives = base[0], base[2]
    if drives is None:
        return f"No number of drives of {_seconds(own)} is enough: they leave open what is wanted."
    if one is None:
        return (
            f"{count(drives, 'drive')} of {_seconds(own)}. One alone would have to be longer than "
            f"{_seconds(found[-1][0])}: --durations tries others."
        )
    shortest = one <= found[0][0]
    about = f"{_seconds(one)}{' or less' if shortest else ''}"
    if drives == 1:
        other = "" if math.isclose(one, own) else f", and about {about} would do"
        return f"One drive of {_seconds(own)} is enough{other}."
    return f"One drive of about {about}, or {drives} of {_seconds(own)}."


def _seconds(time: float) -> str:
    return quantity(time, "s", 2) if time < 100 else f"{significant(2)(time)} s"
