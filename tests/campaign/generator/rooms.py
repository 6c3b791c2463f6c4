"""Random rooms and obstacles: rectangles, circles, turned and non-convex polygons; walls and posts."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..oracle.shapes import obstacle_clearance, room_clearance
from .quantities import Quantity, log_uniform, one_of

Array = npt.NDArray[np.float64]
Rng = np.random.Generator

SMALLEST = 1e-5
"""Of a thing in the way [m]: a post of 10 micrometres."""
OUTLINES: tuple[tuple[tuple[float, float], ...], ...] = (
    ((0, 0), (1, 0), (1, 1), (0, 1)),
    ((0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)),
    ((0, 0), (3, 0), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)),
    ((0, 0), (3, 0), (3, 1), (2, 1), (2, 2), (1, 2), (1, 1), (0, 1)),
    ((0, 0), (1, 0), (1, 1), (2, 1), (2, 2), (3, 2), (3, 3), (0, 3)),
    ((1, 0), (2, 0), (2, 1), (3, 1), (3, 2), (2, 2), (2, 3), (1, 3), (1, 2), (0, 2), (0, 1), (1, 1)),
    ((0, 0), (4, 0), (4, 3), (1, 3), (1, 2), (3, 2), (3, 1), (0, 1)),
    ((0, 0), (8, 0), (8, 1), (0, 1)),
)
"""Rectilinear: square, L, U, T, stairs, cross, hook, corridor."""


def draw_outline(rng: Rng, size: float, centre: Array) -> list[list[Quantity]]:
    """Corners of a simple polygon about `size` [m] across: rectilinear and turned, regular, or a star."""
    sort = rng.random()
    if sort < 0.6:
        corners = np.array(one_of(rng, OUTLINES), dtype=float)
        # Walls of all lengths: rows and columns are shifted, never past each other.
        for axis in (0, 1):
            levels, places = np.unique(corners[:, axis], return_inverse=True)
            corners[:, axis] = np.cumsum(
                np.concatenate([[0.0], np.diff(levels) * rng.uniform(0.3, 1.7, len(levels) - 1)])
            )[places]
    else:
        count = int(rng.integers(3, 10))
        angles = (
            np.sort(rng.permutation(24)[:count]) * (2 * np.pi / 24)
            if sort < 0.8
            else np.arange(count) * 2 * np.pi / count
        )
        while np.diff(np.append(angles, angles[0] + 2 * np.pi)).max() >= np.pi:
            angles = np.arange(count) * 2 * np.pi / count
        reach = rng.uniform(0.4, 1.0, count) if sort < 0.8 else np.ones(count)
        corners = reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    corners = (corners - corners.mean(axis=0)) / np.ptp(corners, axis=0).max() * size
    turn = one_of(rng, (0.0, rng.uniform(-np.pi, np.pi), np.pi / 4))
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    placed = corners @ rotation.T + centre
    if rng.random() < 0.5:
        placed = placed[::-1]
    return [[Quantity(x, "m"), Quantity(y, "m")] for x, y in placed.tolist()]


def draw_room(rng: Rng, size: float) -> dict[str, Any]:
    """A room about `size` [m] across, around the origin or beside it."""
    centre = size * rng.uniform(-0.5, 0.5, 2) if rng.random() < 0.6 else size * rng.uniform(-3, 3, 2)
    kind = one_of(rng, ("rectangle", "circle", "polygon", "polygon", "polygon"))
    if kind == "rectangle":
        half = size / 2 * rng.uniform([0.2, 0.2], [1.0, 1.0])
        pairs = [[Quantity(c - h, "m"), Quantity(c + h, "m")] for c, h in zip(centre, half, strict=True)]
        return {"kind": kind, "x": pairs[0], "y": pairs[1]}
    if kind == "circle":
        x, y = (Quantity(value, "m") for value in centre)
        return {"kind": kind, "x": x, "y": y, "radius": Quantity(size / 2, "m")}
    return {"kind": kind, "points": draw_outline(rng, size, centre)}


def inner_point(rng: Rng, room: dict[str, Any], size: float, reach: float = 1.0) -> tuple[Array, float]:
    """A point in a room, well away from its walls, and how far that is [m]."""
    x, y = _box(room)
    points = rng.uniform([x[0], y[0]], [x[1], y[1]], (200, 2))
    clearances = room_clearance(room, points[:, 0], points[:, 1])
    # Not always the best one: starts close to a wall are as good.
    order = np.argsort(-clearances)[: max(1, int(200 * rng.uniform(0, 0.2) * reach))]
    chosen = int(one_of(rng, order))
    if clearances[chosen] <= 0:
        chosen = int(np.argmax(clearances))
    return points[chosen], float(clearances[chosen])


def _box(room: dict[str, Any]) -> tuple[tuple[float, float], tuple[float, float]]:
    if room["kind"] == "rectangle":
        return tuple(room["x"]), tuple(room["y"])
    if room["kind"] == "circle":
        x, y, radius = (float(room[key]) for key in ("x", "y", "radius"))
        return (x - radius, x + radius), (y - radius, y + radius)
    corners = np.array(room["points"], dtype=float)
    return tuple(zip(corners.min(axis=0).tolist(), corners.max(axis=0).tolist(), strict=True))


def draw_obstacle(rng: Rng, size: float, place: Array) -> dict[str, Any]:
    """A post, a thin wall, or a polygon at a place [m]; `size` is the room's."""
    kind = one_of(rng, ("post", "wall", "polygon"))
    if kind == "post":
        x, y = (Quantity(value, "m") for value in place)
        return {
            "kind": "circle",
            "x": x,
            "y": y,
            "radius": Quantity(max(SMALLEST, size * log_uniform(rng, 1e-3, 0.1)), "m"),
        }
    if kind == "wall":
        half = np.maximum(
            SMALLEST, size / 2 * np.array([log_uniform(rng, 0.03, 0.5), log_uniform(rng, 5e-4, 0.01)])
        )
        turn = rng.uniform(-np.pi, np.pi)
        ahead, left = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
        signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        corners = [place + a * half[0] * ahead + b * half[1] * left for a, b in signs]
        return {"kind": "polygon", "points": [[Quantity(x, "m"), Quantity(y, "m")] for x, y in corners]}
    return {
        "kind": "polygon",
        "points": draw_outline(rng, max(4 * SMALLEST, size * rng.uniform(0.03, 0.25)), place),
    }


def clear_of(obstacle: dict[str, Any], points: Array, radius: float) -> bool:
    """Whether all points (K, 2) are farther from an obstacle than a robot's radius [m], and not just so."""
    distances = obstacle_clearance(obstacle, points[:, 0], points[:, 1])
    return bool(np.all(distances > radius * 1.001 + 1e-9))
