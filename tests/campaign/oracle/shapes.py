"""Distances in the plane, from outlines alone: to segments and corners, inside by crossings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


def room_clearance(room: Mapping[str, Any], x: Array, y: Array) -> Array:
    """Distance (K,) of points from a room's walls [m], positive inside."""
    if room["kind"] == "rectangle":
        (left, right), (low, high) = room["x"], room["y"]
        return np.minimum(np.minimum(x - left, right - x), np.minimum(y - low, high - y))
    if room["kind"] == "circle":
        return room["radius"] - np.hypot(x - room.get("x", 0.0), y - room.get("y", 0.0))
    corners = np.array(room["points"], dtype=float)
    clearance = inside_distance(corners, x, y)
    return np.where(clearance >= 0, clearance, -beyond_walls(corners, x, y))


def obstacle_clearance(obstacle: Mapping[str, Any], x: Array, y: Array) -> Array:
    """Distance (K,) of points from an obstacle [m], negative within it."""
    if obstacle["kind"] == "circle":
        return np.hypot(x - obstacle["x"], y - obstacle["y"]) - obstacle["radius"]
    return -inside_distance(np.array(obstacle["points"], dtype=float), x, y)


def inside_distance(corners: Array, x: Array, y: Array) -> Array:
    """Distance (K,) of points from a polygon's outline, positive inside."""
    nearest = np.full(len(x), np.inf)
    inside = np.zeros(len(x), dtype=bool)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / ((bx - ax) ** 2 + (by - ay) ** 2)
        share = np.clip(along, 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(x - ax - share * (bx - ax), y - ay - share * (by - ay)))
        if ay != by:
            # Does a ray to the right cross this edge [Shimrat, Algorithm 112, 1962]?
            crosses = (ay > y) != (by > y)
            inside ^= crosses & (x < ax + (y - ay) / (by - ay) * (bx - ax))
    return np.where(inside, nearest, -nearest)


def beyond_walls(corners: Array, x: Array, y: Array) -> Array:
    """How far points (K,) are beyond the nearest wall of a polygon; past a corner the farther one of its two
    walls, for a room's limit is on every wall by itself.
    """
    nearest = np.full(len(x), np.inf)
    walls = [_wall(*ends, x, y) for ends in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    for (along, away), (before, away_before) in zip(walls, [walls[-1], *walls[:-1]], strict=True):
        nearest = np.minimum(nearest, np.where((along >= 0) & (along <= 1), away, np.inf))
        past = (along < 0) & (before > 1)
        nearest = np.minimum(nearest, np.where(past, np.maximum(away, away_before), np.inf))
    return nearest


def _wall(start: Array, end: Array, x: Array, y: Array) -> tuple[Array, Array]:
    # Where along a wall points are (0 to 1), and how far from its line.
    (ax, ay), (dx, dy) = start, end - start
    square = dx**2 + dy**2
    away = np.abs((x - ax) * dy - (y - ay) * dx) / np.sqrt(square)
    return ((x - ax) * dx + (y - ay) * dy) / square, away


def room_size(room: Mapping[str, Any]) -> float:
    """Half the shorter side of a room's bounding box, or of its outline if less [m]; a circle's radius."""
    if room["kind"] == "circle":
        return float(room["radius"])
    if room["kind"] == "rectangle":
        return float(min(np.diff(room["x"])[0], np.diff(room["y"])[0])) / 2
    return min(thickness(room["points"]), shortest_edge(room["points"])) / 2


def shortest_edge(points: Sequence[Sequence[float]]) -> float:
    """Of a polygon [m]."""
    corners = np.array(points, dtype=float)
    return float(np.hypot(*(np.roll(corners, -1, axis=0) - corners).T).min())


def thickness(points: Sequence[Sequence[float]]) -> float:
    """The least width of a polygon's hull [m]: the narrowest strip along one of its edges."""
    corners = np.array(points, dtype=float)
    widths = []
    for first in range(len(corners)):
        for second in range(first):
            edge = corners[first] - corners[second]
            across = np.array([-edge[1], edge[0]]) / np.hypot(*edge)
            offsets = (corners - corners[second]) @ across
            # An edge of the hull has all corners on one side.
            if offsets.min() > -1e-9 * np.ptp(offsets) or offsets.max() < 1e-9 * np.ptp(offsets):
                widths.append(float(np.ptp(offsets)))
    return min(widths)


def obstacle_size(obstacle: Mapping[str, Any]) -> float:
    """Half an obstacle's smaller extent [m]."""
    if obstacle["kind"] == "circle":
        return float(obstacle["radius"])
    return min(thickness(obstacle["points"]), shortest_edge(obstacle["points"])) / 2
