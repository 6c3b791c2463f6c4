"""How the runs of a drive are cut into pieces, and which coefficients act in each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.space import Space
from oed.kernel.problem import Problem


@dataclass(frozen=True)
class PieceLayout:
    """Pieces of `samples` samples; those of several runs follow each other.

    Attributes:
        space: all drives.
        samples: of a piece; they divide a run's.
        inputs: how many inputs the robot has.
    """

    space: Space
    samples: int
    inputs: int

    @property
    def each(self) -> int:
        """Pieces of a run."""
        return self.space.samples // self.samples

    @property
    def count(self) -> int:
        """Pieces of all runs."""
        return self.each * self.space.runs

    @cached_property
    def held(self) -> Array:
        """Takes the free coefficients of a run to the input held in each of its periods, (N, free)."""
        whole = self.space.own_sampling
        return whole[:, 1:-1] if self.space.rest_to_rest else whole

    @cached_property
    def _spans(self) -> Places:
        # First and last coefficient (pieces of a run, 2) that act in each piece.
        acting = (self.held != 0).reshape(self.each, self.samples, -1).any(axis=1)
        last = acting.shape[1] - 1 - acting[:, ::-1].argmax(axis=1)
        both = np.stack([acting.argmax(axis=1), last], axis=1)
        return np.asarray(np.where(acting.any(axis=1)[:, None], both, 0))

    @cached_property
    def window(self) -> int:
        """Coefficients of an input that act in a piece, at most."""
        return int(np.ptp(self._spans, axis=1).max()) + 1

    @cached_property
    def first(self) -> Places:
        """The first coefficient of each piece's window, (pieces of a run,)."""
        return np.asarray(np.minimum(self._spans[:, 0], self.held.shape[1] - self.window))

    @cached_property
    def basis(self) -> Array:
        """Values of each piece's own coefficients' basis functions, (pieces of a run, samples, window)."""
        columns = self.first[:, None] + np.arange(self.window)
        parts = self.held.reshape(self.each, self.samples, -1)
        return np.asarray(np.take_along_axis(parts, columns[:, None, :], axis=2))

    @cached_property
    def places(self) -> Places:
        """Where each piece's own coefficients stand in z, (pieces, inputs * window), ascending."""
        free = self.held.shape[1]
        own = self.first[:, None] + np.arange(self.window)
        runs = np.concatenate([own + run * free for run in range(self.space.runs)])
        offsets = np.arange(self.inputs) * free * self.space.runs
        return np.asarray((offsets[None, :, None] + runs[:, None, :]).reshape(self.count, -1))


LEAST, MOST = 2, 50
"""Samples of the shortest and the longest piece."""
_OVERHEAD = 70.0
"""Work of a piece besides that of its samples, in the units of `_work`."""


def divisible(problem: Problem) -> PieceLayout | None:
    """How the problem's drives are cut into pieces; None where they have to be written out as a whole.

    That is so for robust limits and other systems, constants of sensors to estimate, noise that readings
    share over time, segments of unequal length, and samples without a divisor that makes a piece both short
    and long enough. Else they are cut as it takes least work.
    """
    space = problem.design
    cuts = problem.measurement.cuts(space.samples)
    if problem.robust is not None or cuts is None or problem.constants:
        return None
    whole = space.samples if cuts.segment == 1 else cuts.segment
    fitting = [
        PieceLayout(space, count, len(problem.system.inputs))
        for count in range(LEAST, MOST + 1)
        if whole % count == 0 and count % cuts.multiple == 0
    ]
    return min(fitting, key=_work, default=None)


def _work(layout: PieceLayout) -> float:
    # A piece costs its samples times the squared number of what acts in it, and something of its own.
    size = layout.inputs * layout.window + 3
    unknowns: int = layout.inputs * layout.held.shape[1]
    return layout.count * (layout.samples * size**2 + _OVERHEAD * unknowns)
