"""The last part of every log kept as test data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from oed.foundation.errors import FileFlaw, LogError
from oed.foundation.text import given_text
from oed.logs.drive import FEWEST
from oed.logs.log import Log

HELD_OUT = "held_out"
"""Finding in the first log of a file."""


def last_held_out(logs: Sequence[Log], share: float) -> tuple[list[Log], list[Log]]:
    """The logs without the poses of their last part, and these.

    Wheels stay whole in both: what they did before explains what follows.

    Args:
        logs: of drives.
        share: of each log's duration that is held out, above 0 and below 1.

    Raises:
        LogError: logs of which too few poses are left on either side, each with its file.
    """
    kept, held, flaws, said = list[Log](), list[Log](), list[FileFlaw](), set[str]()
    percent = f"{100 * share:.3g} %"
    for log in logs:
        times = log.pose_times
        first = int(np.searchsorted(times, times[-1] - share * log.duration))
        few = min(first, len(times) - first)
        if few < FEWEST:
            side = "before them" if few == first else "in them"
            text = (
                f"{log.name}: holding out the last {percent} of {given_text(log.duration, 's')} leaves {few} "
                f"of {len(times)} poses {side}; at least {FEWEST} are needed"
            )
            flaws.append(FileFlaw(log.file, 0, 0, "", text))
        before, after = (
            replace(log, pose_times=times[rows], poses=log.poses[rows])
            for rows in (slice(None, first), slice(first, None))
        )
        if log.file not in said:
            text = f"the last {percent} of each drive is test data, which nothing is estimated from"
            before = before.found(HELD_OUT, text)
        said.add(log.file)
        kept.append(before)
        held.append(replace(after, name=f"{log.name} (last {percent})"))
    if flaws:
        raise LogError(flaws)
    return kept, held
