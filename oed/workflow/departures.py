"""What a record says of robots in any study: how many leave the workspace or hit an obstacle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from oed.kernel.problem import Problem
from oed.kernel.solution import Solution
from oed.kernel.tightening import UncertainSystem
from oed.records.stored.departures import Departing, StoredDepartures
from oed.records.stored.simulation import Paths
from oed.robots.models.model import robot_of
from oed.robots.usual_uncertainty import usual_uncertainty
from oed.study.study import Study
from oed.uncertainty.departures import DRAWS, Departures, departures, paths, position_limits, violated
from oed.uncertainty.robust import Robust
from oed.uncertainty.uncertainty import Uncertainty, impossible_system_message, require_spread, spread_of
from oed.workflow.robustness import BUNDLE, BUNDLE_STREAM, points_by_run, uncertain_table


def departures_on(
    study: Study, solutions: Sequence[Solution], best: Solution | None, seed: int
) -> StoredDepartures | None:
    """Simulate robots on the best drive and on every drive that is no baseline.

    Args:
        study: of the solutions.
        solutions: with their drives.
        best: whose paths are kept for figures.
        seed: of the draws.

    Returns:
        A record's `departures`; None for systems that are no robots, for studies without limits on positions
        and where there is no drive.
    """
    problem = with_uncertainty(study) if position_limits(study.problem) else None
    if problem is None:
        return None
    robust = study.problem.robust
    draws = robust.draws if isinstance(robust, Robust) else DRAWS
    simulated = [
        (solution.name, _simulated(problem, solution, draws, seed))
        for solution in solutions
        if solution.trajectory is not None and solution.evaluation is not None
        if solution.kind != "baseline" or solution is best
    ]
    if not simulated:
        return None
    return StoredDepartures.of(
        simulated[0][1],
        usual=problem.uncertainty is not study.problem.uncertainty,
        robust=robust is not None,
        uncertain=uncertain_table(require_spread(problem.uncertain_system)),
        results=[Departing.of(departing, name=name) for name, departing in simulated],
        bundle=None if robust is not None or best is None else _bundle(problem, best, seed),
    )


def with_uncertainty(study: Study) -> Problem | None:
    """Return a robot's problem with what robots are drawn from: the study's uncertainty, else the usual one.

    A prior takes the place of the usual ranges of the parameters that it names, unless it is so wide that it
    includes robots that cannot be. None of systems that are no robots.
    """
    problem = study.problem
    if study.file.domain != "robots":
        return None
    if problem.uncertainty is not None or problem.robust is not None:
        return problem
    return next(
        (
            replace(problem, uncertainty=uncertainty, prior=system.prior)
            for uncertainty, system in _assumptions(problem)
            if (spread := spread_of(system)) is not None and not impossible_system_message(spread, system)
        ),
        None,
    )


def _assumptions(problem: Problem) -> Iterator[tuple[Uncertainty | None, UncertainSystem]]:
    # The prior with usual ranges of other parameters; usual ranges alone.
    usual = Uncertainty(within=usual_uncertainty(robot_of(problem.model)))
    system = problem.uncertain_system
    if problem.prior is not None:
        others = usual.without(problem.prior.names, problem.model)
        yield others, replace(system, uncertainty=others)
    yield usual, replace(system, uncertainty=usual, prior=None)


def _simulated(problem: Problem, solution: Solution, draws: int, seed: int) -> Departures:
    assert solution.trajectory is not None
    departing = departures(problem, solution.trajectory, draws=draws, seed=seed)
    assert departing is not None
    return departing


def _bundle(problem: Problem, best: Solution, seed: int) -> Paths:
    assert best.trajectory is not None
    values = require_spread(problem.uncertain_system).draws(BUNDLE, seed, BUNDLE_STREAM)
    points = points_by_run(paths(problem, best.trajectory, values), best.trajectory.runs)
    violating = violated(problem, best.trajectory, values, position_limits(problem))
    return Paths.of(name=best.name, violating=violating, paths=points[..., :2])
