"""What in a study's keys does not go together, beyond what each of them says by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

from oed.bounds.certificate import LATTICE
from oed.estimation.methods import estimator_flaws
from oed.foundation.errors import Flaw
from oed.foundation.files import file_stem, name_flaw
from oed.kernel.measurement.measurement import Measurement
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


def file_flaws(file: StudyFile) -> list[Flaw]:
    """Why keys that every study has do not go together; [] where they do."""
    validated = validation_flaws(file.validation, file.measurement) if file.validation else []
    flaws = [*_name_flaws(file), *_start_flaws(file), *_drift_flaws(file), *validated]
    if file.uncertainty is not None and file.robust is None:
        text = "is what a robust drive has to survive, and none is asked for: add `robust: {kind: chance}`"
        flaws.append(Flaw(("uncertainty",), text))
    return flaws


def robot_flaws(file: RobotStudyFile) -> list[Flaw]:
    """Why a robot's keys do not go together; [] where they do."""
    return [*_design_flaws(file), *_log_flaws(file)]


def _log_flaws(file: RobotStudyFile) -> list[Flaw]:
    # What does not fit the robot, or its sensors.
    if file.log is None:
        return []
    return [*file.log.flaws(file.robot), *file.log.sensor_flaws(file.measurement)]


def _design_flaws(file: RobotStudyFile) -> list[Flaw]:
    # What is asked of a drive where none is designed.
    if file.trajectory is not None:
        return []
    text = "is about a drive to be designed, and the study has no `trajectory`: add it, or leave this out"
    usual = {name: field.default for name, field in type(file).model_fields.items()}
    return [Flaw((name,), text) for name in OF_DESIGNS if getattr(file, name) != usual[name]]


def _drift_flaws(file: StudyFile) -> list[Flaw]:
    # What there is none of need not be left out.
    sensors = file.measurement.joint_sensors
    if any(
        getattr(sensor, "drift", None) is not None or getattr(sensor, "diffusion", ()) for sensor in sensors
    ):
        return []
    key = "drift" if file.domain == "robots" else "diffusion"
    text = f"there is no drift to leave out: give the measurement's `{key}`, or omit this"
    return [
        Flaw(("solvers", place, "without_drift"), text)
        for place, solver in enumerate(file.solvers)
        if solver.without_drift
    ]


def _name_flaws(file: StudyFile) -> list[Flaw]:
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
    flaws: list[Flaw] = []
    known = set[str]()
    for key, name in entries:
        flaw = name_flaw(name)
        if flaw:
            flaws.append(Flaw(key, flaw))
            continue
        stem = file_stem(name)
        if stem in known and (not flaws or flaws[-1].key != key):
            flaws.append(Flaw(key, f"a second result named {name}; give each a name of its own"))
        known.add(stem)
    return flaws


def _start_flaws(file: StudyFile) -> list[Flaw]:
    # A search can start only from one before it.
    flaws, known = [], list[str]()
    for index, solver in enumerate(file.solvers):
        wanted = getattr(solver, "start_from", None)
        if wanted is not None and wanted not in known:
            text = (
                f"expected the name of a search listed before ({', '.join(known) or 'none'}), got {wanted!r}"
            )
            flaws.append(Flaw(("solvers", index, "start_from"), text))
        known.append(solver.label)
    return flaws


def validation_flaws(options: ValidationOptions, measurement: Measurement) -> list[Flaw]:
    """What keeps estimators from a measurement, each flaw once; [] if nothing."""
    flaws: list[Flaw] = []
    for name in options.estimators or (None,):
        found = estimator_flaws(measurement, name, options.heading, options.loss)
        flaws += [flaw for flaw in found if flaw not in flaws]
    return flaws
