"""Limits. A new one is a file here and an entry in `LIMITS` (a new workspace shape: in `WORKSPACES`)."""

from typing import Annotated, Any

from oed.foundation.component import OneOf
from oed.kernel.limit import Limit, Rows
from oed.robots.limits.body_motion import BodySpeed, LateralAcceleration, TurningRadius, YawRate
from oed.robots.limits.end_pose import EndHeading, EndPosition
from oed.robots.limits.inputs import SteeringAngle, SteeringRate, WheelAcceleration, WheelJerk, WheelSpeed
from oed.robots.limits.path_length import PathLength
from oed.robots.limits.python_limit import PythonLimit
from oed.robots.limits.trailer_angle import TrailerAngle
from oed.robots.limits.workspace import (
    WORKSPACES,
    Circle,
    CircularObstacle,
    Obstacle,
    Obstacles,
    Polygon,
    PolygonalObstacle,
    Rectangle,
    Workspace,
)

LIMITS: dict[str, Any] = {
    one.name: Annotated[one, OneOf(WORKSPACES)] if one is Workspace else one
    for one in (
        WheelSpeed,
        WheelAcceleration,
        WheelJerk,
        SteeringAngle,
        SteeringRate,
        BodySpeed,
        YawRate,
        LateralAcceleration,
        TurningRadius,
        TrailerAngle,
        Workspace,
        Obstacles,
        PathLength,
        EndPosition,
        EndHeading,
    )
}
"""What a study's `limits:` may hold: key -> type."""

__all__ = [
    "LIMITS",
    "BodySpeed",
    "Circle",
    "CircularObstacle",
    "EndHeading",
    "EndPosition",
    "LateralAcceleration",
    "Limit",
    "Obstacle",
    "Obstacles",
    "PathLength",
    "Polygon",
    "PolygonalObstacle",
    "PythonLimit",
    "Rectangle",
    "Rows",
    "SteeringAngle",
    "SteeringRate",
    "TrailerAngle",
    "TurningRadius",
    "WheelAcceleration",
    "WheelJerk",
    "WheelSpeed",
    "Workspace",
    "YawRate",
]
