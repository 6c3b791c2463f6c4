"""A result of a record: a drive of a search or of a baseline, with all that is known of it."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from oed.foundation.arrays import Array
from oed.foundation.presenting import Card, Presented, given, number
from oed.foundation.shown import shown
from oed.foundation.text import listing, size_text, words
from oed.kernel.dynamics.trajectory import Trajectory
from oed.records.stored.parts import (
    Column,
    Count,
    Name,
    Number,
    Numbers,
    Positive,
    Rounded,
    Seconds,
    Seed,
    Size,
    Sizes,
    Stored,
    require_alike,
    require_table,
)
from oed.records.stored.selection import StoredSelection

DEGREE = 7
"""Of splines, at most."""
NUMBERS = (
    "objective",
    "lambda_min",
    "lambda_max",
    "condition_number",
    "smallest_singular_value",
    "norm_y",
    "path_length",
)
"""Of an evaluation, each a number of a result."""
ROUNDING = 1e-6
"""Share by which two eigenvalues that are one may differ: each is computed in its own way."""

SINGULAR = 1e-9
"""Share of the largest eigenvalue below which the smallest one counts as 0, in records that do not say so."""


class StoredDrive(Stored):
    """A drive's exact splines, and its poses at the samples."""

    degree: Annotated[int, Field(ge=0, le=DEGREE)]
    knots: list[Size]
    coefficients: Annotated[Sizes, Field(min_length=1)]
    start: list[Size] | Sizes
    samples: Annotated[int, Field(ge=1)]
    runs: Annotated[int, Field(ge=1)] = 1
    poses: Annotated[Sizes, Rounded(9)]
    weights: list[Positive] | None = None

    @property
    def trajectory(self) -> Trajectory:
        """Its splines."""
        return Trajectory(
            np.array(self.knots),
            self.degree,
            np.array(self.coefficients),
            np.array(self.start),
            self.samples,
            self.runs,
            None if self.weights is None else np.array(self.weights),
        )

    @property
    def by_run(self) -> list[Array]:
        """The poses of every run at its samples, each (N + 1, states)."""
        return np.split(np.array(self.poses, dtype=float), self.runs)

    def _require(self) -> None:
        require_table("coefficients", self.coefficients, None, len(self.coefficients[0]))
        self._require_knots()
        if self.samples % self.runs:
            raise ValueError(f"samples: expected as many in each of {self.runs} runs, got {self.samples}")
        width = len(self.poses[0]) if self.poses else 3
        require_table("poses", self.poses, self.samples + self.runs, width)
        self._require_starts(width)

    def _require_knots(self) -> None:
        count = len(self.coefficients) + self.degree + 1
        if len(self.knots) != count:
            raise ValueError(f"knots: expected {count} of them, got {len(self.knots)}")
        falling = any(later < earlier for earlier, later in zip(self.knots, self.knots[1:], strict=False))
        if falling or not self.knots[0] < self.knots[-1]:
            raise ValueError("knots: expected times that rise")
        if self.knots[0] != 0:
            raise ValueError(f"knots: expected times from 0, got {self.knots[0]:g}")

    def _require_starts(self, width: int) -> None:
        rows = [one if isinstance(one, list) else [one] for one in self.start]
        nested = any(isinstance(one, list) for one in self.start)
        if nested:
            require_table("start", rows, self.runs, width)
        elif self.runs > 1 or len(self.start) != width:
            raise ValueError(f"start: expected {width} numbers of each of {self.runs} runs")


class Margin(Stored):
    """How much room a drive leaves to a limit; the gain is that of a `Solution`, None where not known."""

    limit: str
    margin: Number
    size: Positive
    unit: str
    active: bool
    satisfied: bool = Field(alias="kept")
    certain: bool | None = None
    gain: Number | None = None


class StartPoint(Stored):
    """What a search made of one of its starts."""

    objective: Number | None
    status: str
    wall_seconds: Seconds
    iterations: Count


class StoredExplored(Stored):
    """What a search with a budget spent, as `Explored`."""

    solves: Count
    iterations: Count
    samples: Count
    budget: Count
    spent: Positive


class Progress(Stored):
    """The best objective after so many evaluations."""

    evaluations: Count
    seconds: Seconds
    objective: Number | None


class Level(Stored):
    """A spline that a search with `coefficients: auto` went through, and what it reached on it."""

    coefficients: Annotated[int, Field(ge=1)]
    objective: Number | None
    iterations: Count


class PrecisionOverTime(Stored):
    """Standard deviations by the readings until some times of every run, as they are and if nothing drifted;
    SI, None where the parameter is not identified yet.
    """

    t: list[Positive]
    standard_deviations: dict[str, Column]
    steady_deviations: dict[str, Column]

    def _require(self) -> None:
        for each in (self.standard_deviations, self.steady_deviations):
            require_alike(len(self.t), **each)


class Covariance(Stored):
    """The predicted covariance of parameters that are identified together."""

    parameters: Annotated[list[str], Field(min_length=1)]
    covariance: list[list[Number | None]]

    def _require(self) -> None:
        require_table("covariance", self.covariance, len(self.parameters), len(self.parameters))
        known = [row[place] for place, row in enumerate(self.covariance)]
        if any(value is not None and value < 0 for value in known):
            raise ValueError("covariance: expected variances of at least 0")


class Result(Presented, Stored):
    """What a search, a baseline or a path of the user's own came to; SI, None where there is no number.

    Attributes:
        name, kind, criterion, status, message, wall_seconds, starts, stages, history, levels, seed: as a
            `Solution` has them.
        feasible, identifiable, singular, violations, objective, lambda_min, lambda_max, condition_number,
            smallest_singular_value, norm_y, path_length, singular_values, standard_deviations, covariances,
            margins: as an `Evaluation` has them.
        trajectory: name of the drive's CSV file.
        drive: the drive.
        criteria: what other criteria say of it, by their kinds.
        selection: which readings are taken, where they were chosen.
        steady_deviations: of a process that drifts, the standard deviations if it did not.
        usual_drift_deviations: of a robot without drift, the standard deviations if it drifted as robots
            usually do; {} where that is not scored, as in records of earlier versions.
        over_time: how both fall along the drive.
        explored: what a search with a budget spent, as a `Solution` has it.
    """

    name: Name
    kind: str
    criterion: str | None = None
    status: str
    message: str
    feasible: bool
    identifiable: bool | None = None
    singular: bool | None = None
    violations: dict[str, Number]
    objective: Number | None
    lambda_min: Number | None
    lambda_max: Number | None
    condition_number: Number | None
    smallest_singular_value: Number | None
    norm_y: Number | None
    path_length: Positive | None
    singular_values: Numbers
    standard_deviations: dict[str, Positive | None]
    covariances: list[Covariance] = Field(default_factory=list)
    margins: list[Margin] = Field(default_factory=list)
    wall_seconds: Seconds
    starts: list[StartPoint]
    stages: dict[str, Number | None]
    history: list[Progress] = Field(default_factory=list)
    levels: list[Level] = Field(default_factory=list)
    seed: Seed | None = None
    trajectory: Name | None
    drive: StoredDrive | None
    criteria: dict[str, Number | None] = Field(default_factory=dict)
    selection: StoredSelection | None = None
    steady_deviations: dict[str, Positive | None] = Field(default_factory=dict)
    usual_drift_deviations: dict[str, Positive | None] = Field(default_factory=dict)
    over_time: PrecisionOverTime | None = None
    explored: StoredExplored | None = None

    @property
    def origin(self) -> Literal["search", "baseline", "path"]:
        """What the drive is: found by a search, a baseline, or a path of the user's own."""
        return "baseline" if self.kind == "baseline" else "path" if self.kind == "path" else "search"

    @property
    def by_gradient(self) -> bool:
        """Whether a search follows gradients."""
        return self.kind == "ipopt"

    @property
    def rounded(self) -> bool:
        """Whether its information is rounding in some direction, in records that do not say so themselves."""
        if self.singular is not None or self.lambda_min is None:
            return False
        return self.lambda_min <= SINGULAR * (self.lambda_max or 0.0)

    @property
    def leaves_open(self) -> bool:
        """Whether some combination of the parameters is not identifiable, to rounding."""
        return self.rounded if self.singular is None or self.lambda_min is None else self.singular

    @property
    def useless(self) -> bool:
        """Whether what the study's criterion asks about is not identifiable."""
        return self.rounded if self.identifiable is None or self.lambda_min is None else not self.identifiable

    @property
    def worth(self) -> float | None:
        """Its objective: minus infinity where JSON cannot hold the number of so poor a drive."""
        if self.drive is None:
            return None
        return -math.inf if self.objective is None else self.objective

    def _card(self) -> Card:
        facts = given(
            ("objective", number(self.objective)),
            (
                "limits",
                "satisfied" if self.feasible else f"exceeded: {listing(list(map(words, self.violations)))}",
            ),
            ("path length", "" if self.path_length is None else size_text(self.path_length, "m")),
            ("message", self.message),
        )
        return Card(f"Result {self.name}: {words(self.status)}", facts)

    def __repr__(self) -> str:
        """One line: a record has many."""
        limits = "satisfied" if self.feasible else f"exceeded ({listing(list(map(words, self.violations)))})"
        text = f"{words(self.status)}, limits {limits}, objective {number(self.objective)}"
        return shown(f"Result {self.name}: {text}")

    def _require(self) -> None:
        if self.feasible and self.drive is None:
            raise ValueError("drive: expected that of a feasible result, got none")
        self._require_order()

    def _require_order(self) -> None:
        if self.lambda_min is None or self.lambda_max is None:
            return
        if self.lambda_min > (1 + ROUNDING) * self.lambda_max:
            raise ValueError(f"lambda_min: expected at most lambda_max, got {self.lambda_min:g}")
