"""The drives of robots that a study allows: their start poses, and how poses follow from twists."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.quantities import Angle, Length
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System
from oed.robots.models.arcs import Integration
from oed.robots.models.model import Model


class StartPose(Component):
    """A fixed start pose: x [m], y [m], heading [rad]."""

    x: Length = 0.0
    y: Length = 0.0
    heading: Angle = 0.0


class DesignSpace(Space):
    """All drives of a robot that a study allows: as any system's, with start poses and an integration rule.

    A single start pose holds for all runs.
    """

    start: StartPose | Annotated[tuple[StartPose, ...], Field(min_length=1)] | Literal["free"] = StartPose()
    integration: Integration = "arc"

    @property
    def fixed_starts(self) -> Array | None:
        """The start pose (x, y, heading) of every run, (runs, 3), where they are fixed."""
        if isinstance(self.start, str):
            return None
        poses = self.start if isinstance(self.start, tuple) else (self.start,) * self.runs
        return np.array([(pose.x, pose.y, pose.heading) for pose in poses])

    def driving(self, system: System) -> System:
        """The robot with this integration rule."""
        return system.system(self.integration) if isinstance(system, Model) else system
