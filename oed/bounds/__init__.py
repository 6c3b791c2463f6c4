"""Certificates: how far from the best possible can a design be? A new bound is one more in `_caps`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from oed.bounds.caps import NO_ROOM, SPEEDS, noise_of, prior_matrix, regression_caps
from oed.bounds.certificate import INFLATION, LOOSE, Cap, Certificate
from oed.bounds.joint import joint_caps
from oed.bounds.motion import largest_rates, unslipped
from oed.bounds.speed_lattice import LatticeBound, LatticeProgram, SpeedLimits, lattice_bound
from oed.criteria import E
from oed.evaluation import evaluate
from oed.measurements.displacements import Displacements
from oed.problem import Problem
from oed.trajectory import Trajectory

TIME_LIMIT = 5.0
"""Seconds that the search for a bound may take."""
GAP = 2e-4
"""Gap between the bound and its own best speeds at which that search ends."""
EXACTLY = (
    "limits kept exactly, without the 0.1 % that scoring tolerates",
    "as many samples as the study's",
)
SECONDS_PER_STEP = 1e-8
"""Measured time of one step of the dynamic programming, generously."""
LATTICE = "lattice"
"""Name and kind of the drive that the lattice's search comes upon."""
NOTHING = "no bound is known for this robot, criterion and measurement"

MEAN = "no bound is known for the mean over robots"


def bound(problem: Problem, *, time_limit: float = TIME_LIMIT, gap: float = GAP) -> Certificate:
    """The smallest upper bound on a problem's objective that is proved here, with its assumptions.

    Args:
        problem: with criterion E.
        time_limit: of the search by branch and bound [s].
        gap: at which that search ends.
    """
    began = time.perf_counter()
    if problem.robust is not None and problem.robust.objective == "mean":
        # A cap is of the nominal robot, which limits the worst of several, but not their mean.
        return Certificate(np.inf, MEAN, (), None, (), None, True, time.perf_counter() - began)
    caps, drive, complete = _caps_of_runs(problem), None, True
    searched = _lattice(problem, time_limit, gap)
    if searched is not None:
        found, cap = searched
        caps.append(cap)
        drive, complete = _lattice_drive(problem, found), found.complete
    inflated = [
        Cap(one.value * (1 + INFLATION), one.method, (*one.assumptions, *EXACTLY), one.multiplier)
        for one in caps
    ]
    inflated.sort(key=lambda one: one.value)
    best = inflated[0] if inflated else Cap(np.inf, NOTHING, ())
    return Certificate(
        best.value,
        best.method,
        best.assumptions,
        best.multiplier,
        tuple(inflated),
        drive,
        complete,
        time.perf_counter() - began,
    )


def _caps_of_runs(problem: Problem) -> list[Cap]:
    # Each cap is of one direction or of the trace, so what runs tell of it adds up: lambda_min of a sum is at
    # most the sum of the caps.
    space = problem.design
    if space.runs == 1:
        return list(_caps(problem))
    starts = space.start if isinstance(space.start, tuple) else (space.start,) * space.runs
    singles = [
        replace(problem, robust=None, design=space.model_copy(update={"runs": 1, "start": start}))
        for start in starts
    ]
    unequal = len(set(starts)) > 1
    found = [list(_caps(single)) for single in (singles if unequal else singles[:1])]
    return [
        Cap(
            sum(cap.value for cap in each) * (1 if unequal else space.runs),
            each[0].method,
            (*each[0].assumptions, "every run for itself"),
            each[0].multiplier,
        )
        for each in zip(*found, strict=True)
    ]


def _caps(problem: Problem) -> Iterator[Cap]:
    if not isinstance(problem.criterion, E):
        return
    if isinstance(problem.measurement, Displacements):
        yield from regression_caps(problem, problem.measurement)
    else:
        yield from joint_caps(problem)


def _lattice(problem: Problem, time_limit: float, gap: float) -> tuple[LatticeBound, Cap] | None:
    # Where every sample is measured for itself, and the inputs act on the ground as they are.
    measurement = problem.measurement
    if (
        not isinstance(problem.criterion, E)
        or problem.design.runs > 1
        or not isinstance(measurement, Displacements)
        or measurement.noise_model != "increments"
        or measurement.segment_count(problem.design.samples) != problem.design.samples
        or len(problem.model.inputs) != 2
        or len(problem.model.coefficient_names) != 2
        or not unslipped(problem)
    ):
        return None
    one = problem.any_estimations[-1]
    if one.judged != one.block.parameters:
        # The lattice's inputs are in the order of W's columns.
        return None
    space = problem.design
    step = space.period * float(largest_rates(problem).max())
    limits = SpeedLimits(
        space.samples, problem.input_bounds, step, step / 2 if space.rest_to_rest else np.inf
    )
    weights = space.period * one.scales / noise_of(problem, one)
    if LatticeProgram(limits, weights).steps * SECONDS_PER_STEP > time_limit:
        # So fine a lattice that not even one Z could be tried.
        return None
    found = lattice_bound(
        limits,
        weights,
        prior_matrix(problem, one),
        gap=gap,
        time_limit=time_limit,
    )
    method = f"dynamic programming over wheel speeds on a lattice, branch and bound with {found.nodes} nodes"
    assumptions = [SPEEDS, NO_ROOM]
    if space.integration == "arc":
        assumptions.append("arcs tell at most as much as chords of full length")
    return found, Cap(found.upper, method, tuple(assumptions), found.multiplier)


def _lattice_drive(problem: Problem, found: LatticeBound) -> Trajectory | None:
    # The best speeds found, or the same the other way round: whichever keeps best to the room.
    space = problem.design
    start = (0.0, 0.0, 0.0) if problem.fixed_starts is None else problem.fixed_starts[0]
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
    scored = [(evaluate(problem, drive), drive) for drive in drives]
    return max(scored, key=lambda pair: (pair[0].feasible, -sum(pair[0].violations.values())))[1]


__all__ = ["GAP", "LATTICE", "LOOSE", "TIME_LIMIT", "Cap", "Certificate", "bound"]
