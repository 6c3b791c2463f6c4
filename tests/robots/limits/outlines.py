"""Outlines of rooms and obstacles, as corners in order, and distances from them by shapely."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import strategies as st

L_SHAPE = ((0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4))
U_SHAPE = ((0, 0), (5, 0), (5, 4), (3.5, 4), (3.5, 1), (1.5, 1), (1.5, 4), (0, 4))
COMB = ((0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (3, 1), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2))
SPIRAL = ((0, 0), (5, 0), (5, 5), (1, 5), (1, 2), (3, 2), (3, 3), (2, 3), (2, 4), (4, 4), (4, 1), (0, 1))
STAR = tuple(
    (float(radius * np.cos(angle)), float(radius * np.sin(angle)))
    for radius, angle in zip([2.0, 0.7] * 5, np.arange(10) * np.pi / 5, strict=True)
)
SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))
TRIANGLE = ((0, 0), (3, 0.5), (1, 2))
MORE_CORNERS = ((1, 0), (2, 0), (2, 1), (1.5, 1.5), (1, 2), (0, 2), (0, 0.3), (0, 0), (0.4, 0))
"""Corners on straight lines, the first of them too."""

OUTLINES = {
    "square": SQUARE,
    "triangle": TRIANGLE,
    "L": L_SHAPE,
    "U": U_SHAPE,
    "comb": COMB,
    "spiral": SPIRAL,
    "star": STAR,
    "more corners": MORE_CORNERS,
}


def signed_distance(outline, points) -> np.ndarray:
    """Distance of points (G, 2) from an outline, positive inside."""
    shape = shapely.Polygon(outline)
    found = shapely.points(np.asarray(points, dtype=float))
    return np.where(shapely.contains(shape, found), 1, -1) * shapely.distance(shape.exterior, found)


def grid_around(outline, count: int = 23, room: float = 0.4) -> np.ndarray:
    """Points (count^2, 2) in and around an outline, its lines and corners among them where they are round."""
    low, high = np.min(outline, axis=0), np.max(outline, axis=0)
    margin = room * (high - low)
    x, y = (np.linspace(low[axis] - margin[axis], high[axis] + margin[axis], count + axis) for axis in (0, 1))
    return np.array(np.meshgrid(x, y)).reshape(2, -1).T


@st.composite
def convex_outlines(draw) -> np.ndarray:
    """Corners on an ellipse, no two too close, counter-clockwise."""
    count = draw(st.integers(3, 9))
    gaps = np.array(draw(st.lists(st.floats(0.3, 1), min_size=count, max_size=count)))
    angles = draw(st.floats(0, 6)) + 2 * np.pi * np.cumsum(gaps) / gaps.sum()
    axes = draw(st.tuples(st.floats(0.3, 3), st.floats(0.3, 3)))
    middle = draw(st.tuples(st.floats(-5, 5), st.floats(-5, 5)))
    return np.column_stack([np.cos(angles), np.sin(angles)]) * axes + middle


@st.composite
def outlines(draw) -> np.ndarray:
    """Corners all around a middle at any distances from it: mostly not convex."""
    count = draw(st.integers(4, 12))
    radii = np.array(draw(st.lists(st.floats(0.3, 3), min_size=count, max_size=count)))
    gaps = np.array(draw(st.lists(st.floats(0.5, 1), min_size=count, max_size=count)))
    angles = 2 * np.pi * np.cumsum(gaps) / gaps.sum()
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


def rectilinear_outline(draw: np.random.Generator) -> np.ndarray:
    """Corners of a room of right angles, drawn at random and turned by any angle: corners that lie on one
    line do so to rounding.
    """
    while True:
        sides = [
            np.cumsum(draw.choice([0.25, 0.3, 0.5, 1, 2], 14) if even else draw.uniform(0.1, 1, 14))
            for even in draw.random(2) < 0.5
        ]
        cells = _adjoining_cells(draw, int(draw.integers(2, 19)))
        x, y = sides
        room = shapely.union_all([shapely.box(x[i], y[j], x[i + 1], y[j + 1]) for i, j in cells])
        if room.geom_type == "Polygon" and not room.interiors and shapely.is_valid(room):
            break
    corners = shapely.get_coordinates(shapely.simplify(room, 0))[:-1]
    angle = draw.uniform(0, 2 * np.pi) if draw.random() < 0.5 else np.deg2rad(draw.integers(360))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return corners @ turn.T


def _adjoining_cells(draw: np.random.Generator, count: int) -> list[tuple[int, int]]:
    # Of a grid of 13 by 13, each beside one before.
    cells = [(6, 6)]
    for _ in range(count - 1):
        i, j = cells[draw.integers(len(cells))]
        right, up = ((1, 0), (-1, 0), (0, 1), (0, -1))[draw.integers(4)]
        cells.append((int(np.clip(i + right, 0, 12)), int(np.clip(j + up, 0, 12))))
    return cells
