"""The smallest of the bounds that hold for a problem. A new bound is a function in `BOUNDS`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from oed.bounds.certificate import Bound, Certificate, raised
from oed.bounds.closed_form import NO_ROOM, SPEEDS, noise_of, prior_matrix, regression_bounds
from oed.bounds.conjugate import combined_bounds, traced
from oed.bounds.joint import joint_bounds
from oed.bounds.points import point_bounds
from oed.bounds.reach import largest_rates, room, unslipped
from oed.bounds.readings import selection_certificate
from oed.bounds.sensitivity import sensitivity_bounds
from oed.bounds.speed_lattice import LatticeBound, LatticeProgram, SpeedLimits, lattice_bound
from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.kernel.criteria import A, D, E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.kernel.results import TOLERANCE
from oed.kernel.scorer import score
from oed.robots.limits import Rectangle
from oed.robots.models.model import Model, robot_of
from oed.robots.sensors.displacements import Displacements
from oed.robots.space import DesignSpace

BOUNDS: tuple[Callable[[Problem], Iterator[Bound]], ...] = (regression_bounds, joint_bounds)
"""Each yields the upper bounds that it knows on the objective of one run; of other problems nothing."""
COMBINED: tuple[Callable[[Problem], Iterator[Bound]], ...] = (sensitivity_bounds,)
"""The same of bounds that only say something together: of problems with criterion D or A in place of E."""
WHOLE: tuple[Callable[[Problem], Iterator[Bound]], ...] = (point_bounds,)
"""Each yields the upper bounds that it knows on the objective of all runs together."""
GAP = 2e-4
"""Gap between the bound and its own best speeds at which that search ends."""
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
"""Comparisons of one pass of the dynamic programming above which a lattice is too fine for it."""
NOTHING = "no bound is known for this robot, criterion and measurement"
"""Where nothing is proved."""
UNKNOWN = "no bound is known for this system, criterion and measurement"
"""The same of what is no robot."""
ROOMLESS = "no bound is known without a room: give limits.workspace"
OF_E = "no bound is known for this criterion; for criterion E there is one"
HALL = 1e4
"""Half a side of a room [m] that is large enough for any drive."""

MEAN = "no bound is known for the mean over {}s"
"""Where the objective is a mean, which the nominal robot's bound does not hold for."""


EVERY = "every reading taken"
STEADY = "drift left out: it can only take information away"
"""Assumption of bounds where only some of them are."""
REPEATED = "no bound is known for designs whose readings may be repeated"


@typed
def bound(
    problem: Problem,
    *,
    nodes: int | None = None,
    time_limit: float | None = None,
    gap: float = GAP,
) -> Certificate:
    """The smallest upper bound on a problem's objective that is proved here, with its assumptions; beside it
    the same for limits widened by what scoring tolerates.

    Args:
        problem: with criterion E, D or A.
        nodes: of the search by branch and bound at most; by default as many as take some seconds.
        time_limit: of this search [s]; none by default, for where it stops depends on the machine.
        gap: at which this search ends.

    Raises:
        ProblemError: a problem without a drive to be designed.
        WrongKind: no problem.
    """
    began = time.perf_counter()
    problem.require_designed()
    found = _at_once(problem) or _searched(problem, nodes, time_limit, gap)
    return replace(found, wall_seconds=time.perf_counter() - began)


def _at_once(problem: Problem) -> Certificate | None:
    # What is known without a search over designs; None where it takes one.
    if problem.robust is not None and problem.robust.objective == "mean":
        # A bound is of the nominal robot, which limits the worst of several, but not their mean.
        return Certificate(np.inf, MEAN.format(problem.model.noun), ())
    if problem.selection is None:
        return None
    if problem.design.only is not None:
        return selection_certificate(problem, problem.design.only)
    return Certificate(np.inf, REPEATED, ()) if problem.selection.most > 1 else None


def _searched(problem: Problem, nodes: int | None, time_limit: float | None, gap: float) -> Certificate:
    # The covariance of readings under process noise is at least that without, F so at most that without.
    given, problem = problem, problem.steady
    looser = problem.widened(TOLERANCE)
    bounds, widened = _bounds_of_runs(problem), _bounds_of_runs(looser)
    found = _lattice(problem, nodes, time_limit, gap)
    if found is not None:
        bounds.append(_lattice_bound(problem, found.upper, found))
        if _program(looser) is not None:
            widened.append(_lattice_bound(looser, found.of_others(*_speeds(looser)), found))
    # Rounding may make a bound under wider limits the lower one, which holds under these limits too.
    lowest = min((bound.value for bound in bounds), default=-np.inf)
    bounds += [bound for bound in widened if bound.value < lowest]
    # Some of the readings say no more than all of them.
    every = () if problem.selection is None else (EVERY,)
    every = every if given is problem else (*every, STEADY)
    return replace(
        _smallest(problem, bounds, (*every, *EXACTLY), found, NOTHING if bounds else _lacking(problem)),
        drive=None if found is None else _lattice_drive(problem, found),
        widened=_smallest(problem, widened, (*every, *TOLERATED), found),
    )


def _smallest(
    problem: Problem,
    bounds: Sequence[Bound],
    assumptions: tuple[str, ...],
    found: LatticeBound | None,
    nothing: str = NOTHING,
) -> Certificate:
    criterion = problem.criterion
    judged = sum(len(estimation.judged) for estimation in problem.any_estimations)
    inflated = [
        replace(one, value=raised(one.value, criterion, judged), assumptions=(*one.assumptions, *assumptions))
        for one in bounds
    ]
    inflated.sort(key=lambda one: one.value)
    best = inflated[0] if inflated else Bound(np.inf, nothing, ())
    return Certificate(
        best.value,
        best.method,
        best.assumptions,
        best.multiplier,
        tuple(inflated),
        complete=found is None or found.complete,
        nodes=0 if found is None else found.nodes,
        criterion=criterion,
        judged=judged,
    )


def _lacking(problem: Problem) -> str:
    # Why nothing is proved: what there would be a bound with.
    if not isinstance(problem.model, Model):
        return UNKNOWN
    hall = Rectangle(x=(-HALL, HALL), y=(-HALL, HALL))
    if room(problem) is None and _bounds_of_runs(
        replace(problem, robust=None, limits=(*problem.limits, hall))
    ):
        return ROOMLESS
    same = E(scaling=problem.criterion.scaling, subset=problem.criterion.subset)
    if type(problem.criterion) is not E and _bounds_of_runs(replace(problem, robust=None, criterion=same)):
        return OF_E
    return NOTHING


def _bounds_of_runs(problem: Problem, *, together: bool = False) -> list[Bound]:
    # Each bound is of one direction or of the trace, so what runs add to it adds up: lambda_min of a sum is
    # at most the sum of the bounds.
    space, same = problem.design, traced(problem)
    whole = [one for bounds in WHOLE for one in bounds(problem)]
    if whole:
        return whole
    combined = [] if same is None else list(combined_bounds(problem, _bounds_of_runs(same, together=True)))
    if space.runs == 1:
        return [*combined, *_bounds(problem, together)]
    if not isinstance(space, DesignSpace) or not problem.criterion.proportional:
        return combined
    starts = space.start if isinstance(space.start, tuple) else (space.start,) * space.runs
    singles = [
        replace(problem, robust=None, design=space.model_copy(update={"runs": 1, "start": start}))
        for start in starts
    ]
    unequal = len(set(starts)) > 1
    # What is no bound of one tr(Z F) does not add up.
    found = [
        [one for one in _bounds(single, together) if one.multiplier is not None]
        for single in (singles if unequal else singles[:1])
    ]
    return [
        Bound(
            sum(one.value for one in each) * (1 if unequal else space.runs),
            each[0].method,
            (*each[0].assumptions, "every run for itself"),
            each[0].multiplier,
            each[0].block,
        )
        for each in zip(*found, strict=True)
    ]


def _bounds(problem: Problem, together: bool) -> Iterator[Bound]:
    for bounds in (*BOUNDS, *COMBINED) if together else BOUNDS:
        yield from bounds(problem)


def _lattice(
    problem: Problem, nodes: int | None, time_limit: float | None, gap: float
) -> LatticeBound | None:
    if _program(problem) is None:
        return None
    return lattice_bound(
        *_speeds(problem), gap=gap, nodes=nodes, time_limit=time_limit, criterion=problem.criterion
    )


def _program(problem: Problem) -> LatticeProgram | None:
    # None where a lattice proves nothing, or is so fine that not even one Z could be tried.
    if not _sampled(problem):
        return None
    limits, weights, _ = _speeds(problem)
    program = LatticeProgram(limits, weights)
    return program if program.steps <= MOST_STEPS else None


def _sampled(problem: Problem) -> bool:
    # Where every sample is measured for itself, and the inputs act on the ground as they are.
    measurement = problem.measurement
    if (
        type(problem.criterion) not in (E, D, A)
        or problem.design.runs > 1
        or not isinstance(measurement, Displacements)
        or measurement.noise_model != "increments"
        or measurement.segment_count(problem.design.samples) != problem.design.samples
        or len(problem.model.inputs) != 2
        or len(robot_of(problem.model).coefficient_names) != 2
        or not unslipped(problem)
    ):
        return False
    one = problem.any_estimations[-1]
    if type(problem.criterion) is not E and len(problem.any_estimations) > 1:
        return False
    # The lattice's inputs are in the order of W's columns.
    return one.judged == one.block.parameters


def _speeds(problem: Problem) -> tuple[SpeedLimits, Array, Array]:
    # Limits of the speeds, weights, and the prior.
    space, one = problem.design, problem.any_estimations[-1]
    rate = float(largest_rates(problem).max())
    ends = problem.rest_spare + space.period / 2 * rate if space.rest_to_rest else np.inf
    limits = SpeedLimits(space.samples, problem.input_bounds, space.period * rate, ends)
    return limits, space.period * one.scales / noise_of(problem, one), prior_matrix(problem, one)


def _lattice_bound(problem: Problem, value: float, found: LatticeBound) -> Bound:
    method = f"dynamic programming over wheel speeds on a lattice, branch and bound with {found.nodes} nodes"
    assumptions = [SPEEDS, NO_ROOM]
    if robot_of(problem.system).integration == "arc":
        assumptions.append("arcs are at most as informative as chords of full length")
    # Branching proves it by several Z, each of a part of all speeds.
    multiplier = found.parts[0].multiplier if len(found.parts) == 1 else None
    return Bound(value, method, tuple(assumptions), multiplier)


def _lattice_drive(problem: Problem, found: LatticeBound) -> Trajectory | None:
    # The best speeds found, or the same the other way round: whichever keeps best to the room.
    space = problem.design
    start = problem.start_states(np.zeros((1, 0))) if problem.fixed_starts is None else problem.fixed_starts
    speeds = found.speeds
    candidates = [speeds, -speeds, speeds[::-1], -speeds[::-1]]
    low, high = problem.input_bounds.T
    candidates = [one for one in candidates if np.all(one >= low - 1e-9) and np.all(one <= high + 1e-9)]
    drives = [
        Trajectory.from_samples(one, space.duration, start, rest_to_rest=space.rest_to_rest)
        for one in candidates
    ]
    if not drives:
        return None
    scored = [(score(problem, drive), drive) for drive in drives]
    return max(scored, key=lambda pair: (pair[0].feasible, -sum(pair[0].violations.values())))[1]
