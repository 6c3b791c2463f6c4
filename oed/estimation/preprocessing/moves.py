"""Short moves of a log, measured and predicted: what clocks, swapped wheels and wrong signs show in.

How far the clocks of wheels and poses are apart follows from them, as a first guess.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from oed.estimation.prediction.layout import SegmentLayout, cut
from oed.estimation.prediction.logged_readings import further_starts
from oed.estimation.prediction.segments import Driven, SegmentReadings
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
CLEAR = 0.9
"""An offset is taken for real where it leaves at most this share of what no offset leaves unexplained."""


@dataclass(frozen=True)
class Moves:
    """Moves of logs, one after the other.

    Attributes:
        robot: at its nominal parameters.
        layout: every move a segment.
        offsets: of the clocks, (clocks,) [s].
    """

    robot: Model
    layout: SegmentLayout
    offsets: Array

    @classmethod
    def of(cls, robot: Model, logs: Sequence[Log]) -> Moves:
        """The moves of logs, whose clocks agree; positions and headings alone matter."""
        step = max(float(np.median(np.diff(log.pose_times))) for log in logs)
        layout = cut(logs, max(MOVE, 2 * step), [0.0] * len(logs))
        return cls(robot, layout, np.zeros(len(layout.clocks)))

    @cached_property
    def inputs(self) -> Array:
        """As they were logged, (S, n, inputs)."""
        return self.layout.inputs(self.offsets)

    def predicted(self, inputs: Array | None = None) -> dict[str, Array]:
        """What can be compared of `rolled` with the measured moves."""
        rolled, quantities = self.rolled(inputs), self.layout.quantities
        if "heading" in quantities:
            return rolled if "x" in quantities else {"turn": rolled["turn"]}
        return {"distance": np.hypot(rolled["forward"], rolled["left"])}

    def rolled(self, inputs: Array | None = None) -> dict[str, Array]:
        """Each move by the wheels, with logged inputs or others: forward, to the left [m], turn [rad]."""
        layout = self.layout
        chosen = self.inputs if inputs is None else inputs
        readings = SegmentReadings.logged(self.robot, ("x", "y", "heading"), layout.count, layout.periods)
        nominal, place = np.array(self.robot.nominal), np.zeros(len(PLACE))
        further = further_starts(self.robot, layout, self.offsets, nominal, inputs)
        starts = np.pad(further, ((0, 0), (3, 0)))
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
    measured: dict[str, Array], predicted: dict[str, Array], *, any_side: bool = False
) -> dict[str, float]:
    """Share of what is measured that a prediction times its best factor leaves, by kind of move.

    The factor lies within `GAINS`: nominal parameters are never right, but of the right sign. Moves ahead
    and to the left are those of a sensor anywhere on the robot, turned by less than a right angle; with
    `any_side` by any angle.

    Args:
        measured: moves.
        predicted: moves.
        any_side: whether the sensor may be turned by any angle.
    """
    found: dict[str, float] = {}
    for name in ("turn", "distance"):
        if name in measured and _any(measured[name]):
            found[name] = _left(measured[name], predicted[name])
    if "forward" in measured and _any(measured["forward"] + 1j * measured["left"]):
        moved, rolled = (one["forward"] + 1j * one["left"] for one in (measured, predicted))
        found["distance"] = _left(moved, rolled, np.exp(1j * measured["turn"]) - 1, any_side=any_side)
    return found


def _left(truth: Moved, guess: Moved, swing: Moved | None = None, *, any_side: bool = False) -> float:
    # Least squares of truth by guess times a factor and, of a sensor off the origin, by its swing.
    rest, own = (truth, guess) if swing is None else _without(swing, truth, guess)
    factor = complex(np.vdot(own, rest)) / float(np.vdot(own, own).real) if _any(own) else 0j
    believed = factor.real > 0 or (any_side and factor != 0)
    along = factor / abs(factor) if believed else 1.0
    factor = along * float(np.clip(abs(factor) if believed else 0.0, *GAINS))
    return float((np.abs(rest - factor * own) ** 2).sum() / (np.abs(truth) ** 2).sum())


def _without(swing: Moved, *moves: Moved) -> tuple[Moved, ...]:
    # Moves with what a sensor off the origin adds by swinging around it taken out.
    if not _any(swing):
        return moves
    return tuple(one - swing * (np.vdot(swing, one) / np.vdot(swing, swing)) for one in moves)


def _any(moves: Moved) -> bool:
    # Whether there is any motion, of which less than counts at all is none: its squares are no numbers.
    return float(np.abs(moves).max(initial=0.0)) > SMALLEST


def clock_offsets(moves: Moves) -> Array:
    """What the inputs' clocks show when the poses' show 0, (clocks,) [s]; 0 where no motion shows it."""
    layout = moves.layout
    return np.array([_offset(moves.within(layout.clock == clock)) for clock in range(len(layout.clocks))])


def _offset(moves: Moves) -> float:
    if moves.layout.count < FEWEST:
        return 0.0
    measured, clocks = moves.measured(), len(moves.layout.clocks)

    def left(offset: float) -> float:
        shares = unexplained(measured, replace(moves, offsets=np.full(clocks, offset)).predicted())
        return float(np.prod([max(share, 1e-9) for share in shares.values()])) if shares else 1.0

    coarse = np.arange(-REACH, REACH + COARSE / 2, COARSE)
    best = min(coarse, key=left)
    fine = best + np.arange(-COARSE, COARSE + FINE / 2, FINE)
    best = min(fine, key=left)
    return float(best) if left(best) < CLEAR * left(0.0) else 0.0
