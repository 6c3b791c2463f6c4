"""Short moves of a log, measured and predicted: what clocks, swapped wheels and wrong signs show in.

How far the clocks of wheels and poses are apart follows from them, as a first guess.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from oed.estimation.prediction.layout import SegmentLayout, cut
from oed.estimation.prediction.logged_readings import further_starts
from oed.estimation.prediction.segments import Driven, SegmentReadings
from oed.estimation.preprocessing.outliers import jumps, white_noise, without_outliers
from oed.estimation.setup.unknowns import PLACE
from oed.foundation.arrays import Array, Bools
from oed.foundation.quantities import SMALLEST
from oed.logs.log import Log
from oed.robots.models.model import Model

Moved = Array | npt.NDArray[np.complex128]

Axes = tuple[complex, complex]
"""What x and y count for in the complex plane of positions."""
AS_READ: Axes = (1, 1j)
MOVE = 0.5
"""Length of a move [s]: longer than the jitter of clocks, shorter than turns."""
FEWEST = 10
"""Moves from which on their comparison is believed; anything suits a few."""
GAINS = (1 / 3, 3.0)
"""How far a true motion may be from that of the nominal parameters, as a factor."""
REACH = 1.0
"""Largest offset looked for [s]."""
COARSE, FINE = 0.05, 0.01
"""Steps of the search [s]; the fit refines what it finds."""
BEYOND = 3.0
"""How many times as large as that of noise alone the mean square of moves has to be to be judged."""
SOME = 40
"""Moves of a clock that the search begins with, about."""
CLEAR = 0.9
"""An offset is taken for real where it leaves at most this share of what no offset leaves unexplained."""


@dataclass(frozen=True)
class Moves:
    """Moves of logs, one after the other.

    Attributes:
        robot: at its nominal parameters.
        layout: every move a segment.
        offsets: of the clocks, (clocks,) [s].
        deviations: of the white noise of each log's quantities, (logs, quantities), SI.
    """

    robot: Model
    layout: SegmentLayout
    offsets: Array
    deviations: Array

    @classmethod
    def of(cls, robot: Model, logs: Sequence[Log]) -> Moves:
        """The moves of logs, whose clocks agree; positions and headings alone matter, and outliers do not."""
        step = max(float(np.median(np.diff(log.pose_times))) for log in logs)
        deviations = np.array([white_noise(log) for log in logs])
        logs = [without_outliers(log) for log in logs]
        layout = cut(logs, max(MOVE, 2 * step), [0.0] * len(logs))
        moves = cls(robot, layout, np.zeros(len(layout.clocks)), deviations)
        smooth = ~_with_jumps(layout)
        return moves.within(smooth) if smooth.any() and not smooth.all() else moves

    @cached_property
    def inputs(self) -> Array:
        """As they were logged, in the small steps in which moves are driven, (S, n, inputs)."""
        return self.layout.in_small_steps.inputs(self.offsets)

    def predicted(self, inputs: Array | None = None) -> dict[str, Array]:
        """What can be compared of `rolled` with the measured moves."""
        rolled, quantities = self.rolled(inputs), self.layout.quantities
        if "heading" in quantities:
            return rolled if "x" in quantities else {"turn": rolled["turn"]}
        return {"distance": np.hypot(rolled["forward"], rolled["left"])}

    def rolled(self, inputs: Array | None = None) -> dict[str, Array]:
        """Each move by the wheels, with logged inputs or others: forward, to the left [m], turn [rad]."""
        layout = self.layout.in_small_steps
        chosen = self.inputs if inputs is None else inputs
        readings = SegmentReadings.logged(self.robot, ("x", "y", "heading"), layout.count, layout.periods)
        nominal, place = np.array(self.robot.nominal), np.zeros(len(PLACE))
        further = further_starts(self.robot, layout, self.offsets, nominal, inputs)
        starts = np.hstack([np.zeros((layout.count, 3)), further])
        ends = readings(Driven(starts, chosen, layout.steps, nominal, place))[:, -1]
        return dict(zip(("forward", "left", "turn"), ends.T, strict=True))

    def measured(self, sign: float = 1.0, unit: float = 1.0, axes: Axes = AS_READ) -> dict[str, Array]:
        """Each move by the poses.

        Args:
            sign: of headings that may have been read with another one.
            unit: of headings that may have been read in another one.
            axes: of positions that may have been read in another unit, or along other axes.
        """
        x, y, turn = (self.changes(name) for name in ("x", "y", "heading"))
        heading, found = self.headings(), {}
        if turn is not None:
            found["turn"] = sign * unit * turn
        if x is not None and y is not None:
            move = axes[0] * x + axes[1] * y
            if heading is None:
                found["distance"] = np.abs(move)
            else:
                move = move * np.exp(-1j * sign * unit * heading)
                found |= {"forward": move.real, "left": move.imag}
        return found

    def noise(self, unit: float = 1.0, axes: Axes = AS_READ) -> dict[str, float]:
        """Mean square of what noise alone makes of a move, by its kind as in `unexplained`.

        Args:
            unit: of headings, as for `measured`.
            axes: of positions.
        """
        squares = 2 * np.mean(self.deviations[self.layout.owner] ** 2, axis=0)
        own = dict(zip(self.layout.quantities, squares, strict=True))
        size = {"x": abs(axes[0]) ** 2, "y": abs(axes[1]) ** 2}
        distance = sum(factor * own[name] for name, factor in size.items() if name in own)
        return {"turn": unit**2 * own.get("heading", 0.0), "distance": distance}

    def headings(self) -> Array | None:
        """Heading [rad] at the start of each move, (S,), where it is measured."""
        quantities = self.layout.quantities
        return self.layout.readings[:, 0, quantities.index("heading")] if "heading" in quantities else None

    def changes(self, name: str) -> Array | None:
        """By how much a measured quantity changes in each move, (S,); None where it is not measured."""
        layout = self.layout
        if name not in layout.quantities:
            return None
        own = layout.readings[:, :, layout.quantities.index(name)]
        return np.asarray(own[np.arange(layout.count), layout.last] - own[:, 0])

    def mounting(self) -> float:
        """How far the pose sensor is turned to the left on the robot [rad]; 0 where no move shows it."""
        measured = self.measured()
        if "forward" not in measured:
            return 0.0
        predicted = self.predicted()
        moved, rolled = (one["forward"] + 1j * one["left"] for one in (measured, predicted))
        rest, own = _without(np.exp(1j * measured["turn"]) - 1, moved, rolled)
        return -float(np.angle(np.vdot(own, rest))) if _any(own) else 0.0

    @property
    def goes_places(self) -> bool:
        """Whether there is more in the measured distances than noise."""
        measured = self.measured()
        way = measured.get("distance", np.hypot(measured.get("forward", 0.0), measured.get("left", 0.0)))
        return float(np.mean(way**2)) > BEYOND * self.noise()["distance"]

    def lengthening(self) -> float:
        """Measured distances over those by the wheels; not a number where these are 0."""
        distances = []
        for moves in (self.measured(), self.predicted()):
            own = moves.get("distance", np.hypot(moves.get("forward", 0.0), moves.get("left", 0.0)))
            distances.append(float(np.sum(own)))
        return distances[0] / distances[1] if distances[1] > 0 else np.nan

    def within(self, rows: Bools) -> Moves:
        """Only some of the moves, (S,)."""
        layout = self.layout
        part = replace(
            layout,
            owner=layout.owner[rows],
            times=layout.times[rows],
            readings=layout.readings[rows],
            valid=layout.valid[rows],
        )
        return replace(self, layout=part)


def unexplained(
    measured: dict[str, Array],
    predicted: dict[str, Array],
    noise: Mapping[str, float] | None = None,
    *,
    any_side: bool = False,
) -> dict[str, float]:
    """Share of what is measured that a prediction times its best factor leaves, by kind of move.

    The factor lies within `GAINS`: nominal parameters are never right, but of the right sign. Moves ahead
    and to the left are those of a sensor anywhere on the robot, turned by less than a right angle; with
    `any_side` by any angle. What noise makes of moves nothing has to explain; a kind of move of which there
    is hardly more than that is left out; of the others a share may be a little below 0.

    Args:
        measured: moves.
        predicted: moves.
        noise: mean square of what noise makes of each kind of move; none by default.
        any_side: whether the sensor may be turned by any angle.
    """
    pairs = {name: (measured[name], predicted[name]) for name in ("turn", "distance") if name in measured}
    swing = None
    if "forward" in measured:
        moved, rolled = (one["forward"] + 1j * one["left"] for one in (measured, predicted))
        pairs["distance"], swing = (moved, rolled), np.exp(1j * measured["turn"]) - 1
    found: dict[str, float] = {}
    for name, (truth, guess) in pairs.items():
        own = 0.0 if noise is None else noise[name]
        size = float(np.mean(np.abs(truth) ** 2)) if len(truth) else 0.0
        if _any(truth) and size > BEYOND * own:
            swung = swing if name == "distance" else None
            rest = _left(truth, guess, swung, any_side=any_side and swung is not None)
            found[name] = (rest - own) / (size - own)
    return found


def _left(truth: Moved, guess: Moved, swing: Moved | None = None, *, any_side: bool = False) -> float:
    # Mean square left of truth by guess times a factor and, of a sensor off the origin, its swing.
    rest, own = (truth, guess) if swing is None else _without(swing, truth, guess)
    factor = complex(np.vdot(own, rest)) / float(np.vdot(own, own).real) if _any(own) else 0j
    believed = factor.real > 0 or (any_side and factor != 0)
    along = factor / abs(factor) if believed else 1.0
    factor = along * float(np.clip(abs(factor) if believed else 0.0, *GAINS))
    return float(np.mean(np.abs(rest - factor * own) ** 2))


def _without(swing: Moved, *moves: Moved) -> tuple[Moved, ...]:
    # Moves with what a sensor off the origin adds by swinging around it taken out.
    if not _any(swing):
        return moves
    return tuple(one - swing * (np.vdot(swing, one) / np.vdot(swing, swing)) for one in moves)


def _any(moves: Moved) -> bool:
    # Whether there is any motion, of which less than counts at all is none: its squares are no numbers.
    return float(np.abs(moves).max(initial=0.0)) > SMALLEST


def _with_jumps(layout: SegmentLayout) -> Bools:
    # Moves in which the poses jump, as those of a tracker that found the robot elsewhere.
    found = np.zeros(layout.count, dtype=bool)
    for number, log in enumerate(layout.logs):
        own = layout.owner == number
        after = np.cumsum(np.append(False, jumps(log)))
        first, last = (np.searchsorted(log.pose_times, layout.times[own][:, end]) for end in (0, -1))
        found[own] = after[first] != after[last]
    return found


def clock_offsets(moves: Moves) -> Array:
    """What the inputs' clocks show when the poses' show 0, (clocks,) [s]; 0 where no motion shows it."""
    clock, clocks = moves.layout.clock, len(moves.layout.clocks)
    counts = np.bincount(clock, minlength=clocks)
    # Where about they are shows in some of each clock's moves.
    number = np.arange(moves.layout.count) - np.searchsorted(clock, clock)
    some = moves.within(number % (1 + counts // SOME)[clock] == 0)
    steps = np.arange(-REACH, REACH + COARSE / 2, COARSE)
    coarse = steps[:, None] * np.ones(clocks)
    best = _best(coarse, _left_by_clocks(some, coarse))
    tried = np.vstack([np.zeros(clocks), best + np.arange(-COARSE, COARSE + FINE / 2, FINE)[:, None]])
    left = _left_by_clocks(moves, tried)
    best, least = _best(tried[1:], left[1:]), left[1:].min(axis=0)
    return np.where((least < CLEAR * left[0]) & (counts >= FEWEST), best, 0.0)


def _best(tried: Array, left: Array) -> Array:
    # Of offsets (tries, clocks) those that leave least.
    return np.asarray(np.take_along_axis(tried, left.argmin(axis=0)[None], axis=0)[0])


def _left_by_clocks(moves: Moves, tried: Array) -> Array:
    # What offsets (tries, clocks) leave of each clock's moves unexplained, alike; all clocks at a time.
    measured, clock = moves.measured(), moves.layout.clock
    found = np.ones(tried.shape)
    for row, offsets in enumerate(tried):
        predicted = replace(moves, offsets=offsets).predicted()
        for place in range(len(offsets)):
            both = ({name: one[clock == place] for name, one in own.items()} for own in (measured, predicted))
            shares = unexplained(*both)
            found[row, place] = np.prod([max(share, 1e-9) for share in shares.values()])
    return found
