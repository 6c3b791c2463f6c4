"""Robust drives: limits on the path with a back-off for uncertain parameters.

The nominal optimum touches its limits, so a robot with different parameters violates them. Each limit on the
path is tightened by the change of its distance with the parameters, from the sensitivities of the path.
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
from oed.uncertainty.uncertainty import (
    UncertainQuantities,
    impossible_system_message,
    require_spread,
    spread_of,
)

TIGHTER = 1.15
"""Factor on the back-off after draws with too many violations."""
ADDED = 2
"""Number of worst draws added at a time."""
NOTHING_UNCERTAIN = (
    "needs to know what is uncertain: add `uncertainty: {track: 5 %}`, or a prior of its parameters"
)
"""Message for robust studies without an uncertainty or a prior."""
OTHER_PARAMETERS = "the criterion of other robots is of their own parameters: omit `estimate`, or be nominal"
"""Message for objectives over robots whose parameters are not those to estimate."""


class Robust(Tightening):
    """Treatment of the limits that keeps a drive feasible for uncertain robots.

    Attributes:
        kind: "chance": a back-off of `beta` standard deviations of every limit's distance. "scenarios": no
            back-off; instead robots at the corners of the ranges satisfy the limits too, for ranges too wide
            for a linearisation.
        confidence: least probability of satisfying all limits for the whole drive, by simulation.
        objective: objective of the design: the criterion of the "nominal" robot, its "mean" over robots
            of the uncertainty's covariance, or that of the "worst" of the nominal robot and those at
            either end of one of the ranges.
        draws: number of robots simulated to verify that probability.
        beta: back-off in standard deviations; from the confidence if None. Raised until draws satisfy
            the limits.
        added_scenarios: further values of the uncertain quantities, SI, that have to satisfy the limits;
            with kind "scenarios" the worst draws are added. Named `kept` in files.
        compare: True to search without robustness as well, for comparison.
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
        """Return the number of drives that draws can test with a simultaneous confidence interval.

        Args:
            most: requested number of drives.
        """
        # The interval of zero violations has to lie below the allowed probability.
        room = log(TAIL) - self.draws * log(self.confidence)
        return most if room >= log(most) else max(1, int(exp(room)))

    @property
    def reach(self) -> float:
        """Back-off in standard deviations; by default the two-sided normal quantile of the confidence."""
        if self.beta is not None:
            return self.beta
        # Imported here to keep other imports fast.
        import scipy

        return float(scipy.special.ndtri((1 + self.confidence) / 2))

    @property
    def backs_off(self) -> bool:
        """True if limits have a back-off; False if scenarios satisfy them instead."""
        return self.kind != "scenarios"

    def tighter(self, worst: Array) -> Robust:
        """Return a tighter treatment, after draws whose largest violations were at values `worst` (K, q)."""
        if self.kind == "chance":
            return self.model_copy(update={"beta": TIGHTER * self.reach})
        added = tuple(tuple(float(value) for value in values) for values in worst[:ADDED])
        return self.model_copy(update={"added_scenarios": (*self.added_scenarios, *added)})

    def issues(self, system: UncertainSystem) -> list[Issue]:
        """Return the contradictions to a system.

        They are: no uncertainty, impossible robots, an objective over parameters that are not estimated, and
        values of the wrong number of quantities.
        """
        spread = spread_of(system)
        if spread is None:
            return [Issue(("robust",), NOTHING_UNCERTAIN)]
        if system.uncertainty is None and (text := impossible_system_message(spread, system)):
            return [Issue(("prior",), text)]
        if self.objective != "nominal" and spread.system != system.estimated:
            return [Issue(("robust", "objective"), OTHER_PARAMETERS)]
        if any(len(values) != len(spread.names) for values in self.added_scenarios):
            text = f"expected {len(spread.names)} values each ({', '.join(spread.names)})"
            return [Issue(("robust", "kept"), text)]
        return []

    def backed_off(self, limit: PathLimit, drive: Drive, system: UncertainSystem) -> Rows:
        """Return the rows of a limit on the path with its back-off, on a drive of the spread's robot."""
        rows = limit.rows(drive)
        return rows.backed_off(_back_off(limit, drive, require_spread(system), self, rows.size))

    def scenarios(self, system: UncertainSystem) -> Scenarios:
        """Return the scenarios at the corners of the ranges, and the added ones."""
        spread = require_spread(system)
        added = np.reshape(np.array(self.added_scenarios, dtype=float), (-1, len(spread.names)))
        return spread.scenarios(
            np.vstack([spread.extremes(self.reach), added]) if self.kind == "scenarios" else added
        )

    def judged(self, system: UncertainSystem) -> Scenarios:
        """Return the scenarios whose mean or worst criterion is the objective."""
        spread = require_spread(system)
        return spread.scenarios(
            spread.moments()
            if self.objective == "mean"
            else np.vstack([spread.nominal, spread.ends(self.reach)])
        )


def _back_off(
    limit: PathLimit, drive: Drive, spread: UncertainQuantities, robust: Robust, size: float
) -> Expression:
    # Back-off of every row of the limit.
    points = drive.path.shape[0] // drive.runs
    width = len(spread.system.parameters) + len(spread.system.states)
    parts = []
    for run in range(drive.runs):
        amount = _back_off_function(limit, spread, robust, size, drive.first_run + run).map(points)
        path = drive.path[run * points : (run + 1) * points, :].T
        slopes = drive.path_sensitivities[:, run * points * width : (run + 1) * points * width]
        parts.append(amount(path, slopes))
    return ca.vec(ca.horzcat(*parts).T)


def _back_off_function(
    limit: PathLimit, spread: UncertainQuantities, robust: Robust, size: float, run: int
) -> ca.Function:
    # Back-off of the rows at a point as a function of the point and its sensitivities.
    system = spread.system
    states, parameters = len(system.states), len(system.parameters)
    point, slopes = ca.SX.sym("point", states), ca.SX.sym("S", states, parameters + states)
    by_quantity = slopes[:, :parameters] @ _sparse(spread.parameter_slopes) + slopes[
        :, parameters:
    ] @ _sparse(spread.start_slopes(run))
    distances = limit.rows_at(point.T, system).expression
    moves = ca.jacobian(distances, point) @ by_quantity
    deviations = robust.reach * (moves @ ca.DM(np.linalg.cholesky(spread.covariance)))
    # Rounded at 0 for a finite slope at the start, where nothing depends on the parameters yet.
    soft = ROUNDED * size
    amount = ca.sqrt(ca.sum2(deviations**2) + soft**2) - soft
    return ca.Function("moved", [point, slopes], [ca.densify(amount)])


def _sparse(matrix: Array) -> ca.DM:
    return ca.sparsify(ca.DM(matrix))
