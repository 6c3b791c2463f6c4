"""Logs preprocessed for a fit: alike, in motion, on one clock, and what is plainly wrong refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from oed.estimation.prediction.layout import stretches
from oed.estimation.preprocessing.moves import Moves, clock_offsets
from oed.estimation.preprocessing.wiring_checks import (
    explained_by_other_sizes,
    frozen,
    poorly_explained,
    stands_still,
    wiring_fault,
)
from oed.foundation.arrays import Array
from oed.foundation.errors import FileFlaw, LogError
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
    moves = Moves.of(robot, logs)
    if compare_clocks:
        moves = replace(moves, offsets=clock_offsets(moves))
    flaws, doubts = [], dict[str, str]()
    for index, file in enumerate(moves.layout.clocks):
        own = moves.within(moves.layout.clock == index)
        left = poorly_explained(own)
        key, wrong = _what_is_wrong(own, left)
        if wrong:
            flaws.append(FileFlaw(file, 0, 0, key, wrong))
        elif left is not None:
            doubts[file] = f"the wheels leave {left:.0%} of the measured motion unexplained"
    if flaws:
        raise LogError(flaws)
    found = tuple(
        log.found("poorly_explained", doubts[log.file], doubtful=True) if log.file in doubts else log
        for log in logs
    )
    return PreparedLogs(found, moves.offsets, moves.mounting())


def _what_is_wrong(moves: Moves, left: float | None) -> tuple[str, str]:
    # The quantity and what is plainly wrong with it, "" where that is all or nothing; `left` is the share of
    # the motion that the wheels leave unexplained, where that is too large.
    if stands_still(moves):
        return "", STILL
    still = frozen(moves)
    if still is not None:
        return still, FROZEN
    wrong = wiring_fault(moves)
    if wrong is None and left is not None and _hopeless(moves, left):
        wrong = (
            f"the wheels explain next to nothing of the measured motion (measured distances are "
            f"{moves.lengthening():.2g} times theirs): is this the robot's log, are columns, ticks "
            "per turn and units right?"
        )
    return "", wrong or ""


def _hopeless(moves: Moves, left: float) -> bool:
    # A sensor far off the robot can be made to explain any distances: their sum cannot.
    longer = moves.lengthening()
    if longer > TENFOLD or longer < 1 / TENFOLD:
        return True
    return left > HOPELESS and not explained_by_other_sizes(moves)


def _require_alike(logs: Sequence[Log]) -> None:
    first = logs[0]
    flaws = [
        FileFlaw(
            log.file,
            0,
            0,
            "",
            f"holds {', '.join(log.quantities)}, {first.name} {', '.join(first.quantities)}",
        )
        for log in logs
        if log.quantities != first.quantities
    ]
    if flaws:
        raise LogError(flaws)


def _require_motion(logs: Sequence[Log]) -> None:
    text = "no poses while the wheels are logged; do the two clocks begin together?"
    flaws = [FileFlaw(log.file, 0, 0, "", text) for log in logs if not stretches(log, 0.0)]
    if flaws:
        raise LogError(flaws)
