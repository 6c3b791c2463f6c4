"""A first study for a robot, a room and a sensor: commented YAML that solves as it stands."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import jinja2
import yaml

from oed.foundation.errors import StudyError, UserMistake
from oed.foundation.quantities import parse_quantity
from oed.foundation.text import did_you_mean
from oed.robots.baselines import suited
from oed.robots.models import MODELS, Model, PythonRobot
from oed.robots.models.coefficients import nominal_coefficients
from oed.robots.models.model import robot_of
from oed.robots.presets import preset, preset_names
from oed.robots.usual_uncertainty import EFFECTIVE, usual_uncertainty
from oed.study.offered import OFFERS, entries_of, noise_of, offer_of, require_unit, usual_noise
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
    "drive_gain": "6 m/s^2",
    "viscous_drag": "1.5 1/s",
    "stiffness_front": "25 m/s^2/rad",
    "stiffness_rear": "28 m/s^2/rad",
    "front_axle": "16 cm",
    "rear_axle": "17 cm",
    "gyration_radius": "12 cm",
}
"""Sizes of a typical robot, for those that are not given."""
DRAWS = 2000
"""Robots that a first drive is simulated with: enough to show 99 %, in seconds."""
ROOM = "3 m x 3 m"
"""The room of a first study, where none is given."""
DURATION = "20 s"
"""Duration of a first drive."""
PILOT = "8 s"
"""Duration of a drive before anything is known of a robot that skids: short, to stay in the room."""
SHORT = "5 s"
"""Duration of a drive of a robot with inertia, whose periods are to be short."""
IDENTIFIABLE = {"skid_steer": ("wheel_radius_right", "wheel_radius_left", "track")}
"""What to estimate of robots whose parameters are not identifiable all together."""
INERT = ("bicycle_dynamic",)
"""Robots with inertia."""
PLACED = ("offset_drive", "skid_steer_icr")
"""Robots with a place of their own among the parameters, which no sensor whose place is unknown can find."""
SENSORS = tuple(OFFERS)
"""What a first study may measure with."""


@dataclass(frozen=True)
class Choice:
    """What a first study is for.

    Attributes:
        robot: a preset's name or a robot's kind.
        sizes: the robot's constants, with units, by their keys; typical ones for those not given.
        room: "4 m x 3 m" or "circle 2 m" (its radius).
        sensor: one of `SENSORS`.
        noise: standard deviations of its readings, with units, by their quantities; usual ones for those not
            given.
        duration: of one run, with its unit; by default 20 s, of robots that skid 8 s.
        runs: how many.
        designs: whether a drive is to be designed; else the study is for logs alone.
    """

    robot: str
    sizes: Mapping[str, str] = field(default_factory=dict)
    room: str = ROOM
    sensor: str = "poses"
    noise: Mapping[str, str] = field(default_factory=dict)
    duration: str | None = None
    runs: int = 1
    designs: bool = True


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
        hint = did_you_mean(robot, robots())
        raise UserMistake(f"expected a robot of {', '.join(robots())}; got {robot!r}{hint}")
    fields = model.model_fields
    return {key: value for key, value in TYPICAL.items() if key in fields and key != "body_radius"}


def noise_needed(robot: str, sensor: str) -> dict[str, str]:
    """The standard deviations of a sensor's readings on a robot, with usual values.

    Raises:
        UserMistake: an unknown robot or sensor.
    """
    sizes_needed(robot)
    return usual_noise(sensor, trailer=_has_trailer(robot))


def usual_duration(robot: str) -> str:
    """How long a first drive takes: of robots that skid shorter, so that it stays in the room, and of those
    with inertia, which need short periods.
    """
    if _kind(robot) in INERT:
        return SHORT
    return PILOT if skids(robot) else DURATION


def skids(robot: str) -> bool:
    """Whether a robot's wheels skid in turns, so that its first drive is a pilot."""
    return _model(robot).skids


def starter(choice: Choice) -> str:
    """The study as commented YAML, checked.

    Raises:
        UserMistake: an unknown robot or sensor, a room that cannot be read.
        StudyError: sizes that make no study, e.g. a room smaller than the robot.
    """
    model = robot_of(_read(_text(choice), "the new study").problem.model)
    if skids(choice.robot) and "track" in type(model).model_fields:
        own = {parameter.name: parameter.nominal for parameter in model.parameters}["track"]
        widened = {**choice.sizes, "track": f"{EFFECTIVE * own:.3g} m"}
        choice = replace(choice, sizes=widened)
        model = robot_of(_read(_text(choice)).problem.model)
    amounts = _ranges(choice, model)
    scaling = _scaling(choice, model)
    study = _read(_text(choice, scaling=scaling), "the new study")
    study.require_identifiable()
    baselines = suited(study.problem) if choice.designs else ()
    return _text(choice, baselines, amounts, model, scaling)


def _scaling(choice: Choice, model: Model) -> str:
    # Nothing can be precise to a share of nothing.
    estimated = nominal_coefficients(model).ravel() if offer_of(choice.sensor).alone else ()
    return "relative" if all(estimated) else "none"


def require_readable(choice: Choice) -> None:
    """Refuse answers that no study can be made of, as far as they are given.

    Raises:
        UserMistake: says what is wrong with them.
    """
    try:
        _read(_text(choice))
    except StudyError as error:
        raise UserMistake(in_short(error)) from None


def in_short(error: StudyError) -> str:
    """What is wrong with a study that is nowhere yet: its keys, without lines of a file."""
    return "; ".join(
        f"{issue.key}: {issue.message}" if issue.key else issue.message for issue in error.issues
    )


def _read(text: str, name: str = "study") -> Study:
    return read_study(parse_yaml(text, name))


def _kinds() -> dict[str, type[Model]]:
    return {str(model.model_fields["kind"].default): model for model in MODELS if model is not PythonRobot}


def _plain(text: str) -> bool:
    # Whether YAML takes it for a word or a number: what is written into a study as it is.
    try:
        return isinstance(yaml.safe_load(text), str | float | int)
    except yaml.YAMLError:
        return False


def _text(
    choice: Choice,
    baselines: Sequence[str] = ("straight", "random"),
    amounts: Mapping[str, str] | None = None,
    model: Model | None = None,
    scaling: str = "none",
) -> str:
    # Where `model` is given, with what stands in its logs.
    known, radius, (x_min, x_max, y_min, y_max) = (
        sizes_needed(choice.robot),
        _circle(choice.room),
        _extent(choice.room),
    )
    for key, size in choice.sizes.items():
        require_unit(key, size, TYPICAL.get(key, ""))
        if size and not _plain(size):
            raise UserMistake(f"{key}: expected a quantity, got {size!r}")
    noise = noise_of(choice.sensor, choice.noise, trailer=_has_trailer(choice.robot))
    corners = [f"[{x:g} m, {y:g} m]" for x, y in ((x_min, y_min), (x_max, y_min), (x_min, y_max))]
    return _template(choice.designs).render(
        choice=choice,
        sensor=offer_of(choice.sensor),
        entries=entries_of(choice.sensor, noise, corners, mounted=_kind(choice.robot) in PLACED),
        typical_noise=not choice.noise,
        robot=choice.robot.replace("_", " "),
        kind=_kind(choice.robot),
        preset=choice.robot in preset_names(),
        skids=_model(choice.robot).skids,
        inert=_kind(choice.robot) in INERT,
        known=known,
        typical=[key for key in known if not choice.sizes.get(key)],
        sizes={**known, **{key: value for key, value in choice.sizes.items() if value or key not in known}},
        effective=EFFECTIVE,
        draws=DRAWS,
        duration=choice.duration or usual_duration(choice.robot),
        radius=radius,
        x=(x_min, x_max),
        y=(y_min, y_max),
        identifiable=IDENTIFIABLE.get(_kind(choice.robot)),
        amounts=amounts,
        baselines=baselines,
        model=model,
        scaling=scaling,
    )


@cache
def _template(designs: bool) -> jinja2.Template:
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("oed.study"),
        autoescape=jinja2.select_autoescape(("html",)),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    made.filters["g"] = "{:g}".format
    return made.get_template("first_study.yaml.jinja" if designs else "logs_study.yaml.jinja")


def _ranges(choice: Choice, model: Model) -> dict[str, str]:
    # Ranges of the parameters before a calibration, as YAML.
    judged = IDENTIFIABLE.get(_kind(choice.robot))
    return {
        name: amount if isinstance(amount, str) else f"[{', '.join(amount)}]"
        for name, amount in usual_uncertainty(model).items()
        if judged is None or name in judged
    }


def _model(robot: str) -> type[Model]:
    return _kinds()[_kind(robot)]


def _kind(robot: str) -> str:
    return str(preset(robot)["robot"]["kind"]) if robot in preset_names() else robot


def _has_trailer(robot: str) -> bool:
    return _kind(robot) == "tractor_trailer"


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
