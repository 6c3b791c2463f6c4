"""What a robust study's record says: how many robots violate the limits on each drive, and at what cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.solution import NOMINAL, Solution
from oed.optimize import solve
from oed.records.stored.simulation import Paths, StatesOverTime, StoredRobustness, Tried, Uncertain
from oed.study.study import Study
from oed.uncertainty.departures import path_limits, paths, violated, violation_probability
from oed.uncertainty.robust import Robust
from oed.uncertainty.uncertainty import UncertainQuantities, spread_of
from oed.workflow.studies import Work

PLAIN = "Searched without back-off for other robots than the nominal one, for comparison."
"""What is said of the search that a robust one is compared with."""
BUNDLE = 40
"""Robots whose paths a report draws."""
DRAWN = 100
"""Points of each such path."""
BUNDLE_STREAM = 1000
"""Of draws: the robots drawn are not those that limits were tightened by."""


def nominal_search(work: Work) -> list[Solution]:
    """What the study's first search finds without tightened limits, scored by the study's problem.

    Nothing for a study that is not robust, or does not ask.
    """
    study = work.study
    problem, robust = study.problem, study.problem.robust
    if not isinstance(robust, Robust) or not robust.compare or not study.solvers:
        return []
    options = study.solvers[0].model_copy(update={"name": NOMINAL})
    plain = replace(problem, robust=None)
    found = solve(plain, options, seed=work.seed, workers=work.workers, progress=work.progress)
    detail = f"{found.detail} {PLAIN}".strip()
    scored = None if found.trajectory is None else evaluate(problem, found.trajectory)
    return [replace(found, evaluation=scored, detail=detail)]


def tried(work: Work, solutions: Sequence[Solution]) -> list[Solution]:
    """The solutions with what a robust study's robots do on each; as they are if it is not robust."""
    problem, robust = work.study.problem, work.study.problem.robust
    if not isinstance(robust, Robust):
        return list(solutions)
    work.progress.begin(f"simulate {robust.draws} robots on every drive", len(solutions))
    scored = []
    for solution in solutions:
        if solution.trajectory is not None and solution.violation is None:
            found = violation_probability(problem, solution.trajectory, draws=robust.draws, seed=work.seed)
            solution = replace(solution, violation=found)
        scored.append(solution)
        work.progress.advance()
    return scored


def safe(study: Study, solutions: Sequence[Solution]) -> list[Solution]:
    """The solutions with few enough violations, as far as that was tried; all if the study is not robust.

    The search without tightened limits is for comparison only, whatever it has found.
    """
    robust = study.problem.robust
    if not isinstance(robust, Robust):
        return list(solutions)
    allowed = 1 - robust.confidence
    return [
        one
        for one in solutions
        if one.name != NOMINAL and (one.violation is None or one.violation.surely_below(allowed))
    ]


def robustness(study: Study, solutions: Sequence[Solution], seed: int) -> StoredRobustness | None:
    """A record's `robustness`, of solutions that were tried; None for a study that is not robust.

    Args:
        study: of the solutions.
        solutions: with their violation probabilities.
        seed: of the paths that are shown.
    """
    problem, robust = study.problem, study.problem.robust
    spread = spread_of(problem.uncertain_system)
    if not isinstance(robust, Robust) or spread is None:
        return None
    drives = [one for one in solutions if one.violation is not None and one.evaluation is not None]
    return StoredRobustness.of(
        robust,
        limits=[limit.name for limit in path_limits(problem)],
        uncertain=uncertain_table(spread),
        results=[_tried(solution) for solution in drives],
        **_drawn(problem, drives, spread.draws(BUNDLE, seed, BUNDLE_STREAM)),
    )


def uncertain_table(spread: UncertainQuantities) -> list[Uncertain]:
    """Return uncertain quantities as a record has them."""
    columns = (spread.names, spread.units, spread.nominal, spread.low, spread.high, spread.uniform)
    return [
        Uncertain.of(name=name, unit=unit, nominal=nominal, low=low, high=high, uniform=uniform)
        for name, unit, nominal, low, high, uniform in zip(*columns, strict=True)
    ]


def _tried(solution: Solution) -> Tried:
    robust = solution.robust if isinstance(solution.robust, Robust) else None
    return Tried.of(
        solution.violation,
        solution.evaluation,
        name=solution.name,
        back_off=None if robust is None else robust.reach,
        added=None if robust is None else len(robust.added_scenarios),
    )


def _drawn(problem: Problem, drives: Sequence[Solution], values: Any) -> dict[str, Any]:
    # Of the searches' own drives only: what systems of uncertain quantities `values` (K, q) do; where they
    # move through space, their paths. Systems without states have no course to draw.
    paths_of_all, courses = list[Paths](), list[StatesOverTime]()
    for solution in drives if problem.model.states else ():
        if solution.robust is None and solution.name != NOMINAL:
            continue
        assert solution.trajectory is not None
        states = paths(problem, solution.trajectory, values)
        points = points_by_run(states, problem.design.runs)
        known = {"name": solution.name, "violating": violated(problem, solution.trajectory, values)}
        if problem.model.velocity_signal:
            paths_of_all.append(Paths.of(**known, paths=points[..., :2]))
        else:
            times = [
                np.linspace(0, run.duration, run.samples + 1)[_drawn_samples(run.samples + 1)]
                for run in solution.trajectory.each
            ]
            courses.append(StatesOverTime.of(**known, times=times, states=points))
    return {"bundles": paths_of_all, "courses": courses or None}


def points_by_run(states: Array, runs: int) -> Array:
    """Return states that figures draw, (K, runs, points, states), of all samples (K, N + runs, states)."""
    by_run = states.reshape(len(states), runs, -1, states.shape[2])
    return by_run[:, :, _drawn_samples(by_run.shape[2])]


def _drawn_samples(count: int) -> Places:
    return np.unique(np.linspace(0, count - 1, DRAWN).astype(int))
