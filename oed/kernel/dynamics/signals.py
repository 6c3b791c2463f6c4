"""Signals: what an input may do in a run, as a linear map from a few unknowns to the values held."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.quantities import Duration
from oed.kernel.dynamics import spline
from oed.kernel.dynamics.trajectory import middles

Pieces = Annotated[int, Field(ge=1, le=100_000)]


class Signal(Component, ABC):
    """Course of one input in a run: the values held in its N periods, linear in n unknowns.

    Attributes:
        kind: name of the signal.
        shared: all runs have the same; else each has unknowns of its own.
    """

    kind: str
    shared: bool = False

    @property
    @abstractmethod
    def unknowns(self) -> int:
        """Number n of unknowns of a run."""

    @abstractmethod
    def matrix(self, duration: float, samples: int) -> Array:
        """(N, n): takes the unknowns to the values held, those in the middles of the periods.

        Args:
            duration: duration of a run [s].
            samples: N.
        """

    def bounds(self, low: float, high: float) -> Array:
        """Bounds (n, 2) of the unknowns for an input that is to stay in [low, high]."""
        return np.tile([low, high], (self.unknowns, 1)).astype(float)

    def within(self, unknowns: Array, low: float, high: float) -> Array:
        """Unknowns like others within such bounds, that leave [low, high] at no time.

        Args:
            unknowns: within their bounds, (..., n).
            low: least value of the input.
            high: largest value of the input.
        """
        return unknowns

    def doubts(self, duration: float, samples: int, low: float, high: float) -> str:
        """Return why the signal fits no such run; "" where it does.

        Args:
            duration: duration of a run [s].
            samples: number of periods of a run.
            low: least value of the input.
            high: largest value of the input.
        """
        if self.unknowns > samples:
            return f"{self.unknowns} unknowns need as many samples in a run, got {samples}"
        return ""


class Constant(Signal):
    """One value all the time: a single unknown in a run."""

    kind: Literal["constant"] = "constant"

    @property
    def unknowns(self) -> int:
        """The value."""
        return 1

    def matrix(self, duration: float, samples: int) -> Array:
        """Ones."""
        return np.ones((samples, 1))


class PiecewiseConstant(Signal):
    """Steps: as many values as pieces of equal length; a period has the value of the piece of its middle."""

    kind: Literal["piecewise_constant"] = "piecewise_constant"
    pieces: Pieces

    @property
    def unknowns(self) -> int:
        """A value for each piece."""
        return self.pieces

    def matrix(self, duration: float, samples: int) -> Array:
        """A one in each row."""
        return _spline_values(0, self.pieces, samples)


class PiecewiseLinear(Signal):
    """A polygon of pieces of equal length: a value where each begins, and one at the end."""

    kind: Literal["piecewise_linear"] = "piecewise_linear"
    pieces: Pieces

    @property
    def unknowns(self) -> int:
        """A value where each piece begins, and at the end."""
        return self.pieces + 1

    def matrix(self, duration: float, samples: int) -> Array:
        """Shares of the values at both ends of the piece of a period's middle."""
        return _spline_values(1, self.pieces + 1, samples)


class SplineSignal(Signal):
    """A clamped uniform B-spline, as held in the middles of the periods.

    Attributes:
        degree: degree of the spline.
        coefficients: number of coefficients, including those that rest fixes.
        rest_to_rest: the first and the last coefficient are 0.
    """

    kind: Literal["spline"] = "spline"
    degree: Annotated[int, Field(ge=0, le=7)] = 3
    coefficients: Pieces = 16
    rest_to_rest: bool = False

    @field_validator("coefficients", mode="before")
    @classmethod
    def _a_number(cls, count: Any) -> Any:
        if count == "auto":
            raise ValueError(
                "expected a whole number, got 'auto', which the spline of a robot's drive may have"
            )
        return count

    @property
    def unknowns(self) -> int:
        """The coefficients that are free."""
        return self.coefficients - (2 if self.rest_to_rest else 0)

    def matrix(self, duration: float, samples: int) -> Array:
        """The basis functions [de Boor, A Practical Guide to Splines, ch. IX]."""
        table = _spline_values(self.degree, self.coefficients, samples)
        return table[:, 1:-1] if self.rest_to_rest else table

    @property
    def shortage(self) -> str:
        """Message that there are too few coefficients; "" where there are enough."""
        needed = self.degree + (3 if self.rest_to_rest else 1)
        if self.coefficients >= needed:
            return ""
        rest = " at rest at both ends" if self.rest_to_rest else ""
        return (
            f"a degree-{self.degree} spline{rest} needs at least {needed} coefficients, "
            f"got {self.coefficients}"
        )

    def doubts(self, duration: float, samples: int, low: float, high: float) -> str:
        """Too few coefficients, or more than samples."""
        doubt = self.shortage or super().doubts(duration, samples, low, high)
        if doubt or not self.rest_to_rest or low <= 0 <= high:
            return doubt
        return f"[{low:g}, {high:g}] (SI) excludes 0, which rest_to_rest needs"


class Fourier(Signal):
    """A mean, and cosines and sines of a period and its first harmonics.

    The unknowns are the mean, the amplitudes of the cosines, then those of the sines.

    Attributes:
        harmonics: number of sines and of cosines.
        period: period of the first harmonic [s]; a run's duration if None.
    """

    kind: Literal["fourier"] = "fourier"
    harmonics: Annotated[int, Field(ge=1, le=10_000)]
    period: Annotated[Duration, Field(gt=0)] | None = None

    @property
    def unknowns(self) -> int:
        """The mean and two amplitudes for each harmonic."""
        return 1 + 2 * self.harmonics

    def matrix(self, duration: float, samples: int) -> Array:
        """Ones, cosines, sines."""
        orders = 2 * np.pi / (self.period or duration) * np.arange(1, self.harmonics + 1)
        angles = np.outer(middles(duration, samples), orders)
        return np.hstack([np.ones((samples, 1)), np.cos(angles), np.sin(angles)])

    def bounds(self, low: float, high: float) -> Array:
        """The range for the mean, half of it either way for the amplitudes."""
        half = (high - low) / 2
        bounds = np.tile([-half, half], (self.unknowns, 1))
        bounds[0] = low, high
        return bounds

    def within(self, unknowns: Array, low: float, high: float) -> Array:
        """Waves of this shape, as large as there is room on both sides of the mean."""
        mean, waves = np.clip(unknowns[..., :1], low, high), unknowns[..., 1:]
        cosines, sines = np.split(waves, 2, axis=-1)
        # No sum of waves is larger than that of their amplitudes.
        most = np.hypot(cosines, sines).sum(axis=-1, keepdims=True)
        room = np.minimum(mean - low, high - mean)
        share = np.minimum(1.0, room / np.where(most > 0, most, 1.0))
        return np.concatenate([mean, share * waves], axis=-1)

    def doubts(self, duration: float, samples: int, low: float, high: float) -> str:
        """Waves too short for the samples."""
        waves = self.harmonics * duration / (self.period or duration)
        if 2 * waves >= samples:
            return (
                f"{waves:g} waves of the last harmonic in a run need more than {2 * waves:g} samples, "
                f"got {samples}: take fewer harmonics, a longer period or more samples"
            )
        return super().doubts(duration, samples, low, high)


SIGNALS: tuple[type[Signal], ...] = (Constant, PiecewiseConstant, PiecewiseLinear, SplineSignal, Fourier)
"""Every signal of this package."""


def _spline_values(degree: int, count: int, samples: int) -> Array:
    # Matrix from coefficients of a clamped uniform spline to its values in the middles of the periods. Pieces
    # of length 1 have knots in whole numbers, so that rounding moves no middle across a knot.
    pieces = count - degree
    knots = spline.clamped_knots(pieces, count, degree)
    return spline.values(knots, degree, np.eye(count), (np.arange(samples) + 0.5) * pieces / samples)
