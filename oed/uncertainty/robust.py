"""Drives that keep to the room whatever the robot turns out to be: limits on the path, tightened.

The nominal optimum rides its limits; a robot with other parameters leaves them. Each limit on the path is
tightened by how far its distance moves with the parameters, through the sensitivities of the path.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, log
from typing import Annotated, Literal

import casadi as ca
import numpy as np
import numpy.typing as npt
import scipy
from pydantic import Field, model_validator

from oed.foundation.component import Component
from oed.foundation.quantities import Ratio
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.limit import ROUNDED, Limit, PathLimit, Rows
from oed.robots.models.model import Model
from oed.uncertainty.uncertainty import Spread

Array = npt.NDArray[np.float64]

SAFER = 1.15
"""Factor on the reserve where draws have shown too many robots to leave."""
ADDED = 2
"""Worst draws added at a time."""


class Robust(Component):
    """How a drive is kept within its limits for all robots that may be.

    Attributes:
        kind: "chance": `beta` standard deviations of every limit's distance in reserve. "tube": the farthest
            that the distance moves, to first order, within all ranges together. "scenarios": nothing in
            reserve, but the limits kept by robots at the corners of the ranges as well: for ranges so wide
            that first order means nothing.
        confidence: least probability of keeping all limits for the whole drive, by simulation.
        objective: what the design maximises: the criterion of the "nominal" robot, its "mean" over robots
            of the uncertainty's covariance, or that of the "worst" of the nominal robot and those at
            either end of one of the ranges.
        draws: robots simulated to find that probability.
        beta: reserve in standard deviations; from the confidence if None. Raised until draws keep the limits.
        kept: values of the uncertain quantities, SI, with which the limits are to be kept as well; of a tube
            and of scenarios the worst draws are added.
        compare: whether to search without all this too, to say what it costs.
    """

    kind: Literal["chance", "tube", "scenarios"] = "chance"
    confidence: Annotated[Ratio, Field(ge=0.5, lt=1)] = 0.99
    objective: Literal["nominal", "mean", "worst"] = "nominal"
    draws: Annotated[int, Field(ge=100, le=10_000_000)] = 10_000
    beta: Annotated[float, Field(gt=0)] | None = None
    kept: tuple[tuple[float, ...], ...] = ()
    compare: bool = True

    @model_validator(mode="after")
    def _draws_that_can_show_it(self) -> Robust:
        needed = ceil(log(0.025) / log(self.confidence))
        if self.draws < needed:
            raise ValueError(f"a confidence of {self.confidence:g} takes {needed} draws or more to show")
        return self

    @property
    def reach(self) -> float:
        """The reserve in standard deviations; by default that of one normal distance, two-sided."""
        return float(scipy.special.ndtri((1 + self.confidence) / 2)) if self.beta is None else self.beta

    def safer(self, worst: Array) -> Robust:
        """More careful, after draws of which `worst` (K, q) left farthest."""
        if self.kind == "chance":
            return self.model_copy(update={"beta": SAFER * self.reach})
        added = tuple(tuple(float(value) for value in values) for values in worst[:ADDED])
        return self.model_copy(update={"kept": (*self.kept, *added)})

    def scenarios(self, spread: Spread) -> Array:
        """Values (K, q) with which the limits are kept besides the nominal ones."""
        kept = np.reshape(np.array(self.kept, dtype=float), (-1, len(spread.names)))
        return np.vstack([spread.extremes(self.reach), kept]) if self.kind == "scenarios" else kept

    def judged(self, spread: Spread) -> Array:
        """Values (K, q) of the robots whose criterion is averaged, or the worst of which counts."""
        if self.objective == "nominal":
            return spread.nominal[None, :]
        if self.objective == "mean":
            return spread.moments()
        return np.vstack([spread.nominal, spread.ends(self.reach)])

    def together(self, values: Sequence[float | Array]) -> Array:
        """One number (...,) of the criterion's (...,) for each of those robots."""
        table = np.array(values, dtype=float)
        return np.asarray(table.mean(axis=0) if self.objective == "mean" else table.min(axis=0))


def robust_rows(limits: Sequence[Limit], drive: Drive, spread: Spread, robust: Robust) -> list[Rows]:
    """Every limit on a drive; those on its path with their reserve, and for all robots to be kept."""
    begin, _ = drive.ends_of(drive.poses)
    values = robust.scenarios(spread)
    others = [
        drive.again(ca.DM(parameters), begin + ca.DM(shift), spread.robot)
        for parameters, shift in zip(spread.robots(values), spread.shifts(values), strict=True)
    ]
    own = drive
    if spread.robot != drive.model:
        # Seen through its coefficients, a robot would not tell by itself how its other parameters move it.
        own = drive.again(ca.DM(spread.robot.nominal), begin, spread.robot)
    return [
        _joined([reserved(limit, own, spread, robust), *(limit.rows(other) for other in others)])
        if isinstance(limit, PathLimit)
        else limit.rows(drive)
        for limit in limits
    ]


def reserved(limit: PathLimit, drive: Drive, spread: Spread, robust: Robust) -> Rows:
    """A limit on the path with its reserve, on a drive of the spread's robot."""
    rows = limit.rows(drive)
    if robust.kind == "scenarios":
        return rows
    reserve = _reserve(limit, drive, spread, robust, rows.size)
    below, above = np.isfinite(rows.lower), np.isfinite(rows.upper)
    sides = [
        ca.vec(rows.expression + sign * reserve)[np.flatnonzero(one).tolist()]
        for sign, one in ((1, above), (-1, below))
        if one.any()
    ]
    high, low = int(above.sum()), int(below.sum())
    return Rows(
        ca.vertcat(*sides),
        np.concatenate([np.full(high, -np.inf), rows.lower[below]]),
        np.concatenate([rows.upper[above], np.full(low, np.inf)]),
        rows.size,
        rows.unit,
    )


def _reserve(limit: PathLimit, drive: Drive, spread: Spread, robust: Robust, size: float) -> Expression:
    # One amount for every row of the limit, in their order.
    model, points = drive.model, drive.path.shape[0] // drive.runs
    width = len(model.parameters) + len(model.states)
    parts = []
    for run in range(drive.runs):
        moved = _moved(limit, model, spread, robust, size, drive.first_run + run).map(points)
        path = drive.path[run * points : (run + 1) * points, :].T
        slopes = drive.path_sensitivities[:, run * points * width : (run + 1) * points * width]
        parts.append(moved(path, slopes))
    return ca.vec(ca.horzcat(*parts).T)


def _moved(
    limit: PathLimit, model: Model, spread: Spread, robust: Robust, size: float, run: int
) -> ca.Function:
    # How far the rows of one point move with the robot, given the point and its sensitivities.
    states, parameters = len(model.states), len(model.parameters)
    point, slopes = ca.SX.sym("point", states), ca.SX.sym("S", states, parameters + states)
    by_quantity = slopes[:, :parameters] @ _sparse(spread.parameter_slopes) + slopes[
        :, parameters:
    ] @ _sparse(spread.start_slopes(run))
    distances = limit.rows_at(point.T, model).expression
    moves = ca.jacobian(distances, point) @ by_quantity
    soft = ROUNDED * size
    if robust.kind == "chance":
        factor = np.linalg.cholesky(spread.covariance)
        amount = _rounded(robust.reach * (moves @ ca.DM(factor)), soft)
    else:
        widest = spread.half_widths(robust.reach)
        each = [
            _rounded(moves[:, index] * float(widest[index]), soft / len(widest))
            for index in range(len(widest))
        ]
        amount = sum(each[1:], each[0])
    return ca.Function("moved", [point, slopes], [ca.densify(amount)])


def _rounded(rows: Expression, soft: float) -> Expression:
    # The length of every row; rounded at 0, for optimisers, where nothing moves yet.
    return ca.sqrt(ca.sum2(rows**2) + soft**2) - soft


def _sparse(matrix: Array) -> ca.DM:
    return ca.sparsify(ca.DM(matrix))


def _joined(rows: Sequence[Rows]) -> Rows:
    return Rows(
        ca.vertcat(*(one.expression for one in rows)),
        np.concatenate([one.lower for one in rows]),
        np.concatenate([one.upper for one in rows]),
        rows[0].size,
        rows[0].unit,
    )
