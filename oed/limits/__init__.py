"""Limits. A new one is a file here and an entry in `LIMITS` (a new workspace shape: in `WORKSPACES`)."""

from typing import Annotated, Any

from oed.component import OneOf
from oed.limits.limit import Limit, Rows
from oed.limits.wheel_acceleration import WheelAcceleration
from oed.limits.wheel_speed import WheelSpeed
from oed.limits.workspace import WORKSPACES, Rectangle, Workspace

LIMITS: dict[str, Any] = {
    WheelSpeed.name: WheelSpeed,
    WheelAcceleration.name: WheelAcceleration,
    Workspace.name: Annotated[Workspace, OneOf(WORKSPACES)],
}
"""What a study's `limits:` may hold: key -> type."""

__all__ = ["LIMITS", "Limit", "Rectangle", "Rows", "WheelAcceleration", "WheelSpeed", "Workspace"]
