"""Smallest of the bounds that hold for a problem. A new bound is a function in `BOUNDS`."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from oed.bounds.certificate import Bound, Certificate, inflate
from oed.bounds.closed_form import NO_ROOM, SPEEDS, noise_of, prior_matrix, regression_bounds
from oed.bounds.conjugate import combined_bounds
from oed.bounds.joint import joint_bounds
from oed.bounds.lattice_program import LatticeProgram, SpeedLimits
from oed.bounds.point_designs import point_bounds
from oed.bounds.reach import has_exact_inputs, largest_rates, workspace_bounds
from oed.bounds.sensitivity import sensitivity_bounds
from oed.bounds.speed_lattice import LatticeBound, lattice_bound
from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.kernel.criteria import E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.kernel.results import TOLERANCE
from oed.kernel.scorer import score
from oed.optimize.selection import select
from oed.robots.limits import Rectangle
from oed.robots.models.model import Model, robot_of
from oed.robots.sensors.displacements import Displacements
from oed.robots.space import DesignSpace

Generator = Callable[[Problem], Iterator[Bound]]
"""Function that yields the bounds that it can prove, and nothing for unknown problems."""
BOUNDS: tuple[Generator, ...] = (regression_bounds, joint_bounds)
"""Generators of upper bounds on tr(Z F), tr Z = 1, or on the smallest eigenvalue of F, of one run."""
COMBINED: tuple[Generator, ...] = (sensitivity_bounds,)
"""Generators of further bounds on tr(Z F), for criteria whose conjugate combines several."""
JOINT_RUNS: tuple[Generator, ...] = (point_bounds,)
"""Generators of upper bounds on the objective of all runs together."""
GAP = 2e-4
"""Gap between the lattice's bound and its best speeds at which the search ends."""
EXACTLY = (
    f"limits satisfied exactly, without the {100 * TOLERANCE:g} % that scoring tolerates",
    "as many samples as the study's",
)
"""Assumptions of bounds on drives that satisfy the limits exactly."""
TOLERATED = (
    f"limits, duration, start and rest satisfied within the {100 * TOLERANCE:g} % that scoring tolerates",
    "as many samples as the study's",
)
"""Assumptions of bounds on drives within what scoring tolerates."""
MOST_STEPS = 5e8
"""Largest number of comparisons in one pass of the dynamic programme."""
NOTHING = "no bound is known for this robot, criterion and measurement"
"""Method of certificates without a bound."""
UNKNOWN = "no bound is known for this system, criterion and measurement"
"""Method of certificates without a bound, for systems that are no robots."""
ROOMLESS = "no bound is known without a room: give limits.workspace"
OF_E = "no bound is known for this criterion; for criterion E there is one"
HALL = 1e4
"""Half a side of a workspace [m] that is large enough for any drive."""

MEAN = "no bound is known for the mean over {}s"
"""Method of certificates without a bound, for objectives that are means over robots."""
EVERY = "every reading taken"
"""Assumption of bounds for problems that select some readings."""
STEADY = "drift left out: it can only take information away"
"""Assumption of bounds for problems with process noise."""
UNDETERMINED = "all readings together leave parameters undetermined: no choice of them is bounded"
"""Method of certificates without a bound, for selections of readings."""
SELECTED = "directional derivatives at the best weights [Kiefer and Wolfowitz, 1960], {} weights"
"""Method of bounds on selections of readings, in words."""
REPEATED = "no bound is known for designs whose readings may be repeated"


@typed
def bound(
    problem: Problem,
    *,
    nodes: int | None = None,
    time_limit: float | None = None,
    gap: float = GAP,
) -> Certificate:
    """Return the smallest proved upper bound on a problem's objective, with its assumptions.

    The certificate holds a second one, for limits widened by the scoring tolerance.

    Args:
        problem: problem with criterion E, D or A.
        nodes: largest number of branch-and-bound nodes; by default as many as take some seconds.
        time_limit: time limit of the search [s]; none by default, so that results are the same on all
            machines.
        gap: gap at which the search ends.

    Raises:
        ProblemError: the problem has no drive to be designed.
        WrongKind: the argument is no problem.
    """
    began = time.perf_counter()
    problem.require_designed()
    certificate = _certificate_without_search(problem) or _certificate_by_search(
        problem, nodes, time_limit, gap
    )
    return replace(certificate, wall_seconds=time.perf_counter() - began)


def _certificate_without_search(problem: Problem) -> Certificate | None:
    # The certificate of problems that need no search over designs; None for all others.
    if problem.robust is not None and problem.robust.objective == "mean":
        # The nominal robot's bound holds for the worst of several robots, but not for their mean.
        return Certificate(np.inf, MEAN.format(problem.model.noun), ())
    if problem.selection is None:
        return None
    if problem.design.only is not None:
        return _selection_certificate(problem, problem.design.only)
    return Certificate(np.inf, REPEATED, ()) if problem.selection.most > 1 else None


def _selection_certificate(problem: Problem, trajectory: Trajectory) -> Certificate:
    # The certificate of all selections of readings of a trajectory.
    selected = select(problem, trajectory)
    if selected is None:
        return Certificate(np.inf, UNDETERMINED, (), criterion=problem.criterion)
    judged = selected.parts.judged
    return Certificate(
        inflate(selected.bound, problem.criterion, judged),
        SELECTED.format(len(selected.parts.readings)),
        ("readings of this experiment within the budget of weights",),
        selected.relaxed.gradient,
        criterion=problem.criterion,
        judged=judged,
    )


def _certificate_by_search(
    problem: Problem, nodes: int | None, time_limit: float | None, gap: float
) -> Certificate:
    # Process noise only adds to the covariance of readings, so F is at most that without process noise.
    original, problem = problem, problem.steady
    looser = problem.widened(TOLERANCE)
    bounds, widened = _objective_bounds(problem), _objective_bounds(looser)
    lattice, speeds, wider = None, _speeds(problem), _speeds(looser)
    if speeds is not None:
        lattice = lattice_bound(
            *speeds, gap=gap, nodes=nodes, time_limit=time_limit, criterion=problem.criterion
        )
        bounds.append(_lattice_bound(problem, lattice.upper, lattice))
        if wider is not None:
            widened.append(_lattice_bound(looser, lattice.bound_for(*wider), lattice))
    # A bound under wider limits holds under these limits too, and may be lower by rounding.
    lowest = min((bound.value for bound in bounds), default=-np.inf)
    bounds += [bound for bound in widened if bound.value < lowest]
    # Some of the readings have no more information than all of them.
    common = () if problem.selection is None else (EVERY,)
    common = common if original is problem else (*common, STEADY)
    return replace(
        _smallest_certificate(
            problem,
            bounds,
            (*common, *EXACTLY),
            lattice,
            NOTHING if bounds else _missing_bound_reason(problem),
        ),
        drive=None if lattice is None else _lattice_drive(problem, lattice),
        widened=_smallest_certificate(problem, widened, (*common, *TOLERATED), lattice),
    )


def _smallest_certificate(
    problem: Problem,
    bounds: Sequence[Bound],
    assumptions: tuple[str, ...],
    lattice: LatticeBound | None,
    nothing: str = NOTHING,
) -> Certificate:
    criterion = problem.criterion
    judged = sum(len(estimation.judged) for estimation in problem.any_estimations)
    inflated = [
        replace(
            bound,
            value=inflate(bound.value, criterion, judged),
            assumptions=(*bound.assumptions, *assumptions),
        )
        for bound in bounds
    ]
    inflated.sort(key=lambda bound: bound.value)
    best = inflated[0] if inflated else Bound(np.inf, nothing, ())
    return Certificate(
        best.value,
        best.method,
        best.assumptions,
        best.multiplier,
        tuple(inflated),
        complete=lattice is None or lattice.complete,
        nodes=0 if lattice is None else lattice.nodes,
        criterion=criterion,
        judged=judged,
    )


def _missing_bound_reason(problem: Problem) -> str:
    # The reason why nothing is proved: the change to the problem that would give a bound.
    if not isinstance(problem.model, Model):
        return UNKNOWN
    hall = Rectangle(x=(-HALL, HALL), y=(-HALL, HALL))
    if workspace_bounds(problem) is None and _objective_bounds(
        replace(problem, robust=None, limits=(*problem.limits, hall))
    ):
        return ROOMLESS
    smallest_eigenvalue = E(scaling=problem.criterion.scaling, subset=problem.criterion.subset)
    return (
        OF_E if _objective_bounds(replace(problem, robust=None, criterion=smallest_eigenvalue)) else NOTHING
    )


def _objective_bounds(problem: Problem) -> list[Bound]:
    joint = [bound for bounds in JOINT_RUNS for bound in bounds(problem)]
    if joint or not problem.criterion.conjugate:
        return joint
    if problem.criterion.conjugate == "linear":
        return _trace_bounds(problem, BOUNDS)
    return list(combined_bounds(problem, _trace_bounds(problem, (*BOUNDS, *COMBINED))))


def _trace_bounds(problem: Problem, generators: Sequence[Generator]) -> list[Bound]:
    # F adds up over runs, and with it bounds on tr(Z F).
    space = problem.design
    if space.runs == 1:
        return [bound for bounds in generators for bound in bounds(problem)]
    if not isinstance(space, DesignSpace):
        return []
    starts = Counter(space.start if isinstance(space.start, tuple) else (space.start,) * space.runs)
    by_start = []
    for start, count in starts.items():
        design = space.model_copy(update={"runs": 1, "start": start})
        single_run = replace(problem, robust=None, design=design)
        run_bounds = [bound for bounds in generators for bound in bounds(single_run)]
        # Bounds without a Z do not add up.
        added = [bound for bound in run_bounds if bound.multiplier is not None]
        by_start.append([replace(bound, value=count * bound.value) for bound in added])
    return [
        replace(
            matching[0],
            value=sum(bound.value for bound in matching),
            assumptions=(*matching[0].assumptions, "every run for itself"),
        )
        for matching in zip(*by_start, strict=True)
    ]


def _speeds(problem: Problem) -> tuple[SpeedLimits, Array, Array] | None:
    # Limits of the speeds, weights, and prior information for the dynamic programme. None unless every sample
    # is a measurement of its own and the inputs act on the ground without slip, and for too fine a lattice.
    measurement, space, criterion = problem.measurement, problem.design, problem.criterion
    estimation = problem.any_estimations[-1]
    if (
        not criterion.conjugate
        or space.runs > 1
        or not isinstance(measurement, Displacements)
        or measurement.noise_model != "increments"
        or measurement.segment_count(space.samples) != space.samples
        or len(problem.model.inputs) != 2
        or len(robot_of(problem.model).coefficient_names) != 2
        or not has_exact_inputs(problem)
        or (criterion.conjugate == "smooth" and len(problem.any_estimations) > 1)
        # The lattice orders its inputs as the columns of W.
        or estimation.judged != estimation.block.parameters
    ):
        return None
    rate = float(largest_rates(problem).max())
    ends = problem.rest_spare + space.period / 2 * rate if space.rest_to_rest else np.inf
    limits = SpeedLimits(space.samples, problem.input_bounds, space.period * rate, ends)
    weights = space.period * estimation.scales / noise_of(problem, estimation)
    is_coarse = LatticeProgram(limits, weights).steps <= MOST_STEPS
    return (limits, weights, prior_matrix(estimation)) if is_coarse else None


def _lattice_bound(problem: Problem, value: float, lattice: LatticeBound) -> Bound:
    method = (
        f"dynamic programming over wheel speeds on a lattice, branch and bound with {lattice.nodes} nodes"
    )
    assumptions = [SPEEDS, NO_ROOM]
    if robot_of(problem.system).integration == "arc":
        assumptions.append("arcs are at most as informative as chords of full length")
    # Branching proves a bound by several Z, one for each part of the speeds.
    multiplier = lattice.parts[0].multiplier if len(lattice.parts) == 1 else None
    return Bound(value, method, tuple(assumptions), multiplier)


def _lattice_drive(problem: Problem, lattice: LatticeBound) -> Trajectory | None:
    # The best speeds, as they are or reversed: the variant with the smallest violations of the limits.
    space = problem.design
    start = problem.start_states(np.zeros((1, 0))) if problem.fixed_starts is None else problem.fixed_starts
    low, high = problem.input_bounds.T
    drives = [
        Trajectory.from_samples(speeds, space.duration, start, rest_to_rest=space.rest_to_rest)
        for forwards in (lattice.speeds, lattice.speeds[::-1])
        for speeds in (forwards, -forwards)
        if np.all(speeds >= low - 1e-9) and np.all(speeds <= high + 1e-9)
    ]

    def keeping(drive: Trajectory) -> tuple[bool, float]:
        evaluation = score(problem, drive)
        return evaluation.feasible, -sum(evaluation.violations.values())

    return max(drives, key=keeping, default=None)
