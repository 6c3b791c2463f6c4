"""The periods of drives, each by how it begins, and parts of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.models.model import Integration, Model
from oed.rollout import roll_out
from oed.trajectory import Trajectory

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Periods:
    """The periods of one drive, or of many robots with the same inputs, each by how it begins.

    Attributes:
        trajectory: whose inputs are held.
        states: at their begin, (drives * N, states), drive by drive.
        parameters: of the robots, (drives, p).
        sensitivities: of those states, by columns, (drives * N, s); s = 0 where nobody asks for them.
    """

    trajectory: Trajectory
    states: Array
    parameters: Array
    sensitivities: Array

    @cached_property
    def held(self) -> Array:
        """Inputs held in each period of a drive, (N, inputs)."""
        return self.trajectory.inputs

    @property
    def drives(self) -> int:
        """How many."""
        return len(self.parameters)

    @cached_property
    def table(self) -> Array:
        """All that is known of each period's begin, (drives * N, ...): its state, inputs, parameters,
        sensitivities, and the sample period.
        """
        rows = np.arange(len(self.states))
        parts = [self.states, self.held[self.place_of(rows)], self.parameters[self.drive_of(rows)]]
        return np.hstack([*parts, self.sensitivities, np.full((len(rows), 1), self.trajectory.period)])

    def drive_of(self, rows: Places) -> Places:
        """The drives that periods belong to."""
        return np.asarray(rows // self.trajectory.samples)

    def place_of(self, rows: Places) -> Places:
        """Which of their drive's periods they are."""
        return np.asarray(rows % self.trajectory.samples)


@dataclass(frozen=True)
class Stretches:
    """Parts of periods: from a fraction of a period to another.

    Attributes:
        row: of the period, (K,).
        begin, end: fractions, (K,).
    """

    row: Places
    begin: Array
    end: Array

    def __len__(self) -> int:
        """K."""
        return len(self.row)

    def chosen(self, which: Any) -> Stretches:
        """Some of them."""
        return Stretches(self.row[which], self.begin[which], self.end[which])

    def cut(self, parts: int) -> Stretches:
        """So many equal ones of each."""
        edges = self.begin + (self.end - self.begin) * np.linspace(0, 1, parts + 1)[:, None]
        return Stretches(np.tile(self.row, parts), edges[:-1].ravel(), edges[1:].ravel())


def periods_of(
    model: Model,
    integration: Integration,
    trajectory: Trajectory,
    parameters: Array,
    starts: Array,
    *,
    sensitive: bool = False,
) -> Periods:
    """The periods of robots with parameters (drives, p) from starts (drives, runs, states)."""
    count, states = len(parameters), len(model.states)
    function = _rolled(model, integration, trajectory.samples, trajectory.runs, sensitive)
    mapped = function.map("robots", "serial", count, [0, 1], []) if count > 1 else function
    begun = starts.transpose(1, 0, 2).reshape(trajectory.runs, -1)
    poses, slopes = mapped(trajectory.inputs, trajectory.period, parameters.T, begun)
    table = np.array(poses).reshape(trajectory.samples, count, states).transpose(1, 0, 2)
    width = len(model.parameters) + states if sensitive else 0
    wide = np.array(slopes).reshape(states, count * trajectory.samples, width).transpose(1, 2, 0)
    return Periods(trajectory, table.reshape(-1, states), parameters, wide.reshape(count * len(table[0]), -1))


@lru_cache(maxsize=16)
def _rolled(model: Model, integration: Integration, samples: int, runs: int, sensitive: bool) -> ca.Function:
    # (inputs, period, parameters, starts) -> states at the begin of every period, and their sensitivities.
    inputs, period = ca.MX.sym("inputs", samples, len(model.inputs)), ca.MX.sym("period")
    parameters = ca.MX.sym("parameters", len(model.parameters))
    start = ca.MX.sym("start", runs, len(model.states))
    drive = roll_out(
        model, integration, inputs=inputs, start=start, parameters=parameters, period=period, runs=runs
    )
    states, width = len(model.states), len(model.parameters) + len(model.states)
    columns = (np.array(drive.begins)[:, None] * width + np.arange(width)).ravel().tolist()
    slopes = drive.sensitivities[:, columns] if sensitive else ca.MX(states, 0)
    return ca.Function("rolled", [inputs, period, parameters, start], [drive.poses[drive.begins, :], slopes])
