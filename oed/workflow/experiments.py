"""Simulated experiments with a study's drives: do estimates scatter as predicted, and what does slip do?"""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import ValidationError

from oed.foundation.errors import ProblemError, UserMistake
from oed.foundation.wording import sentence
from oed.kernel.solution import Solution, scored
from oed.optimize import Ipopt, Progress, Silent, Workers, default_workers
from oed.records.outcomes import trial_of, validation_of
from oed.records.record import Record
from oed.records.recorded_study import recorded_study
from oed.records.stored.simulation import StoredTrial, StoredValidation
from oed.simulation import validate
from oed.simulation.trial import run_trial
from oed.study.cross_checks import validation_issues
from oed.study.study import ValidationOptions
from oed.workflow.integration_steps import with_enough_steps
from oed.workflow.studies import Work


def simulated(work: Work, solutions: Sequence[Solution]) -> StoredValidation | None:
    """A record's `validation` of solutions' drives; None for a study that does not ask for one."""
    options = work.study.file.validation
    return None if options is None else _simulated(work, solutions, options)


def validation_options(
    saved: Record,
    *,
    replicates: int | None = None,
    estimators: Sequence[str] | None = None,
    heading: str | None = None,
) -> ValidationOptions:
    """The simulation that a record's study asks for (or the default one), with what is given instead.

    Args:
        saved: the record.
        replicates: simulated experiments.
        estimators: their names.
        heading: which headings the estimators use.

    Raises:
        UserMistake: fewer replicates than a study may ask for, 100.
    """
    given = {"replicates": replicates, "estimators": estimators, "heading": heading}
    asked = (saved.study.validation or ValidationOptions()).model_dump()
    changed = {**asked, **{key: value for key, value in given.items() if value is not None}}
    try:
        return ValidationOptions.model_validate(changed)
    except ValidationError as error:
        detail = error.errors(include_url=False)[0]
        raise UserMistake(f"{detail['loc'][0]}: {sentence(detail)}") from None


def validated(
    saved: Record,
    options: ValidationOptions,
    *,
    seed: int | None = None,
    workers: Workers | None = None,
    progress: Progress | None = None,
    trust: bool = False,
) -> Record:
    """A saved record with its drives simulated anew.

    Args:
        saved: the record.
        options: of the simulation.
        seed: of the noise; None for the record's.
        workers: processes, or a cluster; does not change the result.
        progress: informed how far the work is.
        trust: whether Python code that the record names may be run.

    Raises:
        ProblemError: an estimator or headings that do not suit the measurement, or no noise to simulate with.
        RecordError: the robot is code that is not trusted.
    """
    study = recorded_study(saved, trust=trust)
    issues = validation_issues(options, study.problem.measurement)
    if issues:
        raise ProblemError(issues)
    solutions = [
        scored(study.problem, one.drive.trajectory, one.name)
        for one in saved.results
        if one.drive is not None
    ]
    study = with_enough_steps(study, solutions)
    work = Work(study, saved.seed if seed is None else seed, workers, progress or Silent())
    return saved.with_validation(_simulated(work, solutions, options))


def _simulated(work: Work, solutions: Sequence[Solution], options: ValidationOptions) -> StoredValidation:
    entries = []
    for solution in solutions:
        evaluation, trajectory = solution.evaluation, solution.trajectory
        if trajectory is None or evaluation is None or not evaluation.feasible or evaluation.singular:
            continue
        for estimator in options.estimators or (None,):
            try:
                result = validate(
                    work.study.problem,
                    trajectory,
                    replicates=options.replicates,
                    estimator=estimator,
                    heading=options.heading,
                    loss=options.loss,
                    alpha=options.alpha,
                    seed=work.seed,
                    workers=work.workers or default_workers(),
                    progress=work.progress,
                )
            except ProblemError:
                # Without the prior, or what the criterion ignores, a drive may make too little identifiable.
                continue
            entries.append(validation_of(solution.name, result))
    return StoredValidation.of(options, seed=work.seed, results=entries)


def driven_in_physics(work: Work, solutions: Sequence[Solution]) -> StoredTrial | None:
    """A record's `physics`: solutions' drives of a simulated robot with slip; None for a study that asks for
    none.
    """
    study = work.study
    trial, solver = study.physics, next(iter(study.solvers), Ipopt())
    if trial is None:
        return None
    known = solutions[0] if study.solvers else None
    found = run_trial(
        study.problem, trial, solver, known, seed=work.seed, workers=work.workers, progress=work.progress
    )
    return trial_of(found)
