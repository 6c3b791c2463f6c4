"""Tasks by the names of trajectory files: the drives that they hold take the names' place, so that a study
stands on its own from here on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from oed.foundation.errors import Issue, ProblemError
from oed.kernel.criteria import Criterion, I, TaskDrive
from oed.study.robot_study import RobotStudyFile
from oed.study.study_file import StudyFile

Key = tuple[str | int, ...]
File = TypeVar("File", bound=StudyFile)


def with_tasks(file: File, folder: Path, drives_of: Callable[[Path, File], Sequence[TaskDrive]]) -> File:
    """A study whose criteria have drives where they named files.

    Args:
        file: the study's keys.
        folder: from which files are found.
        drives_of: the drives of a file; raises a `ProblemError` without keys.

    Raises:
        ProblemError: every file that cannot be read, by its key.
    """
    issues = list[Issue]()

    def read(key: Key, criterion: Criterion) -> Criterion:
        if not isinstance(criterion, I) or not any(isinstance(one, str) for one in criterion.task):
            return criterion
        drives = list[TaskDrive]()
        for index, one in enumerate(criterion.task):
            try:
                drives += [one] if isinstance(one, TaskDrive) else drives_of(folder / one, file)
            except ProblemError as error:
                issues.extend(Issue((*key, "task", index), issue.message) for issue in error.issues)
        return criterion.model_copy(update={"task": tuple(drives)})

    updated = file.model_copy(update={"criterion": read(("criterion",), file.criterion)})
    updated = _in_solvers(updated, read)
    trial = updated.physics if isinstance(updated, RobotStudyFile) else None
    if trial is not None and trial.criterion is not None:
        own = read(("physics", "criterion"), trial.criterion)
        updated = updated.model_copy(update={"physics": trial.model_copy(update={"criterion": own})})
    if issues:
        raise ProblemError(issues)
    return updated


def _in_solvers(file: File, read: Callable[[Key, Criterion], Criterion]) -> File:
    # Searches may aim at criteria of their own.
    solvers = list(file.solvers)
    for index, one in enumerate(solvers):
        own = getattr(one, "criterion", None)
        if isinstance(own, Criterion):
            updated = read(("solvers", index, "criterion"), own)
            solvers[index] = one.model_copy(update={"criterion": updated})
    return file.model_copy(update={"solvers": tuple(solvers)})
