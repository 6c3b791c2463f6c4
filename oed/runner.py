"""Run a study: every search, baseline and simulation it asks for, into a record."""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from oed.baselines import baselines
from oed.bounds import LATTICE, Certificate, bound
from oed.criteria import A, Criterion, D, E
from oed.errors import ProblemError, UserMistake
from oed.evaluation import evaluate, input_table, nuisance_table, parameter_table
from oed.files import require_writable
from oed.path_file import read_trajectory, write_trajectory
from oed.record import (
    FORMAT,
    Record,
    certificate_data,
    drive_of,
    finite,
    result_data,
    save_record,
    validation_data,
)
from oed.robustness import nominal_search, robustness
from oed.solution import Solution, Status
from oed.solvers import SOLVERS, Progress, Silent, default_workers, solve
from oed.study import PathFile, Study, ValidationOptions, file_stem, recorded_study
from oed.trajectory import Trajectory
from oed.validation import validate

PRACTICALLY_EQUAL = 2e-3
"""Share of the objective by which two designs may differ and still count as equally good."""
ON_THE_SPOT = 0.01
"""Path length [m] of a design below which paths of the same length mean nothing."""
PACKAGES = ("casadi", "numpy", "scipy", "pymoo")


def run(
    study: Study,
    out: str | Path | None = None,
    *,
    seed: int | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Record:
    """Do everything the study asks for.

    Args:
        study: what to do.
        out: folder for record.json and the trajectories' CSV files; nothing is written without it.
        seed: instead of the study's.
        workers: processes; does not change the result.
        progress: told how far the work is.
    """
    chosen, listener = study.seed if seed is None else seed, progress or Silent()
    # What would fail at the end is better known before the work is done.
    paths = own_paths(study)
    if out is not None:
        require_writable(Path(out))
    solutions, interrupted = search(study, seed=chosen, workers=workers, progress=listener)
    validation: dict[str, Any] | None = None
    certificate: Certificate | None = None
    robust: dict[str, Any] | None = None
    try:
        if not interrupted:
            certificate = _certificate(study, listener)
            solutions += _lattice_drive(study, certificate)
            solutions += _baselines(
                study, paths, best_of(solutions, study.problem.criterion), chosen, listener
            )
            robust = robustness(study, solutions, chosen, listener)
            validation = _validation(study, solutions, chosen, listener, workers)
    except KeyboardInterrupt:
        interrupted = True
    return record(
        study,
        solutions,
        chosen,
        out,
        certificate=certificate,
        validation=validation,
        robust=robust,
        interrupted=interrupted,
    )


def search(
    study: Study, *, seed: int, workers: int | None = None, progress: Progress | None = None
) -> tuple[list[Solution], bool]:
    """The study's searches, one after the other, each knowing those before it; and whether an interrupt
    ended them early, with what had been found by then.

    Raises:
        StudyError: parameters that no drive tells apart.
    """
    study.require_identifiable()
    done: dict[str, Solution] = {}
    for solver in study.solvers:
        try:
            solution = solve(
                study.problem, solver, seed=seed, workers=workers, progress=progress, earlier=done
            )
        except KeyboardInterrupt:
            return list(done.values()), True
        done[solution.name] = solution
        if solution.status is Status.INTERRUPTED:
            return list(done.values()), True
    try:
        unreserved = nominal_search(study, seed=seed, workers=workers, progress=progress or Silent())
    except KeyboardInterrupt:
        return list(done.values()), True
    return [*done.values(), *unreserved], False


def own_paths(study: Study) -> dict[str, Trajectory]:
    """The user's own paths that the study compares with, by name.

    Raises:
        PathFileError: one that cannot be read.
    """
    return {
        path.label: read_trajectory(study.folder / path.file, study.problem)
        for path in study.file.baselines
        if isinstance(path, PathFile)
    }


def best_of(solutions: list[Solution], criterion: Criterion) -> Solution | None:
    """The feasible solution of largest objective; among practically equal ones the most informative.

    A search may give up a little of the objective to learn more in all other directions; one that did
    not is no better for it.
    """
    feasible = [(one, one.evaluation) for one in solutions if one.evaluation and one.evaluation.feasible]
    if not feasible:
        return None
    largest = max(evaluation.objective for _, evaluation in feasible)
    enough = criterion.concede(largest, 1 - PRACTICALLY_EQUAL)
    equal = [pair for pair in feasible if pair[1].objective >= enough]
    # A search by another criterion has given up nothing of this one on purpose.
    equal = [pair for pair in equal if pair[0].criterion is None] or equal
    return max(equal, key=lambda pair: pair[1].log_determinant)[0]


def record(
    study: Study,
    solutions: list[Solution],
    seed: int,
    out: str | Path | None = None,
    *,
    certificate: Certificate | None = None,
    validation: dict[str, Any] | None = None,
    robust: dict[str, Any] | None = None,
    physics: dict[str, Any] | None = None,
    interrupted: bool = False,
) -> Record:
    """The record of solutions, written to `out` where given, with their trajectories."""
    judges = criteria_of(study)
    results = [
        {
            **result_data(solution, _file(solution) if out is not None else None),
            "criteria": _judged(study, judges, solution),
        }
        for solution in solutions
    ]
    made = Record(
        {
            "format": FORMAT,
            "oed_version": package_version("oed"),
            "study": study.echo(),
            "study_text": study.text,
            "seed": seed,
            "inputs": input_table(study.problem),
            "parameters": parameter_table(study.problem),
            "nuisances": nuisance_table(study.problem),
            "results": results,
            "best": best.name if (best := best_of(solutions, study.problem.criterion)) is not None else None,
            "certificate": None if certificate is None else certified(study, certificate, solutions),
            "robustness": robust,
            "validation": validation,
            "interrupted": interrupted,
            "notes": _notes(certificate, interrupted),
            "provenance": provenance(),
        }
    )
    if out is not None:
        for solution in solutions:
            if solution.trajectory is not None and solution.evaluation is not None:
                path = Path(out) / _file(solution)
                write_trajectory(path, study.problem, solution.trajectory, solution.evaluation.poses)
        save_record(made, out)
    return made


def criteria_of(study: Study) -> dict[str, Criterion]:
    """What every result is judged by: E, D and A in the study's scaling, and whatever it searches for."""
    own = study.problem.criterion
    common = {"scaling": own.scaling, "subset": own.subset}
    judges: dict[str, Criterion] = {kind.__name__: kind(**common) for kind in (E, D, A)}
    judges[own.kind] = own
    for solver in study.solvers:
        if solver.criterion is not None:
            judges.setdefault(solver.criterion.kind, solver.criterion)
    return judges


def _judged(study: Study, judges: Mapping[str, Criterion], solution: Solution) -> dict[str, float | None]:
    evaluation, trajectory = solution.evaluation, solution.trajectory
    if evaluation is None or trajectory is None:
        return {}
    values: dict[str, float | None] = {}
    for name, criterion in judges.items():
        own = study.problem.criterion
        same = (criterion.scaling, criterion.subset) == (own.scaling, own.subset)
        # The same matrices serve every criterion that sees the parameters alike.
        value = (
            float(study.problem.told(criterion).value(list(evaluation.information.values())))
            if same
            else evaluate(replace(study.problem, criterion=criterion), trajectory).objective
        )
        values[name] = finite(value)
    return values


def _file(solution: Solution) -> str:
    return f"{file_stem(solution.name)}.csv"


def score(study: Study, trajectory: Trajectory, name: str) -> Solution:
    """Any trajectory, scored by the study's problem."""
    return Solution(
        name=name,
        kind="path",
        trajectory=trajectory,
        evaluation=evaluate(study.problem, trajectory),
        status=Status.SCORED,
    )


def certified(study: Study, certificate: Certificate, solutions: Sequence[Solution]) -> dict[str, Any] | None:
    """A certificate with its gap to the best feasible of these solutions."""
    samples = study.problem.design.samples
    # A path of the user's own with other samples is measured otherwise, and the bound is not about it.
    found = [
        (one.evaluation.objective, one.kind)
        for one in solutions
        if one.evaluation is not None and one.evaluation.feasible
        if one.trajectory is not None and one.trajectory.samples == samples
    ]
    searched = {solver.model_fields["kind"].default for solver in SOLVERS}
    splines = [objective for objective, kind in found if kind in searched]
    return certificate_data(
        certificate,
        max((objective for objective, _ in found), default=None),
        LATTICE if any(one.kind == LATTICE for one in solutions) else None,
        max(splines, default=None),
    )


def _certificate(study: Study, progress: Progress) -> Certificate | None:
    if not study.file.bound:
        return None
    progress.begin("bound what any drive could reach", 1)
    certificate = bound(study.problem)
    progress.advance()
    return certificate


def _lattice_drive(study: Study, certificate: Certificate | None) -> list[Solution]:
    # The speeds that the bound's own search ended with are a candidate like any other.
    if certificate is None or certificate.drive is None:
        return []
    return [replace(score(study, certificate.drive, LATTICE), kind=LATTICE)]


def _baselines(
    study: Study, paths: dict[str, Trajectory], best: Solution | None, seed: int, progress: Progress
) -> list[Solution]:
    # Every everyday path as large as it can be, and again with the best design's length, as in the paper.
    asked = study.file.baselines
    if not asked:
        return []
    progress.begin("score everyday paths", len(asked))
    length = best.evaluation.path_length if best is not None and best.evaluation is not None else None
    if length is not None and length < ON_THE_SPOT:
        length = None
    scored: list[Solution] = []
    for path in asked:
        if isinstance(path, PathFile):
            scored.append(score(study, paths[path.label], path.label))
        else:
            scored += baselines(study.problem, path, length=length, seed=seed)
        progress.advance()
    return scored


def _validation(
    study: Study, solutions: list[Solution], seed: int, progress: Progress, workers: int | None
) -> dict[str, Any] | None:
    options = study.file.validation
    return None if options is None else _simulated(study, solutions, options, seed, progress, workers)


def validation_options(
    saved: Record,
    *,
    replicates: int | None = None,
    estimators: Sequence[str] | None = None,
    heading: str | None = None,
) -> ValidationOptions:
    """The simulation that a record's study asks for (or the default one), with what is given instead.

    Raises:
        UserMistake: fewer than 100 replicates.
    """
    given = {"replicates": replicates, "estimators": estimators, "heading": heading}
    asked = saved.data["study"].get("validation") or {}
    changed = {**asked, **{key: value for key, value in given.items() if value is not None}}
    try:
        return ValidationOptions.model_validate(changed)
    except ValidationError as error:
        detail = error.errors()[0]
        raise UserMistake(f"{detail['loc'][0]}: {detail['msg'].lower()}, got {detail['input']!r}") from None


def validated(
    saved: Record,
    options: ValidationOptions,
    *,
    seed: int | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Record:
    """A saved record with its drives simulated anew.

    Args:
        saved: the record.
        options: of the simulation.
        seed: of the noise; None for the record's.
        workers: processes; does not change the result.
        progress: told how far the work is.

    Raises:
        ProblemError: the measurement gives no noise to simulate with.
    """
    study = recorded_study(saved)
    drives = [(str(entry["name"]), drive_of(entry)) for entry in saved.results]
    solutions = [score(study, drive, name) for name, drive in drives if drive is not None]
    chosen = saved.data["seed"] if seed is None else seed
    outcome = _simulated(study, solutions, options, chosen, progress or Silent(), workers)
    return Record({**saved.data, "validation": outcome})


def _simulated(
    study: Study,
    solutions: list[Solution],
    options: ValidationOptions,
    seed: int,
    progress: Progress,
    workers: int | None,
) -> dict[str, Any]:
    entries = []
    for solution in solutions:
        evaluation, trajectory = solution.evaluation, solution.trajectory
        if trajectory is None or evaluation is None or not evaluation.feasible or evaluation.singular:
            continue
        for estimator in options.estimators or (None,):
            try:
                result = validate(
                    study.problem,
                    trajectory,
                    replicates=options.replicates,
                    estimator=estimator,
                    heading=options.heading,
                    loss=options.loss,
                    alpha=options.alpha,
                    seed=seed,
                    workers=workers or default_workers(),
                    progress=progress,
                )
            except ProblemError:
                # A drive that tells too little without the prior, or without what the criterion leaves out.
                continue
            entries.append(validation_data(solution.name, result))
    return {**options.model_dump(mode="json"), "seed": seed, "results": entries}


def provenance() -> dict[str, Any]:
    """What made a record: versions of the packages that compute, of Python and the platform, and when."""
    return {
        "packages": {name: package_version(name) for name in PACKAGES},
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _notes(certificate: Certificate | None, interrupted: bool) -> list[str]:
    # What the study asks for and was not done is said, never passed over.
    unbounded = certificate is not None and not math.isfinite(certificate.upper_bound)
    notes = [f"`bound: true`: {certificate.method}."] if certificate is not None and unbounded else []
    return notes + (["The run was interrupted; this is what had been done by then."] if interrupted else [])


def package_version(package: str) -> str:
    """The version of an installed package, for records."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"
