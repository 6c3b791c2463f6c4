"""Motions that a sensor read of itself, before they are fitted: strays are left out of the path that they
make up, and what is plainly wrong with all of them is named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from oed.estimation.prediction.logged_readings import LoggedReadings
from oed.estimation.prediction.motion_layout import driven, motion_segments
from oed.estimation.preprocessing.moves import FEWEST, Moves
from oed.estimation.preprocessing.wiring_checks import BAD, BETTER, inputs_misread, worst
from oed.estimation.setup.unknowns import Unknowns
from oed.foundation.arrays import Array, Bools
from oed.logs.log import Log
from oed.logs.motions import inverted
from oed.robots.models.model import Model

STRAY = 8.0
"""Robust standard deviations off the wheels' motion from which on one that a sensor read is a stray."""
MOST_STRAYS = 0.3
"""Share of strays beyond which they are none: something else is wrong."""
FINEST = 1e-4
"""Least deviation that strays are judged by [m, rad]."""
ROUNDS = 30
"""Of reweighting."""
FAIR, FAR_BETTER = 0.02, 0.25
"""Share of the motion that may be left unexplained without a look, and what has to be left of it at most by
another reading where it is not plainly bad."""
LUCK = 0.005
"""Share of the motion left unexplained below which one reading is as good as another."""
AS_LIKELY = 2.0
"""What leaves at most so many times what the best explanation leaves is as likely."""
STRAYS, LEFT_OUT = "stray_motions", "motions_left_out"
"""Names of what is found of them, and of those that are not fitted."""


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
    wrong[inside] = _strays(robot, log, offset)
    share = float(wrong.mean())
    if not 0 < share <= MOST_STRAYS:
        return log
    text = (
        f"{np.count_nonzero(wrong)} of {len(wrong)} relative poses ({100 * share:.1f} %) are far off the "
        "wheels' motion: bad matches, left out of the path that is shown; with loss: cauchy or huber they "
        "hardly matter to the estimates"
    )
    return log.following(~wrong).found(STRAYS, text, doubtful=True)


def with_left_out(log: Log, offset: float) -> Log:
    """The log with a word on motions during which its wheels are not logged: none of them is fitted."""
    if log.motions is None or (count := int(np.count_nonzero(~driven(log, offset)))) == 0:
        return log
    text = (
        f"{count} of {len(log.motions)} relative poses are outside of the wheels' log or across a gap in it; "
        "left out"
    )
    return log.found(LEFT_OUT, text)


def _strays(robot: Model, log: Log, offset: float) -> Bools:
    # Motions while wheels are logged that are far off what these explain, with any factors and mounting.
    layout = motion_segments([log], [offset])
    names = tuple(parameter.name for parameter in robot.parameters)
    readings = LoggedReadings.of(layout, Unknowns(robot, names, (), 0), np.array([offset]))
    values = np.array(robot.nominal, dtype=float)
    rolled = readings(values, readings.first_starts(values))[:, -1]
    measured = layout.readings[:, -1]
    moved, by_wheels = (one[:, 0] + 1j * one[:, 1] for one in (measured, rolled))
    swing = np.exp(1j * measured[:, 2]) - 1
    return _off(measured[:, 2], rolled[:, 2:]) | _off(moved, np.column_stack([by_wheels, swing]))


def _off(values: Array, columns: Array) -> Bools:
    # Which values are far off their robust regression on columns, with Cauchy's weights; real or complex.
    weights = np.ones(len(values))
    for _ in range(ROUNDS):
        root = np.sqrt(weights)
        factors = np.linalg.lstsq(columns * root[:, None], values * root, rcond=None)[0]
        off = np.abs(values - columns @ factors)
        size = max(float(np.median(off)) / 0.6745, FINEST)
        weights = 1 / (1 + (off / size) ** 2)
    return np.asarray(off > STRAY * size)


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
        own = Moves.of(moves.robot, [without_strays(moves.robot, _as(log, read)) for log in logs])
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


def _as(log: Log, read: Callable[[Array], Array]) -> Log:
    # The log with its motions read otherwise.
    motions = log.motions
    assert motions is not None
    other = replace(log, motions=replace(motions, values=read(motions.values)))
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
