"""Plane shapes: as they are drawn, and as constraints, signed distances that an optimiser can follow.

A convex shape's distance is smooth outside of it. So a room of any outline is its convex hull, an
intersection of half-planes, less the pockets between hull and outline, taken apart into convex pieces; an
obstacle is its convex pieces. Geometry is shapely's, imported where it is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression

Point = tuple[float, float]
Extent = tuple[float, float, float, float]

SLIVER = 1e-9
"""Share of a shape's area (or length) below which a piece of it (or a bend) is rounding."""
NEAR = 1e-7
"""Share of the length of two edges within which they meet."""
SOFT = 1e-6
"""Share of a shape's longest edge over which the corner of a distance to a point is rounded."""


@dataclass(frozen=True)
class Outline:
    """What is drawn of a room or of what stands in it: a polygon, or a circle.

    Attributes:
        points: the polygon's corners in order, or the circle's centre [m].
        radius: of the circle [m]; 0 of a polygon.
    """

    points: tuple[Point, ...]
    radius: float = 0.0

    @property
    def extent(self) -> Extent:
        """Bounding box (x_min, x_max, y_min, y_max) [m]."""
        x, y = zip(*self.points, strict=True)
        return min(x) - self.radius, max(x) + self.radius, min(y) - self.radius, max(y) + self.radius


@dataclass(frozen=True)
class Wall:
    """A half-plane normal @ p >= offset, with a unit normal inwards."""

    normal: Point
    offset: float

    def clearance(self, points: Expression) -> Expression:
        """Distance (G, 1) of points (G, 2) from it, positive inside."""
        return self.normal[0] * points[:, 0] + self.normal[1] * points[:, 1] - self.offset


@dataclass(frozen=True)
class ConvexShape:
    """A convex polygon, its corners counter-clockwise."""

    corners: tuple[Point, ...]

    def clearance(self, points: Expression) -> Expression:
        """Distance (G, 1) of points (G, 2) from it: to an edge or a corner outside, negative inside."""
        distance = ca.Function("distance", [_POINT], [self._distance(_POINT)])
        return distance.map(points.shape[0])(points.T).T

    def _distance(self, point: ca.SX) -> ca.SX:
        corners = np.array(self.corners)
        edges = np.roll(corners, -1, axis=0) - corners
        lengths = np.hypot(edges[:, 0], edges[:, 1])
        found = ca.SX(-np.inf)
        for corner, (ahead, left), length in zip(corners, edges, lengths, strict=True):
            offset = point - ca.DM(corner)
            found = ca.fmax(found, (left * offset[0] - ahead * offset[1]) / length)
        for corner, edge, before in zip(corners, edges, np.roll(edges, 1, axis=0), strict=True):
            # Beyond the ends of both edges that meet there, the corner is closest.
            offset = point - ca.DM(corner)
            closest = ca.logic_and(ca.dot(offset, ca.DM(edge)) < 0, ca.dot(offset, ca.DM(before)) > 0)
            radius = ca.sqrt(ca.sumsqr(offset) + (SOFT * lengths.max()) ** 2)
            found = ca.if_else(closest, radius, found)
        return found


_POINT = ca.SX.sym("point", 2)


def polygon_issue(points: Sequence[Point]) -> str:
    """What keeps points from being the corners of a polygon; "" if nothing."""
    import shapely

    hull = shapely.MultiPoint(points).convex_hull
    if hull.area <= SLIVER * hull.length**2:
        return "expected corners that enclose an area, got corners on a line"
    shape = shapely.Polygon(points)
    if not shapely.is_valid(shape):
        reason = shapely.is_valid_reason(shape)
        return f"expected an outline that neither crosses nor touches itself, got {reason}"
    return ""


def walls_and_pockets(points: Sequence[Point]) -> tuple[tuple[Wall, ...], tuple[ConvexShape, ...]]:
    """A room of any outline: its hull's walls, and the convex pieces of what the hull has too much.

    The least distance from all of them is that from the outline: where the hull's edge is no wall of the
    room, the pocket is closer.
    """
    import shapely

    room = shapely.Polygon(points)
    hull = room.convex_hull
    corners = _corners(hull)
    walls = []
    for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        normal = _left_of(begin, end)
        walls.append(Wall((float(normal[0]), float(normal[1])), float(normal @ begin)))
    least = SLIVER * hull.area
    pockets = _opened_pockets(_corners(room), walls, SLIVER * hull.length)
    return tuple(walls), tuple(piece for part in pockets for piece in seamless(convex_pieces(part, least)))


def _opened_pockets(corners: Array, walls: Sequence[Wall], near: float) -> list[object]:
    """What lies between a room's corners (G, 2) and the walls of its hull, as polygons.

    Each begins and ends where the outline touches the hull, to a distance `near` [m], and reaches beyond the
    hull's edge between, so that no point on that is allowed.
    """
    import shapely

    distances = [wall.clearance(corners) for wall in walls]
    touching = np.flatnonzero(np.min(distances, axis=0) <= near)
    pockets = []
    for first, last in pairwise([*touching, touching[0] + len(corners)]):
        begin, *between, end = corners[np.arange(first, last + 1) % len(corners)]
        tip = (begin + end) / 2 - _left_of(begin, end) * float(np.hypot(*(end - begin))) / 2
        if between:
            pockets.append(shapely.Polygon([begin, tip, end, *reversed(between)]))
    return pockets


def hull_farther_out(points: Sequence[Point], by: float) -> Array:
    """Corners (k, 2) of the convex hull of points with every edge moved outwards by `by`."""
    import shapely

    corners = _corners(shapely.MultiPoint(points).convex_hull)
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    before, after = (edges / np.hypot(*edges.T)[:, None] for edges in (before, after))
    # Where both edges' lines meet again: along the difference of their directions, farther at sharp corners.
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.asarray(corners + by * (before - after) / turn[:, None])


def seamless(pieces: Sequence[ConvexShape]) -> tuple[ConvexShape, ...]:
    """The pieces, and one across every line where two of them meet.

    A point on such a line is on the edge of both, which alone would let a robot without a body pass along it.
    """
    tables = [np.array(piece.corners) for piece in pieces]
    across = [
        _across(first, second, seam)
        for first, second in combinations(tables, 2)
        for seam in _common_edges(first, second)
    ]
    return (*pieces, *across)


def _across(first: Array, second: Array, seam: Array) -> ConvexShape:
    # From its seam (2, 2) with the second piece, the first piece lies to the left, the second to the right.
    begin, end = seam
    left, middle = _left_of(begin, end), (begin + end) / 2
    corners = begin, _far_side(second, middle, -left), end, _far_side(first, middle, left)
    return ConvexShape(tuple((float(x), float(y)) for x, y in corners))


def _far_side(corners: Array, point: Array, direction: Array) -> Array:
    # Where a ray from a point on the edge of a convex polygon (G, 2) leaves it.
    begins, ends = corners, np.roll(corners, -1, axis=0)
    right = -np.array([_left_of(begin, end) for begin, end in zip(begins, ends, strict=True)])
    speeds, left_over = right @ direction, ((begins - point) * right).sum(axis=1)
    ahead = speeds > SLIVER
    return np.asarray(point + max(0.0, (left_over[ahead] / speeds[ahead]).min()) * direction)


def _common_edges(first: Array, second: Array) -> list[Array]:
    # Ends (2, 2) of every stretch along which two polygons lie side by side, in the first one's direction.
    return [
        stretch
        for begin, end in zip(first, np.roll(first, -1, axis=0), strict=True)
        for other_begin, other_end in zip(second, np.roll(second, -1, axis=0), strict=True)
        if (stretch := _overlap(begin, end, other_end, other_begin)) is not None
    ]


def _overlap(begin: Array, end: Array, other_begin: Array, other_end: Array) -> Array | None:
    # What two edges of one direction have in common, to rounding, between corners as they were given.
    length, ahead = float(np.hypot(*(end - begin))), (end - begin) / np.hypot(*(end - begin))
    others = np.array([other_begin, other_end]) - begin
    first, last = others @ ahead
    near = NEAR * (length + abs(last - first))
    low = begin if first <= near else other_begin
    high = end if last >= length - near else other_end
    meet = np.abs(others @ _left_of(begin, end)).max() <= near
    return np.array([low, high]) if meet and min(last, length) - max(first, 0.0) > near else None


def _left_of(begin: Array, end: Array) -> Array:
    # The unit vector to the left of the way from one point to another.
    ahead = end - begin
    return np.asarray(np.array([-ahead[1], ahead[0]]) / np.hypot(*ahead))


def convex_pieces(shape: object, least: float = 0.0) -> tuple[ConvexShape, ...]:
    """Convex polygons that together are `shape` (a shapely geometry), those below an area `least` left out.

    Triangles, joined while they stay convex.
    """
    import shapely

    # A corner on a straight line would be one more for triangles to begin at.
    parts = [part for part in shapely.get_parts(_simple(shape)) if part.area > least]
    triangles = [
        triangle
        for part in parts
        for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(part))
        if triangle.area > least
    ]
    pieces: list[object] = []
    for triangle in triangles:
        joined, place = triangle, 0
        while place < len(pieces):
            # They do not overlap; and shapely's union may lose one of them.
            together = shapely.GeometryCollection([pieces[place], joined])
            place += 1
            if abs(together.convex_hull.area - together.area) <= 1e-9 * together.area:
                joined = together.convex_hull
                del pieces[place - 1]
                place = 0
        pieces.append(joined)
    return tuple(ConvexShape(tuple((float(x), float(y)) for x, y in _corners(piece))) for piece in pieces)


def half_thickness(points: Sequence[Point]) -> float:
    """Half the shorter side of the narrowest rectangle around a polygon, or half its shortest edge if less.

    A wall that is drawn thin has an edge as short at its end: what is tolerated of this must not let a robot
    through it.
    """
    import shapely

    shape = shapely.Polygon(points)
    corners, around = _corners(shape), np.asarray(shapely.get_coordinates(shapely.oriented_envelope(shape)))
    edges = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    sides = np.hypot(*np.diff(around, axis=0).T)
    return float(min(edges.min(), sides.min())) / 2


def middle_of(points: Sequence[Point]) -> Point:
    """The point of a polygon that is farthest from its outline."""
    import shapely

    shape = shapely.Polygon(points)
    line = shapely.maximum_inscribed_circle(shape, tolerance=1e-3 * float(np.sqrt(shape.area)))
    x, y = line.coords[0]
    return float(x), float(y)


def _corners(shape: object) -> Array:
    # Counter-clockwise, the first one not repeated. Simplifying leaves a ring's first corner, and four of a
    # triangle's, on a straight line between their neighbours.
    import shapely

    corners = np.asarray(shapely.get_coordinates(shapely.orient_polygons(_simple(shape)))[:-1])
    before, after = np.roll(corners, 1, axis=0) - corners, np.roll(corners, -1, axis=0) - corners
    twice_the_area = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    across = twice_the_area / np.hypot(*(after - before).T)
    return np.asarray(corners[across > SLIVER * shapely.length(shape)])


def _simple(shape: object) -> object:
    # Without corners on a straight line between their neighbours, to rounding.
    import shapely

    return shapely.simplify(shape, SLIVER * shapely.length(shape))
