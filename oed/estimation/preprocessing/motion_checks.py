"""Motions that a sensor read of itself, before they are fitted: strays are left out of the path that they
make up, and what is plainly wrong with all of them is named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from oed.estimation.prediction.motion_layout import driven
from oed.estimation.preprocessing.motion_comparison import MotionComparison
from oed.estimation.preprocessing.moves import FEWEST, Moves, unexplained
from oed.estimation.preprocessing.wiring_checks import BAD, BETTER, inputs_misread, worst
from oed.foundation.arrays import Array
from oed.logs.log import Log
from oed.logs.motions import inverted
from oed.robots.models.model import Model

MANY, MOST_STRAYS = 0.3, 0.5
"""Share of strays from which on more go wrong than usually do, and beyond which nobody can tell."""
FAIR, FAR_BETTER = 0.02, 0.25
"""Share of the motion that may be left unexplained without a look, and what has to be left of it at most by
another reading where it is not plainly bad."""
LUCK = 0.005
"""Share of the motion left unexplained below which one reading is as good as another."""
AS_LIKELY = 2.0
"""What leaves at most so many times what the best explanation leaves is as likely."""
LOOK = "look at the matcher, and at what else may be wrong"
STRAYS, MANY_STRAYS, LEFT_OUT = "stray_motions", "many_stray_motions", "motions_left_out"
"""Names of what is found of them, of very many, and of those that are not fitted."""


def without_strays(robot: Model, log: Log, offset: float = 0.0) -> Log:
    """The log with the path of the motions that are not plainly wrong; itself without motions.

    Args:
        robot: at its nominal parameters.
        log: of its drive.
        offset: of the log's clocks, as far as known [s].
    """
    if log.motions is None:
        return log
    inside = driven(log, offset)
    if np.count_nonzero(inside) < FEWEST:
        return log
    wrong = np.zeros(len(inside), dtype=bool)
    wrong[inside] = MotionComparison.of(robot, [log], offset).strays(offset)
    share = float(wrong.mean())
    if share == 0:
        return log
    if share > MOST_STRAYS:
        text = f"{100 * share:.0f} % of the relative poses are far off what wheels do that suit the others"
        return log.found(MANY_STRAYS, f"{text}: {LOOK}", doubtful=True)
    text = (
        f"{np.count_nonzero(wrong)} of {len(wrong)} relative poses ({100 * share:.1f} %) are far off the "
        "wheels' motion: bad matches, left out of the path that is shown; with loss: cauchy or huber they "
        "hardly matter to the estimates"
    )
    if share > MANY:
        text += f"; so many are more than usually go wrong: {LOOK}"
    return log.following(~wrong).found(MANY_STRAYS if share > MANY else STRAYS, text, doubtful=True)


def motion_clock_offsets(robot: Model, logs: Sequence[Log]) -> Array:
    """What the inputs' clocks show when the poses' show 0, by the motions of each file's logs, (files,) [s];
    0 where no motion shows it.

    Args:
        robot: at its nominal parameters.
        logs: with motions.
    """
    found = list[float]()
    for file in dict.fromkeys(log.file for log in logs):
        own = [log for log in logs if log.file == file]
        any_driven = any(driven(log, 0.0).any() for log in own)
        found.append(MotionComparison.of(robot, own, 0.0).offset() if any_driven else 0.0)
    return np.array(found)


def with_left_out(log: Log, offset: float) -> Log:
    """The log with a word on motions during which its wheels are not logged: none of them is fitted."""
    if log.motions is None or (count := int(np.count_nonzero(~driven(log, offset)))) == 0:
        return log
    text = (
        f"{count} of {len(log.motions)} relative poses are outside of the wheels' log or across a gap in it; "
        "left out"
    )
    return log.found(LEFT_OUT, text)


def motion_fault(moves: Moves, logs: Sequence[Log]) -> str | None:
    """What is most likely wrong with how motions are read, in words; None where nothing is.

    Args:
        moves: of the logs, as they were read.
        logs: of one file.
    """
    as_given = worst(moves, moves.inputs, any_side=True)
    if as_given < FAIR or moves.layout.count < FEWEST:
        return None
    tried = [(worst(moves, inputs, any_side=True), text) for text, inputs in inputs_misread(moves)]
    for text, read in MISREAD.items():
        read_so = [without_strays(moves.robot, _as(log, read)) for log in logs]
        own = Moves.of(moves.robot, read_so)
        # Where many are left out, or noise hides what showed before, that is no explanation.
        if _judged(own) >= _judged(moves) and not any(_has_many_strays(log) for log in read_so):
            tried.append((worst(own, own.inputs, any_side=True), text))
    # A share of next to nothing is the luck of the noise.
    tried = [(max(left, LUCK), text) for left, text in tried]
    least = min(left for left, _ in tried)
    if least >= (min(BETTER * as_given, BAD) if as_given >= BAD else FAR_BETTER * as_given):
        return None
    texts = dict.fromkeys(text for left, text in sorted(tried) if left <= AS_LIKELY * least)
    before = f"{100 * as_given:.0f} %" if as_given < 1 else "all of it"
    left = f"that leaves {100 * least:.0f} % of the motion unexplained instead of {before}"
    return f"{', or '.join(texts)}: {left}"


def _judged(moves: Moves) -> set[str]:
    # The kinds of moves in which there is more than noise.
    return set(unexplained(moves.measured(), moves.predicted(), moves.noise(), any_side=True))


def _has_many_strays(log: Log) -> bool:
    return any(one.name == MANY_STRAYS for one in log.findings)


def _as(log: Log, read: Callable[[Array], Array]) -> Log:
    # The log with its motions read otherwise, and nothing found in them yet.
    motions = log.motions
    assert motions is not None
    other = replace(log, motions=replace(motions, values=read(motions.values)), findings=())
    return other.following(np.ones(len(motions), dtype=bool))


def _turned_back(values: Array) -> Array:
    # From fixed axes to those of the sensor at each motion's beginning, where each follows the one before.
    headings = np.concatenate([[0.0], np.cumsum(values[:-1, 2])])
    moved = (values[:, 0] + 1j * values[:, 1]) * np.exp(-1j * headings)
    return np.column_stack([moved.real, moved.imag, values[:, 2]])


MISREAD: dict[str, Callable[[Array], Array]] = {
    "the motions run backwards, from t1 to t0; give inverse: true": inverted,
    "the heading is in degrees; give it unit: deg": lambda values: values * [1, 1, math.pi / 180],
    "the heading is in radians, not in degrees": lambda values: values * [1, 1, 180 / math.pi],
    "the heading has the wrong sign (it turns to the left)": lambda values: values * [1, 1, -1],
    "x and y are mirrored: are they exchanged, or has one of them the wrong sign?": lambda values: (
        values * [1, -1, 1]
    ),
    "x and y are along fixed axes, not along the sensor's own where the motion begins; give the poses that "
    "they are differences of as `poses`": _turned_back,
}
"""What may be wrong with all motions, in words, and how they are then to be read."""
