"""Limit on how far the robot drives."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field

from oed.foundation.quantities import Length
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.limit import BareLimit, Rows

SOFT = 1e-4
"""Speed [m/s] over which the corner of the speed at rest is rounded, upwards."""


class PathLength(BareLimit):
    """Each run no longer than `bounds` [m], as its battery (or cable) allows."""

    name: ClassVar[str] = "path_length"
    looks_at: ClassVar[Literal["run"]] = "run"
    bounds: Annotated[Length, Field(gt=0)]

    def rows(self, drive: Drive) -> Rows:
        """One row per run: the distance that its origin travels, at most a tenth of a millimetre per second
        more.
        """
        twist = drive.signals["twist"]
        steps = ca.sqrt(twist[:, 0] ** 2 + twist[:, 1] ** 2 + SOFT**2) * drive.period
        lengths = ca.vertcat(*(ca.sum1(run) for run in ca.vertsplit(steps, drive.samples)))
        return Rows(lengths, np.full(drive.runs, -np.inf), np.full(drive.runs, self.bounds), self.bounds, "m")
