"""The design as stages, one for each segment: what is handed on from stage to stage are unknowns.

What a stage asks of its splines are few neighbouring coefficients. Those that the next stage asks for as well
are handed on to it, so that every row is of one stage and what it hands on, as fatrop has them. The sum over
segments that the criterion is of has to be handed on too: as many states more as the matrix has entries.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from benchmarks.forms import SEGMENTS
from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics import spline
from oed.kernel.dynamics.rollout import roll_out
from oed.kernel.dynamics.trajectory import bounding_values, middles
from oed.kernel.problem import Problem
from oed.robots.sensors import Displacements

STATES = 3
"""Of a pose."""


@dataclass(frozen=True)
class Rates:
    """Rows of a stage that are linear in its window.

    Attributes:
        slopes: (rows, 2 w).
        lower, upper: bounds.
    """

    slopes: Array
    lower: Array
    upper: Array


@dataclass(frozen=True)
class Layout:
    """Where what is whose.

    Attributes:
        windows: coefficients that each stage looks at, neighbours.
        entries: of the information.
        auxiliary: unknowns of the criterion.
    """

    windows: tuple[Places, ...]
    entries: int
    auxiliary: int

    @cached_property
    def carried(self) -> list[int]:
        """How many of its coefficients each stage takes over from the one before."""
        ends = [own[-1] + 1 for own in self.windows]
        return [0, *(int(end - own[0]) for end, own in zip(ends, self.windows[1:], strict=False))]

    @property
    def states(self) -> list[int]:
        """Of each stage and the end; the start is known."""
        own = STATES + self.entries
        return [0, *(own + 2 * int(count) for count in self.carried[1:]), own]

    @property
    def controls(self) -> list[int]:
        """Of each stage, and the criterion's unknowns."""
        new = zip(self.windows, self.carried, strict=True)
        return [*(2 * (len(own) - count) for own, count in new), self.auxiliary]

    @property
    def width(self) -> int:
        """Coefficients of the widest window, w."""
        return max(map(len, self.windows))

    @cached_property
    def begins(self) -> list[int]:
        """Place of each stage's first unknown, and of the end's."""
        sizes = np.add(self.states, self.controls)
        return [0, *np.cumsum(sizes)[:-1].tolist()]

    @property
    def size(self) -> int:
        """All unknowns."""
        return sum(self.states) + sum(self.controls)

    def window(self, stage: int) -> Places:
        """Places of a stage's coefficients, wheels of each side by side."""
        first = self.begins[stage] + (STATES + self.entries if stage else 0)
        return first + np.arange(2 * len(self.windows[stage]))

    def pose(self, stage: int) -> Places:
        """Places of the pose that a stage begins with; of the first it is known, and -1."""
        return self.begins[stage] + np.arange(STATES) if stage else np.full(STATES, -1)

    def information(self, stage: int) -> Places:
        """Places of the information before a stage; of the first, -1."""
        first = self.begins[stage] + STATES
        return first + np.arange(self.entries) if stage else np.full(self.entries, -1)


class Stages:
    """The program, and what it is made of.

    Args:
        problem: measured by segments, with limits on speeds, accelerations and the room.
        instants: samples at which the room is looked at.
        scale: that information is divided by.
    """

    def __init__(self, problem: Problem, instants: Places, scale: float) -> None:
        """Sort what is whose."""
        assert isinstance(problem.measurement, Displacements)
        own = problem.measurement.model_copy(update={"segments": 1})
        self.problem, self.scale = replace(problem, measurement=own), scale
        self.samples = count = problem.design.samples // SEGMENTS
        self.limits = {limit.name: limit for limit in problem.limits}
        self.largest = np.abs(problem.input_bounds).max(axis=1)
        size = len(problem.any_estimations[0].judged)
        self.upper = np.triu_indices(size)
        self.entries = ca.SX.sym("entries", len(self.upper[0]))
        matrix = ca.SX.zeros(size, size)
        for place, (row, column) in enumerate(zip(*self.upper, strict=True)):
            matrix[int(row), int(column)] = matrix[int(column), int(row)] = self.entries[place]
        self.criterion = problem.objective.epigraph([matrix])
        self.layout = Layout(self._windows(), self.entries.shape[0], self.criterion.variables.shape[0])
        each = [instants - stage * count for stage in range(SEGMENTS)]
        self.instants = [own[(own > 0) & (own <= count)] for own in each]
        self.slots = max(len(own) for own in self.instants)
        self.rates = list(self._rates())

    @property
    def sampling(self) -> Array:
        """Matrix (N, n) that takes coefficients to the inputs held in each period."""
        space = self.problem.design
        times = middles(space.duration, space.samples)
        return spline.values(space.knots, space.spline.degree, np.eye(space.all_coefficients), times)

    def _windows(self) -> tuple[Places, ...]:
        space = self.problem.design
        table = np.abs(self.sampling).reshape(SEGMENTS, self.samples, -1).max(axis=1)
        return tuple(np.intersect1d(np.nonzero(own)[0], space.free_rows) for own in table)

    @cached_property
    def stage(self) -> ca.Function:
        """(pose, window (2 w,), (n, w) of the splines, (slots, n) of the instants) -> what follows: pose,
        further information, rows of the room.
        """
        given, following = self._stage
        return ca.Function("stage", given, [following])

    @cached_property
    def slopes(self) -> ca.Function:
        """(the same) -> what follows, and its derivatives by pose and window that are not 0."""
        given, following = self._stage
        table = ca.jacobian(following, ca.vertcat(*given[:2]))
        self.pattern = table.sparsity()
        return ca.Function("slopes", given, [following, _nonzeros(table)])

    @cached_property
    def curvature(self) -> ca.Function:
        """(the same, multipliers of what follows) -> second derivatives of the sum that are not 0."""
        given, following = self._stage
        multipliers = ca.SX.sym("multipliers", following.shape[0])
        table, _ = ca.hessian(ca.dot(multipliers, following), ca.vertcat(*given[:2]))
        self.bent = table.sparsity()
        return ca.Function("curvature", [*given, multipliers], [_nonzeros(table)])

    @cached_property
    def _stage(self) -> tuple[list[ca.SX], ca.SX]:
        problem, width = self.problem, self.layout.width
        pose, window = ca.SX.sym("pose", STATES), ca.SX.sym("window", 2 * width)
        splines = ca.SX.sym("splines", self.samples, width)
        instants = ca.SX.sym("instants", self.slots, self.samples)
        drive = roll_out(
            problem.system,
            inputs=splines @ ca.reshape(window, 2, width).T @ ca.diag(ca.DM(self.largest)),
            start=pose,
            parameters=ca.SX(ca.DM(problem.system.nominal)),
            period=ca.SX(problem.design.period),
        )
        matrix = sum(one.matrix for one in problem.estimations(drive)) / self.scale
        further = ca.vertcat(*(matrix[int(i), int(j)] for i, j in zip(*self.upper, strict=True)))
        rows = self.limits["workspace"].rows(replace(drive, path=instants @ drive.path[1:, :]))
        room = ca.reshape(rows.expression / rows.size, self.slots, -1)
        self.room_bounds = [
            np.reshape(one / rows.size, room.shape, order="F") for one in (rows.lower, rows.upper)
        ]
        following = ca.vertcat(drive.states[-1, :].T, further, ca.vec(room))
        return [pose, window, splines, instants], ca.densify(following)

    def _rates(self) -> Iterator[Rates]:
        # Rows of accelerations are linear in neighbouring coefficients: each is of the first stage with both.
        space = self.problem.design
        table = ca.SX.sym("coefficients", 2, space.all_coefficients)
        identity = np.eye(space.all_coefficients)
        rates = bounding_values(space.knots, space.spline.degree, identity, space.samples, 1)
        drive = roll_out(
            self.problem.system,
            inputs=ca.SX(self.samples, 2),
            start=ca.SX(STATES, 1),
            parameters=ca.SX(ca.DM(self.problem.system.nominal)),
            period=ca.SX(space.period),
            input_rates=ca.DM(rates) @ table.T @ ca.diag(ca.DM(self.largest)),
        )
        rows = self.limits["wheel_acceleration"].rows(drive)
        whole = np.array(ca.evalf(ca.jacobian(ca.vec(rows.expression), ca.vec(table)))) / rows.size
        free = np.repeat(np.isin(np.arange(space.all_coefficients), space.free_rows), 2)
        asked = [set(np.nonzero(row)[0] // 2) for row in whole * free]
        owner = np.array(
            [next(k for k, own in enumerate(self.layout.windows) if one <= set(own)) for one in asked]
        )
        for stage, own in enumerate(self.layout.windows):
            chosen = owner == stage
            columns = (2 * own[:, None] + np.arange(2)).ravel()
            yield Rates(
                whole[chosen][:, columns], rows.lower[chosen] / rows.size, rows.upper[chosen] / rows.size
            )


def _nonzeros(table: ca.SX) -> ca.SX:
    return ca.vertcat(*table.nonzeros())
