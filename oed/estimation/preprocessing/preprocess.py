"""Logs preprocessed for a fit: thinned, alike, in motion, on one clock, and what is plainly wrong refused.

Long logs are brought down to as many poses as a fit takes in reasonable time. Neighbouring poses are averaged
first, over times in which the robot hardly turns: of independent noise that loses nothing. What is still too
many is left out between pieces that are spread evenly over each log. The wheels' motion stays as it was
logged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from oed.estimation.prediction.layout import GAP, stretches
from oed.estimation.preprocessing.motion_checks import (
    motion_clock_offsets,
    motion_fault,
    with_left_out,
    without_strays,
)
from oed.estimation.preprocessing.moves import FEWEST, Moves, clock_offsets
from oed.estimation.preprocessing.steering_checks import STEERED, zero_fault
from oed.estimation.preprocessing.wiring_checks import (
    explained_by_other_sizes,
    frozen,
    moves_one_way,
    poorly_explained,
    stands_still,
    unit_fault,
    wiring_fault,
)
from oed.foundation.arrays import Array
from oed.foundation.errors import FileIssue, LogError
from oed.logs.findings import IN_DEGREES, WILD_READING
from oed.logs.log import Log
from oed.robots.models.model import Model

HOPELESS = 0.9
"""Share of the motion left unexplained from which on an estimate would be nonsense."""
TENFOLD = 10.0
"""Factor between measured distances and those of the wheels that no robot's sizes account for."""

STILL = (
    "the measured poses hardly move while the wheels drive: did the reference run, are its columns and "
    "units right?"
)
FROZEN = (
    "hardly changes while the robot drives and turns: did the reference measure it, is it the right column, "
    "in the right unit?"
)
Indices = npt.NDArray[np.intp]

MOST_POSES = 100_000
"""Poses of all logs together that a fit takes."""
BRIEF = 0.02
"""Longest time that poses are averaged over [s]. Means of poses on an arc lie inside it, by (Omega T)^2 / 24
of its radius: 2e-5 at 1 rad/s."""
SHORTEST_LOG = 50
"""Poses that every log keeps at least when they are averaged."""
AVERAGED, SAMPLED = "averaged_poses", "sampled_poses"
"""Findings in a log."""
PIECES, LEAST = 10, 500
"""Pieces of a log that are used where not all of it is, and poses that each of them has at least."""


def thinned(logs: Sequence[Log], most: int = MOST_POSES) -> tuple[Log, ...]:
    """Logs with at most about `most` poses together; each says what was done to it."""
    if any(log.motions is not None for log in logs):
        return tuple(_with_fewer_motions(log, most / max(_poses(logs), 1)) for log in logs)
    count = _poses(logs)
    if count <= most:
        return tuple(logs)
    each = _averaged_each(logs, math.ceil(count / most))
    if each > 1:
        logs = [_averaged(log, each) for log in logs]
    share = most / _poses(logs)
    return tuple(logs) if share >= 1 else tuple(_sampled(log, share) for log in logs)


def _with_fewer_motions(log: Log, share: float) -> Log:
    # Each is a reading by itself.
    if log.motions is None or share >= 1:
        return log
    count = len(log.motions)
    kept = np.zeros(count, dtype=bool)
    kept[np.linspace(0, count - 1, max(int(share * count), 1)).astype(np.intp)] = True
    text = f"{int(kept.sum())} of {count} motions are used, spread over the log, and the others left out"
    return replace(log, motions=log.motions.rows(kept)).found(SAMPLED, text)


def thinning_notes(before: Sequence[Log], after: Sequence[Log]) -> list[str]:
    """What was done to logs all together, in words; [] where nothing was."""
    count, left, each = _poses(before), _poses(after), after[0].averaged
    sampled = any(finding.name == SAMPLED for log in after for finding in log.findings)
    done = [f"averaged {each} at a time"] if each > 1 else []
    done += [f"{left} kept in pieces spread over the logs, the others left out"] if sampled else []
    return [f"{count} poses are more than a fit takes in reasonable time: {', '.join(done)}"] if done else []


def _poses(logs: Sequence[Log]) -> int:
    return sum(len(log.pose_times) for log in logs)


def _averaged_each(logs: Sequence[Log], wanted: int) -> int:
    # As many in all logs, so that they have the same noise.
    period = max(float(np.median(np.diff(log.pose_times))) for log in logs)
    shortest = min(len(log.pose_times) for log in logs)
    return max(1, min(wanted, int(BRIEF / period + 1e-6), shortest // SHORTEST_LOG))


def _averaged(log: Log, each: int) -> Log:
    rows = _groups(log, each)
    count = len(log.pose_times)
    text = f"{count} poses are averaged, {each} at a time: noise and residuals are those of the means"
    times, poses = log.pose_times[rows].mean(axis=1), log.poses[rows].mean(axis=1)
    return replace(log, pose_times=times, poses=poses, averaged=each).found(AVERAGED, text)


def _groups(log: Log, each: int) -> Indices:
    # Rows of poses that follow each other without a gap, (groups, each); what wheels bridge is one, too.
    steps = np.diff(log.pose_times)
    longest = min(GAP * float(np.median(steps)), log.gap or math.inf)
    whole = np.split(np.arange(len(log.pose_times)), np.flatnonzero(steps > longest) + 1)
    return np.concatenate([own[: len(own) // each * each].reshape(-1, each) for own in whole])


def _sampled(log: Log, share: float) -> Log:
    count = len(log.pose_times)
    kept = min(count, max(int(share * count), LEAST))
    pieces = int(np.clip(kept // LEAST, 1, PIECES))
    width = kept // pieces
    first = np.linspace(0, count - width, pieces).astype(np.intp)
    rows = np.unique(first[:, None] + np.arange(width))
    text = (
        f"{len(rows)} of {count} poses are used, in {pieces} pieces spread over the log, and the others left "
        "out: more would take long and hardly change the estimates"
    )
    times = log.pose_times[rows]
    # What was left out is no motion to be bridged.
    holes = ((times[1:] + times[:-1]) / 2)[np.diff(rows) > 1]
    breaks = (*log.breaks, *holes.tolist())
    return replace(log, pose_times=times, poses=log.poses[rows], breaks=breaks).found(SAMPLED, text)


@dataclass(frozen=True)
class PreparedLogs:
    """Logs that fit the robot.

    Attributes:
        logs: with what was found.
        offsets: of the clocks of each file, as far as their motion shows, (files,) [s].
        mounting: how far the pose sensor is turned to the left on the robot, roughly [rad].
    """

    logs: tuple[Log, ...]
    offsets: Array
    mounting: float

    @property
    def relative(self) -> bool:
        """Whether the logs hold motions that a sensor read of itself, instead of poses."""
        return self.logs[0].motions is not None

    @property
    def files(self) -> tuple[str, ...]:
        """The files, in order."""
        return tuple(dict.fromkeys(log.file for log in self.logs))

    @property
    def clocks(self) -> list[float]:
        """Of each log [s]."""
        return [float(self.offsets[self.files.index(log.file)]) for log in self.logs]


def preprocess(robot: Model, logs: Sequence[Log], *, compare_clocks: bool) -> PreparedLogs:
    """Check that logs fit a robot, and compare the clocks of its wheels and poses.

    Args:
        robot: at its nominal parameters.
        logs: at least one.
        compare_clocks: whether clocks may be apart.

    Raises:
        LogError: different readings, no motion, wheels exchanged, signs or units wrong; all files at once.
    """
    _require_alike(logs)
    _require_motion(logs)
    if not logs[0].quantities:
        # Without poses there is nothing to compare the wheels with before a fit.
        return PreparedLogs(tuple(logs), np.zeros(len({log.file for log in logs})), 0.0)
    relative = logs[0].motions is not None
    if relative:
        logs, apart = _without_strays(robot, logs, compare_clocks)
    moves = Moves.of(robot, logs)
    if relative or compare_clocks:
        moves = replace(moves, offsets=apart if relative else clock_offsets(moves))
    issues, doubts = [], dict[str, str]()
    for index, file in enumerate(moves.layout.clocks):
        issue, doubt = _judged(moves.within(moves.layout.clock == index), file, logs)
        issues += issue
        if doubt:
            doubts[file] = doubt
    if issues:
        raise LogError(issues)
    prepared = tuple(
        log.found("poorly_explained", doubts[log.file], doubtful=True) if log.file in doubts else log
        for log in logs
    )
    return PreparedLogs(prepared, moves.offsets, moves.mounting())


def _without_strays(robot: Model, logs: Sequence[Log], compare_clocks: bool) -> tuple[list[Log], Array]:
    # Relative poses and their clocks: before anything is made of their path, of which one that is wrong
    # bends all that follows.
    files = list(dict.fromkeys(log.file for log in logs))
    apart = motion_clock_offsets(robot, logs) if compare_clocks else np.zeros(len(files))
    each = [float(apart[files.index(log.file)]) for log in logs]
    kept = [with_left_out(without_strays(robot, log, own), own) for log, own in zip(logs, each, strict=True)]
    return kept, apart


def _judged(moves: Moves, file: str, logs: Sequence[Log]) -> tuple[list[FileIssue], str]:
    # What is plainly wrong with a file, or what may be.
    own = [log for log in logs if log.file == file]
    relative = own[0].motions is not None
    # Few motions that are long differ by more than the nominal sizes' first order.
    left = None if relative and moves.layout.count < FEWEST else poorly_explained(moves)
    found = [one for log in own for one in log.findings]
    odd = (f"; {one.message}" for one in found if one.name in (IN_DEGREES, STEERED))
    key, wrong = _what_is_wrong(moves, left, next(odd, ""))
    # As of crossed wires, clocks that agree may be taken to be apart.
    agreeing = replace(moves, offsets=np.zeros_like(moves.offsets))
    zero = zero_fault(agreeing) or zero_fault(moves) if wrong or left is not None else None
    if wrong and zero is not None:
        key, wrong = zero
    if relative:
        wrong = motion_fault(moves, own) or wrong
    if wrong:
        wild = (f"; {one.message}" for one in found if one.name == WILD_READING)
        return [FileIssue(file, 0, 0, key, f"{wrong}{next(wild, '')}")], ""
    if left is None:
        return [], ""
    doubt = f"the wheels leave {100 * left:.0f} % of the measured motion unexplained"
    return [], doubt + ("" if zero is None else f"; {zero[0]}: {zero[1]}")


def _what_is_wrong(moves: Moves, left: float | None, odd: str) -> tuple[str, str]:
    # The quantity and what is plainly wrong with it, "" where that is all or nothing; `left` is the share of
    # the motion that the wheels leave unexplained, where that is too large; `odd` what was found in the log.
    unit = unit_fault(moves)
    if unit is not None:
        return "", unit
    if stands_still(moves):
        return "", f"{STILL}{odd}"
    still = frozen(moves)
    if still is not None:
        return still, FROZEN
    wrong = wiring_fault(moves)
    if wrong is None and left is not None:
        # By crossed wires, clocks that agree may be taken to be apart.
        wrong = wiring_fault(replace(moves, offsets=np.zeros_like(moves.offsets)))
    if wrong is None and left is not None and _hopeless(moves, left):
        wrong = (
            f"the wheels explain next to nothing of the measured motion (measured distances are "
            f"{moves.lengthening():.2g} times theirs): is this the robot's log, are columns, ticks "
            f"per turn and units right?{odd}"
        )
    return "", wrong or ""


def _hopeless(moves: Moves, left: float) -> bool:
    # A sensor far off the robot can be made to explain any distances: their sum cannot.
    longer = moves.lengthening()
    if moves.goes_places and (longer > TENFOLD or longer < 1 / TENFOLD):
        return True
    return left > HOPELESS and not moves_one_way(moves) and not explained_by_other_sizes(moves)


def _require_alike(logs: Sequence[Log]) -> None:
    first = logs[0]
    others = [log for log in logs if _held(log) != _held(first)]
    issues = [
        FileIssue(log.file, 0, 0, "", f"holds {_held(log)}, {first.name} {_held(first)}") for log in others
    ]
    if issues:
        raise LogError(issues)


def _held(log: Log) -> str:
    return f"{'' if log.motions is None else 'relative '}{', '.join(log.quantities)}"


def _require_motion(logs: Sequence[Log]) -> None:
    empty = [log for log in logs if len(log.pose_times) < 2]
    if empty:
        text = "has neither poses nor anything else that is read of where the robot is"
        raise LogError([FileIssue(log.file, 0, 0, "", text) for log in empty])
    text = "no poses while the wheels are logged; do the two clocks begin together?"
    issues = [FileIssue(log.file, 0, 0, "", text) for log in logs if not stretches(log, 0.0)]
    if issues:
        raise LogError(issues)
