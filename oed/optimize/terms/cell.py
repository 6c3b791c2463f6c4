"""One sample of a drive: where it leads, what it adds, and the derivatives of both."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.update import Update
from oed.optimize.terms.blocks import Packed


class Cell:
    """A sample as a function of the x handed on to it, of inputs in units of their scale, and of constants.

    x is the system's state, followed by entries of its sensitivities and of a filter's covariance.

    Attributes:
        symbols: x, inputs, constants (SX).
        results: x at the end of the sample, and the entries that it adds (SX).
        states: number of the system's states.
        width: length of x.
        begin: entries of x behind the state where a run begins, (width - states,).
        added: number of entries that a sample adds to the information.
    """

    def __init__(
        self,
        symbols: Sequence[Expression],
        results: Sequence[Expression],
        *,
        states: int,
        begin: Array,
        update: Update | None = None,
    ) -> None:
        """Take the formulas of a sample; functions are made when they are first called.

        Args:
            symbols: x, inputs, constants.
            results: x at the end of the sample, entries that it adds.
            states: number of the system's states.
            begin: entries of x behind the state where a run begins.
            update: a filter's update whose symbols the results are written with.
        """
        self.states, self.begin, self._update = states, begin, update
        self.symbols, self._lifted = list(symbols), ca.cse([ca.densify(part) for part in results])
        self.results: list[Expression] = ca.cse(self._written_out(self._lifted))
        self.width, self.added = int(symbols[0].shape[0]), int(results[1].shape[0])
        self._unknowns = ca.vertcat(*symbols[:2])

    def _written_out(self, expressions: list[Expression]) -> list[Expression]:
        # Without symbols of the update.
        return expressions if self._update is None else self._update.written_out(expressions)

    @cached_property
    def values(self) -> ca.Function:
        """(x, inputs, constants) -> x at the end, what is added."""
        return ca.Function("cell", self.symbols, self.results)

    @cached_property
    def _slopes(self) -> list[Expression]:
        # Of both parts; with an update, then of all that is bent where that is not some of the unknowns.
        update, unknowns = self._update, self._unknowns
        if update is None:
            return list(ca.cse([ca.jacobian(part, unknowns) for part in self._lifted]))
        entries, changes = update.slopes(unknowns)
        parts = [
            ca.jacobian(part, unknowns) + ca.jacobian(part, update.symbols) @ entries for part in self._lifted
        ]
        bent = ca.vertcat(ca.SX.eye(unknowns.shape[0]), entries, changes)
        return list(ca.cse(update.written_out([*parts, bent[self.bent, :], bent[self.half_bent, :]])))

    @cached_property
    def slopes(self) -> list[Packed]:
        """Derivatives of x at the end and of what is added by (x, inputs)."""
        return [Packed(part) for part in self._slopes[:2]]

    @cached_property
    def bent_slopes(self) -> list[Packed]:
        """Derivatives of `bent` and `half_bent` by (x, inputs); [] where these are x and inputs alone."""
        return [Packed(part) for part in self._slopes[2:]]

    @cached_property
    def jacobian(self) -> ca.Function:
        """(x, inputs, constants) -> entries of the slopes."""
        return ca.Function("cell_slopes", self.symbols, [packed.entries for packed in self.slopes])

    @cached_property
    def bent_jacobian(self) -> ca.Function:
        """(x, inputs, constants) -> entries of `bent_slopes`."""
        return ca.Function("bent_slopes", self.symbols, [packed.entries for packed in self.bent_slopes])

    @cached_property
    def _bending(self) -> tuple[list[Expression], Expression]:
        weights = [ca.SX.sym("weights", part.shape[0]) for part in self.results]
        weighted = sum(ca.dot(weight, part) for weight, part in zip(weights, self._lifted, strict=True))
        update, unknowns = self._update, self._unknowns
        if update is None:
            matrix, _ = ca.hessian(weighted, unknowns)
            return weights, ca.cse(matrix)
        matrix, slope = ca.hessian(weighted, ca.vertcat(unknowns, update.symbols))
        more, further = update.curvature(slope[unknowns.shape[0] :], unknowns)
        matrix += ca.diagcat(more, ca.SX(*[update.symbols.shape[0]] * 2))
        return weights, ca.cse(*update.written_out([ca.diagcat(matrix, further)]))

    @cached_property
    def bent(self) -> list[int]:
        """Places in (x, inputs, changed by the update, its changes) that enter not only linearly, without
        `half_bent`.
        """
        places = set(self._bending[1].sparsity().row())
        return sorted(places - set(self.half_bent))

    @cached_property
    def half_bent(self) -> list[int]:
        """Places changed by the update that are bent with others alone, not with each other."""
        if self._update is None:
            return []
        first, matrix = self._unknowns.shape[0], self._bending[1]
        among = range(first, first + self._update.symbols.shape[0])
        places = [place for place in among if matrix[place, :].nnz()]
        return [] if matrix[places, among.start :].nnz() else places

    @cached_property
    def inner(self) -> list[Packed]:
        """Second derivatives of the weighted sum by what is bent; with an update matrices (bent, bent) and
        (half_bent, bent) that with their transposes make up those.
        """
        matrix = self._bending[1]
        if self._update is None:
            return [Packed(matrix[self.bent, self.bent])]
        lower = ca.tril(matrix[self.bent, self.bent])
        return [Packed(lower - ca.diag(ca.diag(lower)) / 2), Packed(matrix[self.half_bent, self.bent])]

    @cached_property
    def curvature(self) -> ca.Function:
        """(x, inputs, constants, weights of both parts) -> entries of `inner`."""
        return ca.Function(
            "cell_curvature", [*self.symbols, *self._bending[0]], [packed.entries for packed in self.inner]
        )
