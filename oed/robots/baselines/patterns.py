"""The baselines as lists of moves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

FULL_TURN = 2 * math.pi
RIGHT_ANGLE = FULL_TURN / 4
SLALOM_ANGLE = FULL_TURN / 12
"""Heading [rad] at which a slalom crosses its middle line, where the robot can turn so tightly."""


@dataclass(frozen=True)
class Move:
    """One move from rest to rest with a constant ratio of its speeds.

    Attributes:
        forward: distance along the robot [m], backwards negative.
        turn: change of heading [rad], to the left positive.
        sideways: distance across the robot [m], to the left positive.
    """

    forward: float
    turn: float
    sideways: float = 0.0

    @property
    def in_place(self) -> bool:
        """Whether the robot's origin stays where it is."""
        return self.forward == 0 and self.sideways == 0


Pattern = Callable[[float, int], list[Move]]
"""The moves of one lap: its size [m] and its number, from 0."""


def straight(size: float, lap: int) -> list[Move]:
    """There; on the next lap, back."""
    return [Move(-size if lap % 2 else size, 0.0)]


def circle(size: float, lap: int) -> list[Move]:
    """A full circle of diameter `size`, to the left."""
    return [Move(math.pi * size, FULL_TURN)]


def square(size: float, lap: int) -> list[Move]:
    """A square in both directions, spinning at the corners [Borenstein and Feng, UMBmark, 1995]."""
    left = [Move(size, 0.0), Move(0.0, RIGHT_ANGLE)] * 4
    right = [Move(size, 0.0), Move(0.0, -RIGHT_ANGLE)] * 4
    return left + right


def square_over_again(size: float, lap: int) -> list[Move]:
    """A square in both directions with a quarter turn between, so that both rounds have the same corners."""
    both = square(size, lap)
    return [*both[:8], Move(0.0, RIGHT_ANGLE), *both[8:], Move(0.0, -RIGHT_ANGLE)]


def square_one_way(size: float, lap: int) -> list[Move]:
    """A square to the left, spinning at the corners."""
    return square(size, lap)[:8]


def rounded_square(size: float, lap: int, tightest: float = 0.0) -> list[Move]:
    """A square of width `size` in both directions whose corners are quarter circles.

    Their radius is size / 4, or the tightest that the robot can drive where that is larger.

    Args:
        size: of the pattern [m].
        lap: its number, from 0.
        tightest: radius [m] of the tightest arc that the robot can drive.
    """
    return [*_rounded(size, tightest, RIGHT_ANGLE), *_rounded(size, tightest, -RIGHT_ANGLE)]


def rounded_one_way(size: float, lap: int, tightest: float = 0.0) -> list[Move]:
    """A rounded square to the left.

    Args:
        size: of the pattern [m].
        lap: its number, from 0.
        tightest: radius [m] of the tightest arc that the robot can drive.
    """
    return _rounded(size, tightest, RIGHT_ANGLE)


def _rounded(size: float, tightest: float, corner: float) -> list[Move]:
    # Once round, from the middle of a side.
    radius = min(max(size / 4, tightest), size / 2)
    side, arc = Move(size - 2 * radius, 0.0), Move(RIGHT_ANGLE * radius, corner)
    half = Move(side.forward / 2, 0.0)
    moves = [half, arc, side, arc, side, arc, side, arc, half]
    return [one for one in moves if one.forward > 0]


def figure_eight(size: float, lap: int) -> list[Move]:
    """A circle to the left, then one to the right, of diameter `size` each."""
    return [Move(math.pi * size, FULL_TURN), Move(math.pi * size, -FULL_TURN)]


def slalom(size: float, lap: int, tightest: float = 0.0) -> list[Move]:
    """A bend to the left of a line, then one to its right, of overall length `size`; next lap, back.

    All arcs have the same radius, `tightest` at least, and the heading ends as it began.

    Args:
        size: of the pattern [m].
        lap: its number, from 0.
        tightest: radius [m] of the tightest arc that the robot can drive.
    """
    radius = max(size / (8 * math.sin(SLALOM_ANGLE)), tightest)
    angles = [math.asin(size / (8 * radius)) * turn for turn in (1, -2, 1, -1, 2, -1)]
    arcs = [Move(radius * abs(angle), angle) for angle in angles]
    return [Move(-arc.forward, -arc.turn) for arc in reversed(arcs)] if lap % 2 else arcs


def straight_and_spin(size: float, lap: int) -> list[Move]:
    """There, a full turn in place, back, and the turn undone."""
    return [Move(size, 0.0), Move(0.0, FULL_TURN), Move(-size, 0.0), Move(0.0, -FULL_TURN)]


def sideways_straight(size: float, lap: int) -> list[Move]:
    """To the left without turning; on the next lap, back."""
    return [Move(0.0, 0.0, -size if lap % 2 else size)]


def sideways_square(size: float, lap: int) -> list[Move]:
    """A square without turning: forward, left, back, right; then the other way round."""
    forward, left = Move(size, 0.0), Move(0.0, 0.0, size)
    back, right = Move(-size, 0.0), Move(0.0, 0.0, -size)
    return [forward, left, back, right, left, forward, right, back]


PATTERNS: dict[str, Pattern] = {
    one.__name__: one
    for one in (
        straight,
        circle,
        square,
        rounded_square,
        figure_eight,
        slalom,
        straight_and_spin,
        sideways_straight,
        sideways_square,
    )
}
"""The patterns by the names that studies call them; a new one is a function above and its name here."""
ONE_WAY: dict[str, Pattern] = {"square": square_one_way, "rounded_square": rounded_one_way}
"""What goes both ways, to the left alone: where time or room is short, and in runs that take turns."""
BENT: dict[Pattern, Callable[..., list[Move]]] = {
    one: one for one in (rounded_square, rounded_one_way, slalom)
}
"""Those whose arcs are as wide as the robot's tightest ones at least, whose radius is asked for then."""
VARIANTS: dict[str, tuple[Pattern, ...]] = {"square": (square_over_again,)}
"""Other ways to drive a pattern, of which the best counts."""
RANDOM = "random"
"""Name of the baseline that is no pattern."""
NAMES: tuple[str, ...] = (*PATTERNS, RANDOM)
"""What a study may call a baseline."""
if TYPE_CHECKING:
    BaselineName = str
else:
    BaselineName = Literal[NAMES]
