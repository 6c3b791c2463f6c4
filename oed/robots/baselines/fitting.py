"""Families of drives of one form: the largest that satisfies the limits, and the one of a given length."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from oed.foundation.errors import NotFinite
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.kernel.scorer import limits_exceeded, score
from oed.robots.limits.workspace import Area

BISECTIONS = 20
"""Halvings between two sizes: to a millionth of their difference."""
REFINEMENTS = 12
"""Halvings of the largest size that fits: to 2e-4 of the step between sizes scanned."""
COARSE = 5
"""The same while laps and places are compared: to one in a hundred."""
FALLING = 2
"""Numbers of laps in a row that are worse than the best after which more are not tried."""
TIME_PRECISION = 1e-6
"""Share of the largest size that the duration allows which that is missed by."""
SCANNED = 24
"""Sizes scanned close together, a quarter apart: a room's narrow passages allow sizes in between."""
SCANNED_RATIO = 200.0
"""The largest over the smallest of these: below, a path is a two-hundredth of the room."""
SCANNED_STEP = SCANNED_RATIO ** (1 / (SCANNED - 1))
"""Ratio of each of these to the next."""
TAIL = 5
"""Further sizes below those, for limits that allow small ones only."""
TAIL_RATIO = 4.0
"""Ratio of each of these to the next."""
SMALLEST = SCANNED_RATIO * TAIL_RATIO**TAIL
"""The largest size over the smallest that is tried."""
SHRUNK, MOST_SHRUNK = 2e-4, 0.05
"""Share by which a size is made smaller at first where finer integration steps see a limit exceeded; it is
doubled each time, up to the other one.
"""
CONFIRMED = 3
"""Halvings of the last of these steps."""
MOST_LAPS = 50
"""Laps of a path of given length at most; each costs samples to stop and start."""
PROPORTIONAL_STEPS = 8
"""Steps of the size in proportion to the length, which converge at once for most patterns."""
EXACT = 1e-9
"""Share of a limit's size by which a baseline may exceed it."""
LENGTH_PRECISION = 1e-6
"""Share of a length that is missed at most by these."""


@dataclass(frozen=True)
class Shape:
    """A family of drives of one form: `drive(size, laps)`.

    Attributes:
        drive: of a size, in m for a pattern.
        largest: size beyond which none fits.
        smallest: size below which the robot could not turn so tightly.
        fits: whether the samples suffice for that many laps.
        seconds: least time [s] that a drive of a size and number of laps takes.
        words: what is driven of a size and number of laps.
    """

    drive: Callable[[float, int], Trajectory]
    largest: float
    smallest: float
    fits: Callable[[int], bool]
    seconds: Callable[[float, int], float]
    words: Callable[[float, int], str]


def chosen(problem: Problem, shapes: Sequence[Shape], most: int) -> tuple[Shape, int, float]:
    """The family and the number of laps whose largest drive has the largest objective, and a size [m] that
    this drive does not exceed.

    Args:
        problem: that the drives are made for.
        shapes: families of drives, the simplest first.
        most: laps at most.
    """
    best: _Found | None = None
    for shape in shapes:
        below, falling, laps = math.inf, 0, 1
        while laps <= most and falling < FALLING and below > 0:
            found = _tried(problem, shape, laps, below)
            better = found is not None and (best is None or found.worth > best.worth)
            best, falling = (found, 0) if better else (best, falling + 1)
            below, laps = 0.0 if found is None else found.size, 2 * laps
    if best is None:
        return shapes[0], 1, math.inf
    for laps in (3 * best.laps // 4, 3 * best.laps // 2):
        found = _tried(problem, best.shape, laps, math.inf) if 0 < laps <= most else None
        best = found if found is not None and found.worth > best.worth else best
    return best.shape, best.laps, SCANNED_STEP * best.size


@dataclass(frozen=True)
class _Found:
    # The largest drive of a number of laps, roughly, and its worth: of drives that say nothing, the length.
    shape: Shape
    laps: int
    size: float
    worth: tuple[float, float]


def _tried(problem: Problem, shape: Shape, laps: int, below: float) -> _Found | None:
    if not shape.fits(laps):
        return None
    size = largest_size(problem, shape, laps, below=below, halvings=COARSE)
    if size is None:
        return None
    try:
        evaluation = score(problem, shape.drive(size, laps))
    except NotFinite:
        return None
    return _Found(shape, laps, size, (evaluation.objective, evaluation.path_length))


def largest(problem: Problem, shape: Shape, laps: int = 1, *, below: float = math.inf) -> float:
    """The largest size that satisfies every limit [m]; where none does, a small one: its violations say why.

    Args:
        problem: with the limits.
        shape: the family of drives.
        laps: how many.
        below: size [m] that is not exceeded.
    """
    size = largest_size(problem, shape, laps, below=below)
    return max(shape.largest / 4, shape.smallest) if size is None else size


def largest_by_coarse_steps(
    exact: Problem, coarse: Problem, shape: Shape, laps: int, *, below: float
) -> float:
    """The largest size [m] as by `largest`, looked for with coarser integration steps.

    It is made a little smaller where finer ones see a limit exceeded.

    Args:
        exact: with the limits, and steps by which the drive satisfies them.
        coarse: the same with coarser steps.
        shape: the family of drives.
        laps: how many.
        below: size [m] that is not exceeded.
    """
    size, share = largest(coarse, shape, laps, below=below), SHRUNK
    if exact is coarse or not _exceeded(exact, shape.drive(size, laps)):
        return size
    while share <= MOST_SHRUNK:
        too_large, size, share = size, (1 - share) * size, 2 * share
        if not _exceeded(exact, shape.drive(size, laps)):
            return _between_sizes(exact, shape, laps, size, too_large)
    return largest(exact, shape, laps, below=below)


def _between_sizes(problem: Problem, shape: Shape, laps: int, low: float, high: float) -> float:
    # The largest size that satisfies the limits, between one that does and one that does not.
    for _ in range(CONFIRMED):
        middle = (low + high) / 2
        low, high = (low, middle) if _exceeded(problem, shape.drive(middle, laps)) else (middle, high)
    return low


def largest_size(
    problem: Problem, shape: Shape, laps: int, *, below: float = math.inf, halvings: int = REFINEMENTS
) -> float | None:
    """The largest size [m] that satisfies every limit; None where none does.

    Args:
        problem: with the limits.
        shape: the family of drives.
        laps: how many.
        below: size [m] that is not exceeded.
        halvings: of the step between the sizes scanned.
    """

    @cache
    def exceeded(size: float) -> frozenset[str]:
        return _exceeded(problem, shape.drive(size, laps))

    # Hurried drives exceed their limits of speed and acceleration: they need not be scored to know it.
    most = _in_time(problem, shape, laps, min(shape.largest, below))
    room = frozenset(limit.name for limit in problem.limits if isinstance(limit, Area))
    found = None if most is None else _scanned(exceeded, _sizes(most, shape.smallest), room)
    if found is None:
        return None
    low, high = found
    for _ in range(halvings if low < high else 0):
        middle = (low + high) / 2
        low, high = (low, middle) if exceeded(middle) else (middle, high)
    return low


def _in_time(problem: Problem, shape: Shape, laps: int, most: float) -> float | None:
    # The largest size that the duration allows; None where none does.
    from scipy.optimize import brentq

    duration, low, high = problem.design.duration, max(most / SMALLEST, shape.smallest), most
    if low > high:
        return None
    if shape.seconds(high, laps) <= duration:
        return most
    if shape.seconds(low, laps) > duration:
        return None
    # On a step of whole periods the drive is as long as it may be: the step's end is sought.
    late = duration * (1 + TIME_PRECISION**2)
    found = brentq(lambda size: shape.seconds(size, laps) - late, low, high, rtol=TIME_PRECISION)
    return max(float(found) * (1 - TIME_PRECISION), low)


def _scanned(
    exceeded: Callable[[float], frozenset[str]], sizes: Sequence[float], room: frozenset[str]
) -> tuple[float, float] | None:
    # A size that satisfies the limits and the next larger one that does not (or the same, for the largest of
    # all). A limit of turning forbids small sizes, so that the sizes that fit are an interval.
    above = exceeded(sizes[0])
    if not above:
        return sizes[0], sizes[0]

    # What is too fast is so at every larger size; a room's passages may allow some sizes in between.
    def slow(size: float) -> bool:
        return not exceeded(size) & (above - room)

    low, high = 1, 2
    while high < len(sizes) and not slow(sizes[high - 1]):
        low, high = high, 2 * high
    first = bisect_left(sizes, True, lo=low, hi=min(high, len(sizes)), key=slow)
    for larger, smaller in pairwise(sizes[first - 1 :]):
        known = exceeded(smaller), exceeded(larger)
        if not known[0]:
            return smaller, larger
        found = _between(exceeded, smaller, larger, known)
        if found is not None:
            return found
    return None


def _sizes(most: float, least: float) -> list[float]:
    # From the largest down: close together at first, then far apart.
    close = most * SCANNED_RATIO ** -np.linspace(0.0, 1.0, SCANNED)
    far = most / SCANNED_RATIO / TAIL_RATIO ** np.arange(1, TAIL + 1)
    sizes = [float(size) for size in (*close, *far) if size > least]
    return [*sizes, least] if 0 < least <= most else sizes


def _between(
    exceeded: Callable[[float], frozenset[str]],
    low: float,
    high: float,
    known: tuple[frozenset[str], frozenset[str]],
) -> tuple[float, float] | None:
    # The same between two sizes one of which is too small and the other too large, by different limits.
    too_small, too_large = known
    for _ in range(0 if too_small & too_large else BISECTIONS):
        middle = (low + high) / 2
        found = exceeded(middle)
        if not found:
            return middle, high
        if found & too_small and found & too_large:
            return None
        low, high = (low, middle) if found & too_large else (middle, high)
    return None


def _exceeded(problem: Problem, trajectory: Trajectory) -> frozenset[str]:
    # Without the tolerance of `feasible`, which a bisection would use up.
    try:
        return limits_exceeded(problem, trajectory, EXACT)
    except NotFinite as error:
        return frozenset(map(str, error.issue.key))


def of_length(problem: Problem, shape: Shape, length: float, most: float) -> tuple[float, int]:
    """The size [m] that gives a length, and the laps: as few as the largest size, of length `most`, needs.

    Args:
        problem: that the drive is made for.
        shape: the family of drives.
        length: of the drive [m].
        most: length of the largest size with one lap [m].
    """
    needed = min(MOST_LAPS, max(1, math.ceil(length / most - 1e-5))) if most > 0 else 1
    laps = next((laps for laps in range(needed, 1, -1) if shape.fits(laps)), 1)

    def reached(size: float) -> float:
        try:
            return score(problem.unlimited, shape.drive(size, laps)).path_length
        except NotFinite:
            return 0.0

    # In proportion, as a pattern's length is to its size.
    size = shape.largest
    for _ in range(PROPORTIONAL_STEPS):
        found = reached(size)
        if abs(found - length) <= LENGTH_PRECISION * length:
            return size, laps
        size = min(size * length / found, 1e3 * shape.largest) if found > 0 else shape.largest
    return _bisected(reached, length, shape.largest), laps


def _bisected(reached: Callable[[float], float], length: float, most: float) -> float:
    # The size that reaches a length [m], by halving.
    low, high = 0.0, most
    while reached(high) < length and high < 1e3 * most:
        high *= 2
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if reached(middle) < length else (low, middle)
    return (low + high) / 2
