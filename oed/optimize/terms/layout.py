"""How the runs of a drive are cut into pieces, and which of the inputs' unknowns act in each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.embedding import Embedding, embedding_of
from oed.kernel.dynamics.space import Space
from oed.kernel.measurement.joint import cuts_of as measurement_cuts
from oed.kernel.problem import Problem
from oed.optimize.terms.run_unknowns import RunUnknowns


@dataclass(frozen=True)
class Window:
    """Which of an input's unknowns act in each piece of a run.

    Attributes:
        first: the first of each piece, (pieces,).
        basis: values of each piece's own unknowns' basis functions, (pieces, samples, width).
    """

    first: Places
    basis: Array

    @classmethod
    def of(cls, held: Array, pieces: int) -> Window:
        """Of what takes a run's unknowns to the values held, (N, n), in so many pieces."""
        parts = held.reshape(pieces, -1, held.shape[1])
        acting = (parts != 0).any(axis=1)
        last = acting.shape[1] - 1 - acting[:, ::-1].argmax(axis=1)
        both = np.stack([acting.argmax(axis=1), last], axis=1)
        spans = np.where(acting.any(axis=1)[:, None], both, 0)
        width = int(np.ptp(spans, axis=1).max()) + 1
        first = np.minimum(spans[:, 0], held.shape[1] - width)
        columns = first[:, None] + np.arange(width)
        return cls(first, np.asarray(np.take_along_axis(parts, columns[:, None, :], axis=2)))

    @property
    def width(self) -> int:
        """How many act in a piece, at most."""
        return int(self.basis.shape[2])

    @property
    def places(self) -> Places:
        """Those of each piece, (pieces, width)."""
        return np.asarray(self.first[:, None] + np.arange(self.width))


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
    def embedding(self) -> Embedding:
        """What the inputs' unknowns are."""
        return embedding_of(self.space, self.inputs)

    @cached_property
    def windows(self) -> tuple[Window, ...]:
        """Which of each input's unknowns act in the pieces."""
        # Inputs of one spline have the same.
        known: dict[int, Window] = {}
        for held in self.embedding.own_held:
            if id(held) not in known:
                known[id(held)] = Window.of(held, self.each)
        return tuple(known[id(held)] for held in self.embedding.own_held)

    @property
    def own(self) -> int:
        """Unknowns of all inputs that act in a piece, at most."""
        return sum(one.width for one in self.windows)

    @cached_property
    def basis(self) -> Array:
        """Slopes of each piece's inputs by its own unknowns, (pieces of a run, samples, inputs, own)."""
        found, first = np.zeros((self.each, self.samples, self.inputs, self.own)), 0
        for place, one in enumerate(self.windows):
            found[:, :, place, first : first + one.width] = one.basis
            first += one.width
        return found

    @cached_property
    def within(self) -> Places:
        """Where the own unknowns of each of a run's pieces stand among the inputs' of the run, (pieces of a
        run, own), ascending.
        """
        firsts = np.cumsum([0, *self.embedding.counts[:-1]])
        columns = [first + one.places for first, one in zip(firsts, self.windows, strict=True)]
        return np.concatenate(columns, axis=1)

    @cached_property
    def places(self) -> Places:
        """Where each piece's own unknowns stand in z, (pieces, own), ascending."""
        inputs = RunUnknowns.of(self.embedding, self.embedding.size)
        return inputs.places[:, self.within].reshape(self.count, self.own)


LEAST, MOST = 2, 50
"""Samples of the shortest and the longest piece."""
_OVERHEAD = 70.0
"""Work of a piece besides that of its samples, in the units of `_work`."""


def divisible(problem: Problem) -> PieceLayout | None:
    """How the problem's drives are cut into pieces; None where they have to be written out as a whole.

    That is so for systems without inputs, for robust limits and other systems, constants of sensors to
    estimate, noise that readings share over time, segments of unequal length, and samples without a divisor
    that makes a piece both short and long enough. Else they are cut as it takes least work.
    """
    space = problem.design
    cuts = measurement_cuts(problem.measurement, space.samples)
    if problem.robust is not None or cuts is None or problem.constants or not problem.system.inputs:
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
    size = layout.own + 3
    unknowns: int = sum(layout.embedding.counts)
    return layout.count * (layout.samples * size**2 + _OVERHEAD * unknowns)
