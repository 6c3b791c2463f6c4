"""An experiment of which nothing is chosen: inputs and starts are given."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import model_validator

from oed.foundation.arrays import Array
from oed.kernel.dynamics.space import Space, Spline
from oed.kernel.dynamics.trajectory import Trajectory


class HeldSpace(Space):
    """One experiment alone, whose readings may be chosen.

    Attributes:
        held: inputs in every period of all runs, (N, inputs).
        start: state at the start of every run, (runs, states).
    """

    rest_to_rest: bool = False
    held: tuple[tuple[float, ...], ...]
    start: tuple[tuple[float, ...], ...]

    @model_validator(mode="after")
    def _of_every_period(self) -> Self:
        if len(self.held) != self.all_samples:
            raise ValueError(f"expected inputs of {self.all_samples} periods, got {len(self.held)}")
        return self

    @classmethod
    def of(cls, held: Array, start: Array, *, duration: float) -> HeldSpace:
        """The experiment with these inputs (N, inputs) from starts (runs, states).

        Args:
            held: inputs in each period.
            start: start state of every run.
            duration: duration of one run [s].
        """
        runs = len(start)
        samples = len(held) // runs
        return cls(
            duration=duration,
            samples=samples,
            spline=Spline(degree=0, coefficients=samples),
            runs=runs,
            held=tuple(map(tuple, held.tolist())),
            start=tuple(map(tuple, start.tolist())),
        )

    @property
    def fixed_starts(self) -> Array:
        """Start states of the runs, as they are given."""
        return np.array(self.start, dtype=float).reshape(len(self.start), -1)

    @property
    def only(self) -> Trajectory | None:
        """The experiment."""
        table = np.array(self.held, dtype=float).reshape(len(self.held), -1)
        return self.trajectory(table, self.fixed_starts)
