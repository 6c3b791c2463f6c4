"""The space of drives that a study allows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Any, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from oed.foundation.arrays import Array, Places
from oed.foundation.component import Component, OneOf
from oed.foundation.quantities import Duration
from oed.kernel.dynamics import spline
from oed.kernel.dynamics.signals import SIGNALS, Signal, SplineSignal
from oed.kernel.dynamics.system import System
from oed.kernel.dynamics.trajectory import Trajectory

FIRST = 16
"""Coefficients that `auto` begins with, whatever the duration: the usual number, enough for every degree."""


class Spline(Component):
    """The inputs' splines.

    Attributes:
        degree: degree of all pieces.
        coefficients: per input, those that rest fixes included; or "auto": 16, and a search then goes on from
            its design with twice as many pieces, and again, for as long as that gains something.
    """

    degree: Annotated[int, Field(ge=0, le=7)] = 3
    coefficients: Annotated[int, Field(ge=1, le=100_000)] | Literal["auto"] = FIRST

    @property
    def refines(self) -> bool:
        """True if searches refine the spline."""
        return self.coefficients == "auto"

    @property
    def count(self) -> int:
        """Coefficients; of "auto" those that it begins with."""
        return FIRST if self.coefficients == "auto" else self.coefficients

    @property
    def first(self) -> Spline:
        """The spline that searches begin with."""
        return Spline(degree=self.degree, coefficients=self.count)

    def signal(self, *, rest_to_rest: bool) -> SplineSignal:
        """Return the spline as the signal of an input, at rest at both ends or not."""
        return SplineSignal(degree=self.degree, coefficients=self.count, rest_to_rest=rest_to_rest)

    @property
    def finer(self) -> Spline:
        """The spline of twice as many pieces: every knot is kept, so that it has all curves of this one."""
        return Spline(degree=self.degree, coefficients=2 * self.count - self.degree)


class Space(Component, ABC):
    """All drives that a study allows: duration [s], samples N, splines, rest and starts.

    `rest_to_rest` fixes the first and last coefficient of every input at 0. With several `runs` the drive is
    a series of them, each with this duration, samples and spline and a start of its own.
    """

    duration: Annotated[Duration, Field(gt=0)]
    samples: Annotated[int, Field(ge=1, le=1_000_000)] = 200
    spline: Spline = Spline()
    rest_to_rest: bool = True
    runs: Annotated[int, Field(ge=1, le=100)] = 1

    @model_validator(mode="after")
    def _start_for_every_run(self) -> Self:
        starts = self.fixed_starts
        if starts is not None and len(starts) != self.runs:
            raise ValueError(f"expected one start, or one for each of the {self.runs} runs")
        return self

    @property
    @abstractmethod
    def fixed_starts(self) -> Array | None:
        """The states (runs, k) that the runs start in, the first k of the system's; None where the design
        chooses them.
        """

    @property
    def only(self) -> Trajectory | None:
        """The one drive of a space in which nothing is chosen; None where something is."""
        return None

    @property
    def shortest_duration(self) -> float | None:
        """Least duration of a run [s], where the design chooses it; None where it is given."""
        return None

    @property
    def start_ranges(self) -> Array | None:
        """Least and largest value (k, 2) of the first k states where the design chooses them; None where it
        is free to choose any.
        """
        return None

    @property
    def stores_steps(self) -> bool:
        """True where drives are stored as the values held in their periods, whatever their signals are."""
        return False

    def signals_of(self, inputs: int) -> tuple[Signal, ...]:
        """Return the signal of each input of a run, for so many inputs."""
        return (self.spline.signal(rest_to_rest=self.rest_to_rest),) * inputs

    @property
    def stored_spline(self) -> Spline:
        """Spline as which an input's course in a run is stored."""
        if self.stores_steps:
            return Spline.model_construct(degree=0, coefficients=self.samples)
        return self.spline

    def with_spline(self, spline: Spline) -> Self:
        """The space of the same drives but for their splines."""
        return self.model_copy(update={"spline": spline})

    def driving(self, system: System) -> System:
        """The system as drives of this space drive it; itself, unless the space chooses how it steps."""
        return system

    @property
    def period(self) -> float:
        """Sample period T [s]."""
        return self.duration / self.samples

    @property
    def all_samples(self) -> int:
        """Samples of all runs together."""
        return self.runs * self.samples

    @property
    def whole_duration(self) -> float:
        """Duration of all runs together [s]."""
        return self.runs * self.duration

    @property
    def all_coefficients(self) -> int:
        """Number of spline coefficients of an input in all runs together."""
        return self.runs * self.stored_spline.count

    @property
    def knots(self) -> Array:
        """Knots of the splines [s], of all runs on one clock."""
        return spline.repeated_knots(self.run_knots, self.stored_spline.degree, self.runs)

    @property
    def run_knots(self) -> Array:
        """Knots of the splines of one run [s], on its own clock."""
        return spline.clamped_knots(self.duration, self.stored_spline.count, self.stored_spline.degree)

    @property
    def free(self) -> slice:
        """Coefficients of a run that are free; the others are 0."""
        return slice(1, -1) if self.rest_to_rest else slice(None)

    @property
    def free_rows(self) -> Places:
        """Indices of the coefficients of all runs that are free; the others are 0."""
        rows = np.arange(self.all_coefficients).reshape(self.runs, -1)
        return rows[:, self.free].ravel()

    @property
    def start_is_free(self) -> bool:
        """True if start states are part of the design."""
        return self.fixed_starts is None

    def trajectory(self, coefficients: npt.ArrayLike, start: npt.ArrayLike) -> Trajectory:
        """The drive of this space with these coefficients (n, inputs) and start states (runs, states)."""
        return Trajectory(
            self.knots,
            self.stored_spline.degree,
            np.asarray(coefficients),
            np.asarray(start),
            self.all_samples,
            self.runs,
        )


class SignalSpace(Space):
    """The drives of any system: `start` is one state for all runs, one for each, or "free".

    Of a start with fewer values than the system has states, the other states begin at 0.

    Attributes:
        start: start state of all runs, or of each, SI; "free" where the design chooses it.
        start_bounds: instead, between which values (low, high) each state begins, SI: each run chooses its
            own; fixed where both are equal.
        signals: signal of each input in a run, in the system's order; () for one spline of all inputs.
            Drives are then known by the values held in their periods.
        shortest: least duration of a run [s], where the design chooses it, up to `duration`; runs have it in
            common, and all that happens in them is shorter alike.
    """

    start: tuple[float, ...] | tuple[tuple[float, ...], ...] | Literal["free"] = ()
    start_bounds: tuple[tuple[float, float], ...] = ()
    signals: tuple[Annotated[Signal, OneOf(SIGNALS)], ...] = ()
    shortest: Annotated[Duration, Field(gt=0)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _no_rest_of_signals(cls, values: Any) -> Any:
        signals = isinstance(values, dict) and values.get("signals")
        return {"rest_to_rest": False, **values} if signals else values

    @model_validator(mode="after")
    def _no_spline_beside_signals(self) -> Self:
        if self.signals and (self.rest_to_rest or self.spline != Spline()):
            raise ValueError(
                "spline and rest_to_rest are of spaces without signals, each of which says it for itself"
            )
        return self

    @model_validator(mode="after")
    def _one_way_to_start(self) -> Self:
        if self.start_bounds and self.start != ():
            raise ValueError("expected start or start_bounds, got both")
        for low, high in self.start_bounds:
            if not (np.isfinite([low, high]).all() and low <= high):
                raise ValueError(f"start_bounds: expected finite (low, high), got ({low:g}, {high:g})")
        return self

    @property
    def stores_steps(self) -> bool:
        """True where inputs have signals."""
        return bool(self.signals)

    def signals_of(self, inputs: int) -> tuple[Signal, ...]:
        """Return the signals as they are given, or one spline for all inputs."""
        return self.signals or super().signals_of(inputs)

    @property
    def start_ranges(self) -> Array | None:
        """Ranges of the starts as they are given."""
        return np.array(self.start_bounds, dtype=float) if self.start_bounds else None

    @property
    def shortest_duration(self) -> float | None:
        """`shortest`."""
        return self.shortest

    @property
    def fixed_starts(self) -> Array | None:
        """The states (runs, k) that the runs start in; None where the design chooses them."""
        if isinstance(self.start, str):
            return None
        ranges = self.start_ranges
        if ranges is not None and np.any(ranges[:, 0] < ranges[:, 1]):
            return None
        table = np.array(self.start, dtype=float) if ranges is None else ranges[:, 0]
        return np.tile(table, (self.runs, 1)) if table.ndim == 1 else table
