"""Drives that keep to the room whatever the robot turns out to be: limits on the path, tightened.

The nominal optimum rides its limits; a robot with other parameters violates them. Each limit on the path is
tightened by how far its distance moves with the parameters, through the sensitivities of the path.
"""

from __future__ import annotations

from math import ceil, exp, log
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from pydantic import ConfigDict, Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from oed.foundation.arrays import Array
from oed.foundation.errors import Issue
from oed.foundation.quantities import Ratio
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.limit import ROUNDED, PathLimit, Rows
from oed.kernel.solution import TAIL
from oed.kernel.tightening import Scenarios, Tightening, UncertainSystem
from oed.uncertainty.uncertainty import Spread, given_spread, impossible, spread_of

TIGHTER = 1.15
"""Factor on the back-off where draws have shown too many violations."""
ADDED = 2
"""Worst draws added at a time."""
NOTHING_UNCERTAIN = (
    "needs to know what is uncertain: add `uncertainty: {track: 5 %}`, or a prior of its parameters"
)
"""Why a study that says nothing of what is uncertain cannot be robust."""
OTHER_PARAMETERS = "the criterion of other robots is of their own parameters: omit `estimate`, or be nominal"
"""Why the objective cannot be of other robots."""


class Robust(Tightening):
    """How a drive is kept within its limits for all robots that may be.

    Attributes:
        kind: "chance": a back-off of `beta` standard deviations of every limit's distance. "scenarios": no
            back-off, but the limits satisfied by robots at the corners of the ranges too: for ranges so wide
            that first order means nothing.
        confidence: least probability of satisfying all limits for the whole drive, by simulation.
        objective: what the design maximises: the criterion of the "nominal" robot, its "mean" over robots
            of the uncertainty's covariance, or that of the "worst" of the nominal robot and those at
            either end of one of the ranges.
        draws: robots simulated to find that probability.
        beta: back-off in standard deviations; from the confidence if None. Raised until draws satisfy
            the limits.
        added_scenarios: values of the uncertain quantities, SI, with which the limits are to be satisfied as
            well; of scenarios the worst draws are added. In files `kept`.
        compare: whether to search without all this too, to say what it costs.
    """

    model_config = ConfigDict(populate_by_name=True)

    kind: Literal["chance", "scenarios"] = "chance"
    confidence: Annotated[Ratio, Field(ge=0.5, lt=1)] = 0.99
    draws: Annotated[int, Field(ge=100, le=10_000_000)] = 10_000
    beta: Annotated[float, Field(gt=0)] | None = None
    added_scenarios: Annotated[tuple[tuple[float, ...], ...], Field(alias="kept")] = ()
    compare: bool = True

    @model_serializer(mode="wrap")
    def _as_files_have_it(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data = plain(self)
        return {"kept" if key == "added_scenarios" else key: data[key] for key in data}

    @model_validator(mode="after")
    def _draws_that_can_show_it(self) -> Robust:
        needed = ceil(log(TAIL) / log(self.confidence))
        if self.draws < needed:
            raise ValueError(f"a confidence of {self.confidence:g} takes {needed} draws or more to show")
        return self

    def verifications(self, most: int) -> int:
        """On how many drives draws can be tried, and one of them be shown to satisfy the limits.

        Args:
            most: that are asked for.
        """
        # As often as the interval of no violation at all still lies below what is allowed.
        room = log(TAIL) - self.draws * log(self.confidence)
        return most if room >= log(most) else max(1, int(exp(room)))

    @property
    def reach(self) -> float:
        """The back-off in standard deviations; by default that of one normal distance, two-sided."""
        if self.beta is not None:
            return self.beta
        # Loaded by those who ask.
        import scipy

        return float(scipy.special.ndtri((1 + self.confidence) / 2))

    @property
    def backs_off(self) -> bool:
        """Whether limits have a back-off; else other robots satisfy them."""
        return self.kind != "scenarios"

    def tighter(self, worst: Array) -> Robust:
        """Limits tightened further, after draws of which `worst` (K, q) violated them most."""
        if self.kind == "chance":
            return self.model_copy(update={"beta": TIGHTER * self.reach})
        added = tuple(tuple(float(value) for value in values) for values in worst[:ADDED])
        return self.model_copy(update={"added_scenarios": (*self.added_scenarios, *added)})

    def issues(self, system: UncertainSystem) -> list[Issue]:
        """Nothing uncertain, robots that cannot be, an objective of parameters that are not estimated, values
        of other quantities.
        """
        spread = spread_of(system)
        if spread is None:
            return [Issue(("robust",), NOTHING_UNCERTAIN)]
        if system.uncertainty is None and (text := impossible(spread, system)):
            return [Issue(("prior",), text)]
        if self.objective != "nominal" and spread.system != system.estimated:
            return [Issue(("robust", "objective"), OTHER_PARAMETERS)]
        if any(len(values) != len(spread.names) for values in self.added_scenarios):
            text = f"expected {len(spread.names)} values each ({', '.join(spread.names)})"
            return [Issue(("robust", "kept"), text)]
        return []

    def backed_off(self, limit: PathLimit, drive: Drive, system: UncertainSystem) -> Rows:
        """A limit on the path with its back-off, on a drive of the spread's robot."""
        rows = limit.rows(drive)
        return rows.backed_off(_back_off(limit, drive, given_spread(system), self, rows.size))

    def scenarios(self, system: UncertainSystem) -> Scenarios:
        """Robots at the corners of the ranges, and those added."""
        spread = given_spread(system)
        added = np.reshape(np.array(self.added_scenarios, dtype=float), (-1, len(spread.names)))
        return spread.scenarios(
            np.vstack([spread.extremes(self.reach), added]) if self.kind == "scenarios" else added
        )

    def judged(self, system: UncertainSystem) -> Scenarios:
        """Robots whose criterion is averaged, or the worst of which counts."""
        spread = given_spread(system)
        return spread.scenarios(
            spread.moments()
            if self.objective == "mean"
            else np.vstack([spread.nominal, spread.ends(self.reach)])
        )


def _back_off(limit: PathLimit, drive: Drive, spread: Spread, robust: Robust, size: float) -> Expression:
    # One amount for every row of the limit, in their order.
    points = drive.path.shape[0] // drive.runs
    width = len(spread.system.parameters) + len(spread.system.states)
    parts = []
    for run in range(drive.runs):
        moved = _moved(limit, spread, robust, size, drive.first_run + run).map(points)
        path = drive.path[run * points : (run + 1) * points, :].T
        slopes = drive.path_sensitivities[:, run * points * width : (run + 1) * points * width]
        parts.append(moved(path, slopes))
    return ca.vec(ca.horzcat(*parts).T)


def _moved(limit: PathLimit, spread: Spread, robust: Robust, size: float, run: int) -> ca.Function:
    # How far the rows of one point move with the robot, given the point and its sensitivities.
    system = spread.system
    states, parameters = len(system.states), len(system.parameters)
    point, slopes = ca.SX.sym("point", states), ca.SX.sym("S", states, parameters + states)
    by_quantity = slopes[:, :parameters] @ _sparse(spread.parameter_slopes) + slopes[
        :, parameters:
    ] @ _sparse(spread.start_slopes(run))
    distances = limit.rows_at(point.T, system).expression
    moves = ca.jacobian(distances, point) @ by_quantity
    deviations = robust.reach * (moves @ ca.DM(np.linalg.cholesky(spread.covariance)))
    # Rounded at 0, for optimisers, where nothing moves yet.
    soft = ROUNDED * size
    amount = ca.sqrt(ca.sum2(deviations**2) + soft**2) - soft
    return ca.Function("moved", [point, slopes], [ca.densify(amount)])


def _sparse(matrix: Array) -> ca.DM:
    return ca.sparsify(ca.DM(matrix))
