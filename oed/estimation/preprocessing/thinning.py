"""Long logs brought down to as many poses as a fit takes in reasonable time, and what that does said.

Neighbouring poses are averaged first, over times in which the robot hardly turns: of independent noise that
loses nothing. What is still too many is left out between pieces that are spread evenly over each log. The
wheels' motion stays as it was logged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from oed.estimation.prediction.layout import GAP
from oed.logs.log import Log

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
    count = _poses(logs)
    each = _averaged_each(logs, math.ceil(count / most))
    if each > 1:
        logs = [_averaged(log, each) for log in logs]
    share = most / _poses(logs)
    return tuple(logs) if share >= 1 else tuple(_sampled(log, share) for log in logs)


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
    # Rows of poses that follow each other without a gap, (groups, each).
    steps = np.diff(log.pose_times)
    longest = GAP * float(np.median(steps)) if log.gap is None else log.gap
    stretches = np.split(np.arange(len(log.pose_times)), np.flatnonzero(steps > longest) + 1)
    return np.concatenate([own[: len(own) // each * each].reshape(-1, each) for own in stretches])


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
    # What was left out is no motion to be bridged.
    holes = np.diff(log.pose_times[rows])[np.diff(rows) > 1]
    gap = log.gap if log.gap is None or not len(holes) else min(log.gap, float(holes.min()) / 2)
    sampled = replace(log, pose_times=log.pose_times[rows], poses=log.poses[rows], gap=gap)
    return sampled.found(SAMPLED, text)
