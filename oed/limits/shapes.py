"""Plane shapes as constraints: signed distances that an optimiser can follow.

A convex shape's distance is smooth outside of it. So a room of any outline is its convex hull, an
intersection of half-planes, less the pockets between hull and outline, taken apart into convex pieces; an
obstacle is its convex pieces. Geometry is shapely's, imported where it is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.expression import Expression

Array = npt.NDArray[np.float64]
Point = tuple[float, float]

SLIVER = 1e-9
"""Share of a shape's area below which a piece of it is rounding."""
SOFT = 1e-6
"""Distance [m] over which the corner of a distance to a point is rounded."""


@dataclass(frozen=True)
class Wall:
    """A half-plane normal @ p >= offset, with a unit normal inwards; virtual where no wall stands there."""

    normal: Point
    offset: float
    virtual: bool

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

    shape = shapely.Polygon(points)
    if not shapely.is_valid(shape):
        return f"expected an outline that does not cross itself: {shapely.is_valid_reason(shape)}"
    return "" if shape.area > 0 else "expected corners that enclose an area"


def walls_and_pockets(points: Sequence[Point]) -> tuple[tuple[Wall, ...], tuple[ConvexShape, ...]]:
    """A room of any outline: its hull's walls, and the convex pieces of what the hull has too much."""
    import shapely

    room = shapely.Polygon(points)
    hull = room.convex_hull
    corners = _corners(hull)
    walls = []
    for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = end - begin
        normal = np.array([-edge[1], edge[0]]) / np.hypot(*edge)
        # Along a pocket the hull's edge is no wall of the room.
        along = shapely.LineString([begin, end]).intersection(room.exterior).length
        walls.append(
            Wall(
                (float(normal[0]), float(normal[1])),
                float(normal @ begin),
                virtual=along < (1 - 1e-6) * float(np.hypot(*edge)),
            )
        )
    return tuple(walls), convex_pieces(hull.difference(room), SLIVER * hull.area)


def convex_pieces(shape: object, least: float = 0.0) -> tuple[ConvexShape, ...]:
    """Convex polygons that together are `shape` (a shapely geometry), those below an area `least` left out.

    Triangles, joined while they stay convex.
    """
    import shapely

    parts = [part for part in shapely.get_parts(shape) if part.area > least]
    triangles = [
        triangle
        for part in parts
        for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(part))
        if triangle.area > least
    ]
    pieces: list[object] = []
    for triangle in triangles:
        joined = triangle
        for place, piece in enumerate(pieces):
            union = shapely.union(piece, joined)
            if abs(union.convex_hull.area - union.area) <= 1e-9 * union.area:
                joined = union.convex_hull
                del pieces[place]
                break
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
    # Counter-clockwise, the first one not repeated, none on a straight line between its neighbours.
    import shapely

    simple = shapely.simplify(shape, 0.0)
    return np.asarray(shapely.get_coordinates(shapely.orient_polygons(simple))[:-1])
