"""The design: B-splines of the inputs, and start states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.foundation import views
from oed.foundation.arguments import real_array
from oed.foundation.arrays import Array
from oed.foundation.equality import ByValue
from oed.foundation.presenting import Presented
from oed.foundation.quantities import parse_quantity
from oed.kernel.dynamics import spline


def middles(duration: float, samples: int) -> Array:
    """Times (N,) [s] of the middles of N equal periods."""
    return np.asarray((np.arange(samples, dtype=np.float64) + 0.5) * (duration / samples))


def held_changes(knots: Array, degree: int, coefficients: Array, samples: int, order: int) -> Array:
    """Return the rates (N + 1, inputs) or jerks (N, inputs) of inputs that are held in N equal periods.

    Rates are those of the polygon from the spline's first value to the middle of the first period, from
    middle to middle, and on to the last value. Jerks are the changes of these rates in the middle of each
    period, over one period: the same for a drive and its time reverse. Search, scorer and bounds limit these
    of splines that have no such derivative.

    Args:
        knots: knots of one run [s].
        degree: degree of the run's splines.
        coefficients: (n, inputs); with the identity, the result is the matrix that takes coefficients to it.
        samples: number N of periods.
        order: 1 for rates, 2 for jerks.
    """
    duration = float(knots[-1])
    times = np.concatenate([[0.0], middles(duration, samples), [duration]])
    rates = np.diff(spline.values(knots, degree, coefficients, times), axis=0) / np.diff(times)[:, None]
    return np.asarray(rates if order == 1 else np.diff(rates, axis=0) / (duration / samples))


def bounding_values(knots: Array, degree: int, coefficients: Array, samples: int, order: int) -> Array:
    """Return values (K, inputs) that bound the derivative of an order of inputs at all times: its spline's
    coefficients, a convex hull, or else `held_changes`.

    Args:
        knots: knots of one run [s].
        degree: degree of the run's splines.
        coefficients: (n, inputs); with the identity, the result is the matrix that takes coefficients to it.
        samples: number N of periods of the run.
        order: order of the derivative, 0 to 2.
    """
    if order > degree:
        return held_changes(knots, degree, coefficients, samples, order)
    return spline.derivative(knots, degree, coefficients, order)[1]


@dataclass(frozen=True, repr=False, eq=False)
class Trajectory(ByValue, Presented):
    """A drive: splines of the inputs over time, held sample by sample, from a start state.

    A drive may consist of several runs, each from a start of its own: then their splines follow each other
    on one clock and have nothing in common where they meet.

    Attributes:
        knots: (n + degree + 1,) [s], clamped, from 0 to the duration; the same in every run.
        degree: degree of the splines.
        coefficients: (n, inputs), in the inputs' SI units.
        start: start state (states,), SI; of several runs (runs, states).
        samples: N; the system holds each input at its spline's value in the middle of each period.
        runs: number of runs of equal length among which the N samples are divided.
        weights: weight of every reading, in the order of `parts_of`, (n,); None where all of them are
            taken once.
    """

    knots: Array
    degree: int
    coefficients: Array
    start: Array
    samples: int
    runs: int = 1
    weights: Array | None = None

    def __post_init__(self) -> None:
        """Copy the arrays, check their shapes and make them read-only.

        Raises:
            ValueError: knots and coefficients that do not match, or numbers that are not finite, or knots
                that are no times from 0 to a duration.
        """
        for name in ("knots", "coefficients", "start", "weights"):
            if getattr(self, name) is None:
                continue
            array = real_array(name, getattr(self, name))
            if name == "start" and self.runs == 1:
                array = array.reshape(-1)
            if not np.all(np.isfinite(array)):
                raise ValueError(f"{name} must be finite")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if self.weights is not None and (self.weights.ndim != 1 or np.any(self.weights < 0)):
            raise ValueError("expected weights of readings, none below 0")
        if not len(self.knots) or self.knots[0] != 0 or self.duration <= 0 or np.any(np.diff(self.knots) < 0):
            raise ValueError(f"expected knots that rise from 0 to a positive duration, got {self.knots}")
        expected = len(self.knots) - self.degree - 1
        if self.coefficients.ndim != 2 or len(self.coefficients) != expected:
            raise ValueError(
                f"expected coefficients of shape ({expected}, inputs), got {self.coefficients.shape}"
            )
        if self.runs > 1 and not self._runs_are_alike:
            raise ValueError(f"expected knots that repeat in each of the {self.runs} runs")
        if self.samples % self.runs or len(self.starts) != self.runs:
            raise ValueError(
                f"expected samples that {self.runs} runs share equally and a start for each, got "
                f"{self.samples} samples and start of shape {self.start.shape}"
            )

    @classmethod
    def from_samples(
        cls,
        inputs: npt.ArrayLike,
        duration: float | str,
        start: npt.ArrayLike,
        *,
        rest_to_rest: bool = True,
        runs: int = 1,
    ) -> Trajectory:
        """The drive that holds `inputs` (N, inputs) in N equal periods: polygons through their middles.

        Args:
            inputs: one row per period.
            duration: duration of the whole drive [s], or text with a unit.
            start: start state, (runs, states) of several runs.
            rest_to_rest: the polygon begins and ends at 0 (else at the first and last value).
            runs: number of runs of equal length among which the periods are divided.

        Raises:
            ValueError: a duration that is not positive and finite, or no table of finite inputs.
        """
        if isinstance(duration, str):
            duration = parse_quantity(duration, "s")
        if not 0 < duration < math.inf:
            raise ValueError(f"expected a positive, finite duration, got {duration}")
        rows, duration_of_run = real_array("inputs", inputs), duration / runs
        if rows.ndim != 2 or not len(rows):
            raise ValueError(f"expected inputs of shape (N, inputs), got {rows.shape}")
        parts = []
        for run in np.split(rows, runs):
            ends = np.zeros((2, rows.shape[1])) if rest_to_rest else run[[0, -1]]
            parts += [ends[:1], run, ends[1:]]
        edges = np.concatenate(
            [[0.0, 0.0], middles(duration_of_run, len(rows) // runs), [duration_of_run, duration_of_run]]
        )
        knots = spline.repeated_knots(edges, 1, runs)
        return cls(knots, 1, np.vstack(parts), real_array("start", start), len(rows), runs)

    def on_knots(self, finer: Array) -> Trajectory:
        """The drive by splines of more knots: what it does is what it did.

        Args:
            finer: knots of one run, on its own clock [s]: all that the splines have, and others inside.

        Raises:
            ValueError: knots that leave out some of the splines'.
        """
        tables = [spline.refined(run.knots, self.degree, run.coefficients, finer) for run in self.each]
        knots = spline.repeated_knots(finer, self.degree, self.runs)
        return replace(self, knots=knots, coefficients=np.vstack(tables))

    @property
    def starts(self) -> Array:
        """The start state of every run, (runs, states)."""
        return self.start if self.start.ndim == 2 else self.start[None, :]

    @cached_property
    def each(self) -> tuple[Trajectory, ...]:
        """Every run as a drive of its own, on its own clock."""
        if self.runs == 1:
            return (self,)
        samples, parts = self.samples // self.runs, np.split(self.coefficients, self.runs)
        return tuple(
            Trajectory(self._run_knots, self.degree, part, start, samples)
            for part, start in zip(parts, self.starts, strict=True)
        )

    @property
    def _run_knots(self) -> Array:
        return self.knots[: len(self.coefficients) // self.runs + self.degree + 1]

    @property
    def _runs_are_alike(self) -> bool:
        if len(self.coefficients) % self.runs or len(self.coefficients) // self.runs <= self.degree:
            return False
        repeated = spline.repeated_knots(self._run_knots, self.degree, self.runs)
        return np.allclose(self.knots, repeated, rtol=0, atol=1e-9 * self.duration)

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.knots[-1])

    @property
    def period(self) -> float:
        """Sample period T [s]."""
        return self.duration / self.samples

    @cached_property
    def inputs(self) -> Array:
        """Inputs held in each period, (N, inputs), read-only."""
        # By each run's own clock: on the common one, rounding may move a knot past a period's middle.
        held = [run.inputs_at(middles(run.duration, run.samples)) for run in self.each]
        table = np.concatenate(held)
        table.setflags(write=False)
        return table

    @property
    def ends(self) -> Array:
        """Inputs at the begin and at the end of every run, (2 runs, inputs)."""
        return np.concatenate([run.inputs_at(np.array([0.0, run.duration])) for run in self.each])

    def inputs_at(self, times: Array, order: int = 0) -> Array:
        """Return values of the splines, or of a derivative, at `times` [s], (len(times), inputs); the
        `held_changes` of all runs where the splines have no such derivative.

        Args:
            times: times of evaluation [s], on the clock of all runs.
            order: order of the derivative, 0 to 2.
        """
        if order > self.degree:
            return self._held_changes(order)
        return spline.values(self.knots, self.degree, self.coefficients, times, order)

    def extremes(self, order: int) -> Array:
        """Values (K, inputs) among which every input's least and largest are, of all times; of an order of 1
        or 2 those of its rates or jerks. K depends on knots and degree alone.
        """
        if order == self.degree == 0:
            # Of steps, what is held: nobody drives a value between two periods' middles.
            return self.inputs
        tables = []
        if order <= self.degree:
            tables = [spline.extremes(run.knots, run.degree, run.coefficients, order) for run in self.each]
        repetitions = np.unique(self._run_knots, return_counts=True)[1]
        if order > self.degree or (order and np.any(repetitions[1:-1] > self.degree - order + 1)):
            # A jump has no derivative: what is held has its rates and jerks.
            tables.append(self._held_changes(order))
        return np.concatenate(tables)

    def _held_changes(self, order: int) -> Array:
        return np.concatenate(
            [held_changes(run.knots, run.degree, run.coefficients, run.samples, order) for run in self.each]
        )

    def to_dataframe(self, names: Sequence[str] = ()) -> Any:
        """A pandas DataFrame with a row per period: its begin `t` [s] and the inputs held in it, SI.

        Args:
            names: names of the inputs, e.g. `problem.model.input_names`; "input_1", ... by default.

        Raises:
            ValueError: another number of names.
            UserMistake: pandas is not installed.
        """
        return views.make("table", self, names)
