"""The program in stages with derivatives of one stage, mapped to all and put in their places."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from benchmarks.forms import SEGMENTS
from benchmarks.plain import Plain
from benchmarks.staged import GIVEN, Staged
from benchmarks.stages import STATES
from oed.foundation.arrays import Array, Places
from tests.compiling import compiled


class Mapped:
    """Its functions.

    Args:
        staged: the program.
        machine: whether the functions of a stage are compiled.
    """

    def __init__(self, staged: Staged, *, machine: bool) -> None:
        """Write them."""
        self.staged, stages = staged, staged.stages
        take = compiled if machine else _as_it_is
        self._stage, self._slopes, self._curvature = (
            take(one).map(SEGMENTS) for one in (stages.stage, stages.slopes, stages.curvature)
        )
        self.x = ca.MX.sym("x", staged.layout.size)
        self._multipliers, self._factor = ca.MX.sym("multipliers", staged.count), ca.MX.sym("factor")
        places = [staged.places(k) for k in range(SEGMENTS)]
        self._rows = np.array([rows for rows, _ in places])
        self._signs = places[0][1]
        self._columns = np.array([self._of_stage(k) for k in range(SEGMENTS)])

    def _of_stage(self, k: int) -> Places:
        # Of a stage's pose and window the places among all unknowns; -1 of what is none.
        layout = self.staged.layout
        found = np.full(STATES + 2 * layout.width, -1)
        window = layout.window(k)
        found[:STATES], found[STATES : STATES + len(window)] = layout.pose(k), window
        return found

    @cached_property
    def _given(self) -> list[ca.MX | ca.DM]:
        staged, every = self.staged, range(SEGMENTS)
        return [
            ca.horzcat(*(staged.begun(self.x, k) for k in every)),
            ca.horzcat(*(staged.padded(self.x, k) for k in every)),
            ca.DM(np.hstack(staged.splines)),
            ca.DM(np.hstack(staged.chosen)),
        ]

    @cached_property
    def _around(self) -> tuple[ca.Function, ca.Function]:
        # What is not of a stage: what is handed on as it is, linear rows, the criterion. First derivatives,
        # and second ones for multipliers.
        staged = self.staged
        x, multipliers = ca.SX.sym("x", staged.layout.size), ca.SX.sym("multipliers", staged.count)
        following = ca.SX.sym("following", len(self._signs), SEGMENTS)
        rows = staged.all_rows(x, following)
        curved, _ = ca.hessian(ca.dot(multipliers, rows), x)
        return (
            ca.Function("around", [x], [ca.jacobian(rows, x)]),
            ca.Function("around_bent", [x, multipliers], [curved]),
        )

    @cached_property
    def _values(self) -> ca.MX:
        return self.staged.all_rows(self.x, self._stage(*self._given))

    def _jacobian(self) -> tuple[ca.MX, ca.MX]:
        # Rows and their derivatives.
        following, slopes = self._slopes(*self._given)
        own, unknown = (np.array(one) for one in self.staged.stages.pattern.get_triplet())
        signs = np.tile(self._signs[own], SEGMENTS)
        shape = self.staged.count, self.staged.layout.size
        places = self._rows[:, own].ravel(), self._columns[:, unknown].ravel()
        table = _placed(ca.DM(signs) * ca.vec(slopes), *places, shape)
        return self.staged.all_rows(self.x, following), self._around[0](self.x) + table

    def _hessian(self) -> ca.MX:
        known = np.where(self._rows < 0, self.staged.count, self._rows)
        padded = ca.vertcat(self._multipliers, 0)[known.ravel().tolist()]
        own = ca.reshape(ca.DM(np.tile(self._signs, SEGMENTS)) * padded, -1, SEGMENTS)
        bent = self._curvature(*self._given, own)
        row, column = (self._columns[:, one].ravel() for one in self.staged.stages.bent.get_triplet())
        shape = self.staged.layout.size, self.staged.layout.size
        return _placed(ca.vec(bent), row, column, shape) + self._around[1](self.x, self._multipliers)

    def _program(self) -> dict[str, ca.MX]:
        return {"x": self.x, "f": self.staged.cost(self.x), "g": self._values}

    def by_ipopt(self, unknowns: Array, iterations: int) -> Plain:
        """Solved by Ipopt with MUMPS."""
        x, nothing = self.x, ca.MX(0, 1)
        given, cost = [x, nothing, self._factor, self._multipliers], self.staged.cost(x)
        derivatives = {
            "grad_f": ca.Function("grad_f", [x, nothing], [cost, ca.gradient(cost, x)]),
            "jac_g": ca.Function("jac_g", [x, nothing], [*self._jacobian()]),
            "hess_lag": ca.Function("hess_lag", given, [ca.triu(self._hessian())]),
        }
        return self.staged.by_ipopt(self._program(), unknowns, iterations, **GIVEN, **derivatives)

    def by_fatrop(self, unknowns: Array, iterations: int) -> Plain:
        """Solved by fatrop, which asks for the Lagrangian's gradient as well."""
        x, nothing = self.x, ca.MX(0, 1)
        rows, slopes = self._jacobian()
        cost = self.staged.cost(x)
        gradient = self._factor * ca.gradient(cost, x) + slopes.T @ self._multipliers
        first = ca.Function("nlp_jac_g", [x, nothing], [rows, slopes], ["x", "p"], ["g", "jac_g_x"])
        second_given, lagrangian = (
            [x, nothing, self._factor, self._multipliers],
            ["x", "p", "lam_f", "lam_g"],
        )
        second = ca.Function(
            "nlp_hess_l",
            second_given,
            [ca.densify(gradient), self._hessian()],
            lagrangian,
            ["grad_gamma_x", "hess_gamma_x_x"],
        )
        slope = ca.Function(
            "nlp_grad_f", [x, nothing], [ca.densify(ca.gradient(cost, x))], ["x", "p"], ["grad_f_x"]
        )
        # Asked for once, at the end.
        whole = ca.Function(
            "nlp_grad",
            second_given,
            [cost, rows, ca.densify(gradient), nothing],
            lagrangian,
            ["f", "g", "grad_gamma_x", "grad_gamma_p"],
        )
        cache = {one.name(): one for one in (slope, first, second, whole)}
        return self.staged.by_fatrop(self._program(), unknowns, iterations, cache=cache)


def _as_it_is(function: ca.Function) -> ca.Function:
    return function


def _placed(values: ca.MX, rows: Array, columns: Array, shape: tuple[int, int]) -> ca.MX:
    # A sparse matrix with these values at these places, without those of row or column -1.
    kept = np.nonzero((rows >= 0) & (columns >= 0))[0]
    order = kept[np.lexsort((rows[kept], columns[kept]))]
    pattern = ca.Sparsity.triplet(*shape, rows[order].tolist(), columns[order].tolist())
    return ca.MX(pattern, values[order.tolist()])
