"""From what pieces add up to, to the matrices that a problem judges."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Places
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.joint import start_nuisances
from oed.optimize.terms.base import Terms
from oed.optimize.terms.cell import cuts_of, estimated
from oed.optimize.terms.layout import PieceLayout
from oed.optimize.terms.matrices import Smooth, symmetric, upper_halves
from oed.optimize.terms.small_drives import small_drive

Reader = Callable[[Sequence[int]], Expression]


class Totals:
    """What the pieces of a drive gather together, and the judged entries as a function of it.

    Pieces add up within a group: a segment's, a run's, or the whole drive's. The groups' sums then make up
    the information, squared first where they are rows of a regression.

    Attributes:
        sensors: that are estimated from together; () of a regression.
        group: of every piece.
        groups: how many there are.
        sizes: of the judged matrices.
        finish: their entries of the sums.
    """

    def __init__(self, terms: Terms, layout: PieceLayout, added: int) -> None:
        """Sort the pieces.

        Args:
            terms: whose matrices these are.
            layout: the pieces.
            added: entries that each of them adds.
        """
        problem = self.problem = terms.problem
        self._added, self._size = added, terms.size
        self.sensors, self._cuts = problem.measurement.joint_sensors, cuts_of(problem)
        squared = self._cuts.segment > 1
        self.group: Places = np.repeat(np.arange(problem.design.runs), layout.each)
        if not self.sensors:
            shared = self._cuts.segment // layout.samples if squared else layout.count
            self.group = np.arange(layout.count) // shared
        self.groups = int(self.group[-1]) + 1
        self._square = self._squares() if squared else None
        sums = ca.SX.sym("sums", added * self.groups if self._square is None else self._square.size)
        matrices = self._judged(sums)
        self.sizes = [matrix.shape[0] for matrix in matrices]
        self.finish = Smooth(sums, ca.densify(upper_halves(matrices)))

    @property
    def membership(self) -> ca.DM:
        """The matrix (pieces, groups) that adds pieces up."""
        return _membership(self.group)

    @property
    def by_runs(self) -> tuple[ca.DM, ca.DM]:
        """The matrices (pieces, parts) and (parts, groups) that add pieces up within runs first, to as many
        parts of every run.
        """
        runs = self.problem.design.runs
        if self.groups >= runs:
            return self.membership, ca.DM.eye(self.groups)
        return _membership(np.repeat(np.arange(runs), len(self.group) // runs)), ca.DM.ones(runs, 1)

    @cached_property
    def _blocks(self) -> dict[str, tuple[int, int]]:
        # Of a regression: rows of one group and columns of every block, judged or not.
        robot, regression = self.problem.system, self._cuts.regression
        assert regression is not None
        held, start = ca.SX(1, len(robot.inputs)), ca.SX(len(robot.states), 1)
        blocks = regression.blocks(small_drive(self.problem, held, start))
        return {block.name: tuple(block.design_matrix.shape) for block in blocks}

    def _squares(self) -> Smooth:
        # One group's rows of all regressions -> upper halves of their squares.
        rows = ca.SX.sym("rows", self._added)
        squares, first = [], 0
        for height, columns in self._blocks.values():
            part = ca.reshape(rows[first : first + height * columns], height, columns)
            squares.append(part.T @ part)
            first += height * columns
        return Smooth(rows, upper_halves(squares))

    def _judged(self, sums: Expression) -> list[Expression]:
        # The matrices, as expressions of the sums.
        readers = self._joint(sums) if self.sensors else self._regressions(sums)
        return [
            replace(one, block=replace(one.block, information=reader)).matrix
            for one, reader in zip(self.problem.any_estimations, readers, strict=True)
        ]

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

    def sums(self, groups: Expression) -> Expression:
        """Sums (count,) of the groups' entries (added, groups)."""
        if self._square is None:
            return ca.vec(groups)
        return ca.sum2(self._square.values.map(self.groups)(groups))

    def sums_slopes(self, groups: Expression, slopes: Expression) -> Expression:
        """Derivatives (size, count) of the sums by z, from the `groups` and their `slopes` (size * added,
        groups).
        """
        if self._square is None:
            return ca.reshape(slopes, self._size, -1)
        return self._wide(slopes) @ self._square.slope.map(self.groups)(groups).T

    def weights(self, groups: Expression, weights: Expression) -> tuple[Expression, Expression | None]:
        """Weights (added, groups) of the groups' entries, and the entries' own second derivatives."""
        if self._square is None:
            return ca.reshape(weights, self._added, self.groups), None
        own, bent = self._square.curvature.map("weights", "serial", self.groups, [1], [])(groups, weights)
        return own, bent

    def bent(self, slopes: Expression, bent: Expression) -> Expression:
        """Second derivatives (size, size) by z that squaring adds, from the groups' slopes and those of the
        squares.
        """
        slope, matrix = (
            ca.SX.sym("slope", self._size, self._added),
            ca.SX.sym("bent", self._added, self._added),
        )
        half = ca.Function("half", [slope, matrix], [ca.densify(slope @ matrix)])
        wide = self._wide(slopes)
        return wide @ half.map(self.groups)(wide, bent).T

    def _wide(self, slopes: Expression) -> Expression:
        return ca.reshape(slopes, self._size, self._added * self.groups)


def _membership(group: Places) -> ca.DM:
    # What adds members (n,) of groups up, (n, groups).
    count = int(group[-1]) + 1
    starts = np.searchsorted(group, np.arange(count + 1)).tolist()
    return ca.DM(ca.Sparsity(len(group), count, starts, list(range(len(group)))), 1.0)


def _reader(matrix: Expression, index: Sequence[int] | dict[int, int]) -> Reader:
    def chosen(places: Sequence[int]) -> Expression:
        own = [index[place] for place in places]
        return matrix[own, own]

    return chosen
