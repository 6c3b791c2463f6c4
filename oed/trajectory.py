"""The design: B-splines of the inputs, a start pose, and the space of them that a study allows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from oed import spline
from oed.component import Component
from oed.models.model import Integration
from oed.quantities import Angle, Duration, Length

Array = npt.NDArray[np.float64]


def middles(duration: float, samples: int) -> Array:
    """Times (N,) [s] of the middles of N equal periods."""
    return np.asarray((np.arange(samples, dtype=np.float64) + 0.5) * (duration / samples))


@dataclass(frozen=True)
class Trajectory:
    """A drive: splines of the inputs over time, held sample by sample, from a start pose.

    Attributes:
        knots: (n + degree + 1,) [s], clamped, from 0 to the duration.
        degree: of the splines.
        coefficients: (n, inputs), in the inputs' SI units.
        start: start state (states,): x [m], y [m], heading [rad], ...
        samples: N; the robot holds each input at its spline's value in the middle of each period.
    """

    knots: Array
    degree: int
    coefficients: Array
    start: Array
    samples: int

    def __post_init__(self) -> None:
        """Copy the arrays, check their shapes and make them read-only.

        Raises:
            ValueError: knots and coefficients that do not match, or numbers that are not finite.
        """
        for name in ("knots", "coefficients", "start"):
            array = np.array(getattr(self, name), dtype=float)
            if not np.all(np.isfinite(array)):
                raise ValueError(f"{name} must be finite")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        expected = len(self.knots) - self.degree - 1
        if self.coefficients.ndim != 2 or len(self.coefficients) != expected:
            raise ValueError(
                f"expected coefficients of shape ({expected}, inputs), got {self.coefficients.shape}"
            )

    @classmethod
    def from_samples(
        cls, inputs: npt.ArrayLike, duration: float, start: npt.ArrayLike, *, rest_to_rest: bool = True
    ) -> Trajectory:
        """The drive that holds `inputs` (N, inputs) in N equal periods: polygons through their middles.

        Args:
            inputs: one row per period.
            duration: of the whole drive [s].
            start: start state.
            rest_to_rest: whether the polygon begins and ends at 0 (else at the first and last value).
        """
        rows = np.asarray(inputs, dtype=float)
        ends = np.zeros((2, rows.shape[1])) if rest_to_rest else rows[[0, -1]]
        knots = np.concatenate([[0.0, 0.0], middles(duration, len(rows)), [duration, duration]])
        return cls(knots, 1, np.vstack([ends[:1], rows, ends[1:]]), np.asarray(start, dtype=float), len(rows))

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.knots[-1])

    @property
    def period(self) -> float:
        """Sample period T [s]."""
        return self.duration / self.samples

    @property
    def inputs(self) -> Array:
        """Inputs held in each period, (N, inputs)."""
        return self.inputs_at(middles(self.duration, self.samples))

    def inputs_at(self, times: Array) -> Array:
        """Values of the splines at `times` [s], (len(times), inputs)."""
        return np.asarray(spline.basis(self.knots, self.degree, times) @ self.coefficients)

    def rates_at(self, times: Array) -> Array:
        """Time derivatives of the inputs, (rows, inputs): at `times` [s], or, for a piecewise constant
        drive, the change from each period to the next over one period.
        """
        if self.degree == 0:
            return np.diff(self.inputs, axis=0) / self.period
        matrix, knots = spline.derivative(self.knots, self.degree)
        return np.asarray(spline.basis(knots, self.degree - 1, times) @ (matrix @ self.coefficients))


class Spline(Component):
    """The inputs' splines: degree, and coefficients per input (those that rest fixes included)."""

    degree: Annotated[int, Field(ge=0, le=7)] = 3
    coefficients: Annotated[int, Field(ge=1)] = 16


class StartPose(Component):
    """A fixed start pose: x [m], y [m], heading [rad]."""

    x: Length = 0.0
    y: Length = 0.0
    heading: Angle = 0.0


class DesignSpace(Component):
    """All drives that a study allows: duration [s], samples N, splines, start, rest and integration rule.

    `rest_to_rest` fixes the first and last coefficient of every input at 0.
    """

    duration: Annotated[Duration, Field(gt=0)]
    samples: Annotated[int, Field(ge=1, le=1_000_000)] = 200
    spline: Spline = Spline()
    start: StartPose | Literal["free"] = StartPose()
    rest_to_rest: bool = True
    integration: Integration = "arc"

    @property
    def period(self) -> float:
        """Sample period T [s]."""
        return self.duration / self.samples

    @property
    def knots(self) -> Array:
        """Knots of the splines [s]."""
        return spline.clamped_knots(self.duration, self.spline.coefficients, self.spline.degree)

    @property
    def sampling_matrix(self) -> Array:
        """(N, n): takes coefficients to the inputs held in each period."""
        times = middles(self.duration, self.samples)
        return np.asarray(spline.basis(self.knots, self.spline.degree, times).toarray())

    @property
    def rate_matrix(self) -> Array:
        """Takes coefficients to bounds of the inputs' rates: the derivative's coefficients, a convex hull
        of the rate at all times; for degree 0, the jumps over one sample period.
        """
        if self.spline.degree == 0:
            count = self.spline.coefficients
            return np.diff(np.eye(count), axis=0) / self.period
        return np.asarray(spline.derivative(self.knots, self.spline.degree)[0].toarray())

    @property
    def free_rows(self) -> slice:
        """The coefficients that are free; the others are 0."""
        return slice(1, self.spline.coefficients - 1) if self.rest_to_rest else slice(None)

    @property
    def start_is_free(self) -> bool:
        """Whether the start pose is part of the design."""
        return self.start == "free"

    @property
    def fixed_start(self) -> Sequence[float] | None:
        """The start pose (x, y, heading) where it is fixed."""
        if isinstance(self.start, StartPose):
            return (self.start.x, self.start.y, self.start.heading)
        return None

    def trajectory(self, coefficients: npt.ArrayLike, start: npt.ArrayLike) -> Trajectory:
        """The drive of this space with these coefficients (n, inputs) and start pose (3,)."""
        return Trajectory(
            self.knots, self.spline.degree, np.asarray(coefficients), np.asarray(start), self.samples
        )
