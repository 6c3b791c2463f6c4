"""Parameters of ros2_control's diff_drive_controller for a robot with a right and a left side.

The controller takes the right wheels' radius as right_wheel_radius_multiplier * wheel_radius, the left
ones' alike, and the distance of the sides as wheel_separation_multiplier * wheel_separation; from these it
computes wheel speeds and odometry [ros2_controllers, diff_drive_controller.cpp]. Here wheel_radius and
wheel_separation stay what they are nominally, and the multipliers hold what calibration has found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from oed.exporters.commands import joint_name
from oed.exporters.request import Request
from oed.exporters.two_sides import Sides, controller_limits
from oed.foundation.arguments import typed
from oed.foundation.errors import RecordError, UserMistake
from oed.foundation.files import write_text
from oed.records.record import ESTIMATE_FILE as ESTIMATE
from oed.records.stored.door import checked, read_object
from oed.records.stored.estimate import Estimates
from oed.robots.limits import Limit
from oed.robots.models import (
    DifferentialDrive,
    Model,
    OffsetDrive,
    SkidSteer,
    SkidSteerIcr,
    TractorTrailer,
)
from oed.robots.models.model import robot_of

CONTROLLER = "diff_drive_controller"

Values = Mapping[str, float]


@dataclass(frozen=True)
class _Kind:
    """How a kind of robot is described to the controller.

    Attributes:
        sides: what the controller needs of the robot with these parameter values.
        neutral: parameters whose values belong to the multipliers only: with these values the geometry is
            that of the wheels themselves.
        comment: what the file says of it.
    """

    sides: Callable[[Any, Values], Sides]
    neutral: Values = field(default_factory=dict)
    comment: tuple[str, ...] = ()


def _wheels(_: Model, values: Values) -> Sides:
    return Sides(values["wheel_radius_right"], values["wheel_radius_left"], values["track"])


def _slipping(robot: Model, values: Values) -> Sides:
    # Turning in place and straight ahead both sides have the mean slip.
    left = 1 - (values["slip_outer"] + values["slip_inner"]) / 2
    wheels = _wheels(robot, values)
    return Sides(wheels.radius_right * left, wheels.radius_left * left, wheels.separation)


def _centres(robot: SkidSteerIcr, values: Values) -> Sides:
    radius, width = robot.wheel_radius, values["y_icr_left"] - values["y_icr_right"]
    return Sides(radius * values["alpha_right"], radius * values["alpha_left"], width)


KINDS: dict[type[Model], _Kind] = {
    DifferentialDrive: _Kind(_wheels),
    TractorTrailer: _Kind(_wheels, comment=("The parameters are the tractor's.",)),
    OffsetDrive: _Kind(
        _wheels, comment=("The controller's pose is that of the axle's middle, not of the tracked point.",)
    ),
    SkidSteer: _Kind(
        _slipping,
        {"slip_outer": 0.0, "slip_inner": 0.0},
        (
            "The radii are effective ones, less the mean slip of both sides, and the separation is the",
            "effective track of turning in place: exact there and straight ahead, not in turns between.",
        ),
    ),
    SkidSteerIcr: _Kind(
        _centres,
        {"alpha_right": 1.0, "alpha_left": 1.0},
        (
            "The radii are effective ones (the wheel's times alpha), and the separation is the effective",
            "track of turning in place: the distance of the sides' centres of rotation. The controller's",
            "pose is that of the point midway between these centres.",
        ),
    ),
}
"""The robots that the controller can drive."""


@typed
def diff_drive_parameters(
    model: Model,
    values: Mapping[str, float] | None = None,
    *,
    limits: Iterable[Limit] = (),
    about: Iterable[str] = (),
) -> str:
    """The controller's parameter file, YAML with a comment that says where its numbers come from.

    Args:
        model: the robot.
        values: of its parameters by name, SI, where they are other than nominal, e.g. estimated.
        limits: of the study; what they say of speeds and accelerations becomes the controller's limits.
        about: lines for the comment, e.g. the study's name and where `values` come from.

    Raises:
        UserMistake: a robot without a right and a left side, values of parameters that it does not have,
            values that leave no radius or no track.
    """
    kind, given = _kind_of(model), dict(values or {})
    nominal = {parameter.name: parameter.nominal for parameter in model.parameters}
    strangers = [name for name in given if name not in nominal]
    if strangers:
        text = f"{model.kind} has no {', '.join(strangers)}; its parameters are {', '.join(nominal)}"
        raise UserMistake(text)
    wheels = kind.sides(model, {**nominal, **kind.neutral})
    found = kind.sides(model, {**nominal, **given})
    if not found.sound:
        raise UserMistake(f"{_listed(model, given)}: expected values that leave positive radii and track")
    comment = [
        f"Parameters of ros2_control's {CONTROLLER}, written by oed.",
        *about,
        f"Robot: {model.kind}; {_listed(model, given)}.",
        *kind.comment,
        "wheel_radius and wheel_separation are nominal; the multipliers lead to the values above.",
    ]
    data = {
        "type": f"{CONTROLLER}/DiffDriveController",
        **_geometry(model, wheels, found),
        **controller_limits(model, found, limits),
    }
    body = yaml.safe_dump({CONTROLLER: {"ros__parameters": data}}, sort_keys=False)
    return "".join(f"# {' '.join(line.split())}\n" for line in comment) + body


def _kind_of(robot: Model) -> _Kind:
    for known, kind in KINDS.items():
        if isinstance(robot, known):
            return kind
    names = ", ".join(str(known.model_fields["kind"].default) for known in KINDS)
    raise UserMistake(f"{CONTROLLER} drives robots with two sides: {names}; not {robot.kind}")


def _listed(robot: Model, given: Values) -> str:
    # Every parameter with its value, and the nominal one where that is another.
    parts = []
    for parameter in robot.parameters:
        unit = f" {parameter.unit}" if parameter.unit else ""
        value, nominal = given.get(parameter.name), f"{parameter.nominal:.9g}{unit}"
        text = f"{nominal} (nominal)" if value is None else f"{value:.9g}{unit} (nominal {nominal})"
        parts.append(f"{parameter.name} {text}")
    return ", ".join(parts)


def _geometry(robot: Model, wheels: Sides, found: Sides) -> dict[str, Any]:
    # One radius for both sides, and what tells them apart in the multipliers.
    right, left = robot.inputs
    radius = (wheels.radius_right + wheels.radius_left) / 2
    return {
        "left_wheel_names": [joint_name(left)],
        "right_wheel_names": [joint_name(right)],
        "wheels_per_side": 1,
        "wheel_separation": float(wheels.separation),
        "wheel_radius": float(radius),
        "wheel_separation_multiplier": float(found.separation / wheels.separation),
        "left_wheel_radius_multiplier": float(found.radius_left / radius),
        "right_wheel_radius_multiplier": float(found.radius_right / radius),
    }


def write_parameters(request: Request) -> Path:
    """Write the controller's parameters of the study's robot: estimated ones where an estimate lies beside
    the record, else nominal ones.

    Raises:
        RecordError: an estimate that cannot be read or used, no such result.
        UserMistake: a robot without a right and a left side.
    """
    if request.result is not None:
        # The file is the robot's, not a drive's; yet a mistyped name is a mistake.
        _ = request.entry
    problem, file = request.problem, request.folder / ESTIMATE
    robot = robot_of(problem.model)
    values = _estimated(file, robot) if file.is_file() else {}
    origin = f"estimated, from {ESTIMATE}: {', '.join(values)}" if values else "nominal, from the study"
    about = [f"Study: {problem.name}.", f"Values: {origin}."]
    text = diff_drive_parameters(robot, values, limits=problem.limits, about=about)
    path = request.out if request.out is not None else request.folder / f"{CONTROLLER}.yaml"
    write_text(path, text)
    return path


def _estimated(file: Path, model: Model) -> dict[str, float]:
    # The robot's parameters only: what else was estimated, e.g. a sensor's mounting, is not the controller's.
    text = "expected an estimate: parameters, each with its name and value"
    try:
        data = read_object(file, text, text)
        values = {one.name: one.value for one in checked(Estimates, data, file).parameters}
    except RecordError:
        raise RecordError.about(file, text, "parameters") from None
    known = [parameter.name for parameter in model.parameters]
    own = {name: value for name, value in values.items() if name in known}
    if not own:
        text = f"expected some of the robot's {', '.join(known)}; got {', '.join(values) or 'none'}"
        raise RecordError.about(file, text, "parameters")
    return own
