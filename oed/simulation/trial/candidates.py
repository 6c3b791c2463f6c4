"""The models on trial: what a drive is designed for, and what is calibrated from every drive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from oed.estimation.setup.options import Alternative, CalibrationOptions, Method
from oed.foundation.errors import Issue, ProblemError
from oed.foundation.text import words
from oed.kernel.dynamics.system import label_of
from oed.kernel.problem import Problem
from oed.robots.models.model import robot_of
from oed.robots.sensors import LeverArm, Poses
from oed.simulation.trial.options import Pilot, Trial, drive_issue

if TYPE_CHECKING:
    from oed.estimation.methods.fitting import Fitting

INPUTS = ("wheel_speed_right", "wheel_speed_left")
"""What a simulated robot is commanded by."""
Key = tuple[str | int, ...]


@dataclass(frozen=True)
class Candidate:
    """A model with the problem of designing a drive for it."""

    name: str
    problem: Problem

    def fitting(self, options: CalibrationOptions, method: Method) -> Fitting:
        """How it is calibrated; in windows of usual length where the method needs windows."""
        # Loaded late: to check a study is not to calibrate.
        from oed.estimation.methods.fitting import Fitting

        robot = robot_of(self.problem.system)
        names = self.problem.estimated_of_system or tuple(parameter.name for parameter in robot.parameters)
        segment = options.segment if method == "joint" else "auto"
        chosen = options.model_copy(update={"method": method, "segment": segment})
        return Fitting(robot, names, self.problem.measurement, chosen)


def candidates(problem: Problem, trial: Trial) -> tuple[Candidate, ...]:
    """The study's own robot and the other models.

    Raises:
        ProblemError: a model that the study's measurement or criterion does not suit.
    """
    others = [Candidate(one.label, _redesigned(problem, trial, one)) for one in trial.models]
    return (Candidate(words(label_of(problem.model)), problem), *others)


def trial_issues(problem: Problem, trial: Trial | None) -> list[Issue]:
    """Why a study cannot be tried on a simulated robot."""
    if trial is None:
        return []
    issues = [Issue(("physics",), text) for text in _misfits(problem)]
    if issues:
        return issues
    found = (_model_issues, _drive_issues, _method_issues, _discrepancy_issues)
    return [issue for one in found for issue in one(problem, trial)]


def _misfits(problem: Problem) -> Iterator[str]:
    inputs, sensors = problem.model.input_names, problem.sensors
    sensor = sensors[0] if len(sensors) == 1 else None
    if inputs != INPUTS:
        yield f"simulated robots are driven by {', '.join(INPUTS)}, not by {', '.join(inputs)}"
    if not isinstance(sensor, Poses) or sensor.quantities != ("x", "y", "heading"):
        yield "expected a measurement of poses (x, y and heading), as the simulation reads them"
    elif sensor.lever_arm != LeverArm():
        yield "simulated poses are those of the robot's origin: leave out the lever arm"
    elif sensor.noise.covariance is not None:
        yield "expected the noise of simulated poses as standard deviations, not as a covariance"
    if problem.design.runs > 1:
        yield f"expected a single run, got {problem.design.runs}"


def _model_issues(problem: Problem, trial: Trial) -> Iterator[Issue]:
    known = {words(label_of(problem.model))}
    for index, one in enumerate(trial.models):
        place: Key = ("physics", "models", index)
        if one.label in known:
            yield Issue(place, f"a second model named {one.label}; give each a `name` of its own")
        known.add(one.label)
        found = one.issues(problem.model.input_names)
        yield from (Issue(place, text) for text in found or _design_issues(problem, trial, one))


def _design_issues(problem: Problem, trial: Trial, one: Alternative) -> list[str]:
    try:
        _redesigned(problem, trial, one)
    except ProblemError as error:
        return [f"{one.label}: {issue}" for issue in error.issues]
    return []


def _drive_issues(problem: Problem, trial: Trial) -> Iterator[Issue]:
    for index, name in enumerate(trial.drives):
        text = drive_issue(problem, name)
        if text:
            yield Issue(("physics", "drives", index), text)


def _method_issues(problem: Problem, trial: Trial) -> Iterator[Issue]:
    if "two_stage" in trial.methods and not robot_of(problem.system).coefficient_names:
        text = f"{label_of(problem.system)} has no coefficients, which two_stage estimates"
        yield Issue(("physics", "methods", trial.methods.index("two_stage")), text)


def _discrepancy_issues(problem: Problem, trial: Trial) -> Iterator[Issue]:
    place, asked, (sensor,) = ("physics", "discrepancy"), trial.discrepancy, problem.sensors
    assert isinstance(sensor, Poses)
    if asked is None:
        return
    if sensor.noise.discrepancy is not None:
        yield Issue(
            place, "all drives are designed with the measurement's `discrepancy`: leave out one of them"
        )
    if isinstance(asked, Pilot):
        text = drive_issue(problem, asked.pilot)
        if text:
            yield Issue((*place, "pilot"), text)
    elif not any(asked.model_dump().values()):
        yield Issue(place, "expected a number above 0, or `pilot`, the baseline whose residuals show them")


def _redesigned(problem: Problem, trial: Trial, one: Alternative) -> Problem:
    # Nothing is known of another model's parameters beforehand.
    known = replace(problem, prior=None, uncertainty=None, robust=None)
    criterion = trial.criterion or problem.criterion
    return replace(known, model=one.robot, estimate=one.estimate, criterion=criterion)
