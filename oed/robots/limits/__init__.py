"""Limits. A new one is a file here and an entry in `LIMITS` (a new workspace shape: in `WORKSPACES`)."""

from typing import Annotated, Any

from oed.foundation.component import OneOf
from oed.kernel.limit import BareLimit as BareLimit
from oed.kernel.limit import InputLimit as InputLimit
from oed.kernel.limit import Limit as Limit
from oed.kernel.limit import PathLimit as PathLimit
from oed.kernel.limit import Rows as Rows
from oed.robots.limits.body_motion import BodySpeed as BodySpeed
from oed.robots.limits.body_motion import LateralAcceleration as LateralAcceleration
from oed.robots.limits.body_motion import PathLength as PathLength
from oed.robots.limits.body_motion import TrailerAngleLimit as TrailerAngleLimit
from oed.robots.limits.body_motion import TurningRadius as TurningRadius
from oed.robots.limits.body_motion import YawRateLimit as YawRateLimit
from oed.robots.limits.end_pose import EndHeading as EndHeading
from oed.robots.limits.end_pose import EndPosition as EndPosition
from oed.robots.limits.inputs import CommandedAcceleration as CommandedAcceleration
from oed.robots.limits.inputs import CommandedSpeed as CommandedSpeed
from oed.robots.limits.inputs import CommandedYawAcceleration as CommandedYawAcceleration
from oed.robots.limits.inputs import CommandedYawRate as CommandedYawRate
from oed.robots.limits.inputs import SteeringAngle as SteeringAngle
from oed.robots.limits.inputs import SteeringRate as SteeringRate
from oed.robots.limits.inputs import Throttle as Throttle
from oed.robots.limits.inputs import ThrottleRate as ThrottleRate
from oed.robots.limits.inputs import WheelAcceleration as WheelAcceleration
from oed.robots.limits.inputs import WheelJerk as WheelJerk
from oed.robots.limits.inputs import WheelSpeed as WheelSpeed
from oed.robots.limits.workspace import WORKSPACES
from oed.robots.limits.workspace import Circle as Circle
from oed.robots.limits.workspace import CircularObstacle as CircularObstacle
from oed.robots.limits.workspace import Obstacle as Obstacle
from oed.robots.limits.workspace import Obstacles as Obstacles
from oed.robots.limits.workspace import Polygon as Polygon
from oed.robots.limits.workspace import PolygonalObstacle as PolygonalObstacle
from oed.robots.limits.workspace import Rectangle as Rectangle
from oed.robots.limits.workspace import Workspace as Workspace
from oed.robots.own_parts import PythonLimit as PythonLimit

YawRate, TrailerAngle = YawRateLimit, TrailerAngleLimit
"""Names that these limits had, which they shared with sensors."""

LIMITS: dict[str, Any] = {
    one.name: Annotated[one, OneOf(WORKSPACES)] if one is Workspace else one
    for one in (
        WheelSpeed,
        WheelAcceleration,
        WheelJerk,
        SteeringAngle,
        SteeringRate,
        CommandedSpeed,
        CommandedAcceleration,
        CommandedYawRate,
        CommandedYawAcceleration,
        Throttle,
        ThrottleRate,
        BodySpeed,
        YawRateLimit,
        LateralAcceleration,
        TurningRadius,
        TrailerAngleLimit,
        Workspace,
        Obstacles,
        PathLength,
        EndPosition,
        EndHeading,
    )
}
"""What a study's `limits:` may hold: key -> type."""
