"""A module of somebody's own, with a sensor, a criterion, a limit and a baseline."""

from __future__ import annotations

OWN_PARTS = '''
from math import log
from pathlib import Path
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
import oed

Path(__file__).with_name("was_run").touch()


class Compass(oed.Sensor):
    """The heading, to a magnetic north that nobody knows exactly."""

    kind: Literal["compass"] = "compass"
    noise: float = 0.05
    units: ClassVar = ("rad",)

    @property
    def nuisances(self):
        return (oed.Nuisance("north", 0.0, "rad"),)

    def reading(self, moment):
        return moment.pose[2] + moment.nuisances["north"]

    def whitening(self, moment):
        return ca.SX(1 / self.noise)


class LogSmallest(oed.E):
    """E-optimality, on a logarithmic scale."""

    kind: Literal["log_smallest"] = "log_smallest"
    number: ClassVar[str] = "log λ_min"
    definition: ClassVar[str] = "the logarithm of the smallest eigenvalue"
    share: ClassVar[str] = ""
    proportional: ClassVar[bool] = False

    def judge(self, information):
        with np.errstate(divide="ignore"):
            return np.log(super().judge(information))

    def efficiency(self, value, best, size):
        return None


class Strip(oed.Limit):
    """The robot stays within a strip along the x axis."""

    name: ClassVar[str] = "strip"
    looks_at: ClassVar[str] = "state"
    half_width: float

    def rows(self, drive):
        y = drive.path[:, 1]
        bounds = np.full(y.shape[0], self.half_width)
        return oed.Rows(y, -bounds, bounds, self.half_width, "m")


class Zigzag(oed.Baseline):
    """There, a turn, half as far back, and the turn undone."""

    kind: Literal["zigzag"] = "zigzag"
    angle: float = 1.0

    def moves(self, size, lap):
        turn = oed.Move(0.0, self.angle), oed.Move(0.0, -self.angle)
        return [oed.Move(size, 0.0), turn[0], oed.Move(-size / 2, 0.0), turn[1]]
'''
