"""The design as a nonlinear program: assembled once, solved from many starts.

The unknowns z are the free spline coefficients, in units of each input's largest speed, and the start
pose where it is free. Limits on speed and acceleration act on spline coefficients, whose convex hull
holds the curve, so they hold at all times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, islice
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.expression import Expression
from oed.limits.limit import Rows
from oed.problem import Problem
from oed.rollout import Drive, roll_out
from oed.solvers.interrupts import interrupts_kept
from oed.solvers.threads import one_thread
from oed.trajectory import Trajectory

Array = npt.NDArray[np.float64]


class DesignExpressions:
    """A problem's drive, information and limits as expressions of the unknowns z.

    Positions are limited at `refine` points per sample.
    """

    def __init__(self, problem: Problem, refine: int = 1) -> None:
        """Write the expressions; nothing is solved."""
        space, model = problem.design, problem.robot
        self.problem = problem
        self.input_scale = np.abs(problem.input_bounds).max(axis=1)
        self._free = space.free_rows
        self.coefficient_count = len(self._free) * len(model.inputs)
        self.size = self.coefficient_count + (3 * space.runs if space.start_is_free else 0)
        self.unknowns = ca.SX.sym("z", self.size)
        coefficients = self._coefficients()
        self.drive: Drive = roll_out(
            model,
            space.integration,
            inputs=_sparse(space.sampling_matrix) @ coefficients,
            start=self._start(),
            parameters=ca.SX(ca.DM(model.nominal)),
            period=ca.SX(space.period),
            input_values=coefficients,
            input_rates=_sparse(space.rate_matrix) @ coefficients,
            input_jerks=_sparse(space.jerk_matrix) @ coefficients,
            refine=refine,
            runs=space.runs,
        )
        self.matrices = [one.matrix for one in problem.estimations(self.drive)]
        self.robots = [self._matrices(*robot) for robot in problem.judged_robots]
        self.rows = [_dependent(rows, self.unknowns) for rows in problem.limit_rows(self.drive)]

    def _matrices(self, parameters: Array, shift: Array) -> list[Expression]:
        # The information that the same inputs give a robot with these parameters, started there.
        drive, nominal = self.drive, np.array(self.problem.robot.nominal)
        if np.array_equal(parameters, nominal) and not shift.any():
            return self.matrices
        begin, _ = drive.ends_of(drive.poses)
        other = drive.again(ca.SX(ca.DM(parameters)), begin + ca.DM(shift))
        return [one.matrix for one in self.problem.estimations(other)]

    def _coefficients(self) -> Expression:
        inputs = len(self.problem.model.inputs)
        free = ca.reshape(self.unknowns[: self.coefficient_count], len(self._free), inputs)
        table = ca.SX.zeros(self.problem.design.all_coefficients, inputs)
        table[self._free.tolist(), :] = free @ ca.diag(ca.DM(self.input_scale))
        return table

    def _start(self) -> Expression:
        problem = self.problem
        if problem.fixed_starts is not None:
            return ca.SX(ca.DM(problem.fixed_starts))
        poses = ca.reshape(self.unknowns[self.coefficient_count :], 3, problem.design.runs).T
        return ca.horzcat(poses, ca.SX(problem.design.runs, len(problem.model.states) - 3))

    def trajectory(self, unknowns: Array) -> Trajectory:
        """The drive that z stands for."""
        space, inputs = self.problem.design, len(self.problem.model.inputs)
        table = np.zeros((space.all_coefficients, inputs))
        free = unknowns[: self.coefficient_count].reshape((len(self._free), inputs), order="F")
        table[self._free] = free * self.input_scale
        start = self.problem.fixed_starts
        if start is None:
            start = self.problem.start_states(unknowns[self.coefficient_count :])
        return space.trajectory(table, start)

    def unknowns_of(self, trajectory: Trajectory) -> Array:
        """Z of a drive of this design space.

        Raises:
            ValueError: the drive's splines are not this space's.
        """
        space = self.problem.design
        same = trajectory.degree == space.spline.degree and trajectory.knots.shape == space.knots.shape
        if not same or not np.allclose(trajectory.knots, space.knots):
            raise ValueError("the trajectory's splines are not those of the design space")
        free = trajectory.coefficients[self._free] / self.input_scale
        start = trajectory.starts[:, :3] if space.start_is_free else np.zeros(0)
        return np.concatenate([free.ravel(order="F"), start.ravel()])

    def is_linear(self, rows: Rows) -> bool:
        """Whether the rows are linear in z."""
        return not any(ca.which_depends(rows.expression, self.unknowns, 2, True))

    @cached_property
    def scores(self) -> ca.Function:
        """Maps z to every information matrix of every robot judged, then for every limit its largest
        violation over its size.
        """
        worst = [
            ca.fmax(0, ca.mmax(ca.vertcat(rows.expression - rows.upper, rows.lower - rows.expression)))
            / rows.size
            for rows in map(_finite, self.rows)
        ]
        # Step and measurement repeat each other's sines; shared, a quarter of the operations goes away.
        outputs = ca.cse([*chain.from_iterable(self.robots), ca.vertcat(*worst)])
        return ca.Function("scores", [self.unknowns], outputs)

    @cached_property
    def scale(self) -> float:
        """A typical lambda_min of the information: divides it in the program, so that it is of order 1."""
        rng = np.random.default_rng(0)
        low, high = np.full((2, self.size), [[-1.0], [1.0]])
        bounds = self.problem.input_bounds / self.input_scale[:, None]
        count = self.coefficient_count
        low[:count], high[:count] = np.repeat(bounds, len(self._free), axis=0).T
        draws = rng.uniform(low, high, (200, self.size))
        *matrices, _ = self.scores.map(len(draws))(draws.T)
        smallest, means = [], []
        for stack in _stacks(matrices[: len(self.robots[0])], len(draws)):
            size = stack.shape[1]
            smallest.append(np.linalg.eigvalsh(stack)[:, 0])
            means.append(np.trace(stack, axis1=1, axis2=2) / size)
        typical = float(np.min(smallest, axis=0).max())
        return typical if typical > 0 else float(np.max(means)) or 1.0

    def score_many(self, candidates: Array, threads: int = 1) -> tuple[Array, Array]:
        """Criterion (K,) and relative violation of each limit (K, limits) of candidates (K, size).

        For ranking candidates only: it looks at limits at the samples, `evaluate` between them too.
        """
        count = len(candidates)
        mapped = self.scores.map(count, "thread", threads) if threads > 1 else self.scores.map(count)
        *matrices, violations = mapped(candidates.T)
        stacks = iter(_stacks(matrices, count))
        values = [self.problem.objective.value(list(islice(stacks, len(one)))) for one in self.robots]
        return self.problem.together(values), np.array(violations).T.reshape(count, -1)


def _stacks(matrices: Sequence[ca.DM], count: int) -> list[Array]:
    # A mapped function returns (p, count * p); make it (count, p, p).
    stacks = []
    for matrix in matrices:
        size = matrix.shape[0]
        stacks.append(np.array(matrix).reshape(size, count, size).transpose(1, 0, 2))
    return stacks


def _sparse(matrix: Array) -> ca.DM:
    return ca.sparsify(ca.DM(matrix))


def _finite(rows: Rows) -> Rows:
    # Open sides must not enter a maximum as infinities.
    big = 1e20
    return Rows(
        rows.expression, np.maximum(rows.lower, -big), np.minimum(rows.upper, big), rows.size, rows.unit
    )


def _dependent(rows: Rows, unknowns: Expression) -> Rows:
    # Rows that no unknown moves (coefficients that rest fixes) would only burden the solver.
    # Dense, or rows that are structurally 0 (where runs meet) would not be counted.
    expression = ca.densify(rows.expression)
    moved = np.array(ca.which_depends(expression, unknowns, 1, True), dtype=bool)
    chosen = np.flatnonzero(moved)
    return Rows(expression[chosen.tolist()], rows.lower[moved], rows.upper[moved], rows.size, rows.unit)


@dataclass(frozen=True)
class Outcome:
    """What one call of Ipopt returned."""

    unknowns: Array
    auxiliary: Array
    return_status: str
    iterations: int
    evaluations: int


LINEAR_WEIGHT = 20.0
"""Factor on rows that are linear in z (speeds, accelerations), against 1 for the others (positions).

Ipopt gives every row the same first multiplier, so a row's weight is how strongly it repels early on.
Searches held away from saturated accelerations first end in better optima: on the per-sample form the
mean over starts rises from 67 to 76 (of at most 85.8).
"""

IPOPT_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "detect_simple_bounds": True,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    # Bounds are not to be exceeded at all, or a design could seem to beat a bound that is proved.
    "ipopt.bound_relax_factor": 0.0,
}


class Program:
    """One nonlinear program over z and auxiliary unknowns, built once and called for every start.

    Args:
        design: the problem's expressions.
        objective: scalar to maximise.
        auxiliary: further unknowns, (k,).
        equalities: expressions that must vanish, (e,).
        floors: expressions that must stay at or above values given with each call, (f,).
        relaxed: per limit, an amount (in units of the limit's size) by which it is relaxed, or None.
        options: of Ipopt, added to the package's own.
    """

    def __init__(
        self,
        design: DesignExpressions,
        *,
        objective: Expression,
        auxiliary: Expression,
        equalities: Expression,
        floors: Expression,
        relaxed: Sequence[Expression] | None = None,
        options: dict[str, Any] | None = None,
    ) -> None:
        """Build the solver and its derivatives."""
        self.design = design
        self._equalities, self._floors = equalities.shape[0], floors.shape[0]
        constraints = [equalities, floors]
        self._weights = [LINEAR_WEIGHT if design.is_linear(rows) else 1.0 for rows in design.rows]
        for index, rows in enumerate(design.rows):
            scaled = rows.expression / rows.size
            if relaxed is None:
                constraints.append(self._weights[index] * scaled)
            else:
                constraints += [scaled - relaxed[index], scaled + relaxed[index]]
        self._two_rows = relaxed is not None
        program = {
            "x": ca.vertcat(design.unknowns, auxiliary),
            "f": -objective,
            "g": ca.cse(ca.vertcat(*constraints)),
        }
        self._solver = ca.nlpsol("design", "ipopt", program, {**IPOPT_OPTIONS, **(options or {})})

    def solve(
        self,
        unknowns: Array,
        auxiliary: Array,
        *,
        floors: Array | None = None,
        backoff: Array | None = None,
        auxiliary_lower: Array | None = None,
        auxiliary_upper: Array | None = None,
    ) -> Outcome:
        """Solve from a start. `backoff` tightens each limit by that share of its size."""
        lower, upper = self._bounds(floors, np.zeros(len(self.design.rows)) if backoff is None else backoff)
        open_side = np.full(len(auxiliary), np.inf)
        open_unknowns = np.full(len(unknowns), np.inf)
        low = -open_side if auxiliary_lower is None else auxiliary_lower
        high = open_side if auxiliary_upper is None else auxiliary_upper
        with interrupts_kept(), one_thread():
            result = self._solver(
                x0=np.concatenate([unknowns, auxiliary]),
                lbg=lower,
                ubg=upper,
                lbx=np.concatenate([-open_unknowns, low]),
                ubx=np.concatenate([open_unknowns, high]),
            )
        stats = self._solver.stats()
        values = np.array(result["x"]).ravel()
        size = self.design.size
        return Outcome(
            values[:size],
            values[size:],
            stats["return_status"],
            int(stats["iter_count"]),
            int(stats["n_call_nlp_f"]),
        )

    def _bounds(self, floors: Array | None, backoff: Array) -> tuple[Array, Array]:
        zero = np.zeros(self._equalities)
        lower = [zero, np.zeros(self._floors) if floors is None else floors]
        upper = [zero, np.full(self._floors, np.inf)]
        for rows, shift, weight in zip(self.design.rows, backoff, self._weights, strict=True):
            low, high = rows.lower / rows.size + shift, rows.upper / rows.size - shift
            if self._two_rows:
                open_side = np.full(len(low), np.inf)
                lower += [-open_side, low]
                upper += [high, open_side]
            else:
                lower.append(weight * low)
                upper.append(weight * high)
        return np.concatenate(lower), np.concatenate(upper)
