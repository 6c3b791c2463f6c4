"""What is drawn of a room and of what stands in it."""

from __future__ import annotations

from dataclasses import dataclass

Point = tuple[float, float]
Extent = tuple[float, float, float, float]


@dataclass(frozen=True)
class Outline:
    """A polygon, or a circle.

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
