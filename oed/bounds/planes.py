"""Where the largest of several sums of squared distances from a centre is least."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array

FINER = 6
"""Times that the search looks closer."""
POINTS = 25
"""Centres along each axis of one look."""


@dataclass(frozen=True)
class Plane:
    """What one path says of every centre c: at least n |c|^2 - 2 c' total + squares.

    Attributes:
        squares: sum of |p|^2, raised to what is known of its bound at one centre.
        total: sum of p, (2,).
    """

    squares: float
    total: Array


def plane_through(path: Array, weight: float, centre: Array, value: float) -> Plane:
    """That of a path with a given value at a centre.

    Args:
        path: places, (k, 2).
        weight: times that each of them counts.
        centre: c, (2,).
        value: there.
    """
    total = weight * path.sum(axis=0)
    count = weight * len(path)
    return Plane(value + 2 * float(centre @ total) - count * float(centre @ centre), total)


def best_centre(planes: list[Plane], readings: float, low: Array, high: Array) -> tuple[Array, float]:
    """The centre within a rectangle at which the largest of the planes is least, and that value.

    Args:
        planes: at least one.
        readings: n.
        low: corner of the rectangle, (2,).
        high: corner opposite, (2,).
    """
    squares = np.array([one.squares for one in planes])
    totals = np.array([one.total for one in planes])
    middle, width, least = (low + high) / 2, high - low, np.inf
    for _ in range(FINER):
        x, y = (
            np.clip(np.linspace(m - w / 2, m + w / 2, POINTS), a, b)
            for m, w, a, b in zip(middle, width, low, high, strict=True)
        )
        centres = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
        values = (squares - 2 * centres @ totals.T).max(axis=-1) + readings * (centres**2).sum(axis=-1)
        place = np.unravel_index(int(values.argmin()), values.shape)
        middle, least, width = centres[place], float(values[place]), width / 6
    return middle, least
