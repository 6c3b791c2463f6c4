"""From what a file says of one drive to a `Log`: checked, headings unwrapped, held poses dropped."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import FileIssue, LogError
from oed.logs import findings
from oed.logs.form import LogForm, Repeats
from oed.logs.log import Finding, Log
from oed.logs.motions import PAIRS, QUANTITIES, Motions, motions_of
from oed.logs.series import NotInLog, Series, time_text, together

FEWEST = 3
"""Rows that a drive needs at least, of inputs and of poses."""

MOST_SHORT = 3
"""Runs that are too short and named one by one."""

MARGIN = 1.0
"""What stays of a standing start and end where they are cut off, for the clocks' offset to be found [s]."""

STILL = 1e-3
"""Wheel motion below which a repeated pose is that of a standing robot [rad]."""

CUT_OFF = "the file breaks off within its last line, which is left out"

Relative = Literal["pairs", "follows"]


@dataclass(frozen=True)
class RecordedDrive:
    """One drive as it is in a file, in SI.

    Attributes:
        name: of the drive.
        names: of the robot's inputs.
        inputs: integrals (n, inputs) of the robot's inputs on their clock.
        poses: (m, quantities) on theirs; headings may jump by full turns.
        quantities: the states that the poses are.
        driving: which inputs move the robot.
        bridged: which integrals are right across missing rows.
        one_clock: whether both are columns of the same rows.
        found: while reading.
        relative: of motions in place of poses, whether the rows say when each began ("pairs"), or each began
            at the row before ("follows"); as `motions_of` takes them.
        motions: these, once they are made of the rows.
    """

    name: str
    names: tuple[str, ...]
    inputs: Series
    poses: Series
    quantities: tuple[str, ...]
    driving: Bools
    bridged: Bools
    one_clock: bool
    found: tuple[Finding, ...] = ()
    relative: Relative | None = None
    motions: Motions | None = None

    @property
    def driven(self) -> Array:
        """Integrals of the inputs that move the robot, (n, driving inputs)."""
        return self.inputs.values[:, self.driving]

    def place(self, quantity: str) -> int | None:
        """Index of a quantity in the poses."""
        return self.quantities.index(quantity) if quantity in self.quantities else None

    def with_found(self, *found: Finding | None) -> RecordedDrive:
        """The drive with more findings."""
        return replace(self, found=(*self.found, *(one for one in found if one is not None)))


def _to_log(drive: RecordedDrive, form: LogForm, held: Repeats) -> Log:
    drive = _with_path(drive, form.thin)
    issues = [*_clock_issues(drive)]
    if issues:
        raise LogError(issues)
    drive = _without_slips(drive)
    drive = drive.with_found(
        findings.uneven_clock(drive.inputs, "rows" if drive.one_clock else "inputs"),
        None if drive.one_clock else findings.uneven_clock(drive.poses, "poses"),
        findings.stationary(drive.inputs, drive.driven, at_end=False),
        findings.stationary(drive.inputs, drive.driven, at_end=True),
    )
    if held == "drop" and drive.quantities:
        drive = _without_held(drive)
    if form.skip_stationary:
        drive = _without_standing(drive)
    if form.thin > 1 and drive.motions is None:
        drive = _thinned(drive, form.thin)
    drive = _with_poses_checked(_with_running_heading(_with_gaps_found(drive, form.gap)))
    return Log(
        name=drive.name,
        file=drive.inputs.file,
        input_times=drive.inputs.times,
        integrals=drive.inputs.values,
        pose_times=drive.poses.times,
        poses=drive.poses.values,
        quantities=drive.quantities,
        findings=drive.found,
        gap=form.gap,
        motions=drive.motions,
    )


def _with_path(drive: RecordedDrive, each: int) -> RecordedDrive:
    # The poses that motions make up, in place of their rows; of one motion in each if some are left out.
    if drive.relative is None:
        return drive
    rows, follows = drive.poses, drive.relative == "follows"
    names = ("t0", *QUANTITIES, *("covariance",) * len(PAIRS))
    issues = [*rows.too_large(names), *(rows.clock_issues() if follows else ())]
    motions, wrong = motions_of(rows, follows=follows)
    if issues or wrong:
        raise LogError(issues + wrong)
    if motions is None:
        return replace(drive, poses=rows.rows(slice(0)).with_values(np.zeros((0, len(QUANTITIES)))))
    lines = rows.lines[np.argsort(rows.times, kind="stable")][-len(motions) :]
    if each > 1:
        kept = np.arange(len(motions)) % each == 0
        drive = drive.with_found(_thinning(drive, len(motions), int(kept.sum()), each, "motions"))
        motions, lines = motions.rows(kept), lines[kept]
    path = motions.path()
    poses = replace(rows, times=path.times, values=path.poses, lines=lines[path.motions])
    return replace(drive, poses=poses, motions=replace(motions, begins=path.begins))


def _without_slips(drive: RecordedDrive) -> RecordedDrive:
    inputs, poses = drive.inputs.without_slips(), drive.poses.without_slips()
    slips = len(drive.inputs) - len(inputs), len(drive.poses) - len(poses)
    said = findings.same_times(max(slips) if drive.one_clock else sum(slips))
    return replace(drive, inputs=inputs, poses=poses).with_found(said)


def _clock_issues(drive: RecordedDrive) -> Iterator[FileIssue]:
    yield from _too_few(drive)
    yield from drive.inputs.clock_issues()
    if not drive.one_clock:
        yield from drive.poses.clock_issues()
    if len(drive.inputs) and len(drive.poses):
        yield from _no_overlap(drive.inputs, drive.poses)
    yield from drive.poses.too_large(drive.quantities)
    yield from drive.inputs.too_large(drive.names)


def _too_few(drive: RecordedDrive) -> Iterator[FileIssue]:
    for series, what in ((drive.inputs, "inputs"), (drive.poses, "poses")):
        if len(series) < FEWEST:
            line = int(series.lines[0]) if len(series) and series.counted == "line" else 0
            text = f"{drive.name} has {len(series)} row(s) of {what}; at least {FEWEST} are needed"
            yield FileIssue(series.file, line, 0, "", text)


def _no_overlap(inputs: Series, poses: Series) -> Iterator[FileIssue]:
    if inputs.times.max() < poses.times.min() or poses.times.max() < inputs.times.min():
        text = (
            f"the clocks do not overlap: inputs from {time_text(inputs.times[0])} to "
            f"{time_text(inputs.times[-1])} s, poses from {time_text(poses.times[0])} to "
            f"{time_text(poses.times[-1])} s; are the units of time "
            "and the time zones alike, and do both clocks begin at the same moment?"
        )
        yield poses.issue(0, poses.clock, text)


def _without_held(drive: RecordedDrive) -> RecordedDrive:
    poses = drive.poses
    changed = np.concatenate([[True], np.any(np.diff(poses.values, axis=0) != 0, axis=1)])
    # What the wheels have turned since the pose last changed.
    since = np.flatnonzero(changed)[np.cumsum(changed) - 1]
    at_poses = np.column_stack(
        [np.interp(poses.times, drive.inputs.times, column) for column in drive.driven.T]
    )
    stale = ~changed & np.any(np.abs(at_poses - at_poses[since]) > STILL, axis=1)
    lasting = _lasting(poses.times, changed, stale)
    if np.all(np.abs(drive.driven[1] - drive.driven[0]) <= STILL):
        # A drive from rest: the wheels' clock may be ahead of the poses' at the start.
        stale &= (since > 0) | (lasting > MARGIN)
    if not stale.any():
        return drive
    kept = poses.rows(~stale)
    if min(len(kept), int(changed.sum())) < FEWEST:
        text = "the pose hardly ever changes while the wheels turn; did the reference run?"
        raise LogError([poses.issue(0, "", f"{drive.name}: {text}")])
    lost = stale & (lasting > findings.gap_limit(poses.times[changed], None))
    slow = stale & ~lost
    return replace(drive, poses=kept).with_found(
        findings.held(kept, int(slow.sum()), len(poses)) if slow.any() else None,
        findings.tracker_lost(poses, lost) if lost.any() else None,
    )


def _lasting(times: Array, changed: Bools, stale: Bools) -> Array:
    # For how long poses (m,) that are stale are so until they change [s]; 0 of others.
    own = np.cumsum(changed) - 1
    ends = times[np.append(np.flatnonzero(changed)[1:], len(times) - 1)]
    begun = np.full(len(ends), np.inf)
    np.minimum.at(begun, own[stale], times[stale])
    return np.where(stale, ends[own] - begun[own], 0.0)


def _without_standing(drive: RecordedDrive) -> RecordedDrive:
    first, last = findings.moving_span(drive.inputs, drive.driven)
    times = drive.inputs.times
    start, end = times[first] - MARGIN, times[last] + MARGIN
    inputs, poses = (
        series.rows((series.times >= start) & (series.times <= end)) for series in (drive.inputs, drive.poses)
    )
    if min(len(inputs), len(poses)) < FEWEST:
        return drive
    from_start, motions = inputs.with_values(inputs.values - inputs.values[:1]), drive.motions
    if motions is not None:
        motions = motions.rows((motions.times[:, 0] >= start) & (motions.times[:, 1] <= end))
    return replace(drive, inputs=from_start, poses=poses, motions=motions)


def _thinned(drive: RecordedDrive, each: int) -> RecordedDrive:
    kept = drive.poses.rows(slice(None, None, each))
    return replace(drive, poses=kept).with_found(_thinning(drive, len(drive.poses), len(kept), each, "poses"))


def _thinning(drive: RecordedDrive, count: int, left: int, each: int, what: str) -> Finding:
    if left < FEWEST:
        text = f"{drive.name}: one in {each} of {count} {what} leaves {left}; at least {FEWEST} are needed"
        raise LogError([NotInLog(drive.poses.file, 0, 0, "thin", text, ("log", "thin"))])
    return findings.thinned(count, each, what)


def _with_gaps_found(drive: RecordedDrive, gap: float | None) -> RecordedDrive:
    bridged = bool(drive.bridged.all())
    same = np.array_equal(drive.inputs.times, drive.poses.times)
    inputs = findings.input_gap(drive.inputs, gap, "rows" if same else "inputs", doubtful=not bridged)
    poses = None if same else findings.pose_gap(drive.poses, gap)
    return drive.with_found(inputs, poses, findings.little_overlap(drive.inputs, drive.poses))


def _with_running_heading(drive: RecordedDrive) -> RecordedDrive:
    place = drive.place("heading")
    if place is None:
        return drive
    raw = drive.poses.values[:, place]
    values = drive.poses.values.copy()
    values[:, place] = np.unwrap(raw)
    suspect = findings.heading_in_degrees(drive.poses.times, raw)
    found = suspect or findings.wrapped_heading(raw)
    return replace(drive, poses=drive.poses.with_values(values)).with_found(found)


def _with_poses_checked(drive: RecordedDrive) -> RecordedDrive:
    x, y, heading = (drive.place(name) for name in ("x", "y", "heading"))
    poses = drive.poses
    positions = None if x is None or y is None else findings.pose_jump(poses, poses.values[:, [x, y]])
    turns = None if heading is None else findings.heading_jump(poses, poses.values[:, heading])
    return drive.with_found(positions, turns)


def to_logs(drives: list[RecordedDrive], form: LogForm, held: Repeats) -> list[Log]:
    """The logs of a file's drives, each checked.

    Args:
        drives: of the file.
        form: in which it was read.
        held: "drop" poses that repeat the one before while the wheels turn, or "keep" them.

    Raises:
        LogError: no drive is long enough, or any has a clock that does not rise, clocks without overlap,
            poses that never change.
    """
    fits = [min(len(drive.inputs), len(drive.poses)) >= FEWEST for drive in drives]
    fit = [drive for drive, long_enough in zip(drives, fits, strict=True) if long_enough]
    if not fit and len(drives) > MOST_SHORT:
        text = f"none of its {len(drives)} runs has {FEWEST} rows; does another column tell them apart?"
        raise LogError([NotInLog(drives[0].inputs.file, 0, 0, "runs", text, ("log", "runs", "column"))])
    read: list[Log] = together(partial(_to_log, drive, form, held) for drive in fit or drives)
    # Said once of a file, of which its drives are parts.
    for series, what in ((drives[0].inputs, "inputs"), (drives[0].poses, "poses")):
        one = findings.skipped_rows(series, what)
        read[0] = read[0].found(one.name, one.message) if one else read[0]
    if fit and len(fit) < len(drives):
        short = [drive.name for drive, long_enough in zip(drives, fits, strict=True) if not long_enough]
        text = f"{len(short)} run(s) of fewer than {FEWEST} rows are left out: {', '.join(short[:5])}"
        read[0] = read[0].found("short_runs", text)
    return read
