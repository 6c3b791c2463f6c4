"""Drives written out sample by sample as one expression, and differentiated as they stand: the reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from oed.kernel.dynamics.rollout import Drive, instant_of
from oed.kernel.limit import PathLimit, Rows
from oed.kernel.problem import Problem
from oed.optimize.terms.chosen import ChosenRows
from oed.optimize.terms.matrices import upper_halves
from oed.optimize.terms.needs import by_instants
from oed.optimize.terms.row_bounds import RowBounds, said_once
from oed.optimize.terms.terms import Terms
from oed.optimize.terms.unknowns import Unknowns


@dataclass(frozen=True)
class Called:
    """Functions of z: entries and rows, their derivatives, second derivatives of weighted sums of them."""

    values: Callable[..., Any]
    jacobian: Callable[..., Any]
    hessian: Callable[..., Any]


def called(terms: Terms, chosen: ChosenRows | None = None) -> Called:
    """The terms' own entries and rows."""
    rows = terms.entries_of_rows(0 if chosen is None else len(chosen))

    def values(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        point = terms.at(z)
        return point.entries, rows.values(point, chosen)

    def jacobian(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        point, table = terms.at(z), np.zeros((rows.count, terms.size))
        table[rows.row, rows.column] = rows.slopes(point, chosen)
        return point.entry_slopes, table

    def hessian(z: np.ndarray, entries: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return np.triu(rows.curvature(terms.at(z), entries, weights, chosen))

    return Called(values, jacobian, hessian)


class WrittenOut(Unknowns):
    """Information and limit rows as expressions of z, with rows of instants behind the others."""

    def __init__(self, problem: Problem, refine: int = 1) -> None:
        super().__init__(problem, refine)
        begin, _ = self.drive.ends_of(self.drive.states)
        others = [
            self.drive.again(ca.DM(parameters), begin + ca.DM(shift))
            for parameters, shift in problem.judged_systems
        ]
        matrices = [[part.matrix for part in problem.estimations(drive)] for drive in others]
        self.sizes = [matrix.shape[0] for matrix in matrices[0]]
        self.entries = upper_halves([matrix for system in matrices for matrix in system])
        self.entry_count = self.entries.shape[0]
        # Rows that nothing moves are no matter of a search.
        self.every = [self._moved(rows) for rows in problem.limit_rows(self.drive)]
        self.limits = [self._fixed(place, rows) for place, rows in enumerate(self.every)]
        self.rows = [RowBounds(rows.lower, rows.upper, rows.size, rows.unit) for rows in self.limits]
        self.linear = [
            not any(ca.which_depends(rows.expression, self.unknowns, 2, True)) for rows in self.limits
        ]

    def _moved(self, rows: Rows) -> Rows:
        """Without rows that no unknown moves."""
        rows = replace(rows, expression=ca.densify(rows.expression))
        moved = ca.which_depends(rows.expression, self.unknowns, 1, True)
        return chosen_rows(rows, np.array(moved, dtype=bool))

    def _fixed(self, place: int, rows: Rows) -> Rows:
        """Without rows of instants, and rows that say the same."""
        limit = self.problem.limits[place]
        if by_instants(self.problem, limit):
            return chosen_rows(rows, np.zeros(len(rows.lower), dtype=bool))
        bent = any(ca.which_depends(rows.expression, self.unknowns, 2, True))
        if limit.looks_at != "inputs" or not rows.lower.size or bent:
            return rows
        slopes = ca.densify(ca.jacobian(rows.expression, self.unknowns))
        both = ca.Function("rows", [self.unknowns], [slopes, rows.expression])
        steep, constants = map(np.array, both(np.zeros(self.size)))
        return chosen_rows(rows, said_once(steep, constants.ravel(), rows))

    def scored(self, candidates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Entries, and the most that limits are exceeded by, at all points of the path."""
        values = ca.Function(
            "values", [self.unknowns], [self.entries, *(rows.expression for rows in self.every)]
        )
        entries, excess = [], []
        for z in candidates:
            first, *rows = (np.array(ca.densify(part)).ravel() for part in values(z))
            entries.append(first)
            pairs = zip(rows, self.every, strict=True)
            excess.append(
                [
                    np.maximum(value - one.upper, one.lower - value).max(initial=-1e20) / one.size
                    for value, one in pairs
                ]
            )
        return np.array(entries), np.array(excess)

    @cached_property
    def bounded_unknowns(self) -> tuple[np.ndarray, ...]:
        """Rows of single unknowns: these rows, the unknowns, the slopes, the constants."""
        found = [[], [], [], []]
        fixed = ca.vertcat(*(rows.expression for rows in self.limits))
        slopes = ca.Function("slopes", [self.unknowns], [ca.jacobian(fixed, self.unknowns), fixed])
        steep, constants = (np.array(ca.densify(part)) for part in slopes(np.zeros(self.size)))
        linear = np.repeat(self.linear, [len(rows.lower) for rows in self.limits])
        for row in np.flatnonzero(linear):
            (columns,) = np.nonzero(steep[row])
            if len(columns) == 1:
                entries = row, columns[0], steep[row, columns[0]], constants[row, 0]
                for column, entry in zip(found, entries, strict=True):
                    column.append(entry)
        return tuple(map(np.array, found))

    def functions(self, terms: Terms | None = None, chosen: ChosenRows | None = None) -> Called:
        """Entries and rows, with chosen rows of instants behind the others, and their derivatives."""
        rows = [rows.expression for rows in self.limits]
        if terms is not None and chosen is not None:
            rows += [self._row(terms, chosen, place) for place in range(len(chosen))]
        every, z = ca.densify(ca.vertcat(ca.SX(0, 1), *rows)), self.unknowns
        weights = [ca.SX.sym("entries", self.entry_count), ca.SX.sym("rows", every.shape[0])]
        weighted = ca.dot(weights[0], self.entries) + ca.dot(weights[1], every)
        slopes = [ca.jacobian(part, z) for part in (self.entries, every)]
        return Called(
            ca.Function("terms", [z], [self.entries, every]),
            ca.Function("slopes", [z], list(map(ca.densify, slopes))),
            ca.Function("curvature", [z, *weights], [ca.triu(ca.hessian(weighted, z)[0])]),
        )

    @cached_property
    def _watched(self) -> list[Drive]:
        """The nominal system, as the uncertain parameters describe it, then others that keep the limits."""
        robust, begin = self.problem.robust, self.drive.ends_of(self.drive.states)[0]
        if robust is None:
            return [self.drive]
        scenarios = robust.scenarios(self.problem.uncertain_system).after_nominal
        return [
            self.drive.again(ca.DM(parameters), begin + ca.DM(shift), scenarios.system)
            for parameters, shift in scenarios.each
        ]

    def _row(self, terms: Terms, chosen: ChosenRows, place: int) -> ca.SX:
        """One of the chosen rows, as the drive has it at that instant."""
        problem, instants = self.problem, terms.instants
        space, row, scale = problem.design, int(chosen.row[place]), self.input_scale
        system, run = divmod(int(chosen.run[place]), space.runs)
        sample = run * space.samples + int(chosen.sample[place])
        held = asked = self.drive.inputs[sample, :].T
        if instants.asking:
            asked = ca.DM(scale) * (ca.DM(chosen.asked[place]) @ self.unknowns)
        limit = problem.limits[instants.owner[row]]
        is_tightened = problem.robust is not None and isinstance(limit, PathLimit)
        drive = self._watched[system] if is_tightened else self.drive
        begin, width = drive.begins[sample], drive.columns
        instant = instant_of(
            drive.system,
            state=drive.states[begin, :].T,
            held=held,
            parameters=drive.parameters,
            period=ca.SX(float(chosen.constants[place, 0])),
            asked=asked,
            fraction=ca.SX(1),
            sensitivities=drive.sensitivities[:, begin * width : (begin + 1) * width],
            run=run,
        )
        if is_tightened and problem.robust.backs_off and system == 0:
            rows = problem.robust.backed_off(limit, instant, problem.uncertain_system)
        else:
            rows = limit.rows(instant)
        alike = np.flatnonzero((instants.owner == instants.owner[row]) & instants.systems[:, system])
        number = alike.tolist().index(row)
        return (
            chosen.share[place]
            * instants.weight[row]
            * ca.densify(ca.vec(rows.expression))[number]
            / rows.size
        )


def chosen_rows(rows: Rows, chosen: np.ndarray) -> Rows:
    """Some of a limit's rows."""
    places = np.flatnonzero(chosen).tolist()
    return replace(
        rows, expression=rows.expression[places], lower=rows.lower[chosen], upper=rows.upper[chosen]
    )
