"""The smallest eigenvalue of what headings say, by dynamic programming over segments, within the room.

With u and d half the sum and half the difference of both inputs' angles in a segment, lambda_min is at most
share * 2 sum u^2 + (1 - share) * 2 sum d^2 for any share. Segments are of two kinds: ways, in which the way
that is driven has a sign and both inputs have it, and turns, in which they have different ones. Of drives
alike in the number of ways, the kind that is first and how often kinds alternate, the largest of that sum is
found for several shares; the least of these bounds them.

The room limits ways. Let g = p'T be how far the robot is from the middle of the room in the direction that it
faces, h the room's half diagonal. Then g' = v + Omega p'N, and a way of length L in a segment, with
|v| + b |Omega| <= V at any time, takes g forward by at least L - h (integral V - L)/b, while -h <= g <= h.
So few ways follow each other before the robot has to turn. Where ways begin, g is at least minus the distance
to the middle, which grows by what is driven. All that is in ranges is taken at the end that allows more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from oed.bounds.reversals import Reversals, Segment, most_squares
from oed.foundation.arrays import Array

PLACES = 24
"""Ranges of g."""
FINER = 4
"""Ranges of the distance to the middle in one of these."""
ALTERNATIONS = 4
"""Times that kinds alternate that are kept apart: so many, and more."""


@dataclass(frozen=True)
class Course:
    """What limits headings.

    Attributes:
        reach: largest speed of each input in every period, (N, 2).
        steps: largest change of each from a period to the next, (2,).
        edges: periods at which segments begin, and N, (P + 1,).
        forward: forward speed by the inputs, of one sign, (2,).
        turn: yaw rate by the inputs, of different signs, (2,).
        weights: that angles count with, (2,).
        arm: b, of |v| + b |Omega| <= the largest speed.
        half: h, half the room's diagonal.
        start: distance of the start from the middle of the room, at most h.
        period: [s].
    """

    reach: Array
    steps: Array
    edges: Sequence[int]
    forward: Array
    turn: Array
    weights: Array
    arm: float
    half: float
    start: float
    period: float

    @property
    def count(self) -> int:
        """Segments P."""
        return len(self.edges) - 1

    @cached_property
    def reversals(self) -> Reversals:
        """What may happen between segments."""
        return Reversals.of(self.reach.max(axis=0))

    @cached_property
    def segments(self) -> list[tuple[bytes, Segment]]:
        """What is possible in each, and what it follows from: those that are alike have it in common."""
        known: dict[bytes, Segment] = {}
        found = []
        for begin, end in zip(self.edges[:-1], self.edges[1:], strict=True):
            own = self.reach[begin:end]
            key = own.tobytes()
            if key not in known:
                known[key] = Segment.of(self.reversals, own, self.steps, self.forward, self.period)
            found.append((key, known[key]))
        return found

    def freely(self, share: float) -> Array:
        """The most that each segment is worth as a way and as a turn, whatever is around it, (P, 2)."""
        angles = np.array([one.angles[:, 0, 0] for _, one in self.segments]).T
        unlimited = np.full(self.count, np.inf)
        each = [most_squares(angles, self.weights, np.ones(2), unlimited, share, sign) for sign in (1, -1)]
        return np.asarray(np.stack(each, axis=1))

    def roughly(self, shares: Sequence[float]) -> Array:
        """The most that all segments are worth by the number of ways, (P + 1,): the least of all shares."""
        return np.asarray(np.min([_chosen(self.freely(share)) for share in shares], axis=0))


def _chosen(worth: Array) -> Array:
    # The best segments are ways.
    gains = np.sort(worth[:, 0] - worth[:, 1])[::-1]
    return np.asarray(worth[:, 1].sum() + np.concatenate([[0.0], np.cumsum(gains)]))


@dataclass
class Worth:
    """What segments alike are worth, for one share.

    Attributes:
        course: what limits headings.
        segment: what is possible.
        share: of u^2.
    """

    course: Course
    segment: Segment
    share: float
    _entries: dict[int, Array] = field(default_factory=dict)

    @property
    def _rate(self) -> float:
        return self.course.half / self.course.arm

    @cached_property
    def _ahead(self) -> Array:
        # The largest g of every range.
        return np.asarray(self.course.half * (2 * np.arange(1, PLACES + 1) / PLACES - 1))

    @cached_property
    def turns(self) -> Array:
        """As a turn that adds so many ranges to the distance to the middle, (A, A, J)."""
        course, fine = self.course, _fine(self.course)
        driven = np.maximum(0.0, (np.arange(_distances()) - 1) * fine)
        most = (self.segment.ways[-1] - driven) / course.arm
        slopes = np.abs(course.turn)
        found = most_squares(self.segment.angles, course.weights, slopes, most[:, None, None], self.share, -1)
        return _places_last(found)

    @cached_property
    def ways(self) -> Array:
        """As a way from a range of g to another, (PLACES, A, A, PLACES)."""
        begun = self._ahead - 2 * self.course.half / PLACES
        length = (self._ahead - begun[:, None] + self._rate * self.segment.ways[-1]) / (1 + self._rate)
        ended = np.array([self._until(value) for value in begun])
        return self._way(np.minimum(length[:, :, None, None], ended[:, None, None, :]))

    def entry(self, place: int) -> Array:
        """As the first way from so many ranges of distance to the middle, to a range of g, (A, A, PLACES)."""
        if place not in self._entries:
            half, ways = self.course.half, self.segment.ways
            away = min(place * _fine(self.course), half)
            # Of any number of first periods: what is driven there, and from there on within the room.
            begun = np.minimum(half, away + ways[:-1])
            rest = (self._ahead[:, None] + begun + self._rate * (ways[-1] - ways[:-1])) / (1 + self._rate)
            length = np.min(self.segment.first[:-1] + rest[:, :, None], axis=1)
            self._entries[place] = self._way(np.minimum(length[:, :, None], self._until(-away)))
        return self._entries[place]

    def _until(self, begun: float) -> Array:
        # The longest way, by what happens at its end: within the room before any number of last periods.
        most = self.course.half - begun + self._rate * self.segment.ways[::-1]
        return np.asarray(np.min(most[:-1, None] / (1 + self._rate) + self.segment.last[:-1], axis=0))

    def _way(self, most: Array) -> Array:
        slopes = np.abs(self.course.forward)
        return _places_last(
            most_squares(self.segment.angles, self.course.weights, slopes, most, self.share, 1)
        )


def _places_last(worth: Array) -> Array:
    # (..., places, A, A) to (..., A, A, places), side by side as they are read.
    return np.ascontiguousarray(np.moveaxis(worth, -3, -1))


def _fine(course: Course) -> float:
    return 2 * course.half / (PLACES * FINER)


def _distances() -> int:
    return PLACES // 2 * FINER + 1


class Classes:
    """Drives by the kind of their first segment and by how often kinds alternate; of one number of ways.

    Values are arrays over these classes, the number of ways so far, what happened at the last boundary, and
    the range of g, or of the distance to the middle.
    """

    count = 2 * (ALTERNATIONS + 1)

    def __init__(self, course: Course, ways: int, share: float, floor: float) -> None:
        """Drives with so many ways.

        Args:
            course: what limits headings.
            ways: how many there are.
            share: of u^2.
            floor: worth of a drive that is not of interest.
        """
        self.course, self.ways_in_all, self.floor = course, ways, floor
        self.worths, known = list[Worth](), dict[tuple[bytes, bool, bool], Worth]()
        for at, (key, one) in enumerate(course.segments):
            first, last = at == 0, at == course.count - 1
            if (key, first, last) not in known:
                known[key, first, last] = Worth(course, one.of_a_drive(first, last), share)
            self.worths.append(known[key, first, last])
        best = course.freely(share).max(axis=1)
        self.rest = np.append(np.cumsum(best[::-1])[::-1], 0.0)
        self.alternating = course.reversals.changed.sum(axis=1) == 1
        self.turned_back = course.reversals.changed.all(axis=1)

    def largest(self) -> Array:
        """The most that drives of every class are worth, or `floor`, (classes,)."""
        ways, turns, entries = (self._nothing(one, 1) for one in (PLACES, _distances(), _distances()))
        place = int(np.ceil(self.course.start / _fine(self.course) * (1 - 1e-12)))
        entries[0, 0, 0, min(place, _distances() - 1)] = turns[1, 0, 0, min(place, _distances() - 1)] = 0.0
        for at, worth in enumerate(self.worths):
            near, far = self._after_ways(worth, ways, entries)
            turned = self._after_turns(worth, turns)
            for one in (near, far, turned):
                one[one + self.rest[at + 1] <= self.floor] = -np.inf
                # Too few ways for those that are left to make up for it.
                one[:, : max(self.ways_in_all - (self.course.count - at - 1), 0)] = -np.inf
            if at + 1 < self.course.count:
                ways, turns, entries = self._alternated(worth, near, far, turned)
        found = np.stack([one[:, self.ways_in_all, 0].max(axis=1) for one in (near, far, turned)])
        return np.asarray(np.maximum(found.max(axis=0), self.floor))

    def _nothing(self, places: int, happens: int) -> Array:
        # By places and what may happen at a boundary.
        shape = self.count, self.ways_in_all + 1, happens, places
        return np.full(shape, -np.inf)

    def _near(self, worth: Worth) -> int:
        # Ranges of the distance to the middle that a first way from there ends within.
        return int(np.ceil(worth.segment.ways[-1] / _fine(self.course))) + 1

    def _after_ways(self, worth: Worth, ways: Array, entries: Array) -> tuple[Array, Array]:
        # After a first way from near the middle, and after any other.
        near, far = (self._nothing(PLACES, worth.segment.last.shape[1]) for _ in range(2))
        for number in range(self.ways_in_all):
            for place in np.flatnonzero(np.isfinite(entries[:, number]).any(axis=(0, 1))):
                target = near if place <= 1 else far
                _spread(target[:, number + 1], entries[:, number, :, place], worth.entry(int(place)))
            for place in np.flatnonzero(np.isfinite(ways[:, number]).any(axis=(0, 1))):
                _spread(far[:, number + 1], ways[:, number, :, place], worth.ways[place])
        return near, far

    def _after_turns(self, worth: Worth, turns: Array) -> Array:
        last = _distances() - 1
        found = self._nothing(last + 1, worth.segment.last.shape[1])
        for number in range(self.ways_in_all + 1):
            for place in np.flatnonzero(np.isfinite(turns[:, number]).any(axis=(0, 1))):
                _spread(
                    found[:, number, :, place:],
                    turns[:, number, :, place],
                    worth.turns[..., : last + 1 - place],
                )
        return found

    def _alternated(self, worth: Worth, near: Array, far: Array, turned: Array) -> tuple[Array, Array, Array]:
        ways, turns, entries = (np.full_like(one, -np.inf) for one in (far, turned, turned))
        both = np.maximum(near, far)
        ways[:, :, 0], turns[:, :, 0] = both[:, :, 0], turned[:, :, 0]
        # Back the way it came: g changes its sign.
        ways[:, :, self.turned_back] = both[:, :, self.turned_back][..., ::-1]
        turns[:, :, self.turned_back] = turned[:, :, self.turned_back]
        within = min(self._near(worth), _distances() - 1)
        for first in (0, 1):
            for times in range(ALTERNATIONS + 1):
                own, onward = 2 * times + first, 2 * min(times + 1, ALTERNATIONS) + first
                for source, place in ((far, _distances() - 1), (near, within)):
                    now = source[own].max(axis=2)[:, self.alternating]
                    held = turns[onward, :, :, place]
                    held[:, self.alternating] = np.maximum(held[:, self.alternating], now)
                held = entries[onward]
                held[:, self.alternating] = np.maximum(
                    held[:, self.alternating], turned[own][:, self.alternating]
                )
        return ways, turns, entries


def _spread(into: Array, source: Array, worth: Array) -> None:
    # into (classes, A, places) at least source (classes, A) and worth (A, A, places) from there.
    classes = np.flatnonzero(np.isfinite(source).any(axis=1))
    best = into[classes]
    for begun in np.flatnonzero(np.isfinite(source).any(axis=0)):
        np.maximum(best, source[classes, begun, None, None] + worth[begun], out=best)
    into[classes] = best
