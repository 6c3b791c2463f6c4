"""Run a study: every search it asks for, into a record."""

from __future__ import annotations

import platform
from collections import Counter
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from oed.evaluation import evaluate, parameter_table
from oed.path_file import write_trajectory
from oed.record import FORMAT, Record, result_data, save_record
from oed.solution import Solution, Status
from oed.solve import Progress, solve
from oed.study import Study
from oed.trajectory import Trajectory

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
    chosen = study.seed if seed is None else seed
    solutions = [
        solve(study.problem, solver, seed=chosen, workers=workers, progress=progress)
        for solver in study.solvers
    ]
    return record_solutions(study, _distinct(solutions), chosen, out)


def record_solutions(
    study: Study, solutions: list[tuple[str, Solution]], seed: int, out: str | Path | None
) -> Record:
    """The record of named solutions, written to `out` where given."""
    results = []
    for name, solution in solutions:
        entry = result_data(solution, f"{name}.csv" if out is not None else None)
        results.append({**entry, "name": name})
        if out is not None and solution.trajectory is not None and solution.evaluation is not None:
            path = Path(out) / f"{name}.csv"
            write_trajectory(path, study.problem, solution.trajectory, solution.evaluation.poses)
    record = Record(
        {
            "format": FORMAT,
            "oed_version": _version("oed"),
            "study": study.echo(),
            "study_text": study.text,
            "seed": seed,
            "parameters": parameter_table(study.problem),
            "results": results,
            "certificate": None,
            "validation": None,
            "notes": _notes(study),
            "provenance": provenance(),
        }
    )
    if out is not None:
        save_record(record, out)
    return record


def score(study: Study, trajectory: Trajectory, name: str) -> Solution:
    """Any trajectory, scored by the study's problem."""
    return Solution(
        name=name,
        kind="path",
        trajectory=trajectory,
        evaluation=evaluate(study.problem, trajectory),
        status=Status.SCORED,
    )


def provenance() -> dict[str, Any]:
    """What made a record: versions of the packages that compute, of Python and the platform, and when."""
    return {
        "packages": {name: _version(name) for name in PACKAGES},
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _notes(study: Study) -> list[str]:
    # What the study asks for and this version does not do is said, never passed over.
    return ["`bound: true` is read, but this version computes no bounds."] if study.file.bound else []


def _distinct(solutions: list[Solution]) -> list[tuple[str, Solution]]:
    # Two searches of one kind get names of their own: ipopt, ipopt_2, ...
    seen: Counter[str] = Counter()
    named = []
    for solution in solutions:
        seen[solution.name] += 1
        count = seen[solution.name]
        named.append((solution.name if count == 1 else f"{solution.name}_{count}", solution))
    return named


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"
