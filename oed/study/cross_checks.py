"""What in a study's keys does not go together, beyond what each of them says by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

from oed.bounds.certificate import LATTICE
from oed.estimation.methods import estimator_issues
from oed.foundation.errors import Issue
from oed.foundation.files import file_stem, name_issue
from oed.kernel.measurement.measurement import Measurement, measurement_of, sensors_of
from oed.kernel.solution import NOMINAL
from oed.robots.baselines import label
from oed.study.parts import PathFile

if TYPE_CHECKING:
    from oed.study.parts import ValidationOptions
    from oed.study.robot_study import RobotStudyFile
    from oed.study.study_file import StudyFile

OF_DESIGNS = (
    "robust",
    "uncertainty",
    "solvers",
    "baselines",
    "same_length",
    "bound",
    "weights",
    "validation",
    "physics",
)
"""Keys that mean nothing where no drive is designed."""


def file_issues(file: StudyFile) -> list[Issue]:
    """Why keys that every study has do not go together; [] where they do."""
    validated = (
        validation_issues(file.validation, measurement_of(file.measurement)) if file.validation else []
    )
    issues = [*_name_issues(file), *_start_issues(file), *_drift_issues(file), *validated]
    # Robots drawn from it are simulated on every drive.
    if file.uncertainty is not None and file.robust is None and file.domain != "robots":
        text = "is what a robust drive has to survive, and none is asked for: add `robust: {kind: chance}`"
        issues.append(Issue(("uncertainty",), text))
    return issues


def robot_issues(file: RobotStudyFile) -> list[Issue]:
    """Why a robot's keys do not go together; [] where they do."""
    return [*_design_issues(file), *_log_issues(file)]


def _log_issues(file: RobotStudyFile) -> list[Issue]:
    # What does not fit the robot, or its sensors.
    if file.log is None:
        return []
    return [*file.log.issues(file.robot), *file.log.sensor_issues(measurement_of(file.measurement))]


def _design_issues(file: RobotStudyFile) -> list[Issue]:
    # What is asked of a drive where none is designed.
    if file.trajectory is not None:
        return []
    text = "is about a drive to be designed, and the study has no `trajectory`: add it, or leave this out"
    usual = {name: field.default for name, field in type(file).model_fields.items()}
    return [Issue((name,), text) for name in OF_DESIGNS if getattr(file, name) != usual[name]]


def _drift_issues(file: StudyFile) -> list[Issue]:
    # What there is none of need not be left out.
    sensors = sensors_of(file.measurement)
    if any(
        getattr(sensor, "drift", None) is not None or getattr(sensor, "diffusion", ()) for sensor in sensors
    ):
        return []
    key = "drift" if file.domain == "robots" else "diffusion"
    text = f"there is no drift to leave out: give the measurement's `{key}`, or omit this"
    return [
        Issue(("solvers", place, "without_drift"), text)
        for place, solver in enumerate(file.solvers)
        if solver.without_drift
    ]


def _name_issues(file: StudyFile) -> list[Issue]:
    # Results are known by their names, and saved in files named after them.
    entries: list[tuple[tuple[str | int, ...], str]] = [
        (("solvers", index, "name"), solver.label) for index, solver in enumerate(file.solvers)
    ]
    if file.robust is not None and file.robust.compare:
        entries.append((("robust",), NOMINAL))
    if file.bound:
        entries.append((("bound",), LATTICE))
    for index, path in enumerate(file.baselines):
        if isinstance(path, PathFile):
            entries.append((("baselines", index), path.label))
        else:
            name = label(path)
            entries += [(("baselines", index), name), (("baselines", index), f"{name}_same_length")]
    issues: list[Issue] = []
    known = set[str]()
    for key, name in entries:
        issue = name_issue(name)
        if issue:
            issues.append(Issue(key, issue))
            continue
        stem = file_stem(name)
        if stem in known and (not issues or issues[-1].key != key):
            issues.append(Issue(key, f"a second result named {name}; give each a name of its own"))
        known.add(stem)
    return issues


def _start_issues(file: StudyFile) -> list[Issue]:
    # A search can start only from one before it.
    issues, known = [], list[str]()
    for index, solver in enumerate(file.solvers):
        wanted = getattr(solver, "start_from", None)
        if wanted is not None and wanted not in known:
            text = (
                f"expected the name of a search listed before ({', '.join(known) or 'none'}), got {wanted!r}"
            )
            issues.append(Issue(("solvers", index, "start_from"), text))
        known.append(solver.label)
    return issues


def validation_issues(options: ValidationOptions, measurement: Measurement) -> list[Issue]:
    """What keeps estimators from a measurement, each issue once; [] if nothing."""
    issues: list[Issue] = []
    for name in options.estimators or (None,):
        found = estimator_issues(measurement, name, options.heading, options.loss)
        issues += [issue for issue in found if issue not in issues]
    return issues
