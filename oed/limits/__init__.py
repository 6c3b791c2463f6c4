"""Limits. A new one is a file here and an entry in `LIMITS` (a new workspace shape: in `WORKSPACES`)."""

from typing import Annotated, Any

from oed.component import OneOf
from oed.limits.body_motion import BodySpeed, LateralAcceleration, TurningRadius, YawRate
from oed.limits.end_pose import EndHeading, EndPosition
from oed.limits.limit import Limit, Rows
from oed.limits.path_length import PathLength
from oed.limits.steering import SteeringAngle, SteeringRate
from oed.limits.trailer_angle import TrailerAngle
from oed.limits.wheel_acceleration import WheelAcceleration
from oed.limits.wheel_jerk import WheelJerk
from oed.limits.wheel_speed import WheelSpeed
from oed.limits.workspace import (
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
    WheelSpeed.name: WheelSpeed,
    WheelAcceleration.name: WheelAcceleration,
    WheelJerk.name: WheelJerk,
    SteeringAngle.name: SteeringAngle,
    SteeringRate.name: SteeringRate,
    BodySpeed.name: BodySpeed,
    YawRate.name: YawRate,
    LateralAcceleration.name: LateralAcceleration,
    TurningRadius.name: TurningRadius,
    TrailerAngle.name: TrailerAngle,
    Workspace.name: Annotated[Workspace, OneOf(WORKSPACES)],
    Obstacles.name: Obstacles,
    PathLength.name: PathLength,
    EndPosition.name: EndPosition,
    EndHeading.name: EndHeading,
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
