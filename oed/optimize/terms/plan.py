"""The parts of which a drive's terms are put together, and what is read at the runs' last instants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from oed.kernel.problem import Problem
from oed.optimize.terms.base import Terms
from oed.optimize.terms.cell import read_end
from oed.optimize.terms.condensing import Condensing
from oed.optimize.terms.kernel import Kernel
from oed.optimize.terms.layout import PieceLayout
from oed.optimize.terms.link import Link
from oed.optimize.terms.matrices import symmetric
from oed.optimize.terms.run_unknowns import RunUnknowns
from oed.optimize.terms.totals import Totals


class Ending:
    """The information of what is read at a run's last instant, after all its pieces, as a function of what is
    handed on and of the last inputs.
    """

    def __init__(self, problem: Problem, link: Link, size: int, scale: Sequence[float]) -> None:
        """Write it."""
        state = ca.SX.sym("state", link.width)
        held = ca.SX.sym("held", len(problem.system.inputs))
        gathered = read_end(problem, ca.DM(list(scale)) * held, state[: link.states])
        carry = link.carry
        turned = carry.turned(symmetric(gathered, carry.gathered_size), carry.whole(state[link.states :]))
        self._arguments, self._gathered = [state, held], ca.cse(turned)
        self._width = link.width
        # What the products by unknowns are of (MX): written out they would be most of the generated C.
        self._given = [ca.MX.sym("state", state.shape[0]), ca.MX.sym("held", held.shape[0])]
        self._slopes = ca.MX.sym("slopes", size, state.shape[0] + held.shape[0])

    @cached_property
    def values(self) -> ca.Function:
        """(state handed on, held) -> information."""
        return ca.Function("ending", self._arguments, [self._gathered])

    @cached_property
    def slopes(self) -> ca.Function:
        """(the same, their derivatives) -> derivatives (size, added) of the information by unknowns."""
        steep = ca.jacobian(self._gathered, ca.vertcat(*self._arguments))
        own = ca.Function("ending_jacobian", self._arguments, [ca.cse(steep)])
        slope = ca.densify(self._slopes @ own(*self._given).T)
        return ca.Function("ending_slopes", [*self._given, self._slopes], [slope])

    @cached_property
    def curvature(self) -> ca.Function:
        """(the same, weights of the information) -> weights of the state, second derivatives."""
        weights = ca.SX.sym("weights", self._gathered.shape[0])
        bent, slope = ca.hessian(ca.dot(weights, self._gathered), ca.vertcat(*self._arguments))
        own = ca.Function(
            "ending_hessian",
            [*self._arguments, weights],
            ca.cse([ca.densify(slope[: self._width, :]), ca.densify(bent)]),
        )
        weighing = ca.MX.sym("weights", weights.shape[0])
        first, second = own(*self._given, weighing)
        whole = self._slopes @ second @ self._slopes.T
        return ca.Function("ending_curvature", [*self._given, self._slopes, weighing], [first, whole])


@dataclass(frozen=True)
class Plan:
    """The parts of which a drive's terms are put together.

    Attributes:
        terms: what they are of, and z.
        layout: the pieces.
        kernel: one of them.
        link: what it hands on.
        total: what they add up to.
    """

    terms: Terms
    layout: PieceLayout
    kernel: Kernel
    link: Link
    total: Totals

    @cached_property
    def unknowns(self) -> RunUnknowns:
        """Which each run has."""
        return RunUnknowns.of(self.terms.embedding, self.terms.size)

    @cached_property
    def condensing(self) -> Condensing:
        """How the pieces follow each other."""
        return Condensing(self.link, self.layout, self.unknowns)

    @cached_property
    def ending(self) -> Ending | None:
        """What is read at the runs' last instants; None of regressions."""
        return (
            Ending(self.terms.problem, self.link, self.unknowns.per_run, self.kernel.cell.scale)
            if self.total.sensors
            else None
        )
