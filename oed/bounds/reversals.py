"""What two inputs can do in a segment, by the speeds at which they change their signs at its ends.

The sign of an input in a segment is that of its angle, its integral. Between two segments in which it has
different signs it has some speed, which limits its angles on both sides; speeds are taken together in ranges,
and every limit is that of the end of a range that allows more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array, Bools

SINGLE = np.array([*np.arange(0.0, 0.6, 0.04), 0.65, 0.8, 1.0])
"""Ends of the ranges of the speed at which one input changes its sign, as shares of the largest; and of the
other sign. Where a change costs least, they are narrow.
"""
DOUBLE = np.array([0.25, 1.0])
"""The same where both inputs do."""
FREE = np.inf
"""Speed of an input that does not change its sign: any."""
ROUNDING = 1e-12
"""Share of its size by which a corner may exceed the limit that it is on."""
AT_ONCE = 32_000
"""Numbers that are worked on together, few enough to stay close to the processor."""


@dataclass(frozen=True)
class Reversals:
    """What may happen between two segments: no input changes its sign (the first), one, or both.

    Attributes:
        before: what each input can have at most at the end of the segment before, in the sign that it has
            there, (A, 2).
        after: the same at the end of that segment, in the sign that it has in the one after, (A, 2).
        changed: which inputs change their sign, (A, 2).
    """

    before: Array
    after: Array
    changed: Bools

    @classmethod
    def of(cls, largest: Array) -> Reversals:
        """All of two inputs with these largest speeds (2,)."""
        (single_low, single_high), (low, high) = _ranges(SINGLE), _ranges(DOUBLE)
        free = np.full(len(single_low), FREE)
        one, other = np.meshgrid(np.arange(len(low)), np.arange(len(low)), indexing="ij")
        before = np.concatenate(
            [
                [[FREE, FREE]],
                np.column_stack([single_high * largest[0], free]),
                np.column_stack([free, single_high * largest[1]]),
                np.column_stack([high[one.ravel()] * largest[0], high[other.ravel()] * largest[1]]),
            ]
        )
        after = np.concatenate(
            [
                [[FREE, FREE]],
                np.column_stack([-single_low * largest[0], free]),
                np.column_stack([free, -single_low * largest[1]]),
                np.column_stack([-low[one.ravel()] * largest[0], -low[other.ravel()] * largest[1]]),
            ]
        )
        return cls(before, after, np.isfinite(before))


def _ranges(ends: Array) -> tuple[Array, Array]:
    # Of both signs, from the lowest on.
    every = np.unique(np.concatenate([-ends, ends]))
    return every[:-1], every[1:]


@dataclass(frozen=True)
class Segment:
    """What is possible in a segment of m periods.

    Attributes:
        angles: largest angle of each input, by what happens at its beginning and at its end, (2, A, A).
        first: longest way in so many of its first periods, by what happens at its beginning, (m + 1, A).
        last: the same of its last periods, by what happens at its end, (m + 1, A).
        ways: longest way in so many of its first periods, whatever happens, (m + 1,).
    """

    angles: Array
    first: Array
    last: Array
    ways: Array

    @classmethod
    def of(cls, reversals: Reversals, reach: Array, steps: Array, forward: Array, period: float) -> Segment:
        """What is possible under limits.

        Args:
            reversals: what may happen at its ends.
            reach: largest speed of each input in every period, (m, 2).
            steps: largest change of each from a period to the next, (2,).
            forward: forward speed by the inputs, of one sign, (2,).
            period: [s].
        """
        count, speeds = len(reach), np.abs(forward)
        since, until = np.arange(1, count + 1), np.arange(count - 1, -1, -1)
        begun = np.minimum(reach, reversals.after[:, None, :] + since[:, None] * steps)
        ended = np.minimum(reach, reversals.before[:, None, :] + until[:, None] * steps)
        angles = period * np.minimum(begun[:, None], ended[None, :]).sum(axis=2)
        return cls(
            np.maximum(np.moveaxis(angles, 2, 0), 0.0),
            _summed(period * begun @ speeds),
            _summed(period * ended[:, ::-1] @ speeds),
            np.concatenate([[0.0], np.cumsum(period * reach @ speeds)]),
        )

    def of_a_drive(self, first: bool, last: bool) -> Segment:
        """It as the first or the last one of a drive: there no input changes its sign."""
        begins, ends = (slice(1 if alone else None) for alone in (first, last))
        return Segment(self.angles[:, begins, ends], self.first[:, begins], self.last[:, ends], self.ways)


def _summed(ways: Array) -> Array:
    # (A, m) to (m + 1, A): nothing less than no way at all.
    table = np.zeros((ways.shape[1] + 1, len(ways)))
    table[1:] = np.maximum(np.cumsum(ways, axis=1).T, 0.0)
    return table


def most_squares(angles: Array, weights: Array, slopes: Array, most: Array, share: float, sign: int) -> Array:
    """The largest a'M a of angles a between 0 and `angles` with slopes'a at most `most`; minus infinity where
    there are none. It is at a corner, for it is convex.

    M is share (1, sign)(1, sign)'/2 + (1 - share) (1, -sign)(1, -sign)'/2 of the angles times the weights.

    Args:
        angles: the largest ones, (2, ...).
        weights: (2,), at least 0.
        slopes: (2,), above 0.
        most: (...).
        share: from 0 to 1.
        sign: of the product of both angles.
    """
    shape = np.broadcast_shapes(angles[0].shape, most.shape)
    found = np.full(shape, -np.inf)
    # As many at a time as stay close to the processor.
    limits = most.reshape(-1, *most.shape[len(shape) - angles[0].ndim :])
    flat = found.reshape(-1, *angles[0].shape)
    together = max(1, AT_ONCE // angles[0].size)
    for first in range(0, len(limits), together):
        part = limits[first : first + together]
        flat[first : first + together] = _most(angles, weights, slopes, part, share, sign)
    return found


def _most(angles: Array, weights: Array, slopes: Array, most: Array, share: float, sign: int) -> Array:
    one, other = angles
    found = np.full(np.broadcast_shapes(one.shape, most.shape), -np.inf)
    none = np.zeros(())
    allowed = most + ROUNDING * (np.abs(most) + slopes[0] * one + slopes[1] * other)
    # Where the largest angles are allowed, those that are clipped are these.
    for first, second in (
        (one, np.clip((most - slopes[0] * one) / slopes[1], 0.0, other)),
        (np.clip((most - slopes[1] * other) / slopes[0], 0.0, one), other),
        (none, np.clip(most / slopes[1], 0.0, other)),
        (np.clip(most / slopes[0], 0.0, one), none),
    ):
        left, right = weights[0] * first, sign * weights[1] * second
        value = _weighted(left + right, share) + _weighted(left - right, 1 - share)
        inside = slopes[0] * first + slopes[1] * second <= allowed
        np.maximum(found, np.where(inside, value, -np.inf), out=found)
    return found


def _weighted(sums: Array, share: float) -> Array:
    # Half the share of the squares, in the place of the sums.
    sums = np.asarray(sums)
    np.multiply(sums, sums, out=sums)
    np.multiply(sums, share, out=sums)
    return np.divide(sums, 2, out=sums)
