"""From what pieces add up to, to the matrices that a problem judges."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Places
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.information import information
from oed.kernel.measurement.sensor import start_nuisances
from oed.kernel.problem import Problem
from oed.optimize.terms.base import small_drive, symmetric, upper_half
from oed.optimize.terms.cell import cuts_of, estimated
from oed.optimize.terms.layout import PieceLayout

Reader = Callable[[Sequence[int]], Expression]


class Totals:
    """What the pieces of a drive gather together.

    Pieces add up within a group: a segment's, a run's, or the whole drive's. The groups' sums then make up
    the information, squared first where they are rows of a regression.

    Attributes:
        group: of every piece.
        groups: how many there are.
    """

    def __init__(self, problem: Problem, layout: PieceLayout) -> None:
        """Sort the pieces."""
        self.problem, self._layout = problem, layout
        self.sensors, self._cuts = problem.measurement.joint_sensors, cuts_of(problem)
        self.squared = self._cuts.segment > 1
        self.group: Places = np.repeat(np.arange(problem.design.runs), layout.each)
        if not self.sensors:
            shared = self._cuts.segment // layout.samples if self.squared else layout.count
            self.group = np.arange(layout.count) // shared
        self.groups = int(self.group[-1]) + 1

    @property
    def membership(self) -> ca.DM:
        """The matrix (pieces, groups) that adds pieces up."""
        starts = np.searchsorted(self.group, np.arange(self.groups + 1)).tolist()
        return ca.DM(ca.Sparsity(len(self.group), self.groups, starts, list(range(len(self.group)))), 1.0)

    @cached_property
    def _blocks(self) -> dict[str, tuple[int, int]]:
        # Of a regression: rows of one group and columns of every block, judged or not.
        robot, regression = self.problem.system, self._cuts.regression
        assert regression is not None
        held, start = ca.SX(1, len(robot.inputs)), ca.SX(len(robot.states), 1)
        blocks = regression.blocks(small_drive(self.problem, held, start))
        return {block.name: tuple(block.design_matrix.shape) for block in blocks}

    def square(self, size: int) -> ca.Function:
        """One group's rows of all regressions -> upper halves of their squares."""
        rows = ca.SX.sym("rows", size)
        halves, first = [], 0
        for height, columns in self._blocks.values():
            part = ca.reshape(rows[first : first + height * columns], height, columns)
            halves.append(upper_half(part.T @ part))
            first += height * columns
        return ca.Function("square", [rows], [ca.vertcat(*halves)])

    def finish(self, size: int) -> tuple[Expression, Expression, list[int]]:
        """The sums (size,), the judged matrices' entries as expressions of them, and the matrices' sizes."""
        sums = ca.SX.sym("sums", size)
        readers = self._joint(sums) if self.sensors else self._regressions(sums)
        matrices = []
        for one, reader in zip(self.problem.any_estimations, readers, strict=True):
            matrices.append(
                information(
                    replace(one.block, information=reader),
                    self.problem.criterion.scaling,
                    parameters=one.judged,
                    unwanted=one.parameters[len(one.judged) :],
                    prior=one.prior,
                )
            )
        entries = ca.vertcat(*(upper_half(matrix) for matrix in matrices))
        return sums, ca.densify(entries), [matrix.shape[0] for matrix in matrices]

    def _regressions(self, sums: Expression) -> list[Reader]:
        readers, first = dict[str, Reader](), 0
        for name, (_, columns) in self._blocks.items():
            count = columns * (columns + 1) // 2
            readers[name] = _reader(symmetric(sums[first : first + count], columns), list(range(columns)))
            first += count
        return [readers[one.block.name] for one in self.problem.any_estimations]

    def _joint(self, sums: Expression) -> list[Reader]:
        # Parameters and nuisances are common to all runs, a start is one run's own.
        problem, runs = self.problem, self.problem.design.runs
        (one,) = problem.any_estimations
        nuisances, places = one.block.nuisances, estimated(problem)
        begun = len(start_nuisances(self.sensors, problem.system, runs)) // runs
        count, own = len(places), len(nuisances) - runs * begun
        total = ca.SX.zeros(count + len(nuisances), count + len(nuisances))
        for run, part in enumerate(ca.vertsplit(sums, sums.shape[0] // runs)):
            starts = range(count + run * begun, count + (run + 1) * begun)
            at = [*range(count), *starts, *range(count + runs * begun, count + runs * begun + own)]
            total[at, at] += symmetric(part, len(at))
        known = [0.0] * count + [(entry.deviation or np.inf) ** -2 for entry in nuisances]
        total = total + ca.diag(ca.DM(known))
        size = len(one.block.parameters)
        index = dict(zip(places, range(count), strict=True))
        index |= {size + place: count + place for place in range(len(nuisances))}
        return [_reader(total, index)]


def _reader(matrix: Expression, index: Sequence[int] | dict[int, int]) -> Reader:
    def chosen(places: Sequence[int]) -> Expression:
        own = [index[place] for place in places]
        return matrix[own, own]

    return chosen


class Sum:
    """The judged entries as a function of what the groups' pieces add up to, with its derivatives."""

    def __init__(self, totals: Totals, added: int) -> None:
        """Write the functions, for so many entries added by every piece."""
        self.totals, self.added = totals, added
        self.square = totals.square(added) if totals.squared else None
        per_group = self.square.size1_out(0) if self.square is not None else added
        self.count = per_group if totals.squared else per_group * totals.groups
        self._sums, self._entries, self.sizes = totals.finish(self.count)
        if self.square is None:
            return
        rows, weights = ca.SX.sym("rows", added), ca.SX.sym("weights", self.count)
        squared = self.square(rows)
        slope = ca.jacobian(squared, rows)
        self.square_slope = ca.Function("square_slope", [rows], [ca.densify(slope)])
        bent = ca.jacobian(slope.T @ weights, rows)
        self.square_weights = ca.Function(
            "square_weights", [rows, weights], [ca.densify(slope.T @ weights), ca.densify(bent)]
        )

    @cached_property
    def finish(self) -> ca.Function:
        """Sums -> entries."""
        return ca.Function("finish", [self._sums], [self._entries])

    @cached_property
    def slope(self) -> ca.Function:
        """Sums -> derivatives of the entries."""
        return ca.Function("finish_slope", [self._sums], [ca.densify(ca.jacobian(self._entries, self._sums))])

    @cached_property
    def curvature(self) -> ca.Function:
        """(sums, weights of the entries) -> weights of the sums, second derivatives."""
        weights = ca.SX.sym("weights", self._entries.shape[0])
        curvature, slope = ca.hessian(ca.dot(weights, self._entries), self._sums)
        return ca.Function("finish_curvature", [self._sums, weights], [ca.densify(slope), curvature])

    def sums(self, groups: Expression) -> Expression:
        """Sums (count,) of the groups' entries (added, groups)."""
        if self.square is None:
            return ca.vec(groups)
        return ca.sum2(self.square.map(self.totals.groups)(groups))

    def sums_slopes(self, groups: Expression, slopes: Expression, size: int) -> Expression:
        """Derivatives (size, count) of the sums by z, from the entries' `slopes` (size * added, groups).

        Args:
            groups: entries of each group.
            slopes: theirs by z.
            size: of z.
        """
        if self.square is None:
            return ca.reshape(slopes, size, self.count)
        return self._wide(slopes, size) @ self.square_slope.map(self.totals.groups)(groups).T

    def weights(self, groups: Expression, weights: Expression) -> tuple[Expression, Expression | None]:
        """Weights (added, groups) of the groups' entries, and the entries' own second derivatives."""
        if self.square is None:
            return ca.reshape(weights, self.added, self.totals.groups), None
        own, bent = self.square_weights.map("weights", "serial", self.totals.groups, [1], [])(groups, weights)
        return own, bent

    def bent(self, slopes: Expression, bent: Expression, size: int) -> Expression:
        """Second derivatives (size, size) by z that squaring adds.

        Args:
            slopes: of the groups by z.
            bent: weights of the squares.
            size: of z.
        """
        slope, matrix = ca.SX.sym("slope", size, self.added), ca.SX.sym("bent", self.added, self.added)
        half = ca.Function("half", [slope, matrix], [ca.densify(slope @ matrix)])
        wide = self._wide(slopes, size)
        return wide @ half.map(self.totals.groups)(wide, bent).T

    def _wide(self, slopes: Expression, size: int) -> Expression:
        return ca.reshape(slopes, size, self.added * self.totals.groups)
