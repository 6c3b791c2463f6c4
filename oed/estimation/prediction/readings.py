"""A drive's readings as functions of what is unknown: what joint estimation computes them from."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt
import scipy

from oed.kernel.dynamics.rollout import roll_out
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.measurement import Nuisance
from oed.kernel.measurement.sensor import JointReadings, Sensor, joint_readings, start_nuisances
from oed.robots.models.model import Integration, Model

Array = npt.NDArray[np.float64]

WRITTEN_OUT = 2000
"""Samples up to which the readings are compiled into one sequence of operations."""


class PredictedReadings:
    """What sensors read of one drive, as functions of the unknowns: parameters, initial pose, nuisances.

    Args:
        robot: whose parameters are unknown.
        integration: its integration rule.
        sensors: in the order of the readings.
        trajectory: the drive.
        parameters: names of those that are unknown; the others are nominal.
    """

    def __init__(
        self,
        robot: Model,
        integration: Integration,
        sensors: Sequence[Sensor],
        trajectory: Trajectory,
        parameters: Sequence[str],
    ) -> None:
        """Keep the parts; functions are compiled when first used."""
        self._robot, self._trajectory, self.sensors = robot, trajectory, tuple(sensors)
        self._integration: Integration = integration
        start = start_nuisances(sensors, robot, trajectory.runs)
        names = [parameter.name for parameter in robot.parameters]
        self._places = [names.index(name) for name in parameters]
        self._places += range(len(names), len(names) + len(start))
        self._nominal = np.concatenate([robot.nominal, trajectory.starts.ravel()])
        self.nuisances: tuple[Nuisance, ...] = (*start, *self._joint(self._nominal, None).nuisances)

    @cached_property
    def initial(self) -> Array:
        """The unknowns' nominal values, SI."""
        own = [entry.nominal for entry in self.nuisances[-self._own_count :]] if self._own_count else []
        return np.concatenate([self._nominal[self._places], own])

    def response(self, unknowns: Array) -> Array:
        """The noise-free readings (M,), SI."""
        return np.array(self._functions[0](unknowns)).ravel()

    def slope(self, unknowns: Array) -> Array:
        """Their derivatives by the unknowns, (M, unknowns)."""
        return np.array(self._functions[1](unknowns))

    def unwrapped(self, readings: Array) -> Array:
        """Readings (M,) whose angles run on where they jumped by full turns, and begin near the nominal."""
        found, nominal, first = readings.copy(), self.response(self.initial), 0
        for sensor, one in zip(self.sensors, self._joint(self._nominal, None).each, strict=True):
            size, rows = one.whitening.shape[0], one.response.numel()
            each = rows // self._trajectory.runs
            for begin, place in product(range(first, first + rows, each), sensor.angles):
                own = slice(begin + place, begin + each, size)
                angles = np.unwrap(found[own])
                found[own] = angles + 2 * np.pi * np.rint((nominal[own][0] - angles[0]) / (2 * np.pi))
            first += rows
        return found

    @cached_property
    def whitener(self) -> Any:
        """Block diagonal A (M, M) with A R A' = 1, at the nominal values: the noise is taken for known."""
        joint = self._joint(self._nominal, None)
        matrices = []
        for sensor, one in zip(self.sensors, joint.each, strict=True):
            whole = sensor.joint_whitening
            if whole is not None:
                matrices += [scipy.sparse.csr_array(whole)] * self._trajectory.runs
                continue
            side_by_side = np.array(ca.evalf(one.whitening))
            size = side_by_side.shape[0]
            matrices.append(scipy.sparse.block_diag(np.hsplit(side_by_side, side_by_side.shape[1] // size)))
        return scipy.sparse.csr_array(scipy.sparse.block_diag(matrices))

    @cached_property
    def colour(self) -> Any:
        """The whitener's inverse: from standard normal numbers to noise."""
        return scipy.sparse.csr_array(scipy.sparse.linalg.inv(scipy.sparse.csc_array(self.whitener)))

    @property
    def _own_count(self) -> int:
        return sum(len(sensor.nuisances) for sensor in self.sensors)

    def _joint(self, values: Any, own: Any) -> JointReadings:
        # The readings at parameters and start `values` (numbers or symbols).
        size = len(self._robot.parameters)
        inputs = ca.MX(ca.DM(self._trajectory.inputs))
        values = ca.MX(ca.DM(values)) if isinstance(values, np.ndarray) else values
        drive = roll_out(
            self._robot,
            self._integration,
            inputs=inputs,
            start=ca.reshape(values[size:], len(self._robot.states), self._trajectory.runs).T,
            parameters=values[:size],
            period=ca.MX(self._trajectory.period),
            runs=self._trajectory.runs,
        )
        return joint_readings(self.sensors, drive, own)

    @cached_property
    def _functions(self) -> tuple[ca.Function, ca.Function]:
        unknowns = ca.MX.sym("unknowns", len(self._places) + self._own_count)
        values = ca.MX(ca.DM(self._nominal))
        values[self._places] = unknowns[: len(self._places)]
        joint = self._joint(values, unknowns[len(self._places) :])
        own = range(joint.leading, joint.leading + len(joint.nuisances))
        slope = joint.jacobian[:, [*self._places, *own]]
        functions = (
            ca.Function("response", [unknowns], [joint.response]),
            ca.Function("slope", [unknowns], [ca.densify(slope)]),
        )
        # Written out, a call is five times as fast; very long drives stay compact.
        written_out = self._trajectory.samples <= WRITTEN_OUT
        return (functions[0].expand(), functions[1].expand()) if written_out else functions

    def __getstate__(self) -> dict[str, Any]:
        """What workers need: compiled functions are made again there."""
        return {key: value for key, value in vars(self).items() if key != "_functions"}
