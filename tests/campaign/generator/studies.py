"""Random valid studies: robot, drive, room, limits, measurement and criterion that fit together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from ..oracle.criteria import predicted
from ..oracle.readings import Block, blocks_of
from ..oracle.robots import Robot, robot_of, through_coefficients
from ..oracle.splines import Run, clamped_run
from .criteria import draw_criterion, draw_estimate, draw_prior, written_prior
from .limits import bounds_of, draw_end_limits, draw_input_limits, draw_motion_limits
from .measurements import draw_measurement
from .quantities import Quantity, log_uniform, one_of, plain, written
from .robots import draw_robot, scale_of, wheel_radius
from .rooms import clear_of, draw_obstacle, draw_room, inner_point

Rng = np.random.Generator
Array = np.ndarray[Any, Any]


@dataclass(frozen=True)
class Study:
    """A random study.

    Attributes:
        spec: its keys, SI, presets filled in, as the oracle reads them.
        given: the same, as a study writes them.
        bounds: of every input, (inputs, 2).
        size: of the room that the drives need [m].
    """

    spec: dict[str, Any]
    given: dict[str, Any]
    bounds: Array
    size: float

    def text(self, rng: Rng) -> str:
        """The YAML, in units drawn at random."""
        return yaml.safe_dump(written(self.given, rng), sort_keys=False, allow_unicode=True)

    @property
    def robot(self) -> Robot:
        """The oracle's robot."""
        return robot_of(plain(self.spec["robot"]))


def draw_study(rng: Rng) -> Study:
    """A valid study."""
    keys, given, preset_limits = draw_robot(rng)
    robot = robot_of(plain(keys))
    trajectory, speed = _draw_trajectory(rng, keys, preset_limits)
    space = {**trajectory, "duration": float(trajectory["duration"])}
    period, rest = space["duration"] / space["samples"], space["rest_to_rest"]
    limits = draw_input_limits(rng, robot, speed, period, space["spline"]["degree"], rest=rest)
    forward, turning = _fastest(rng, robot, bounds_of(limits, robot))
    limits |= draw_motion_limits(rng, robot, forward, turning)
    way = forward * space["duration"]
    size = max(way * log_uniform(rng, 0.05, 1.0), 2 * scale_of(keys))
    limits |= draw_end_limits(rng, way, np.zeros(2))
    starts = _furnish(rng, limits, robot, space["runs"], size)
    trajectory["start"] = _start(rng, starts, free="workspace" in limits)
    if "preset" in given:
        # What a preset limits is kept where the study does not say otherwise.
        limits = {**preset_limits, **limits}
    spec = {"robot": keys, "trajectory": trajectory, "limits": limits}
    spec |= _asked(rng, robot, spec, speed, size)
    written_keys = {**spec, "robot": given}
    if "prior" in spec:
        written_keys["prior"] = written_prior(spec["prior"])
    head = {"format": 1, "name": f"Campaign {keys['kind']}"}
    return Study(spec, {**head, **written_keys}, bounds_of(limits, robot), size)


def _draw_trajectory(rng: Rng, keys: dict[str, Any], limits: dict[str, Any]) -> tuple[dict[str, Any], float]:
    # A period turns the robot by some hundredths of a radian to several radians.
    samples = int(one_of(rng, (1, 2, *(int(log_uniform(rng, 3, 41)) for _ in range(18)))))
    degree, rest = int(rng.integers(0, 6)), bool(rng.random() < 0.75)
    least = degree + (3 if rest else 1)
    count = int(
        one_of(
            rng, (least, least + 1, least + 4, max(least, samples // 2), least + samples, 3 * samples + 40)
        )
    )
    speed = float(limits["wheel_speed"]) if "wheel_speed" in limits else log_uniform(rng, 0.5, 30.0)
    fastest = 2 * wheel_radius(keys) * speed / scale_of(keys)
    period = log_uniform(rng, 0.02, 4.0) / fastest
    trajectory = {
        "duration": Quantity(period * samples, "s"),
        "samples": samples,
        "spline": {"degree": degree, "coefficients": count},
        "rest_to_rest": rest,
        "integration": "arc" if rng.random() < 0.8 else "midpoint",
        "runs": int(one_of(rng, (1, 1, 1, 1, 2, 3))),
    }
    return trajectory, speed


def _fastest(rng: Rng, robot: Robot, bounds: Array) -> tuple[float, float]:
    # Typical largest speed and yaw rate, of random inputs.
    inputs = rng.uniform(bounds[:, 0], bounds[:, 1], (64, len(bounds)))
    p = [np.array([[value]]) for value in robot.values]
    forward, lateral, yaw = (np.broadcast_to(one, (1, 64)) for one in robot.asked(inputs, p))
    return float(np.hypot(forward, lateral).max()), float(np.abs(yaw).max()) or 1.0


def _furnish(rng: Rng, limits: dict[str, Any], robot: Robot, runs: int, size: float) -> list[Array]:
    # Adds a room and obstacles; returns a start position for each run that they allow.
    radius = robot.body_radius
    if rng.random() < 0.15:
        starts = [size * rng.uniform(-1, 1, 2) for _ in range(runs)]
    else:
        # Large enough for the robot's body, well inside.
        room = draw_room(rng, max(size, 12 * radius))
        places = [inner_point(rng, room, size, reach=0.0 if radius else 1.0) for _ in range(runs)]
        if min(clearance for _, clearance in places) > 1.3 * radius:
            limits["workspace"] = room
        starts = [place for place, _ in places]
    obstacles = []
    for _ in range(int(one_of(rng, (0, 0, 0, 1, 2, 3)))):
        place = starts[0] + size * rng.uniform(-0.5, 0.5, 2)
        obstacle = draw_obstacle(rng, size, place)
        if clear_of(obstacle, np.array(starts), radius):
            obstacles.append(obstacle)
    if obstacles:
        limits["obstacles"] = obstacles
    return starts


def _start(rng: Rng, places: list[Array], *, free: bool) -> Any:
    if free and rng.random() < 0.3:
        return "free"
    poses = [
        {"x": Quantity(x, "m"), "y": Quantity(y, "m"), "heading": Quantity(rng.uniform(-3, 3), "rad")}
        for x, y in places
    ]
    # One pose for all runs, or one for each.
    return poses[0] if len(poses) == 1 or rng.random() < 0.5 else poses


def _asked(rng: Rng, robot: Robot, spec: dict[str, Any], speed: float, size: float) -> dict[str, Any]:
    space = plain(spec["trajectory"])
    measurement = draw_measurement(rng, robot, space["samples"], size)
    estimate = draw_estimate(rng, robot, measurement)
    seen = robot if set(estimate or ()) <= set(robot.names) else through_coefficients(robot)
    blocks = blocks_of(plain(measurement), seen, _still(robot, space), space["integration"])
    blocks = tuple(block for block in blocks if estimate is None or set(estimate) & set(block.names))
    legs = (len(robot.inputs), speed, space["duration"])
    criterion = _of_what_is_estimated(seen, blocks, estimate, draw_criterion(rng, blocks, estimate, legs))
    prior = None if criterion["scaling"] == "none" and blocks[0].raw else draw_prior(rng, blocks, estimate)
    found = {"measurement": measurement, "criterion": criterion}
    found |= {} if estimate is None else {"estimate": estimate}
    return found if prior is None else {**found, "prior": prior}


def _of_what_is_estimated(
    robot: Robot, blocks: Sequence[Block], estimate: Sequence[str] | None, criterion: dict[str, Any]
) -> dict[str, Any]:
    # Predictions that nothing estimated changes are a mistake: then of the position, or no predictions.
    if criterion["kind"] not in "GI":
        return criterion
    names = [name for block in blocks for name in block.names if estimate is None or name in estimate]
    judged = [name for name in names if name in criterion.get("subset", names)]
    named = robot if set(judged) <= set(robot.names) else through_coefficients(robot)
    columns = [named.names.index(name) for name in judged]
    for quantity in (criterion["quantity"], "position"):
        asked = {**criterion, "quantity": quantity}
        if np.any(predicted(named, plain(asked), math.inf)[..., columns]):
            return asked
    return {"kind": "E", **{key: criterion[key] for key in ("subset", "scaling") if key in criterion}}


def _still(robot: Robot, space: dict[str, Any]) -> list[Run]:
    # A drive of the right shape: enough to ask what is measured.
    rest = np.full((space["spline"]["coefficients"], len(robot.inputs)), 0.1)
    degree, samples = space["spline"]["degree"], space["samples"]
    return [clamped_run(space["duration"], degree, rest, np.zeros(3), samples)] * space["runs"]
