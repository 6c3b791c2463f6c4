"""Terms that are written as expressions, and their functions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property

import casadi as ca

from oed.foundation.arrays import Array
from oed.kernel.dynamics.direct_call import DirectCall
from oed.kernel.dynamics.expression import Expression
from oed.optimize.condensed.calls import ArrayFunction
from oed.optimize.terms.base import Functions, Terms
from oed.optimize.terms.begun import Begun, Weighted
from oed.optimize.terms.blocks import Packed


class Swept(ABC):
    """The terms at z as expressions (MX).

    Attributes:
        z: the unknowns.
        entries: of the matrices (their upper halves, stacked).
        rows: of limits, (rows,).
        entry_slopes: derivatives of the entries by z, dense.
        row_slopes: those of the rows, sparse.
    """

    z: Expression

    @property
    @abstractmethod
    def entries(self) -> Expression:
        """The matrices' entries."""

    @property
    @abstractmethod
    def rows(self) -> Expression:
        """The limits' rows."""

    @property
    @abstractmethod
    def entry_slopes(self) -> Expression:
        """Derivatives of the entries by z."""

    @property
    @abstractmethod
    def row_slopes(self) -> Expression:
        """Derivatives of the rows by z."""

    @abstractmethod
    def begun(self, samples: Expression) -> Begun:
        """What is known at the begins of some samples (1, K), counted through all runs."""

    @abstractmethod
    def curvature(self, entries: Expression, rows: Expression, begun: Sequence[Weighted]) -> Expression:
        """Second derivatives (size, size) by z of the weighted sum of entries, rows and what has begun."""


def _functions_of(terms: WrittenTerms, count: int) -> Functions:
    sweep, slots = terms.sweep(), terms.slots(count)
    given, rows, slopes = [sweep.z], sweep.rows, sweep.row_slopes
    weights = [ca.MX.sym("entries", terms.entry_count), ca.MX.sym("rows", rows.shape[0] + count)]
    fixed, own = ca.vertsplit(weights[1], [0, rows.shape[0], weights[1].shape[0]])
    weighted, more = list[Weighted](), ca.MX(terms.size, terms.size)
    if count:
        numbers = ca.MX.sym("numbers", slots.width)
        begun = sweep.begun(slots.split(numbers)[0])
        around = slots.around(sweep.z, begun, numbers, terms.size)
        given.append(numbers)
        rows, slopes = ca.vertcat(rows, around.values), ca.vertcat(slopes, around.slopes)
        one, more = around.curvature(own)
        weighted.append(one)
    curvature = ca.triu(sweep.curvature(weights[0], fixed, weighted) + more)
    calls = [
        ca.Function("terms", given, [ca.densify(sweep.entries), ca.densify(rows)]),
        ca.Function("slopes", given, [ca.densify(sweep.entry_slopes), Packed(slopes).entries]),
        ca.Function("curvature", [*given, *weights], [Packed(curvature).entries]),
    ]
    patterns = [
        [ca.Sparsity.dense(terms.entry_count), ca.Sparsity.dense(rows.shape[0])],
        [ca.Sparsity.dense(terms.entry_count, terms.size), slopes.sparsity()],
        [curvature.sparsity()],
    ]
    return Functions(
        *(
            ArrayFunction(
                call.name(), [call.numel_in(place) for place in range(call.n_in())], results, DirectCall(call)
            )
            for call, results in zip(calls, patterns, strict=True)
        )
    )


class WrittenTerms(Terms):
    """Terms whose functions are written out."""

    @abstractmethod
    def sweep(self) -> Swept:
        """The terms at z as expressions."""

    @property
    @abstractmethod
    def scores(self) -> ca.Function:
        """Z -> entries of the matrices, and the most by which every limit is exceeded at the points looked
        at, over its size; below 0 where it is not.
        """

    @cached_property
    def _functions(self) -> dict[int, Functions]:
        return {}

    def functions(self, slots: int = 0) -> Functions:
        """Return the terms' functions with so many slots for rows of instants."""
        if slots not in self._functions:
            self._functions[slots] = _functions_of(self, slots)
        return self._functions[slots]

    @cached_property
    def _scorers(self) -> dict[tuple[int, int], DirectCall]:
        return {}

    def scored(self, candidates: Array, threads: int = 1) -> tuple[Array, Array]:
        """Entries of candidates, and by how much they exceed each limit.

        Args:
            candidates: unknowns, (K, size).
            threads: that share the work; their number changes no digit.
        """
        count, workers = len(candidates), min(threads, len(candidates))
        if (count, workers) not in self._scorers:
            several = ("thread", workers) if workers > 1 else ()
            self._scorers[count, workers] = DirectCall(self.scores.map(count, *several))
        entries, excess = self._scorers[count, workers](candidates)
        return entries.reshape(count, -1), excess.reshape(count, -1)
