"""The design as a nonlinear program: assembled once, solved from many starts.

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
from oed.optimize.terms.slots import Chosen
from oed.optimize.transcription.chain import ChainRule, Frame
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.solver_calls import interrupts_kept, one_thread


@dataclass(frozen=True)
class Outcome:
    """What one call of Ipopt returned.

    Attributes:
        unknowns, auxiliary: where it ended.
        return_status: how, in Ipopt's words.
        iterations, evaluations: that it took.
        row_multipliers, bound_multipliers: Lagrange's.
        maximised: what was maximised, there.
        gains: by how much more that would be, to first order, were each limit wider: per share of its size;
            (0,) where it did not succeed.
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
        """Whether Ipopt reached its tolerance, so that another solve may go on from here."""
        return self.return_status == "Solve_Succeeded"


OUT_OF_TIME = "Maximum_WallTime_Exceeded"
"""What Ipopt says where its time is up."""
IPOPT_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    # A start from which the drive is not finite is named in words, once.
    "show_eval_warnings": False,
    # The derivatives are given; nobody asks for those by parameters, of which there are none.
    "no_nlp_grad": True,
    "calc_lam_p": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    # Bounds are not to be exceeded at all, or a design could seem to beat a bound that is proved.
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
"""Options of a solve that goes on from the end of one before, under slightly other limits."""
UNSCALED = 1e-4
"""Ipopt's tolerance of constraints and complementarity as they are, before it scales them."""
LED_NOWHERE = (
    "Maximum_Iterations_Exceeded",
    "Infeasible_Problem_Detected",
    "Restoration_Failed",
    "Error_In_Step_Computation",
    "Invalid_Number_Detected",
    "Diverging_Iterates",
)
"""How such a solve ends that is better begun anew."""
SLOTS = 64
"""Rows of instants that a program has room for, or a multiple of that."""
WARM_ITERATIONS = 100
"""After which the multipliers it goes on from have misled it: where they help, a dozen do."""


def slots_for(rows: int) -> int:
    """Slots of a program with so many rows of instants."""
    return -(-rows // SLOTS) * SLOTS


class _Written:
    # A program with a number of slots, and its solvers.

    def __init__(self, chain: ChainRule, frame: Frame, options: dict[str, Any]) -> None:
        self.frame, self.functions, self._program = frame, chain.functions, chain.program
        self._options = {**IPOPT_OPTIONS, **chain.derivatives, **options}
        self._solvers: dict[tuple[float | None, float | None], ca.Function] = {}
        self._warm: dict[float | None, ca.Function] = {}

    def solver(self, barrier: float | None, tolerance: float | None) -> ca.Function:
        key = barrier, tolerance
        if key not in self._solvers:
            own = {**_tolerances(tolerance), **({} if barrier is None else {"ipopt.mu_init": barrier})}
            self._solvers[key] = ca.nlpsol("design", "ipopt", self._program, {**self._options, **own})
        return self._solvers[key]

    def warm(self, tolerance: float | None) -> ca.Function:
        most = min(WARM_ITERATIONS, self._options.get("ipopt.max_iter", WARM_ITERATIONS))
        if tolerance not in self._warm:
            options = {**self._options, **WARM_OPTIONS, **_tolerances(tolerance), "ipopt.max_iter": most}
            self._warm[tolerance] = ca.nlpsol("design", "ipopt", self._program, options)
        return self._warm[tolerance]


def _tolerances(asked: float | None) -> dict[str, float]:
    # Ipopt's own, of what is scaled and of what is not, which by itself is asked for to `UNSCALED`.
    if asked is None:
        return {}
    unscaled = max(asked, UNSCALED)
    return {"ipopt.tol": asked, "ipopt.constr_viol_tol": unscaled, "ipopt.compl_inf_tol": unscaled}


class Program:
    """One nonlinear program over z and auxiliary unknowns, built once and called for every start.

    Expressions are SX of z, of `design.entries` and of the auxiliary unknowns.

    Args:
        design: the problem's expressions.
        objective: scalar to maximise.
        auxiliary: further unknowns, (k,).
        equalities: expressions that must vanish, (e,).
        floors: expressions that must stay at or above values given with each call, (f,).
        relaxing: whether the auxiliary unknowns relax the limits, one each, in units of the limit's size.
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
        relaxing: bool = False,
        options: dict[str, Any] | None = None,
    ) -> None:
        """Take the parts; what is solved is written when first called."""
        self.design = design
        self._equalities, self._floors = equalities.shape[0], floors.shape[0]
        self._around = objective, auxiliary, ca.vertcat(equalities, floors)
        self._relaxing, self._options = relaxing, options or {}
        self._with_slots: dict[int, _Written] = {}

    def _written(self, slots: int) -> _Written:
        # With so many slots for rows of instants.
        known = self._with_slots.get(slots)
        # Compiled meanwhile, the terms' functions are others.
        if known is None or known.functions is not self.design.terms.functions(slots):
            frame = Frame(self.design.terms, relaxing=self._relaxing, slots=slots)
            chain = ChainRule(self.design, frame, *self._around)
            self._with_slots[slots] = _Written(chain, frame, self._options)
        return self._with_slots[slots]

    def solve(
        self,
        unknowns: Array,
        auxiliary: Array,
        *,
        floors: Array | None = None,
        backoff: Array | None = None,
        auxiliary_lower: Array | None = None,
        auxiliary_upper: Array | None = None,
        after: Outcome | None = None,
        barrier: float | None = None,
        tolerance: float | None = None,
        chosen: Chosen | None = None,
    ) -> Outcome:
        """Solve from a start. `backoff` tightens each limit by that share of its size.

        With `after` the start is where that solve ended, whose multipliers are a beginning; where they lead
        nowhere, it is solved without them.

        Args:
            unknowns: z to begin at.
            auxiliary: the auxiliary unknowns to begin at.
            floors: least values of the floors.
            backoff: share of its size by which each limit is tightened.
            auxiliary_lower: bounds of these.
            auxiliary_upper: bounds of these.
            after: the solve that it goes on from.
            barrier: Ipopt's first barrier parameter, instead of its 0.1; a small one stays near the start.
            tolerance: of Ipopt, instead of the program's own.
            chosen: rows of instants that hold beside all others.
        """
        slots = 0 if chosen is None else slots_for(len(chosen))
        written = self._written(slots)
        shares = np.zeros(len(self.design.terms.rows)) if backoff is None else backoff
        (low, high), (row_low, row_high) = written.frame.bounds(shares, chosen)
        zero, open_side = np.zeros(self._equalities), np.full(self._floors, np.inf)
        least = np.zeros(self._floors) if floors is None else floors
        unbounded = np.full(len(auxiliary), np.inf)
        given = {
            "x0": np.concatenate([unknowns, auxiliary]),
            "lbg": np.concatenate([zero, least, row_low]),
            "ubg": np.concatenate([zero, open_side, row_high]),
            "lbx": np.concatenate([low, -unbounded if auxiliary_lower is None else auxiliary_lower]),
            "ubx": np.concatenate([high, unbounded if auxiliary_upper is None else auxiliary_upper]),
        }
        if chosen is not None:
            given["p"] = chosen.numbers(slots)
        outcome = self._solved(written, given, after, barrier, tolerance)
        if not outcome.succeeded or self._relaxing:
            # Of no optimum multipliers say nothing.
            return outcome
        rows, bounds = outcome.row_multipliers, outcome.bound_multipliers
        multipliers = np.concatenate([bounds[: len(low)], rows[self._equalities + self._floors :]])
        return replace(outcome, gains=written.frame.gains(shares, multipliers, chosen))

    def _solved(
        self,
        written: _Written,
        given: dict[str, Array],
        after: Outcome | None,
        barrier: float | None,
        tolerance: float | None,
    ) -> Outcome:
        if after is None:
            return self._called(written.solver(barrier, tolerance), given)
        # Rows that have come since had no multipliers.
        rows = np.pad(after.row_multipliers, (0, len(given["lbg"]) - len(after.row_multipliers)))
        multipliers = {"lam_g0": rows, "lam_x0": after.bound_multipliers}
        # The epigraph is where its multipliers are; what is fixed stays as it is given.
        place = slice(self.design.terms.size, None)
        auxiliary = np.clip(after.auxiliary, given["lbx"][place], given["ubx"][place])
        begun = np.concatenate([given["x0"][: place.start], auxiliary])
        warm = self._called(written.warm(tolerance), {**given, "x0": begun, **multipliers})
        if warm.return_status not in LED_NOWHERE:
            return warm
        cold = self._called(written.solver(None, None), given)
        iterations, evaluations = warm.iterations + cold.iterations, warm.evaluations + cold.evaluations
        return replace(cold, iterations=iterations, evaluations=evaluations)

    def _called(self, solver: ca.Function, given: dict[str, Array]) -> Outcome:
        with interrupts_kept(), one_thread():
            result = solver(**given)
        stats = solver.stats()
        values = np.array(result["x"]).ravel()
        size = self.design.terms.size
        return Outcome(
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
