"""The last part of every log kept as test data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import FileIssue, LogError
from oed.foundation.text import given_text
from oed.logs.drive import FEWEST
from oed.logs.log import Log

HELD_OUT, WHOLE = "held_out", "not_held_out"
"""Findings: in the first log of a file, and in one that is too short for it."""


def last_held_out(logs: Sequence[Log], share: float) -> tuple[list[Log], list[Log]]:
    """The logs without what was read in their last part, and these parts.

    Wheels stay whole in both: what they did before explains what follows. A motion across the cut is in
    neither, a log of which either part is too short is whole in the first.

    Args:
        logs: of drives.
        share: of each log's duration that is held out, above 0 and below 1.

    Raises:
        LogError: logs without positions to try dead reckoning on; too few poses are left on either side of
            every log; each with its file.
    """
    _require_positions(logs)
    percent = f"{100 * share:.3g} %"
    few = {index: text for index, log in enumerate(logs) if (text := _too_few(log, share, percent))}
    if len(few) == len(logs):
        raise LogError([FileIssue(logs[index].file, 0, 0, "", text) for index, text in few.items()])
    kept, held, said = list[Log](), list[Log](), set[str]()
    for index, log in enumerate(logs):
        if index in few:
            kept.append(log.found(WHOLE, f"{few[index]}: all of it is estimated from"))
            continue
        cut = _cut(log, share)
        before, after = _between(log, -np.inf, cut), _between(log, cut, np.inf)
        if log.file not in said:
            text = f"the last {percent} of each drive is test data, which nothing is estimated from"
            before = before.found(HELD_OUT, text)
        said.add(log.file)
        kept.append(before)
        held.append(replace(after, name=f"{log.name} (last {percent})"))
    return kept, held


def _require_positions(logs: Sequence[Log]) -> None:
    text = (
        "hold_out: dead reckoning is tried on what is held out, and this log has no positions to compare it "
        "with; name x and y in log.poses, or leave out --hold-out"
    )
    lacking = dict.fromkeys(log.file for log in logs if not {"x", "y"} <= set(log.quantities))
    if lacking:
        raise LogError([FileIssue(file, 0, 0, "", text) for file in lacking])


def _cut(log: Log, share: float) -> float:
    # The time at which the last part begins [s], on either clock: how far they are apart is not known yet.
    return float(log.pose_times[-1] - share * log.duration)


def _too_few(log: Log, share: float, percent: str) -> str:
    # What is wrong with the parts, in words; "" where either has enough.
    cut = _cut(log, share)
    what, begins, ends = "poses", log.pose_times, log.pose_times
    if log.motions is not None:
        what, (begins, ends) = "relative poses", log.motions.times.T
    before, after = int(np.count_nonzero(ends < cut)), int(np.count_nonzero(begins >= cut))
    few = min(before, after)
    if few >= FEWEST:
        return ""
    side = "before them" if few == before else "in them"
    return (
        f"{log.name}: holding out the last {percent} of {given_text(log.duration, 's')} leaves {few} "
        f"of {len(ends)} {what} {side}; at least {FEWEST} are needed"
    )


def _between(log: Log, first: float, last: float) -> Log:
    # With what was read from one time until before another alone, and wheels that are whole.
    def inside(times: Array) -> Bools:
        return np.asarray((times >= first) & (times < last))

    sensors = tuple(
        replace(one, times=one.times[rows], values=one.values[rows])
        for one in log.sensors
        if (rows := inside(one.times)).any()
    )
    log = replace(log, sensors=sensors)
    if log.motions is None:
        rows = inside(log.pose_times)
        return replace(log, pose_times=log.pose_times[rows], poses=log.poses[rows])
    motions = log.motions.rows(np.asarray(inside(log.motions.times).all(axis=1)))
    return replace(log, motions=motions).following(np.ones(len(motions), dtype=bool))
