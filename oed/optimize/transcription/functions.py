"""Functions of a nonlinear program and their derivatives, by the chain rule around the terms."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.calls import ArrayFunction
from oed.optimize.terms.chosen import ChosenRows
from oed.optimize.terms.differentiated import Differentiated
from oed.optimize.terms.point import DriveAt
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.frame import Frame


class ProgramFunctions:
    """Objective and rows of a program as functions of x = (unknowns z, auxiliary unknowns).

    Objective and conditions are functions of z, of the entries of the judged matrices and of the auxiliary
    unknowns; the rows of limits follow the conditions.

    Attributes:
        chosen: rows of instants in the slots; None without slots.
        constants: values of what stays the same in a solve, (c,).
        count: number of rows.
    """

    def __init__(
        self,
        design: DesignExpressions,
        frame: Frame,
        maximised: Expression,
        *,
        auxiliary: Expression,
        conditions: Expression,
        constants: Expression,
    ) -> None:
        """Take the expressions; functions are made when first called.

        Args:
            design: expressions of the problem.
            frame: limits as the program states them.
            maximised: scalar to maximise, SX of z, the entries, the auxiliary unknowns and constants.
            auxiliary: further unknowns, (k,).
            conditions: further rows before those of the limits, (r,).
            constants: symbols that stay the same in a solve, (c,).
        """
        self.chosen: ChosenRows | None = None
        self.constants = np.zeros(constants.shape[0])
        self._terms, self._frame, self._size = design.terms, frame, design.terms.size
        self._conditions, self._auxiliary = int(conditions.shape[0]), int(auxiliary.shape[0])
        variables = ca.vertcat(design.terms.unknowns, design.entries, auxiliary)
        self._outer = Differentiated(variables, ca.vertcat(-maximised, conditions), constants)
        self.count = self._conditions + (2 if frame.relaxing else 1) * frame.count

    @property
    def _inner(self) -> int:
        # Unknowns and entries: what drives make.
        return self._outer.size - self._auxiliary

    def _at(self, x: Array) -> tuple[DriveAt, Array]:
        # The terms, and (z, entries, auxiliary unknowns).
        z, auxiliary = np.split(x, [self._size])
        point = self._terms.at(z)
        return point, np.concatenate([z, point.entries, auxiliary])

    def _outer_slopes(self, variables: Array) -> Array:
        (slopes,) = self._outer.slopes(variables[None], self.constants[None])
        return np.asarray(slopes)

    def _through(self, point: DriveAt, slopes: Array) -> Array:
        # Derivatives by x, of derivatives by (z, entries, auxiliary unknowns).
        by_z, by_entries, by_auxiliary = np.split(slopes, [self._size, self._inner], axis=1)
        if by_entries.any():
            by_z = by_z + by_entries @ point.entry_slopes
        return np.hstack([by_z, by_auxiliary])

    def objective(self, x: Array) -> Array:
        """Return the objective to be minimised, (1,)."""
        return self._outer.values(self._at(x)[1][None], self.constants[None])[0, :1]

    def gradient(self, x: Array) -> Array:
        """Return the objective's derivatives (n,)."""
        point, variables = self._at(x)
        return np.asarray(self._through(point, self._outer_slopes(variables)[:1])[0])

    def rows(self, x: Array) -> Array:
        """Return the rows, (count,)."""
        point, variables = self._at(x)
        conditions = self._outer.values(variables[None], self.constants[None])[0, 1:]
        rows = self._frame.values(point, self.chosen)
        if not self._frame.relaxing:
            return np.concatenate([conditions, rows])
        relaxed = self._frame.relaxations(self.chosen) @ x[self._size :]
        return np.concatenate([conditions, rows - relaxed, rows + relaxed])

    def jacobian(self, x: Array) -> Array:
        """Return the entries of the rows' derivatives, in the order of their pattern."""
        point, variables = self._at(x)
        conditions = self._through(point, self._outer_slopes(variables)[1:])
        parts = [conditions.ravel(), self._frame.slopes(point, self.chosen)]
        if self._frame.relaxing:
            relaxed = self._frame.relaxations(self.chosen).ravel()
            parts += [-relaxed, relaxed]
        return np.concatenate(parts)[self._addresses[1]]

    @cached_property
    def _addresses(self) -> tuple[ca.Sparsity, Places]:
        # Pattern of the rows' derivatives, and where its entries stand among those of conditions, limits and
        # relaxations.
        frame, size, unknowns = self._frame, self._size, self._size + self._auxiliary
        table = np.full((self.count, unknowns), -1)
        conditions = np.arange(self._conditions * unknowns).reshape(self._conditions, unknowns)
        table[: self._conditions] = np.where(self._condition_pattern, conditions, -1)
        first = conditions.size
        for repeated in range(2 if frame.relaxing else 1):
            rows = slice(
                self._conditions + repeated * frame.count, self._conditions + (1 + repeated) * frame.count
            )
            table[rows][frame.row, frame.column] = first + np.arange(len(frame.row))
            if frame.relaxing:
                relaxed = np.arange(frame.relaxed.size).reshape(frame.relaxed.shape)
                behind = first + len(frame.row) + repeated * relaxed.size
                table[rows, size:] = np.where(frame.relaxed, behind + relaxed, -1)
        return _pattern(table >= 0), table.T[table.T >= 0]

    @property
    def _condition_pattern(self) -> Bools:
        pattern = self._outer.slope_pattern[1:]
        by_z = pattern[:, : self._inner].any(axis=1, keepdims=True)
        return np.hstack([np.repeat(by_z, self._size, axis=1), pattern[:, self._inner :]])

    def curvature(self, x: Array, factor: Array, multipliers: Array) -> Array:
        """Return the entries of the second derivatives of the Lagrangian, in the order of their pattern.

        Args:
            x: unknowns, (n,).
            factor: weight of the objective, (1,).
            multipliers: weights of the rows, (count,).
        """
        point, variables = self._at(x)
        on_conditions, *on_rows = np.split(
            multipliers, np.arange(self._conditions, self.count, max(self._frame.count, 1))
        )
        weights = np.concatenate([factor, on_conditions])
        on_entries = (weights @ self._outer_slopes(variables))[self._size : self._inner]
        on_frame = np.sum(on_rows, axis=0) if on_rows else np.zeros(0)
        corner = self._frame.curvature(point, on_entries, on_frame, self.chosen)
        (outer,) = self._outer.curvature(variables[None], weights[None], self.constants[None])
        drives, mixed = outer[: self._inner, : self._inner], outer[: self._inner, self._inner :]
        if outer[: self._inner].any():
            slopes = np.concatenate([np.eye(self._size), point.entry_slopes])
            corner, mixed = corner + slopes.T @ drives @ slopes, slopes.T @ mixed
        else:
            mixed = mixed[: self._size]
        whole = np.block([[corner, mixed], [mixed.T, outer[self._inner :, self._inner :]]])
        return np.asarray(whole.T[self._upper.T], dtype=float)

    @cached_property
    def _upper(self) -> Bools:
        # Second derivatives on and above the diagonal that may differ from 0.
        pattern = self._outer.curvature_pattern
        moved = np.any(pattern[: self._inner, self._inner :], axis=0, keepdims=True)
        mixed = np.repeat(moved, self._size, axis=0)
        corner = np.ones((self._size, self._size), dtype=bool)
        whole = np.block([[corner, mixed], [mixed.T, pattern[self._inner :, self._inner :]]])
        return np.asarray(np.triu(whole), dtype=bool)

    @cached_property
    def called(self) -> dict[str, ArrayFunction]:
        """The functions as a solver of CasADi calls them, by its names for them."""
        size, rows = self._size + self._auxiliary, ca.Sparsity.dense(self.count, 1)
        scalar, places = ca.Sparsity.dense(1, 1), [size, 0]

        return {
            "f": ArrayFunction("f", [size], [scalar], lambda x: [self.objective(x)]),
            "g": ArrayFunction("g", [size], [rows], lambda x: [self.rows(x)]),
            "grad_f": ArrayFunction(
                "grad_f",
                places,
                [scalar, ca.Sparsity.dense(size, 1)],
                lambda x, _: [self.objective(x), self.gradient(x)],
            ),
            "jac_g": ArrayFunction(
                "jac_g",
                places,
                [rows, self._addresses[0]],
                lambda x, _: [self.rows(x), self.jacobian(x)],
            ),
            "hess_lag": ArrayFunction(
                "hess_lag",
                [*places, 1, self.count],
                [_pattern(self._upper)],
                lambda x, _, factor, multipliers: [self.curvature(x, factor, multipliers)],
            ),
        }

    def solver(self, options: dict[str, Any]) -> ca.Function:
        """Return Ipopt for the program; these functions have to be kept as long as it is.

        Args:
            options: options of Ipopt and of CasADi's interface to it.
        """
        x = ca.MX.sym("x", self._size + self._auxiliary)
        f, g, *derivatives = self.called.items()
        program = {"x": x, "f": f[1](x), "g": g[1](x)}
        return ca.nlpsol("design", "ipopt", program, {**dict(derivatives), **options})


def _pattern(table: Bools) -> ca.Sparsity:
    row, column = np.nonzero(table)
    return ca.Sparsity.triplet(*table.shape, row.tolist(), column.tolist())
