"""What a trial found: of every repeat, and as medians and scatter with intervals over the repeats."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from oed.estimation.methods.fitting import Fitting
from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.solution import Solution
from oed.robots.sensors.pose_noise import Discrepancy
from oed.simulation.trial.attainable import overall
from oed.simulation.trial.candidates import Candidate
from oed.simulation.trial.experiment import Found
from oed.simulation.trial.options import Trial

COVERED = (2.5, 97.5)
"""Percentiles that an interval lies between."""
STREAM = 31
"""Of the random numbers that resamples are drawn from."""


@dataclass(frozen=True)
class Interval:
    """A number with the interval that holds 95 % of the resamples."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Repeats:
    """What repeats on one floor found; infinite or NaN where a calibration was refused.

    Attributes:
        errors: a number of each repeat, (repeats, drives, fits) [m].
        resamples: how many.
        seed: of the resamples.
    """

    errors: Array
    resamples: int
    seed: int

    @cached_property
    def picks(self) -> Places:
        """Repeats of every resample, drawn with replacement, (resamples, repeats)."""
        count = len(self.errors)
        return np.random.default_rng([self.seed, STREAM]).integers(count, size=(self.resamples, count))

    @cached_property
    def medians(self) -> Array:
        """Over the repeats, (drives, fits) [m]."""
        return np.asarray(np.median(self.errors, axis=0))

    @cached_property
    def resampled(self) -> Array:
        """Medians of every resample, (resamples, drives, fits)."""
        return np.asarray(np.median(self.errors[self.picks], axis=1))

    def median(self, drive: int, fit: int) -> Interval:
        """The median error of one drive and fit [m]."""
        return interval(self.medians[drive, fit], self.resampled[:, drive, fit])


def interval(value: float, resampled: Array) -> Interval:
    """A number with the percentiles of its resamples."""
    # Neighbours, not means of them: some may be infinite.
    low, high = np.percentile(resampled, COVERED, method="nearest")
    return Interval(float(value), float(low), float(high))


def scatter(values: Array, scales: Array) -> Array:
    """Standard deviations over repeats relative to the parameters' sizes.

    Args:
        values: estimates, (..., repeats, p).
        scales: sizes (p,).

    Returns:
        (..., p); NaN of less than two repeats.
    """
    if values.shape[-2] < 2:
        return np.full((*values.shape[:-2], values.shape[-1]), np.nan)
    return np.asarray(np.std(values, axis=-2, ddof=1) / scales)


def total(relative: Array) -> Array:
    """Root mean square over the parameters (..., p) of their relative scatter."""
    return np.asarray(np.sqrt(np.mean(relative**2, axis=-1)))


@dataclass(frozen=True)
class Planned:
    """A drive to calibrate from.

    Attributes:
        name: of the drive.
        model: that it is designed for; None of a baseline.
        solution: with the drive, scored for that model or else for the study's own.
        predicted: standard errors of the study's own parameters by it; None without a drive.
        aim: what it is designed for; "" of a baseline.
        discrepancy: that the noise had which it is designed with; None without.
    """

    name: str
    model: Candidate | None
    solution: Solution
    predicted: Mapping[str, float] | None
    aim: str = ""
    discrepancy: Discrepancy | None = None

    @property
    def drivable(self) -> Trajectory | None:
        """The drive, where it keeps the limits."""
        evaluation = self.solution.evaluation
        return self.solution.trajectory if evaluation is not None and evaluation.feasible else None


@dataclass(frozen=True)
class Floor:
    """What was found on one floor.

    Attributes:
        friction: of the floor.
        found: of every repeat that was done.
        fits: how models were calibrated, by name.
        resamples: of the bootstrap.
        seed: of its draws.
    """

    friction: float
    found: tuple[Found, ...]
    fits: Mapping[str, Fitting]
    resamples: int
    seed: int

    @property
    def drives(self) -> tuple[str, ...]:
        """Names."""
        return tuple(self.found[0].paths)

    @cached_property
    def repeats(self) -> Repeats:
        """Held-out errors, (repeats, drives, fits) [m]."""
        each = np.array([np.median(one.end, axis=-1) for one in self.found])
        return Repeats(each, self.resamples, self.seed)

    @cached_property
    def attainable(self) -> Repeats:
        """What every model could have at best, over all held-out drives and along them,
        (repeats, 1, fits) [m].
        """
        each = np.array([one.attainable for one in self.found])[:, None]
        return Repeats(each, self.resamples, self.seed)

    @cached_property
    def excess(self) -> Repeats:
        """How much more than that it has, calibrated from a drive, (repeats, drives, fits) [m]."""
        each = np.array([overall(one.along) for one in self.found])
        return Repeats(each - self.attainable.errors, self.resamples, self.seed)

    @cached_property
    def values(self) -> dict[tuple[str, str], Array]:
        """Estimates by (drive, fit), (repeats, p), SI; where none was refused."""
        cells = [(drive, fit) for drive in self.drives for fit in self.fits]
        return {
            cell: np.array([one.values[cell] for one in self.found])
            for cell in cells
            if all(cell in one.values for one in self.found)
        }

    def median(self, name: Literal["along", "misfit"], row: int, column: int) -> float:
        """Over the repeats, of a drive and a fit by their numbers.

        Args:
            name: which number.
            row: of the drive.
            column: of the fit.
        """
        return float(np.median([np.median(getattr(one, name)[row, column]) for one in self.found]))

    def scatter(self, drive: str, fit: str) -> tuple[Array, Interval]:
        """Of the estimates relative to the parameters' sizes, (p,), and in all."""
        table = {one.name: one.scale or 1.0 for one in self.fits[fit].robot.parameters}
        scales = np.array([table[name] for name in self.fits[fit].parameters])
        values = self.values[drive, fit]
        relative = scatter(values, scales)
        return relative, interval(float(total(relative)), total(scatter(values[self.repeats.picks], scales)))


@dataclass(frozen=True)
class Outcome:
    """Everything that a trial did.

    Attributes:
        trial: what was asked.
        models: on trial, the study's own first.
        planned: drives.
        fits: how models were calibrated, by name.
        found: of every repeat that was done, by the floor's number and its own.
        seed: of every random draw.
        interrupted: whether it was cut short.
    """

    trial: Trial
    models: tuple[Candidate, ...]
    planned: tuple[Planned, ...]
    fits: Mapping[str, Fitting]
    found: Mapping[tuple[int, int], Found]
    seed: int
    interrupted: bool

    @property
    def floors(self) -> list[Floor]:
        """One of every friction."""
        floors = []
        for number, friction in enumerate(self.trial.frictions):
            done = tuple(found for (floor, _), found in sorted(self.found.items()) if floor == number)
            floors.append(Floor(friction, done, self.fits, self.trial.resamples, self.seed))
        return floors
