"""What simulations say of drives: whether estimates scatter as predicted, how many robots violate limits, and
what models calibrated from drives of a robot with slip predict.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from oed.foundation.presenting import dataframe
from oed.records.stored.parts import (
    Count,
    Line,
    Matrix,
    Name,
    Number,
    Numbers,
    Positive,
    Rounded,
    Seed,
    Share,
    Stored,
    require_alike,
    require_different,
    require_known,
    require_table,
)
from oed.simulation.agreement import agreement_sentence, agreement_text, largest_ratio
from oed.simulation.monte_carlo import ALPHA, compared


class StoredCheck(Stored):
    """A test of simulated estimates against what is predicted."""

    name: str
    question: str
    statistic: Number
    expected: Annotated[Numbers, Field(min_length=2, max_length=2)]
    p_value: Share
    passed: bool


class Simulated(Stored):
    """Simulated experiments with one drive."""

    name: Name
    estimator: str = "ols"
    heading: str = "known"
    passed: bool
    verdict: str
    parameters: Annotated[list[str], Field(min_length=1)]
    true: Numbers
    mean: Numbers
    predicted_covariance: Matrix = Field(alias="promised_covariance")
    sampled_covariance: Matrix
    paired_variance_ratio: Numbers
    paired_standard_error: Numbers
    checks: list[StoredCheck]
    estimates: Annotated[Matrix, Field(min_length=2), Rounded(10)]

    @property
    def columns(self) -> dict[str, Any]:
        """What is compared, by name, an entry of each parameter; SI."""
        covariances = self.predicted_covariance, self.sampled_covariance
        return {"name": [self.name] * len(self.true)} | compared(
            self.parameters, self.true, self.mean, *covariances
        )

    def _require(self) -> None:
        count = len(self.parameters)
        require_different("parameters", self.parameters)
        require_alike(
            count,
            true=self.true,
            mean=self.mean,
            paired_variance_ratio=self.paired_variance_ratio,
            paired_standard_error=self.paired_standard_error,
        )
        require_table("estimates", self.estimates, None, count)
        covariances = {
            "promised_covariance": self.predicted_covariance,
            "sampled_covariance": self.sampled_covariance,
        }
        for what, covariance in covariances.items():
            require_table(what, covariance, count, count)
            require_covariance(what, covariance)


def require_covariance(what: str, matrix: Matrix) -> None:
    """Refuse what is no covariance: variances above 0, and no correlation beyond 1.

    Raises:
        ValueError: names the row.
    """
    for place, row in enumerate(matrix):
        if not row[place] > 0:
            raise ValueError(f"{what}.{place}: expected a variance above 0, got {row[place]:g}")
    for place, row in enumerate(matrix):
        for other, value in enumerate(row):
            if abs(value) > (1 + 1e-6) * math.sqrt(row[place]) * math.sqrt(matrix[other][other]):
                raise ValueError(f"{what}.{place}.{other}: expected a correlation of at most 1")


class StoredValidation(Stored):
    """A record's `validation`: options left out are the usual ones."""

    replicates: Count = 0
    estimators: list[str] | None = None
    heading: Literal["known", "predicted", "measured"] = "known"
    loss: str | None = "linear"
    alpha: Share = ALPHA
    seed: Seed = 0
    results: list[Simulated]

    def largest_ratio(self, one: Simulated) -> float:
        """How many times as large, or as small, as predicted the standard error of any combination of
        parameters may be by one of the results, with 95 % confidence; infinite where that is not known.
        """
        return largest_ratio(one.predicted_covariance, one.sampled_covariance, self.replicates)

    def agreement(self, results: Sequence[Simulated]) -> str:
        """How well errors agree with the predicted, in words, by that of some results which says least."""
        return agreement_text(max(map(self.largest_ratio, results), default=math.inf))

    def verdict(self, one: Simulated) -> str:
        """What is said of one of the results; of one that passed, with how much that says."""
        said = agreement_sentence(self.largest_ratio(one))
        # Earlier versions saved verdicts without it.
        return f"{one.verdict} {said}" if one.passed and said not in one.verdict else one.verdict

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row per result and parameter: true value, mean estimate, predicted and
        sampled standard error, SI, and the ratio of these.

        Raises:
            UserMistake: pandas is not installed.
        """
        each = [one.columns for one in self.results]
        heads = [name for one in each[:1] for name in one]
        return dataframe({name: [entry for one in each for entry in one[name]] for name in heads})


class Uncertain(Stored):
    """A parameter that may be another."""

    name: str
    unit: str
    nominal: Number
    low: Number
    high: Number
    uniform: bool


class Tried(Stored):
    """How many robots violate the limits on a drive.

    Attributes:
        back_off: of the limits, in standard deviations.
        added: of the worst robots, to the scenarios that the limits are satisfied for.
    """

    name: Name
    probability: Share
    interval: Annotated[list[Share], Field(min_length=2, max_length=2)]
    draws: Count
    seed: Seed
    by_limit: dict[str, Number]
    farthest: Number | None
    objective: Number | None
    back_off: Number | None = Field(alias="reserve")
    added: Count | None = Field(alias="kept")
    checked_at_points: list[str] | None = None


class Paths(Stored):
    """Where robots drawn from the uncertainty go: points by robot and run."""

    name: Name
    violating: list[bool] = Field(alias="leaves")
    paths: Annotated[list[list[Line]], Rounded(4)]

    def _require(self) -> None:
        require_alike(len(self.paths), leaves=self.violating)


class StatesOverTime(Stored):
    """States of systems drawn from the uncertainty.

    Attributes:
        name: of the result that has the design.
        violating: whether each of them violates the limits.
        times: of every run, from its start [s].
        states: by system and run at these times, SI.
    """

    name: Name
    violating: list[bool]
    times: list[list[Number]]
    states: list[list[Matrix]]

    def _require(self) -> None:
        require_alike(len(self.states), violating=self.violating)
        for one in self.states:
            require_alike(len(self.times), states=one)


class StoredRobustness(Stored):
    """A record's `robustness`.

    Attributes:
        bundles: where robots go.
        courses: what other systems do; None of robots.
    """

    kind: Literal["chance", "scenarios"]
    confidence: Share
    objective: Literal["nominal", "mean", "worst"]
    limits: list[str]
    uncertain: list[Uncertain]
    results: list[Tried]
    bundles: list[Paths]
    courses: list[StatesOverTime] | None = None

    def _require(self) -> None:
        names = [one.name for one in self.results]
        require_different("results", names)
        require_known("bundles", (one.name for one in self.bundles), names)
        require_known("courses", (one.name for one in self.courses or ()), names)


class Scaled(Stored):
    """A parameter of a model, and the size that its errors are relative to."""

    name: str
    nominal: Number
    unit: str
    scale: Annotated[float, Field(gt=0, le=1e100)]


class TriedModel(Stored):
    """A model on trial."""

    name: str
    kind: str
    parameters: list[Scaled]


class Fit(Stored):
    """How a model is calibrated."""

    name: str
    kind: str
    method: str


class StoredPlan(Stored):
    """A drive to calibrate from.

    Attributes:
        aim: what it is designed for; None of baselines, and in records of earlier versions.
        discrepancy: that the noise had which it is designed with, SI; None without.
    """

    name: str
    model: str | None
    criterion: str | None
    status: str
    message: str
    feasible: bool
    violations: dict[str, Number]
    path_length: Number | None
    fastest: Number | None
    wall_seconds: Annotated[Positive, Rounded(3)]
    predicted: dict[str, Positive | None] | None = Field(alias="promised")
    path: Annotated[Line, Rounded(4)] | None
    inputs: list[Annotated[Numbers, Rounded(6)]] | None
    aim: str | None = None
    discrepancy: dict[str, Positive] | None = None


class Around(Stored):
    """A number, and the interval it lies in."""

    value: Number | None
    low: Number | None
    high: Number | None


class Attainable(Around):
    """What a model's prediction errors are at best: fitted to the held-out drives themselves [m]."""

    fit: str
    each: Annotated[list[Number | None], Rounded(7)]


class Error(Around):
    """How far off a model's prediction is, calibrated from a drive [m].

    Attributes:
        excess: how much more than at best its error is, over all held-out drives and along them; None in
            records of earlier versions.
        excess_each: the same of every robot.
    """

    drive: str
    fit: str
    along: Number | None
    misfit: Number | None
    refused: Count
    each: Annotated[list[Number | None], Rounded(7)]
    excess: Around | None = None
    excess_each: Annotated[list[Number | None], Rounded(7)] | None = None


class Scatter(Stored):
    """How estimates from a drive scatter."""

    drive: str
    fit: str
    mean: Numbers
    relative: Numbers
    total: Around
    each: list[Numbers]


class StoredFloor(Stored):
    """What was found on one floor."""

    friction: Positive
    done: Count
    errors: list[Error]
    scatter: list[Scatter]
    attainable: list[Attainable] = Field(default_factory=list)
    drawn: Annotated[Numbers, Rounded(6)] = Field(default_factory=list)
    paths: dict[str, Annotated[Line, Rounded(4)]] = Field(default_factory=dict)


class SimulatedRobot(Stored):
    """The robot that drives."""

    kind: str


class Spread(Stored):
    """How much robots differ."""

    friction: Positive
    grip: Positive


class StoredTrial(Stored):
    """A record's `physics`."""

    robot: SimulatedRobot
    frictions: Annotated[Numbers, Field(min_length=1)]
    repeats: Count
    variation: Spread
    held_out: Count
    seed: Seed
    interrupted: bool
    models: Annotated[list[TriedModel], Field(min_length=1)]
    fits: Annotated[list[Fit], Field(min_length=1)]
    planned: list[StoredPlan]
    floors: list[StoredFloor]

    def _require(self) -> None:
        require_different("models", [one.name for one in self.models])
        require_different("planned", [one.name for one in self.planned])
        require_different("fits", [one.name for one in self.fits])
        models = [one.name for one in self.models]
        require_known("planned", (one.model for one in self.planned if one.model is not None), models)
        for place, floor in enumerate(self.floors):
            self._require_floor(f"floors.{place}", floor)
        driven = [set(floor.paths) for floor in self.floors if floor.errors]
        if any(names != driven[0] for names in driven):
            raise ValueError("floors: expected the same drives on every floor")

    def _require_floor(self, what: str, floor: StoredFloor) -> None:
        planned = [one.name for one in self.planned if one.path is not None]
        fits = [one.name for one in self.fits]
        drives = list(dict.fromkeys(one.drive for one in floor.errors))
        for names in (drives, floor.paths, (one.drive for one in floor.scatter)):
            require_known(what, names, planned)
        for names in ((one.fit for one in floor.errors), (one.fit for one in floor.scatter)):
            require_known(what, names, fits)
        require_known(what, (one.fit for one in floor.attainable), fits)
        there = {(one.drive, one.fit) for one in floor.errors}
        for drive, fit in itertools.product(drives, fits):
            if (drive, fit) not in there:
                raise ValueError(f"{what}.errors: expected one of {drive!r} and {fit!r}, got none")
        own = self.models[0]
        for one in floor.scatter:
            if one.fit == own.name:
                require_table(f"{what}.scatter", [one.relative], None, len(own.parameters))
