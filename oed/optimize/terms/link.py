"""What one piece hands on to the next, and how its derivatives become those of what is handed on."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca

from oed.foundation.arrays import Bools
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.blocks import Packed, pull
from oed.optimize.terms.carry import Carry
from oed.optimize.terms.kernel import Kernel


class Link:
    """A kernel with the sensitivities that go through it.

    The state handed on is the robot's, followed by the sensitivities' entries that change along a drive.

    Attributes:
        kernel: the piece.
        carry: its sensitivities.
        states: of the robot.
        width: of the state handed on.
        added: entries that a piece adds to the run's information.
    """

    def __init__(self, kernel: Kernel, carry: Carry) -> None:
        """Take the parts; functions are compiled when first used."""
        self.kernel, self.carry, self.states = kernel, carry, kernel.states
        self.width = self.states + len(carry.moving)
        self.added = int(carry.added.shape[0])

    @property
    def _arguments(self) -> list[Expression]:
        return [self.carry.carried, self.kernel.symbols]

    @cached_property
    def follow(self) -> ca.Function:
        """(carried, gathered) -> carried at the end."""
        return ca.Function("follow", self._arguments, [self.carry.following])

    @cached_property
    def add(self) -> ca.Function:
        """(carried, gathered) -> what is added to the information."""
        return ca.Function("add", self._arguments, [self.carry.added])

    @cached_property
    def _given(self) -> tuple[list[Expression], list[Expression]]:
        # A piece's slopes by its unknowns: of the end state, of what it gathers; and symbols (MX) for them.
        kernel, states = self.kernel, self.states
        ends = ca.MX.sym("ends", kernel.size, kernel.cell.width)
        gathered = ca.MX.sym("gathered", kernel.size, len(kernel.informed))
        parts = [
            _masked(one, pattern) for one, pattern in zip((ends, gathered), kernel.patterns, strict=True)
        ]
        return [parts[0][:states, :], ca.vertcat(parts[0][states:, :], parts[1])], [ends, gathered]

    @cached_property
    def _symbols(self) -> list[Expression]:
        # For what is handed on, and for what a piece gathers (MX).
        return [
            ca.MX.sym("carried", self.carry.carried.shape[0]),
            ca.MX.sym("gathered", self.kernel.symbols.shape[0]),
        ]

    @cached_property
    def _partial(self) -> ca.Function:
        # (carried, gathered) -> slopes of what is handed on and of the added by carried, and by gathered.
        both = [self.carry.following, self.carry.added]
        results = [ca.jacobian(one, by) for by in self._arguments for one in both]
        return ca.Function("partial", self._arguments, ca.cse(results))

    @cached_property
    def _slopes(self) -> list[Expression]:
        # (end of all that is handed on, information) by (begin of it), and by the piece's own unknowns.
        (end, gathered), symbols = self._given
        states, own = slice(0, self.states), slice(self.states, None)
        *carried, following, added = self._partial(*self._symbols)
        through = [following @ gathered, added @ gathered]
        beside = ca.MX(self.states, len(self.carry.moving))
        onward = ca.blockcat([[end[:, states], beside], [through[0][:, states], carried[0]]])
        moved = ca.vertcat(end[:, own], through[0][:, own])
        by_begin = ca.horzcat(through[1][:, states], carried[1])
        return [onward, moved, by_begin, through[1][:, own], *symbols]

    @cached_property
    def onward(self) -> Packed:
        """The end of what is handed on by its begin."""
        return Packed(self._slopes[0])

    @cached_property
    def added_by_begin(self) -> Packed:
        """The information added by the begin of what is handed on."""
        return Packed(self._slopes[2])

    @cached_property
    def jacobian(self) -> ca.Function:
        """(carried, gathered, a piece's slopes of what it hands on, of information) -> entries of `onward`,
        the end by own unknowns (own, width), entries of `added_by_begin`, the added by own unknowns
        (own, added).
        """
        _, moved, _, own, *slopes = self._slopes
        results = [self.onward.entries, ca.densify(moved.T), self.added_by_begin.entries, ca.densify(own.T)]
        return ca.Function("link_slopes", [*self._symbols, *slopes], results)

    @cached_property
    def pull(self) -> ca.Function:
        """(entries of `added_by_begin`, weights of the added) -> weights that they give the begin."""
        return pull(self.added_by_begin, self.width)

    @cached_property
    def _weighted(self) -> tuple[Expression, Expression, Expression]:
        weights = [ca.SX.sym("weights", size) for size in (len(self.carry.moving), self.added)]
        total = ca.dot(weights[0], self.carry.following) + ca.dot(weights[1], self.carry.added)
        return weights[0], weights[1], total

    @cached_property
    def pull_gathered(self) -> ca.Function:
        """(carried, gathered, weights of carried at the end, of the added) -> weights of gathered."""
        *weights, total = self._weighted
        slope = ca.densify(ca.gradient(total, self.kernel.symbols))
        return ca.Function("pull_gathered", [*self._arguments, *weights], [slope])

    @cached_property
    def _bent_partial(self) -> ca.Function:
        # (carried, gathered, weights of carried, of the added) -> second derivatives of the weighted sum by
        # carried, by (carried, gathered), and by gathered: nothing without process noise.
        *weights, total = self._weighted
        slope = ca.gradient(total, self.carry.carried)
        again, _ = ca.hessian(total, self.kernel.symbols)
        results = [ca.jacobian(slope, self.carry.carried), ca.jacobian(slope, self.kernel.symbols), again]
        return ca.Function("bent_partial", [*self._arguments, *weights], ca.cse(results))

    @cached_property
    def _bending(self) -> tuple[list[Expression], Expression, Expression, Expression]:
        # Second derivatives of the weighted sum: by (begin), (begin, own), (own).
        weights = [ca.MX.sym("weights", size) for size in (len(self.carry.moving), self.added)]
        arguments = [*self._symbols, *weights]
        carried, crossed, again = self._bent_partial(*arguments)
        (_, gathered), entries = self._given
        whole = ca.MX.sym("curvature", self.kernel.size, self.kernel.size)
        mixed = crossed @ gathered
        bent = whole + gathered.T @ (again @ gathered) if again.nnz() else whole
        states, own = slice(0, self.states), slice(self.states, None)
        inner = ca.blockcat([[bent[states, states], mixed[:, states].T], [mixed[:, states], carried]])
        across = ca.vertcat(bent[states, own], mixed[:, own])
        return [*arguments, *entries, whole], inner, across, bent[own, own]

    @cached_property
    def bent(self) -> Sequence[int]:
        """Which of what is handed on enters anything but linearly."""
        _, inner, across, _ = self._bending
        both = ca.horzcat(inner, across).sparsity()
        return sorted(set(both.row()))

    @cached_property
    def inner(self) -> Packed:
        """Second derivatives by the bent part of the begin."""
        return Packed(self._bending[1][self.bent, self.bent])

    @cached_property
    def hessian(self) -> ca.Function:
        """(carried, gathered, weights of carried, of the added, a piece's slopes of what it hands on and of
        information, its second derivatives) -> entries of `inner`, second derivatives by (own, bent) and
        by (own, own).
        """
        arguments, _, across, own = self._bending
        results = [self.inner.entries, ca.densify(across[self.bent, :].T), ca.densify(own)]
        return ca.Function("link_curvature", arguments, results)


def _masked(transposed: Expression, pattern: Bools) -> Expression:
    # A matrix given transposed and dense, without the zeros by the start state that the pattern knows.
    whole = transposed.T
    places = ca.sparsify(ca.DM(pattern.astype(float))).sparsity()
    start = ca.project(whole[:, : pattern.shape[1]], places)
    return ca.horzcat(start, whole[:, pattern.shape[1] :])
