"""Plane shapes as constraints: signed distances that an optimiser can follow.

A convex shape's distance is smooth outside of it. So a room of any outline is its convex hull, an
intersection of half-planes, less the pockets between hull and outline, taken apart into convex pieces; an
obstacle is its convex pieces. Geometry is shapely's, imported where it is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.expression import Expression

Array = npt.NDArray[np.float64]
Point = tuple[float, float]

SLIVER = 1e-9
"""Share of a shape's area (or length) below which a piece of it (or a bend) is rounding."""
SOFT = 1e-6
"""Distance [m] over which the corner of a distance to a point is rounded."""


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
            radius = ca.sqrt(ca.sumsqr(offset) + SOFT**2)
            found = ca.if_else(closest, radius, found)
        return found


_POINT = ca.SX.sym("point", 2)


def polygon_flaw(points: Sequence[Point]) -> str:
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
    pockets = [part for part in shapely.get_parts(hull.difference(room)) if part.area > least]
    return tuple(walls), tuple(
        piece for part in pockets for piece in seamless(convex_pieces(_opened(part, hull), least))
    )


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
    import shapely

    shapes = [shapely.Polygon(piece.corners) for piece in pieces]
    across = []
    for first, second in combinations(shapes, 2):
        seam = first.intersection(second)
        if seam.length <= SLIVER * first.length:
            continue
        begin, end = shapely.get_coordinates(seam)[[0, -1]]
        middle = (begin + end) / 2
        reach = _left_of(begin, end) * (first.length + second.length)
        rays = (shapely.LineString([middle, middle + reach]), shapely.LineString([middle, middle - reach]))
        tips = [ray.intersection(shapely.union(first, second)) for ray in rays]
        corners = shapely.union_all([seam, *tips]).convex_hull
        across.append(ConvexShape(tuple((float(x), float(y)) for x, y in _corners(corners))))
    return (*pieces, *across)


def _left_of(begin: Array, end: Array) -> Array:
    # The unit vector to the left of the way from one point to another.
    ahead = end - begin
    return np.asarray(np.array([-ahead[1], ahead[0]]) / np.hypot(*ahead))


def _opened(pocket: object, hull: object) -> object:
    # Together with something beyond the hull's edges along it, so that no point on them is allowed.
    import shapely

    edges = shapely.intersection(shapely.boundary(hull), shapely.boundary(pocket))
    lines = [part for part in shapely.get_parts(edges) if part.length > 0]
    beyond = []
    for line in shapely.get_parts(shapely.line_merge(shapely.union_all(lines))):
        begin, end = shapely.get_coordinates(line)[[0, -1]]
        inwards = _left_of(begin, end)
        if inwards @ (shapely.get_coordinates(shapely.centroid(hull))[0] - begin) < 0:
            inwards = -inwards
        tip = (begin + end) / 2 - inwards * shapely.length(line) / 2
        beyond.append(shapely.Polygon([begin, end, tip]))
    return shapely.union_all([pocket, *beyond])


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
            union = shapely.union(pieces[place], joined)
            place += 1
            if abs(union.convex_hull.area - union.area) <= 1e-9 * union.area:
                joined = union.convex_hull
                del pieces[place - 1]
                place = 0
        pieces.append(joined)
    return tuple(ConvexShape(tuple((float(x), float(y)) for x, y in _corners(piece))) for piece in pieces)


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
