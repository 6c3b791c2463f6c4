"""What simulations say of drives: whether estimates scatter as predicted, how many robots violate limits."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from oed.records.stored.parts import (
    Count,
    Line,
    Matrix,
    Name,
    Number,
    Numbers,
    Rounded,
    Seed,
    Share,
    Stored,
    require_alike,
    require_different,
    require_known,
    require_table,
)
from oed.simulation.monte_carlo import ALPHA


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


class StoredRobustness(Stored):
    """A record's `robustness`."""

    kind: Literal["chance", "tube", "scenarios"]
    confidence: Share
    objective: Literal["nominal", "mean", "worst"]
    limits: list[str]
    uncertain: list[Uncertain]
    results: list[Tried]
    bundles: list[Paths]

    def _require(self) -> None:
        names = [one.name for one in self.results]
        require_different("results", names)
        require_known("bundles", (one.name for one in self.bundles), names)
