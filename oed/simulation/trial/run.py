"""A trial from end to end: a drive for every model, robots that drive, what came of it as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from oed.estimation.methods.fitting import Fitting
from oed.foundation.errors import Issue, ProblemError
from oed.foundation.text import words
from oed.foundation.work.parallel import run_tasks
from oed.kernel.evaluation import evaluate
from oed.kernel.identifiability import require_identifiable
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status
from oed.optimize import Progress, Solver, Workers, default_workers, solve
from oed.simulation.physics.engine import engine_library
from oed.simulation.trial.aims import OPTIMAL, Aim, aims, sensing_of
from oed.simulation.trial.candidates import candidates
from oed.simulation.trial.experiment import Bench, Found, Repeat, repeated
from oed.simulation.trial.options import Trial, held_out_drives, paced_baseline
from oed.simulation.trial.outcome import Outcome, Planned


def require_ready(problem: Problem, trial: Trial) -> None:
    """Refuse at once a trial that would fail later.

    Raises:
        UserMistake: the engine is not installed; says how to.
        ProblemError: models with parameters that no drive tells apart.
    """
    engine_library()
    issues: list[Issue] = []
    for index, model in enumerate(candidates(problem, trial)[1:]):
        try:
            require_identifiable(model.problem)
        except ProblemError as error:
            issues += [Issue(("physics", "models", index), issue.message) for issue in error.issues]
    if issues:
        raise ProblemError(issues)


def run_trial(
    problem: Problem,
    trial: Trial,
    solver: Solver,
    known: Solution | None = None,
    *,
    seed: int,
    workers: Workers | None,
    progress: Progress,
) -> Outcome:
    """What a trial finds; of an interrupted one what had been done by then, marked so.

    Args:
        problem: the study's own robot, and what to design for.
        trial: what to try.
        solver: finds the optimal drive of every model.
        known: what it has found for the own robot already.
        seed: of every random draw.
        workers: processes, or a cluster; does not change the result.
        progress: told how far the work is.
    """
    models, fits = candidates(problem, trial), _fits(problem, trial)
    planned: list[Planned] = []
    found: dict[tuple[int, int], Found] = {}
    interrupted = False
    try:
        for model in models:
            for aim in aims(problem, trial, model, fits[model.name], seed):
                solution = known if aim.model is models[0] else None
                solution = solution or solve(
                    aim.model.problem, solver, seed=seed, workers=workers, progress=progress
                )
                planned.append(_designed(problem, aim, solution))
                if solution.status is Status.INTERRUPTED:
                    raise KeyboardInterrupt
        planned += [_baseline(problem, name, seed) for name in trial.drives]
        bench = _bench(problem, trial, planned, fits, seed)
        _drive(bench, trial, found, workers or default_workers(), progress)
    except KeyboardInterrupt:
        interrupted = True
    return Outcome(trial, models, tuple(planned), fits, found, seed, interrupted)


def _fits(problem: Problem, trial: Trial) -> dict[str, Fitting]:
    own, *others = candidates(problem, trial)
    usual = trial.calibration.method
    fits = {one.name: one.fitting(trial.calibration, usual) for one in (own, *others)}
    further = [method for method in trial.methods if method != usual]
    return fits | {
        f"{own.name} by {words(method)}": own.fitting(trial.calibration, method) for method in further
    }


def _designed(problem: Problem, aim: Aim, solution: Solution) -> Planned:
    evaluation = solution.evaluation if solution.trajectory is not None else None
    predicted = None if evaluation is None else _predicted(problem, solution)
    name = f"{aim.name} {'for' if aim.name.startswith(OPTIMAL) else 'by'} {aim.model.name}"
    return Planned(name, aim.model, solution, predicted, aim.name, aim.discrepancy)


def _predicted(problem: Problem, solution: Solution) -> Mapping[str, float]:
    # What the drive says of the study's own robot.
    assert solution.trajectory is not None
    start = problem.start_states([solution.trajectory.start[:3]])
    drive = replace(solution.trajectory, start=start[0])
    return evaluate(problem, drive).standard_deviations


def _baseline(problem: Problem, name: str, seed: int) -> Planned:
    trajectory = paced_baseline(problem, name, seed)
    evaluation = evaluate(problem, trajectory)
    solution = Solution(name, "baseline", trajectory, evaluation, Status.SCORED, seed=seed)
    return Planned(words(name), None, solution, evaluation.standard_deviations)


def _bench(
    problem: Problem, trial: Trial, planned: Sequence[Planned], fits: Mapping[str, Fitting], seed: int
) -> Bench:
    drives = {one.name: one.drivable for one in planned if one.drivable is not None}
    held_out = held_out_drives(problem, trial.held_out, seed)
    return Bench(trial.robot, trial.variation, sensing_of(problem), drives, held_out, fits, seed)


def _drive(
    bench: Bench, trial: Trial, found: dict[tuple[int, int], Found], workers: Workers, progress: Progress
) -> None:
    # Floors in turn, so that an interrupt leaves as many repeats of each.
    tasks = [
        Repeat(bench, friction, floor, number)
        for number in range(trial.repeats)
        for floor, friction in enumerate(trial.frictions)
    ]
    count = len(bench.drives) + len(bench.held_out)
    progress.begin(f"drive {count} drives with each simulated robot", len(tasks))

    def take(index: int, result: Found | None) -> None:
        if result is not None:
            found[tasks[index].floor, tasks[index].number] = result
        progress.advance()

    run_tasks(repeated, tasks, workers, take)
