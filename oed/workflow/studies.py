"""Studies from files and texts, with what they name besides: earlier records, and paths of the user's own;
and what it takes to work on one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from oed.foundation.arguments import typed
from oed.foundation.errors import Issue, PathFileError
from oed.kernel.criteria import TaskDrive
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.prior import Prior
from oed.optimize import Progress, Silent, Workers
from oed.optimize.refinement import plan
from oed.study.estimated import Discrepancy, Drift, Estimates
from oed.study.study import AnyStudyFile, PathFile, PriorRecord, Study, read_study
from oed.study.yaml_source import parse_yaml, read_yaml


# Records take as long to load as a study to check, and few studies name one.
def _discrepancy_of(folder: Path) -> Discrepancy:
    from oed.records.discrepancy import discrepancy_of

    return discrepancy_of(folder)


def _drift_of(folder: Path) -> Drift:
    from oed.records.drift import drift_of

    return drift_of(folder)


def _prior_of(wanted: PriorRecord, folder: Path) -> Prior:
    from oed.records.recorded_study import prior_of

    return prior_of(wanted, folder)


def _drives_of(file: Path, study: AnyStudyFile) -> list[TaskDrive]:
    from oed.records.recorded_study import drives_of

    return drives_of(file, study)


ESTIMATES = Estimates(_discrepancy_of, _drift_of)
"""How studies take parts from estimates that they name."""


@dataclass(frozen=True)
class Work:
    """Work on a study.

    Attributes:
        study: what to do.
        seed: of every random draw.
        workers: processes, or a cluster; does not change the result.
        progress: informed how far the work is.
    """

    study: Study
    seed: int
    workers: Workers | None = None
    progress: Progress = field(default_factory=Silent)


@typed
def load_study(file: str | Path) -> Study:
    """Read and cross-check a study file.

    Raises:
        StudyError: every mistake in the file, each with its line and key.
    """
    return read_study(read_yaml(file), _prior_of, _drives_of, ESTIMATES)


@typed
def parse_study(text: str, source: str = "study") -> Study:
    """The study that YAML text describes; `source` stands for the file's name in errors.

    Raises:
        StudyError: every mistake in the text, each with its line and key.
    """
    return read_study(parse_yaml(text, source), _prior_of, _drives_of, ESTIMATES)


def refinements(study: Study) -> str:
    """What `coefficients: auto` means for a study, in words; "" where its spline is given."""
    return plan(study.problem, study.solvers)


def own_paths(study: Study) -> dict[str, Trajectory]:
    """The user's own paths that a study compares with, by name.

    Raises:
        StudyError: some that cannot be read, each with the line that names it and its own.
    """
    from oed.records.path_file import read_trajectory

    paths: dict[str, Trajectory] = {}
    issues: list[Issue] = []
    for index, path in enumerate(study.file.baselines):
        if isinstance(path, PathFile):
            try:
                paths[path.label] = read_trajectory(study.folder / path.file, study.problem)
            except PathFileError as error:
                issues += [Issue(("baselines", index, "file"), str(issue)) for issue in error.issues]
    if issues:
        raise study.error(issues)
    return paths
