"""What a reader of estimates should know about a log: gaps, standing, lost track, uneven clocks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.logs.log import BRIDGED, Finding
from oed.logs.series import Series

GAP_STEPS = 5.0
"""Median steps that make a gap."""

JITTER = 0.2
"""Standard deviation of the steps of an uneven clock, relative to their median."""

STANDING = 0.5
"""Shorter standing is not worth a word [s]."""

STIRRED = 0.05
"""What a standing robot's wheels turn at most, as seconds at their mean speed; encoders shake by a tick."""

JUMP, SMALLEST_JUMP = 20.0, 0.05
"""Medians of the moving speed, and m, beyond which a step of the position is lost track."""

TURN_JUMP, SMALLEST_TURN = 5.0, np.radians(20)
"""Times the fast turning of the drive, and rad, beyond which a step of the heading is."""

WILD, PASSING = 20.0, 2
"""Times the fast readings of an input beyond which one is wild, and readings that follow each other of which
it is none: robots that are fast are so for a while."""
WILD_READING = "wild_reading"
"""Name of what is found of these."""

IN_DEGREES = "heading_in_degrees"
"""Name of what is found of a heading that is rather in degrees."""
DEGREES_PER_TURN = 360.0
"""By which a heading in degrees jumps."""
FAST_TURNING = 10.0
"""Usual yaw rate beyond which a heading is rather in degrees [rad/s]."""


def gap_limit(times: Array, gap: float | None) -> float:
    """What step in time is a gap [s]."""
    return float(GAP_STEPS * np.median(np.diff(times))) if gap is None else gap


def input_gap(series: Series, limit: float | None, what: str, *, doubtful: bool) -> Finding | None:
    """Steps in time of the inputs that are too long.

    Args:
        series: on one clock.
        limit: longer steps are gaps [s].
        what: of the log, for the message.
        doubtful: whether a gap casts doubt on the estimates.
    """
    text = _gaps(series, limit, what)
    unknown = "; what the wheels did meanwhile was not logged" if doubtful else ""
    return Finding("gap", text + unknown, doubtful) if text else None


def pose_gap(poses: Series, limit: float | None) -> Finding | None:
    """Steps in time of the poses that are too long; `limit` as for `input_gap`."""
    text, longest = _gaps(poses, limit, "poses"), float(np.diff(poses.times).max())
    if limit is not None:
        after = "segments end there, as `gap` asks"
    else:
        which = "it" if longest <= BRIDGED else f"those of up to {BRIDGED:g} s"
        after = f"the wheels carry segments on through {which}"
    return Finding("gap", f"{text}; {after}") if text else None


def _gaps(series: Series, limit: float | None, what: str) -> str:
    # "" without any.
    steps = np.diff(series.times)
    longer = steps > gap_limit(series.times, limit) * (1 + 1e-9)
    longest = int(np.argmax(steps))
    text = (
        f"{_times(int(longer.sum()), 'gap')} in the {what}; the longest is {steps[longest]:.3g} s "
        f"from {series.at(longest)}"
    )
    return text if longer.any() else ""


def uneven_clock(series: Series, what: str) -> Finding | None:
    """Jitter of the period, gaps left out."""
    steps = np.diff(series.times)
    period = float(np.median(steps))
    jitter = float(np.std(steps[steps <= GAP_STEPS * period])) / period
    if jitter <= JITTER:
        return None
    text = f"the times of the {what} are uneven: steps of {period:.3g} s, +-{100 * jitter:.0f} %"
    return Finding("uneven_clock", text)


def moving_span(series: Series, driven: Array) -> tuple[int, int]:
    """The last row before the wheels begin to turn, and the first after they have stopped."""
    travel = np.abs(np.diff(driven, axis=0)).sum(axis=0).max()
    limit = STIRRED * travel / (series.times[-1] - series.times[0])
    begun = np.any(np.abs(driven - driven[0]) > limit, axis=1)
    unfinished = np.any(np.abs(driven - driven[-1]) > limit, axis=1)
    if not begun.any():
        return 0, len(series) - 1
    return max(int(np.argmax(begun)) - 1, 0), len(series) - int(np.argmax(unfinished[::-1]))


def stationary(series: Series, driven: Array, *, at_end: bool) -> Finding | None:
    """How long the robot stands before or after its drive.

    Args:
        series: of the inputs.
        driven: what the wheels have turned since the first row, (n, wheels).
        at_end: after the drive instead of before.
    """
    first, last = moving_span(series, driven)
    last = min(last, len(series) - 1)
    times = series.times
    if not np.any(driven != driven[0]):
        return None if at_end else Finding("stationary", "the wheels stand all the time")
    seconds = float(times[-1] - times[last] if at_end else times[first] - times[0])
    if seconds < STANDING:
        return None
    name, word = ("stationary_end", "last") if at_end else ("stationary_start", "first")
    return Finding(name, f"the robot stands for the {word} {seconds:.3g} s, not informative about its wheels")


def same_times(rows: int) -> Finding | None:
    """Rows left out that the next one follows at the same time; None of none."""
    text = f"{rows} row(s) have the time of the next one, by a slip of the logger; left out"
    return Finding("same_times", text) if rows else None


def held(kept: Series, stale: int, rows: int) -> Finding:
    """Poses left out as held values of a slower sensor.

    Args:
        kept: poses that are new.
        stale: how many repeat.
        rows: poses in all.
    """
    period = float(np.median(np.diff(kept.times)))
    text = (
        f"{stale} of {rows} poses ({100 * stale / rows:.0f} %) repeat the one before while the wheels turn, "
        f"as a slower sensor's do; left out, a new one comes every {period:.3g} s"
    )
    return Finding("held_poses", text)


def tracker_lost(poses: Series, lost: Bools) -> Finding:
    """Poses left out as those of a tracker that had lost the robot.

    Args:
        poses: all of them.
        lost: which are left out, (m,).
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]])))
    first, after = edges[::2], np.minimum(edges[1::2], len(poses) - 1)
    longest = int(np.argmax(poses.times[after] - poses.times[first]))
    text = (
        f"{int(lost.sum())} of {len(poses)} poses repeat the one before while the wheels turn, as those of a "
        f"tracker that lost the robot: {_times(len(first), 'time')}, the longest for "
        f"{poses.times[after[longest]] - poses.times[first[longest]]:.3g} s from {poses.at(first[longest])}; "
        "left out"
    )
    return Finding("tracker_lost", text)


def thinned(count: int, each: int, what: str) -> Finding:
    """That of so many poses, or motions, the study asks for one in `each`.

    Args:
        count: that the log holds.
        each: one in so many is used.
        what: they are.
    """
    return Finding(f"thinned_{what}", f"of {count} {what} one in {each} is used, as the study asks")


def skipped_rows(series: Series, what: str) -> Finding | None:
    """Rows left out because they have no finite number; `what` of them, for the message."""
    count, first = len(series.skipped), min(series.skipped, default=0)
    if not count:
        return None
    noun = "rows" if series.counted == "line" else f"{series.counted}s"
    text = (
        f"the {what} of {count} of {series.arrived} {noun} of {Path(series.file).name} are skipped, as the "
        f"study asks: they have no finite number there (the first in {series.counted} {first})"
    )
    return Finding(f"skipped_{what}", text)


def little_overlap(inputs: Series, poses: Series) -> Finding | None:
    """Poses of which most were taken when no inputs were logged."""
    inside = np.mean((poses.times >= inputs.times[0]) & (poses.times <= inputs.times[-1]))
    if inside >= 0.5:
        return None
    text = f"only {100 * inside:.0f} % of the poses lie within the time of the inputs"
    return Finding("little_overlap", text, doubtful=True)


def wrapped_heading(heading: Array) -> Finding | None:
    """Full turns taken out of the heading."""
    count = int(np.count_nonzero(np.abs(np.diff(heading)) > np.pi))
    if not count:
        return None
    return Finding("wrapped_heading", f"the heading jumps by a full turn {_times(count, 'time')}; unwrapped")


def heading_in_degrees(times: Array, heading: Array) -> Finding | None:
    """A heading in rad whose size or pace is rather that of degrees."""
    steps = np.abs(np.diff(heading))
    span = float(np.ptp(heading))
    # Wrapped at a full turn of degrees, or turning faster than robots do.
    wrapped = np.any(np.abs(steps - DEGREES_PER_TURN) < 40) and span <= 1.01 * DEGREES_PER_TURN
    pace = float(np.percentile(steps / np.diff(times), 90))
    if span < 6 * np.pi or not (wrapped or pace > FAST_TURNING):
        return None
    text = (
        f"the heading spans {span:.3g} rad and turns by up to {pace:.3g} rad/s: "
        "if it is in degrees, say `unit: deg`"
    )
    return Finding(IN_DEGREES, text, doubtful=True)


def pose_jump(poses: Series, positions: Array) -> Finding | None:
    """Steps of the position (m, 2) that no drive explains: the reference lost track."""
    lengths, far = _leaps(poses, positions)
    return _jump(poses, lengths, far, "pose", "m")


def odometry_jump(poses: Series, positions: Array) -> Finding | None:
    """Steps of the position (n, 2) that odometry has summed up and no drive explains: it began anew."""
    lengths, far = _leaps(poses, positions)
    if not far.any():
        return None
    row = int(np.argmax(np.where(far, lengths, 0)))
    text = f"the odometry jumps by {lengths[row]:.3g} m after {poses.at(row)}: cut where it began anew"
    return Finding("odometry_jump", text, doubtful=True)


def _leaps(poses: Series, positions: Array) -> tuple[Array, Bools]:
    # Lengths of the steps, and which are far longer than usual ones.
    lengths = np.hypot(*np.diff(positions, axis=0).T)
    speeds = lengths / np.diff(poses.times)
    moving = speeds[speeds > 0]
    usual = float(np.median(moving)) if len(moving) else np.inf
    return lengths, (speeds > JUMP * usual) & (lengths > SMALLEST_JUMP)


def wild_reading(series: Series, place: int, label: str, unit: str) -> Finding | None:
    """Readings of an input that no drive explains, far larger than all others and gone with the next ones.

    Args:
        series: as logged.
        place: of the input in its values.
        label: what it is called in the log.
        unit: in which it is logged.
    """
    sizes = np.abs(series.values[:, place])
    usual = float(np.percentile(sizes[sizes > 0], 90)) if sizes.any() else np.inf
    far = sizes > WILD * usual
    edges = np.flatnonzero(np.diff(np.concatenate([[False], far, [False]])))
    if not far.any() or (edges[1::2] - edges[::2]).max() > PASSING:
        return None
    row = int(np.argmax(sizes))
    text = (
        f"{label} reads {series.values[row, place]:.6g} {unit} at {series.at(row)}, where at most "
        f"{usual:.3g} are usual: is that reading wrong?"
    )
    return Finding(WILD_READING, text, doubtful=True)


def heading_jump(poses: Series, heading: Array) -> Finding | None:
    """Steps of the heading (m,) that no drive explains."""
    turns = np.abs(np.diff(heading))
    rates = turns / np.diff(poses.times)
    far = (rates > TURN_JUMP * np.percentile(rates, 95)) & (turns > SMALLEST_TURN)
    return _jump(poses, turns, far, "heading", "rad")


def _jump(
    poses: Series, sizes: Array, far: np.typing.NDArray[np.bool_], what: str, unit: str
) -> Finding | None:
    if not far.any():
        return None
    row = int(np.argmax(np.where(far, sizes, 0)))
    text = (
        f"the {what} jumps {_times(int(far.sum()), 'time')}, most by {sizes[row]:.3g} {unit} "
        f"after {poses.at(row)}: the reference may have lost track; a robust loss "
        "(loss: huber) bounds what that does"
    )
    return Finding("pose_jump", text, doubtful=True)


def _times(count: int, word: str) -> str:
    return f"{count} {word}" if count == 1 else f"{count} {word}s"
