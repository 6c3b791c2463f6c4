"""A first study for a robot, a room and a sensor: commented YAML that solves as it stands."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from oed.foundation.errors import UserMistake
from oed.foundation.quantities import parse_quantity
from oed.kernel.dynamics.system import Parameter
from oed.robots.baselines import suited
from oed.robots.models import MODELS, Model, PythonRobot
from oed.robots.models.model import robot_of
from oed.robots.presets import preset, preset_names
from oed.study.study import Study, read_study
from oed.study.yaml_source import parse_yaml

TYPICAL = {
    "wheel_radius": "5 cm",
    "track": "30 cm",
    "wheelbase": "40 cm",
    "half_wheelbase_plus_half_track": "35 cm",
    "centre_distance": "18 cm",
    "y_icr_left": "25 cm",
    "y_icr_right": "-25 cm",
    "trailer_length": "60 cm",
}
"""Sizes of a typical robot, for those that are not given."""
ROOM = "3 m x 3 m"
"""Of a first study, where none is given: a living room."""
DURATION = "20 s"
"""Of a first drive."""
PILOT = "8 s"
"""Duration of a drive before anything is known of a robot that skids: short, so that it stays in the room."""
EFFECTIVE, LEAST, MOST = 1.8, 1.4, 2.4
"""How many times wider than its wheels' own the track of a robot that skids acts: usual, least and most."""
UNSURE = "5 %"
"""How far the parameters of a robot may be from their nominal values before its first drive."""
IDENTIFIABLE = {"skid_steer": ("wheel_radius_right", "wheel_radius_left", "track")}
"""What to estimate of robots whose parameters are not identifiable all together."""
SENSORS = {
    "poses": (
        "motion capture: position and heading at every sample",
        "{kind: poses, noise: {position: 1 cm, heading: 1 deg}}",
    ),
    "positions": (
        "a laser tracker or satellite navigation: positions only",
        "{kind: poses, quantities: [x, y], noise: {position: 1 cm}}",
    ),
    "ranges": (
        "distances to beacons in three corners of the room",
        "{{kind: ranges, beacons: [{corners}], noise: 3 cm}}",
    ),
    "displacements": (
        "the founding paper's regression: where the robot stands after each of ten segments",
        "{kind: displacements, segments: 10, regressor: both, noise: {position: 1 cm, heading: 1 deg}}",
    ),
}
"""What a first study may measure with: for a reader, and in YAML."""


@dataclass(frozen=True)
class Choice:
    """What a first study is for.

    Attributes:
        robot: a preset's name or a robot's kind.
        sizes: the robot's constants, with units, by their keys; typical ones for those not given.
        room: "4 m x 3 m" or "circle 2 m" (its radius).
        sensor: one of `SENSORS`.
        duration: of one run, with its unit; by default 20 s, of robots that skid 8 s.
        runs: how many.
    """

    robot: str
    sizes: Mapping[str, str] = field(default_factory=dict)
    room: str = ROOM
    sensor: str = "poses"
    duration: str | None = None
    runs: int = 1


def robots() -> tuple[str, ...]:
    """What a first study can be for: presets, then kinds."""
    return (*preset_names(), *_kinds())


def sizes_needed(robot: str) -> dict[str, str]:
    """The constants that a robot's kind needs, with typical values; {} for a preset.

    Raises:
        UserMistake: an unknown robot.
    """
    if robot in preset_names():
        return {}
    model = _kinds().get(robot)
    if model is None:
        raise UserMistake(f"expected a robot of {', '.join(robots())}; got {robot!r}")
    fields = model.model_fields
    return {key: value for key, value in TYPICAL.items() if key in fields and key != "body_radius"}


def usual_duration(robot: str) -> str:
    """How long a first drive takes: of robots that skid shorter, so that it stays in the room."""
    return PILOT if _model(robot).skids else DURATION


def starter(choice: Choice) -> str:
    """The study as commented YAML, checked.

    Raises:
        UserMistake: an unknown robot or sensor, a room that cannot be read.
        StudyError: sizes that make no study, e.g. a room smaller than the robot.
    """
    if choice.sensor not in SENSORS:
        raise UserMistake(f"expected a sensor of {', '.join(SENSORS)}; got {choice.sensor!r}")
    known = sizes_needed(choice.robot)
    text = _text(choice, known, baselines="[straight, random]")
    model = robot_of(_read(text, "the new study").problem.model)
    if _skids(choice) and "track" in type(model).model_fields:
        own = {parameter.name: parameter.nominal for parameter in model.parameters}["track"]
        widened = {**choice.sizes, "track": f"{EFFECTIVE * own:.3g} m"}
        choice = replace(choice, sizes=widened)
        model = robot_of(_read(_text(choice, known, baselines="[straight, random]")).problem.model)
    doubt = _doubt_lines(choice, model)
    study = _read(_text(choice, known, "[straight, random]", doubt), "the new study")
    suitable = f"[{', '.join(suited(study.problem))}]"
    return _text(choice, known, suitable, doubt, _log_lines(choice, model))


def _read(text: str, name: str = "study") -> Study:
    return read_study(parse_yaml(text, name))


def _kinds() -> dict[str, type[Model]]:
    return {str(model.model_fields["kind"].default): model for model in MODELS if model is not PythonRobot}


def _text(
    choice: Choice,
    known: Mapping[str, str],
    baselines: str,
    doubt: Sequence[str] = (),
    log: Sequence[str] = (),
) -> str:
    robot = choice.robot.replace("_", " ")
    where = choice.room.strip()
    lines = [
        f"# The best drive to calibrate a robot ({robot}) in a room of {where}, written by `oed init`.",
        "# `oed check` reads it, `oed run` searches, compares and makes a report. Change what is yours;",
        "# `oed schema` lists every key.",
        *(_PILOT_LINES if _skids(choice) else ()),
        "format: 1",
        f"name: Calibration, {robot}",
        "robot:",
        *_robot_lines(choice, known),
        "trajectory:",
        f"  duration: {choice.duration or usual_duration(choice.robot)}",
        f"  samples: {50 if _skids(choice) else 100}",
        "  spline: {degree: 3, coefficients: 14}   # more coefficients: a freer drive, a longer search",
        f"  start: {{x: {_start(choice)[0]:g} m, y: {_start(choice)[1]:g} m, heading: 0 deg}}   # or: free",
    ]
    if choice.runs > 1:
        lines.append(f"  runs: {choice.runs}   # separate drives, each from its own start, designed together")
    lines += _measurement_lines(choice)
    identifiable = IDENTIFIABLE.get(_kind(choice.robot))
    if identifiable and choice.sensor != "displacements":
        lines += [
            "# Radii and slips are not identifiable together: the slips are taken as known.",
            f"estimate: [{', '.join(identifiable)}]",
        ]
    lines += [
        *doubt,
        "limits:",
        *_limit_lines(choice),
        "# As much as can be for the worst-known combination of parameters: the smallest eigenvalue.",
        "criterion: {kind: E, scaling: relative}",
        "solvers:",
        "  - {kind: ipopt, starts: 6, perturbations: 4}",
        "# Baselines: paths that people drive, made as large as the limits allow, to compare with.",
        f"baselines: {baselines}",
        *log,
        "seed: 0",
    ]
    return "\n".join(lines) + "\n"


_PILOT_LINES = (
    "# How much wider than its wheels' own the track of a skidding robot acts, nobody knows before: this",
    "# is a short pilot drive that stays in the room for the whole range. Drive it and log it; then",
    "# `oed next DIR LOG --duration '20 s'` designs the real one, for the robot as it is known by then.",
)
"""What is said of a first drive of a robot that skids."""


def _doubt_lines(choice: Choice, model: Model) -> list[str]:
    # How far the robot may be from its numbers, and that the drive is to survive it.
    identifiable = IDENTIFIABLE.get(_kind(choice.robot))
    names = [
        parameter for parameter in model.parameters if identifiable is None or parameter.name in identifiable
    ]
    amounts = {one.name: amount for one in names if (amount := _amount(choice, one))}
    kind = "scenarios" if _skids(choice) else "chance"
    return [
        "# How far the robot may be from these numbers: 99 % of such robots satisfy the limits.",
        "uncertainty:",
        *(f"  {name}: {amount}" for name, amount in amounts.items()),
        f"robust: {{kind: {kind}, confidence: 0.99}}",
    ]


def _amount(choice: Choice, parameter: Parameter) -> str:
    if _skids(choice) and parameter.name in ("track", "y_icr_left", "y_icr_right"):
        ends = sorted(parameter.nominal * share / EFFECTIVE for share in (LEAST, MOST))
        return f"[{ends[0]:.3g} m, {ends[1]:.3g} m]"
    if parameter.nominal:
        return UNSURE
    if not parameter.scale:
        return ""
    return f"{parse_quantity(UNSURE, '') * parameter.scale:.2g} {parameter.unit}"


def _skids(choice: Choice) -> bool:
    return _model(choice.robot).skids


def _model(robot: str) -> type[Model]:
    return _kinds()[_kind(robot)]


def _log_lines(choice: Choice, model: Model) -> list[str]:
    # As the exported commands and the package's own paths have their columns.
    inputs = [
        f"#     {entry.name}: {{column: {entry.name}, form: {'speed' if entry.drives else 'value'}}}"
        for entry in model.inputs
    ]
    heading = "none" if choice.sensor == "positions" else "{column: heading, unit: rad}"
    further = "".join(f", {name}: {name}" for name in model.states[3:] if name == "trailer_angle")
    return [
        "# Once the drive is driven and logged, `oed estimate` needs to know what stands where in the log:",
        "# log:",
        "#   time: t",
        "#   inputs:",
        *inputs,
        f"#   poses: {{x: x, y: y, heading: {heading}{further}}}",
    ]


def _robot_lines(choice: Choice, known: Mapping[str, str]) -> list[str]:
    if choice.robot in preset_names():
        own = [f"  {key}: {value}{_note(choice, key)}" for key, value in choice.sizes.items()]
        return [f"  preset: {choice.robot}   # its published geometry and limits; any key overrides", *own]
    lines = [f"  kind: {choice.robot}"]
    for key, value in known.items():
        given = choice.sizes.get(key)
        note = _note(choice, key) if given else "   # a typical size: put in yours"
        lines.append(f"  {key}: {given or value}{note}")
    lines += [f"  {key}: {value}" for key, value in choice.sizes.items() if key not in known]
    if "body_radius" not in choice.sizes:
        lines.append(
            "  # body_radius: 20 cm   # how far its body reaches: kept away from walls and obstacles"
        )
    return lines


def _note(choice: Choice, key: str) -> str:
    if key != "track" or not _skids(choice):
        return ""
    return f"   # as it acts: {EFFECTIVE:g} times the wheels' own, usually; skidding widens it"


def _measurement_lines(choice: Choice) -> list[str]:
    meaning, text = SENSORS[choice.sensor]
    if choice.sensor == "ranges":
        x_min, x_max, y_min, y_max = _extent(choice.room)
        corners = [(x_min, y_min), (x_max, y_min), (x_min, y_max)]
        text = text.format(corners=", ".join(f"[{x:g} m, {y:g} m]" for x, y in corners))
    lines = [f"# Measured by {meaning}.", "measurement:"]
    if _kind(choice.robot) != "tractor_trailer" or choice.sensor == "displacements":
        return [lines[0], f"measurement: {text}"]
    return [*lines, f"  - {text}", "  - {kind: trailer_angle, noise: 1 deg}"]


def _limit_lines(choice: Choice) -> list[str]:
    lines = []
    if choice.robot not in preset_names():
        lines += ["  wheel_speed: 10 rad/s", "  wheel_acceleration: 20 rad/s^2"]
    lines += {
        "tricycle": ["  steering_angle: 60 deg", "  steering_rate: 60 deg/s"],
        "ackermann": ["  steering_angle: 25 deg", "  steering_rate: 60 deg/s"],
        "tractor_trailer": ["  trailer_angle: 60 deg   # beyond, it would jackknife"],
    }.get(_kind(choice.robot), [])
    shape = _circle(choice.room)
    if shape is not None:
        lines.append(f"  workspace: {{kind: circle, radius: {shape:g} m}}")
    else:
        x_min, x_max, y_min, y_max = _extent(choice.room)
        lines.append(
            f"  workspace: {{kind: rectangle, x: [{x_min:g} m, {x_max:g} m], y: [{y_min:g} m, {y_max:g} m]}}"
        )
    lines.append("  # obstacles: [{kind: circle, x: 1 m, y: 0.5 m, radius: 20 cm}]")
    return lines


def _kind(robot: str) -> str:
    return str(preset(robot)["robot"]["kind"]) if robot in preset_names() else robot


def _start(choice: Choice) -> tuple[float, float]:
    x_min, x_max, y_min, y_max = _extent(choice.room)
    return (x_min + x_max) / 2, (y_min + y_max) / 2


def _circle(room: str) -> float | None:
    word, _, size = room.strip().partition(" ")
    return _length(size, room) if word == "circle" else None


def _extent(room: str) -> tuple[float, float, float, float]:
    radius = _circle(room)
    if radius is not None:
        return -radius, radius, -radius, radius
    sides = re.split(r"\s*[x\u00d7]\s*", room.strip())
    if len(sides) != 2:
        raise UserMistake(f"expected a room like '4 m x 3 m' or 'circle 2 m', got {room!r}")
    width, depth = (_length(side, room) for side in sides)
    return -width / 2, width / 2, -depth / 2, depth / 2


def _length(text: str, room: str) -> float:
    try:
        value = parse_quantity(text, "m") if re.search("[a-zA-Z]", text) else float(text)
    except ValueError as error:
        raise UserMistake(f"the room {room!r} cannot be read: {error}") from None
    if not value > 0:
        raise UserMistake(f"the room {room!r} has no size")
    return value
