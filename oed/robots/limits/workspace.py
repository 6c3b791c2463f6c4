"""Where the robot may be: rooms and obstacles, with the robot's own radius as the distance to keep."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from functools import cached_property, lru_cache
from typing import Annotated, Any, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import AfterValidator, Field, field_validator, model_validator

from oed.foundation.arrays import Array
from oed.foundation.component import Component, OneOf
from oed.foundation.errors import Issue
from oed.foundation.quantities import Length
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System
from oed.kernel.limit import Limit, PathLimit, Rows, magnitude
from oed.robots.limits.shapes import (
    ConvexShape,
    Extent,
    Outline,
    Point,
    Wall,
    convex_pieces,
    half_thickness,
    hull_farther_out,
    middle_of,
    polygon_issue,
    seamless,
    walls_and_pockets,
)
from oed.robots.models.model import robot_of


def _checked(points: tuple[Point, ...]) -> tuple[Point, ...]:
    issue = polygon_issue(points)
    if issue:
        raise ValueError(issue)
    return points


Corners = Annotated[tuple[tuple[Length, Length], ...], Field(min_length=3), AfterValidator(_checked)]
"""The corners of a polygon [m], in order."""


@lru_cache(maxsize=64)
def _margins_at(area: Area, radius: float) -> ca.Function:
    # Distances (rows,) by which a robot of that radius [m] is inside, at a point (2,) [m].
    point = ca.MX.sym("point", 2)
    rows = area.rows_for(point.T, radius)
    bounds = ca.vertcat(rows.expression - rows.lower, rows.upper - rows.expression)
    return ca.Function("inside", [point], [bounds])


class Area(PathLimit):
    """A limit on positions alone, by distances."""

    per_metre: ClassVar[float] = 1.0

    @abstractmethod
    def rows_for(self, points: Expression, radius: float) -> Rows:
        """The limit on points (G, 2) [m] of the origin of a robot of that radius [m]."""

    def rows_at(self, path: Expression, system: System) -> Rows:
        """The limit on the robot's origin at every point."""
        return self.rows_for(path[:, :2], robot_of(system).body_radius)

    def issues(self, system: System, space: Space) -> list[Issue]:
        """A fixed start that the limit does not allow."""
        starts = np.zeros((0, 3)) if space.fixed_starts is None else space.fixed_starts
        for x, y in dict.fromkeys((float(x), float(y)) for x, y, _ in starts):
            if not self.allows(x, y, robot_of(system).body_radius):
                where = f"the start ({x:g} m, {y:g} m)"
                return [Issue(("limits", self.name), self.start_issue(where, robot_of(system).body_radius))]
        return []

    def allows(self, x: float, y: float, radius: float = 0.0) -> bool:
        """Whether a robot of that radius may have its origin at a point [m].

        Args:
            x: of the robot's origin [m].
            y: of the robot's origin [m].
            radius: of the robot's body [m].
        """
        return self.allow(np.array([[x, y]]), radius)

    def allow(self, points: Array, radius: float = 0.0) -> bool:
        """Whether a robot of that radius [m] may have its origin at each of the points (G, 2) [m]."""
        margins = _margins_at(self, radius)(np.asarray(points).T)
        return bool(np.array(margins).min() >= -1e-9)

    @abstractmethod
    def start_issue(self, where: str, radius: float) -> str:
        """What to say of a start that the limit does not allow."""


def _clear(distances: Sequence[Expression], radius: float, size: float) -> Rows:
    # Every distance (G, 1) [m] at least the robot's radius.
    expression = ca.vertcat(*distances)
    count = expression.shape[0]
    return Rows(expression, np.full(count, radius), np.full(count, np.inf), size, "m")


def _keeping(radius: float) -> str:
    return f" for a robot of radius {radius:g} m" if radius else ""


class Workspace(Area):
    """An area in which the robot has to stay."""

    name: ClassVar[str] = "workspace"
    loosened: ClassVar[str] = "{amount} more room on every side"
    kind: str

    @property
    @abstractmethod
    def extent(self) -> Extent:
        """Bounding box (x_min, x_max, y_min, y_max) [m]."""

    def state_bounds(self) -> dict[str, tuple[float, float]]:
        """Bounds of x and y: the bounding box [m]."""
        x_min, x_max, y_min, y_max = self.extent
        return {"x": (x_min, x_max), "y": (y_min, y_max)}

    @property
    def outline(self) -> Outline | None:
        """What is drawn of it; None for nothing."""
        return None

    def widened_extent(self, share: float) -> Extent:
        """Bounding box [m] of the room whose rows may be exceeded by `share` of their size.

        Unknown, and so infinite, unless the kind of room says it.
        """
        return (-np.inf, np.inf, -np.inf, np.inf) if share else self.extent

    def _spare(self, share: float) -> float:
        return share * self.rows_for(ca.DM.zeros(1, 2), 0.0).size

    @property
    def middle(self) -> Point:
        """A point [m] well inside."""
        x_min, x_max, y_min, y_max = self.extent
        return (x_min + x_max) / 2, (y_min + y_max) / 2

    def issues(self, system: System, space: Space) -> list[Issue]:
        """A fixed start outside, a robot larger than the room."""
        if not self.allows(*self.middle, robot_of(system).body_radius):
            text = f"the room is too small for a robot of radius {robot_of(system).body_radius:g} m"
            return [Issue(("limits", self.name), text)]
        return super().issues(system, space)

    def start_issue(self, where: str, radius: float) -> str:
        """What to say of a start outside."""
        shape = "" if self.kind == "rectangle" else f"(a {self.kind}) within "
        x_min, x_max, y_min, y_max = self.extent
        return (
            f"{where} lies outside the workspace {shape}x [{x_min:g}, {x_max:g}] m, "
            f"y [{y_min:g}, {y_max:g}] m{_keeping(radius)}; move the start or widen the workspace"
        )


def _farther_out(extent: Extent, by: float) -> Extent:
    x_min, x_max, y_min, y_max = extent
    return x_min - by, x_max + by, y_min - by, y_max + by


def workspace_of(limits: Iterable[Limit]) -> Workspace | None:
    """The room among some limits; None without one."""
    return next((limit for limit in limits if isinstance(limit, Workspace)), None)


class Rectangle(Workspace):
    """x and y each within [min, max] [m]."""

    kind: Literal["rectangle"] = "rectangle"
    x: tuple[Length, Length]
    y: tuple[Length, Length]

    @field_validator("x", "y")
    @classmethod
    def _min_below_max(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not value[0] < value[1]:
            raise ValueError(f"expected min below max, got [{value[0]:g}, {value[1]:g}] m")
        return value

    @property
    def extent(self) -> Extent:
        """The rectangle itself [m]."""
        return (*self.x, *self.y)

    @property
    def outline(self) -> Outline:
        """The rectangle itself."""
        (left, right), (bottom, top) = self.x, self.y
        return Outline(((left, bottom), (right, bottom), (right, top), (left, top)))

    def widened_extent(self, share: float) -> Extent:
        """The rectangle with every side farther out [m]."""
        return _farther_out(self.extent, self._spare(share))

    def rows_for(self, points: Expression, radius: float) -> Rows:
        """X and y of every point; the size is the shorter half-side."""
        count = points.shape[0]
        lower = np.repeat([self.x[0] + radius, self.y[0] + radius], count)
        upper = np.repeat([self.x[1] - radius, self.y[1] - radius], count)
        size = min(self.x[1] - self.x[0], self.y[1] - self.y[0]) / 2
        return Rows(ca.vertcat(points[:, 0], points[:, 1]), lower, upper, size, "m")


class Circle(Workspace):
    """Within `radius` [m] of a centre x, y [m]."""

    kind: Literal["circle"] = "circle"
    x: Length = 0.0
    y: Length = 0.0
    radius: Annotated[Length, Field(gt=0)]

    @property
    def extent(self) -> Extent:
        """The square around it [m]."""
        return self.outline.extent

    @property
    def outline(self) -> Outline:
        """The circle itself."""
        return Outline(((self.x, self.y),), self.radius)

    def widened_extent(self, share: float) -> Extent:
        """The square around a larger circle [m]."""
        return _farther_out(self.extent, self._spare(share))

    def rows_for(self, points: Expression, radius: float) -> Rows:
        """Distance of every point from the circle's line; the size is its radius."""
        away = magnitude(points[:, 0] - self.x, points[:, 1] - self.y, self.radius)
        return _clear([self.radius - away], radius, self.radius)


class Polygon(Workspace):
    """Within a polygon, convex or not, given by its corners `points` [m] in order."""

    kind: Literal["polygon"] = "polygon"
    points: Corners

    @property
    def extent(self) -> Extent:
        """The polygon's bounding box [m]."""
        return self.outline.extent

    @property
    def outline(self) -> Outline:
        """The polygon itself."""
        return Outline(self.points)

    @property
    def middle(self) -> Point:
        """The point farthest from all walls [m]."""
        return middle_of(self.points)

    def widened_extent(self, share: float) -> Extent:
        """The bounding box of its hull with every wall farther out: sharp corners are farther still [m]."""
        x, y = np.array(hull_farther_out(self.points, self._spare(share))).T
        return float(x.min()), float(x.max()), float(y.min()), float(y.max())

    @cached_property
    def _size(self) -> float:
        return half_thickness(self.points)

    @cached_property
    def _parts(self) -> tuple[tuple[Wall, ...], tuple[ConvexShape, ...]]:
        return walls_and_pockets(self.points)

    def rows_for(self, points: Expression, radius: float) -> Rows:
        """Distance of every point from every wall and pocket; the size is half the room's thickness, of its
        thinnest ends as well.
        """
        walls, pockets = self._parts
        clearances = [wall.clearance(points) for wall in walls]
        clearances += [pocket.clearance(points) for pocket in pockets]
        return _clear(clearances, radius, self._size)


WORKSPACES: tuple[type[Workspace], ...] = (Rectangle, Circle, Polygon)


class Obstacle(Component):
    """Something in the room that the robot must not touch."""

    kind: str

    @abstractmethod
    def clearances(self, points: Expression) -> list[Expression]:
        """Distances (G, 1) of points (G, 2) from each of its convex parts [m]."""

    @property
    @abstractmethod
    def size(self) -> float:
        """Half its smaller extent [m]."""

    @property
    def outline(self) -> Outline | None:
        """What is drawn of it; None for nothing."""
        return None


class CircularObstacle(Obstacle):
    """A column of `radius` [m] at x, y [m]."""

    kind: Literal["circle"] = "circle"
    x: Length
    y: Length
    radius: Annotated[Length, Field(gt=0)]

    def clearances(self, points: Expression) -> list[Expression]:
        """Distance from its line."""
        return [magnitude(points[:, 0] - self.x, points[:, 1] - self.y, self.radius) - self.radius]

    @property
    def size(self) -> float:
        """The column's radius [m]."""
        return self.radius

    @property
    def outline(self) -> Outline:
        """The circle itself."""
        return Outline(((self.x, self.y),), self.radius)


class PolygonalObstacle(Obstacle):
    """A polygon, convex or not, given by its corners `points` [m] in order."""

    kind: Literal["polygon"] = "polygon"
    points: Corners

    @cached_property
    def _pieces(self) -> tuple[ConvexShape, ...]:
        import shapely

        return seamless(convex_pieces(shapely.Polygon(self.points)))

    def clearances(self, points: Expression) -> list[Expression]:
        """Distance from each convex piece."""
        return [piece.clearance(points) for piece in self._pieces]

    @property
    def size(self) -> float:
        """Half its thickness [m], of its ends as well."""
        return half_thickness(self.points)

    @property
    def outline(self) -> Outline:
        """The polygon itself."""
        return Outline(self.points)


OBSTACLES: tuple[type[Obstacle], ...] = (CircularObstacle, PolygonalObstacle)


class Obstacles(Area):
    """What the robot must keep its own radius away from; in YAML, a list of them."""

    name: ClassVar[str] = "obstacles"
    loosened: ClassVar[str] = "{amount} less around every obstacle"
    shapes: Annotated[tuple[Annotated[Obstacle, OneOf(OBSTACLES)], ...], Field(min_length=1)]

    @model_validator(mode="before")
    @classmethod
    def _bare_list(cls, value: Any) -> Any:
        return {"shapes": value} if isinstance(value, list | tuple) else value

    def rows_for(self, points: Expression, radius: float) -> Rows:
        """Distance of every point from every convex part; the size is the smallest obstacle's and the
        robot's radius together.
        """
        clearances = [part for shape in self.shapes for part in shape.clearances(points)]
        return _clear(clearances, radius, min(shape.size for shape in self.shapes) + radius)

    def start_issue(self, where: str, radius: float) -> str:
        """What to say of a start inside one."""
        return f"{where} touches an obstacle{_keeping(radius)}; move the start or the obstacle"
