"""Nonlinear program of a design: assembled once, solved from many starts.

Limits on speed and acceleration act on spline coefficients, whose convex hull holds the curve, so they hold
at all times.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.optimize.terms.chosen import ChosenRows
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.frame import Frame
from oed.optimize.transcription.functions import ProgramFunctions
from oed.optimize.transcription.solver_calls import interrupts_kept, one_thread


@dataclass(frozen=True)
class IpoptOutcome:
    """Result of one call of Ipopt.

    Attributes:
        unknowns: unknowns z at its last iterate, (n,).
        auxiliary: auxiliary unknowns there, (k,).
        return_status: return status of Ipopt.
        iterations: number of iterations.
        evaluations: number of evaluations of the objective.
        row_multipliers: Lagrange multipliers of the rows.
        bound_multipliers: Lagrange multipliers of the bounds.
        maximised: maximised objective at the last iterate.
        gains: first-order gains (limits,) of the objective if each limit alone is widened, per share of the
            limit's size; (0,) where the call did not succeed.
    """

    unknowns: Array
    auxiliary: Array
    return_status: str
    iterations: int
    evaluations: int
    row_multipliers: Array
    bound_multipliers: Array
    maximised: float
    gains: Array

    @property
    def succeeded(self) -> bool:
        """True where Ipopt reached its tolerance, so that another solve may go on from here."""
        return self.return_status == "Solve_Succeeded"

    @property
    def infeasible(self) -> bool:
        """True where Ipopt says that no point near its last one keeps to all limits."""
        return self.return_status == "Infeasible_Problem_Detected"


OUT_OF_TIME = "Maximum_WallTime_Exceeded"
"""Return status of Ipopt at its time limit."""
IPOPT_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    # A start whose drive is not finite is reported once, by `NotFinite`.
    "show_eval_warnings": False,
    # The program brings its derivatives; those by parameters are not needed.
    "no_nlp_grad": True,
    "calc_lam_p": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    # Bounds must not be exceeded at all, or a design could seem to beat a proved upper bound.
    "ipopt.bound_relax_factor": 0.0,
    # Rows of few instants are dense: looking for a better order and scaling takes longer than it saves.
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_scaling": 0,
    "ipopt.mumps_pivot_order": 0,
}

WARM_OPTIONS: dict[str, Any] = {
    "ipopt.warm_start_init_point": "yes",
    "ipopt.mu_init": 1e-5,
    "ipopt.warm_start_bound_push": 1e-6,
    "ipopt.warm_start_bound_frac": 1e-6,
    "ipopt.warm_start_slack_bound_push": 1e-6,
    "ipopt.warm_start_slack_bound_frac": 1e-6,
    "ipopt.warm_start_mult_bound_push": 1e-6,
}
"""Options of a solve that continues from the end of an earlier solve, under slightly different limits."""
UNSCALED = 1e-4
"""Tolerance of the unscaled constraints and complementarity of Ipopt."""
LED_NOWHERE = (
    "Maximum_Iterations_Exceeded",
    "Infeasible_Problem_Detected",
    "Restoration_Failed",
    "Error_In_Step_Computation",
    "Invalid_Number_Detected",
    "Diverging_Iterates",
)
"""Return statuses after which a warm-started solve is repeated without multipliers."""
SLOTS = 64
"""Number of which the slots of every program are a multiple."""
WARM_ITERATIONS = 100
"""Iterations of a warm-started solve at most: where its multipliers help, a dozen suffice."""


def slots_for(rows: int) -> int:
    """Return the number of slots of a program with so many rows of instants."""
    return -(-rows // SLOTS) * SLOTS


class _BuiltProgram:
    # A program with a fixed number of slots, and its solvers.

    def __init__(self, functions: ProgramFunctions, frame: Frame, options: dict[str, Any]) -> None:
        self.frame, self.functions, self._options = frame, functions, {**IPOPT_OPTIONS, **options}
        self._solvers: dict[tuple[float | None, float | None, bool], ca.Function] = {}

    def solver(self, barrier: float | None, tolerance: float | None, *, warm: bool = False) -> ca.Function:
        """Return the solver of the program, which is built at its first use.

        Args:
            barrier: first barrier parameter of Ipopt; None for its default.
            tolerance: tolerance of Ipopt; None for the one in the options.
            warm: True for a solver that continues an earlier solve.
        """
        key = barrier, tolerance, warm
        if key not in self._solvers:
            options = {**self._options, **_tolerances(tolerance)}
            if warm:
                most = min(WARM_ITERATIONS, options.get("ipopt.max_iter", WARM_ITERATIONS))
                options |= {**WARM_OPTIONS, "ipopt.max_iter": most}
            if barrier is not None:
                options["ipopt.mu_init"] = barrier
            self._solvers[key] = self.functions.solver(options)
        return self._solvers[key]


def _tolerances(tolerance: float | None) -> dict[str, float]:
    # Tolerances of the scaled and of the unscaled program; for the latter `UNSCALED` is enough.
    if tolerance is None:
        return {}
    unscaled = max(tolerance, UNSCALED)
    return {"ipopt.tol": tolerance, "ipopt.constr_viol_tol": unscaled, "ipopt.compl_inf_tol": unscaled}


class Program:
    """Nonlinear program over z and auxiliary unknowns, built once and called for every start.

    Expressions are SX of z, of `design.entries` and of the auxiliary unknowns.

    Args:
        design: expressions of the problem.
        objective: scalar to maximise.
        auxiliary: further unknowns, (k,).
        equalities: expressions that must vanish, (e,).
        floors: expressions with lower bounds that each call sets, (f,).
        constants: symbols whose values each call sets, (c,).
        relaxing: True where each auxiliary unknown relaxes one limit, in units of the limit's size.
        options: options of Ipopt, added to `IPOPT_OPTIONS`.
    """

    def __init__(
        self,
        design: DesignExpressions,
        *,
        objective: Expression,
        auxiliary: Expression,
        equalities: Expression,
        floors: Expression,
        constants: Expression | None = None,
        relaxing: bool = False,
        options: dict[str, Any] | None = None,
    ) -> None:
        """Store the parts; the program is built at the first call of `solve`."""
        self.design = design
        self._equalities, self._floors = equalities.shape[0], floors.shape[0]
        self._objective, self._parts = (
            objective,
            {
                "auxiliary": auxiliary,
                "conditions": ca.vertcat(equalities, floors),
                "constants": ca.SX(0, 1) if constants is None else constants,
            },
        )
        self._relaxing, self._options = relaxing, options or {}
        self._with_slots: dict[int, _BuiltProgram] = {}

    def _build(self, slots: int) -> _BuiltProgram:
        if slots not in self._with_slots:
            frame = Frame(self.design.terms, relaxing=self._relaxing, slots=slots)
            functions = ProgramFunctions(self.design, frame, self._objective, **self._parts)
            self._with_slots[slots] = _BuiltProgram(functions, frame, self._options)
        return self._with_slots[slots]

    def solve(
        self,
        unknowns: Array,
        auxiliary: Array,
        *,
        floors: Array | None = None,
        constants: Array | None = None,
        backoff: Array | None = None,
        auxiliary_lower: Array | None = None,
        auxiliary_upper: Array | None = None,
        after: IpoptOutcome | None = None,
        barrier: float | None = None,
        tolerance: float | None = None,
        chosen: ChosenRows | None = None,
    ) -> IpoptOutcome:
        """Solve from a start.

        A solve that continues an earlier one starts from its end and its multipliers; where these lead
        nowhere, it is repeated without them.

        Args:
            unknowns: first values of z, (n,).
            auxiliary: first values of the auxiliary unknowns, (k,).
            floors: lower bounds of the floors, (f,); 0 by default.
            constants: values of the constants, (c,); none by default.
            backoff: share of its size by which each limit is tightened, (limits,); 0 by default.
            auxiliary_lower: lower bounds of the auxiliary unknowns, (k,).
            auxiliary_upper: upper bounds of the auxiliary unknowns, (k,).
            after: earlier solve that this one continues.
            barrier: first barrier parameter of Ipopt instead of 0.1; a small one stays near the start.
            tolerance: tolerance of Ipopt instead of the one in the options.
            chosen: rows of instants that hold in addition to all other rows.
        """
        built = self._build(0 if chosen is None else slots_for(len(chosen)))
        if chosen is not None:
            chosen = chosen.padded(slots_for(len(chosen)))
        built.functions.chosen = chosen
        built.functions.constants = np.zeros(0) if constants is None else constants
        shares = np.zeros(len(self.design.terms.rows)) if backoff is None else backoff
        (low, high), (row_low, row_high) = built.frame.bounds(shares, chosen)
        zero, open_side = np.zeros(self._equalities), np.full(self._floors, np.inf)
        least = np.zeros(self._floors) if floors is None else floors
        unbounded = np.full(len(auxiliary), np.inf)
        arguments = {
            "x0": np.concatenate([unknowns, auxiliary]),
            "lbg": np.concatenate([zero, least, row_low]),
            "ubg": np.concatenate([zero, open_side, row_high]),
            "lbx": np.concatenate([low, -unbounded if auxiliary_lower is None else auxiliary_lower]),
            "ubx": np.concatenate([high, unbounded if auxiliary_upper is None else auxiliary_upper]),
        }
        outcome = self._solve_after(built, arguments, after, barrier, tolerance)
        if not outcome.succeeded or self._relaxing:
            # Multipliers mean nothing away from an optimum.
            return outcome
        rows, bounds = outcome.row_multipliers, outcome.bound_multipliers
        multipliers = np.concatenate([bounds[: len(low)], rows[self._equalities + self._floors :]])
        return replace(outcome, gains=built.frame.gains(shares, multipliers, chosen))

    def _solve_after(
        self,
        built: _BuiltProgram,
        arguments: dict[str, Array],
        after: IpoptOutcome | None,
        barrier: float | None,
        tolerance: float | None,
    ) -> IpoptOutcome:
        if after is None:
            return self._call(built.solver(barrier, tolerance), arguments)
        # Rows that were added since the earlier solve had no multipliers.
        rows = np.pad(after.row_multipliers, (0, len(arguments["lbg"]) - len(after.row_multipliers)))
        multipliers = {"lam_g0": rows, "lam_x0": after.bound_multipliers}
        # The auxiliary unknowns begin where their multipliers belong, but fixed ones keep their values.
        place = slice(self.design.terms.size, None)
        auxiliary = np.clip(after.auxiliary, arguments["lbx"][place], arguments["ubx"][place])
        start = np.concatenate([arguments["x0"][: place.start], auxiliary])
        warm = self._call(built.solver(None, tolerance, warm=True), {**arguments, "x0": start, **multipliers})
        if warm.return_status not in LED_NOWHERE:
            return warm
        cold = self._call(built.solver(None, None), arguments)
        iterations, evaluations = warm.iterations + cold.iterations, warm.evaluations + cold.evaluations
        return replace(cold, iterations=iterations, evaluations=evaluations)

    def _call(self, solver: ca.Function, arguments: dict[str, Array]) -> IpoptOutcome:
        with interrupts_kept(), one_thread():
            result = solver(**arguments)
        stats = solver.stats()
        values = np.array(result["x"]).ravel()
        size = self.design.terms.size
        return IpoptOutcome(
            values[:size],
            values[size:],
            stats["return_status"],
            int(stats["iter_count"]),
            int(stats["n_call_nlp_f"]),
            np.array(result["lam_g"]).ravel(),
            np.array(result["lam_x"]).ravel(),
            -float(result["f"]),
            np.zeros(0),
        )
