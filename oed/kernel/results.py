"""Result of scoring a trajectory: information, predicted precision and margins of the limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from oed.foundation import views
from oed.foundation.arrays import Array
from oed.foundation.equality import ByValue
from oed.foundation.presenting import Presented
from oed.kernel.measurement.square_root import SquareRoot

TOLERANCE = 1e-3
"""A limit is satisfied when it is exceeded by at most this share of its size, and active within it."""


@dataclass(frozen=True)
class Margin:
    """Distance that a trajectory keeps from one limit.

    Attributes:
        name: name of the limit.
        margin: distance to the limit at the closest time, in `unit`; negative when it is exceeded.
        size: size of the limit in `unit`.
        unit: SI unit.
        certain: the margin holds at all times; else only at the points that were checked.
    """

    name: str
    margin: float
    size: float
    unit: str
    certain: bool = True

    @property
    def active(self) -> bool:
        """True if the trajectory touches the limit or exceeds it."""
        return self.margin <= TOLERANCE * self.size

    @property
    def violation(self) -> float:
        """Amount by which the limit is exceeded, 0 where it is satisfied."""
        return max(0.0, -self.margin)

    @property
    def satisfied(self) -> bool:
        """True if the limit is satisfied, within `TOLERANCE` of its size."""
        return self.violation <= TOLERANCE * self.size


@dataclass(frozen=True)
class Steps:
    """Fineness of the integration steps with which a trajectory was scored.

    Attributes:
        times: factor by which the steps are finer than the study's.
        enough: smallest factor that gives the same information and limits as still finer steps; 1 where the
            steps of the study are fine enough.
        change: largest share by which information, standard errors and margins of limits change from the
            study's steps to these; infinite where the study's give no numbers.
        settled: fine enough steps were reached.
    """

    times: int
    enough: int
    change: float
    settled: bool


@dataclass(frozen=True, repr=False, eq=False)
class Evaluation(ByValue, Presented):
    """Score of a trajectory as `evaluate` returns it; all SI.

    Attributes:
        objective: value of the criterion, larger is better; of a robust problem the value that it asks for.
        singular_values: singular values of W, descending, blocks together: of the paper's regressors
            unscaled, of sensors in units of the noise and scaled, with all nuisances eliminated.
        norm_y: size of the noise-free measurement at the nominal parameters, |W c|; of sensors in units of
            the noise.
        path_length: length of the path of the robot's origin [m].
        margins: margins of every limit, at all times; of a robust problem less its back-off.
        design_matrices: W of each block by name.
        square_roots: information of each block by name, on the parameters the criterion judges, in its
            scaling; of the nominal robot.
        full_square_roots: information of each block by name, on its estimated parameters, SI.
        identifiable: all that the criterion asks about is identifiable.
        covariances: predicted covariance of each block's estimated parameters, SI; infinite variances of
            those that are not identifiable; {} without noise.
        parameters: names of the estimated parameters by block.
        states: states at the samples, (N + runs, states), run by run.
        path: states on the fine grid, (10 N + runs, states).
        nominal, units: nominal values and SI units of the estimated parameters, by name.
        steps: integration steps of the score; None of a system whose steps are exact, or of a score by the
            problem's own steps.
    """

    objective: float
    singular_values: Array
    norm_y: float
    path_length: float
    margins: tuple[Margin, ...]
    design_matrices: Mapping[str, Array]
    square_roots: Mapping[str, SquareRoot]
    full_square_roots: Mapping[str, SquareRoot]
    identifiable: bool
    covariances: Mapping[str, Array]
    parameters: Mapping[str, tuple[str, ...]]
    states: Array
    path: Array
    nominal: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    steps: Steps | None = None

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for array in (self.states, self.path, self.singular_values):
            array.setflags(write=False)

    @cached_property
    def information(self) -> Mapping[str, Array]:
        """F of each block by name, on the parameters the criterion judges, in its scaling."""
        return {name: root.matrix for name, root in self.square_roots.items()}

    @cached_property
    def full_information(self) -> Mapping[str, Array]:
        """F of each block's estimated parameters, SI."""
        return {name: root.matrix for name, root in self.full_square_roots.items()}

    @cached_property
    def lambda_min(self) -> float:
        """Smallest eigenvalue of the information in the criterion's scaling, over all blocks."""
        return float(min(root.smallest for root in self.square_roots.values()))

    @cached_property
    def lambda_max(self) -> float:
        """Largest eigenvalue of the information in the criterion's scaling, over all blocks."""
        return float(max(root.largest for root in self.square_roots.values()))

    @property
    def smallest_singular_value(self) -> float:
        """s_min(W)."""
        return float(self.singular_values[-1])

    @property
    def condition_number(self) -> float:
        """cond(W) = s_max / s_min; infinite for a singular design."""
        largest, smallest = float(self.singular_values[0]), self.smallest_singular_value
        return largest / smallest if smallest > 0 else np.inf

    @property
    def log_determinant(self) -> float:
        """Log det of the information, all blocks together; minus infinity for a singular design."""
        return float(sum(root.log_determinant for root in self.square_roots.values()))

    @property
    def standard_deviations(self) -> dict[str, float]:
        """Predicted standard deviation of each estimated parameter, SI; {} without noise."""
        return {
            name: float(size)
            for block, covariance in self.covariances.items()
            for name, size in zip(self.parameters[block], np.sqrt(np.diag(covariance)), strict=True)
        }

    @property
    def singular(self) -> bool:
        """True if some combination of the parameters that the criterion judges is not identifiable."""
        return not all(root.complete for root in self.square_roots.values())

    @property
    def feasible(self) -> bool:
        """True if every limit is satisfied."""
        return all(margin.satisfied for margin in self.margins)

    @property
    def checked_at_points(self) -> tuple[str, ...]:
        """Names of the limits that were checked at some points only: between them nothing is known."""
        return tuple(margin.name for margin in self.margins if not margin.certain)

    @property
    def violations(self) -> dict[str, float]:
        """Amount by which each limit that is not satisfied is exceeded, in its SI unit."""
        return {margin.name: margin.violation for margin in self.margins if not margin.satisfied}

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with a row per estimated parameter: nominal value and standard error, SI;
        no row without noise.

        Raises:
            UserMistake: pandas is not installed.
        """
        return views.make("table", self)
