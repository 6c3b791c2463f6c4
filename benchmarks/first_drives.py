"""Share of uncalibrated robots that leave the workspace: `python -m benchmarks.first_drives DIR ...`.

Each `DIR` is a folder that `oed run` wrote for a robust study. Only its `record.json` and its drive's CSV
file are read; the kinematics, written without the package, are those of the tests' independent oracle, and
parameters are drawn anew, each uniformly from its range.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.stats import beta

from tests.campaign.oracle.motion import drive
from tests.campaign.oracle.robots import robot_of
from tests.campaign.oracle.shapes import room_clearance, room_size

Array = npt.NDArray[np.float64]

DRAWS, SEED = 2000, 20261128
"""Robots, and the seed of their parameters."""
BEYOND = 1e-3
"""Share of the workspace's size (half its shorter side, or its radius) beyond which a robot is outside."""
ALLOWED = 0.015
"""Upper bound of the share of robots outside that is allowed."""
PIECES = 20
"""Equal parts of a period at whose ends the robot's place is looked at; arcs are exact at each."""
CAR_STEP = 2e-3
"""Longest step [s] of the classical Runge-Kutta method for a car with inertia."""
CAR_SLOW = 0.3
"""Speed [m/s] over which tyre slip is rounded at rest, as the model's documentation states."""


@dataclass(frozen=True)
class Outside:
    """Robots that leave the workspace on one drive."""

    folder: Path
    count: int
    draws: int
    farthest: float

    @property
    def upper(self) -> float:
        """Upper end of the two-sided 95 % interval of Clopper and Pearson."""
        if self.count == self.draws:
            return 1.0
        return float(beta.ppf(0.975, self.count + 1, self.draws - self.count))


def outside(folder: Path, draws: int = DRAWS, seed: int = SEED) -> Outside:
    """Simulate robots drawn from a run's uncertainty on the drive that it recommends.

    Args:
        folder: run's folder, with `record.json`.
        draws: number of robots.
        seed: seed of the parameters' uniform draws.
    """
    record = json.loads((folder / "record.json").read_text())
    study = record["study"]
    names, ranges = zip(
        *((entry["name"], (entry["low"], entry["high"])) for entry in record["robustness"]["uncertain"]),
        strict=True,
    )
    low, high = np.array(ranges).T
    values = np.random.default_rng(seed).uniform(low, high, (draws, len(names)))
    drawn = {name: values[:, [column]] for column, name in enumerate(names)}
    table = np.genfromtxt(folder / f"{record['best']}.csv", delimiter=",", names=True)
    held = np.column_stack([table[entry["name"]][:-1] for entry in record["inputs"]])
    period = float(study["trajectory"]["duration"]) / len(held)
    start = np.array([table[name][0] for name in ("x", "y", "heading")])
    places = _car_path if study["robot"]["kind"] == "bicycle_dynamic" else _path
    x, y = places(study["robot"], held, start, drawn, period)
    room = study["limits"]["workspace"]
    clearance = room_clearance(room, x.ravel(), y.ravel()).reshape(x.shape).min(axis=1)
    excess = (study["robot"].get("body_radius", 0.0) - clearance) / room_size(room)
    return Outside(folder, int((excess > BEYOND).sum()), draws, float(excess.max()) * room_size(room))


def _path(
    spec: Mapping[str, Any], held: Array, start: Array, drawn: Mapping[str, Array], period: float
) -> tuple[Array, Array]:
    # Inputs that are held longer, in shorter periods: arcs between the samples are looked at as well.
    robot = robot_of(spec)
    copies = len(next(iter(drawn.values())))
    parameters = [
        drawn.get(name, np.full((copies, 1), nominal))
        for name, nominal in zip(robot.names, robot.values, strict=True)
    ]
    states = [np.full((copies, 1), value) for value in (*start, *[0.0] * (len(robot.states) - 3))]
    motion = drive(robot, np.repeat(held, PIECES, axis=0), states, parameters, period / PIECES, "arc")
    return motion.states[0], motion.states[1]


def _car_path(
    spec: Mapping[str, Any], held: Array, start: Array, drawn: Mapping[str, Array], period: float
) -> tuple[Array, Array]:
    copies = len(next(iter(drawn.values())))
    car = {
        name: drawn[name][:, 0] if name in drawn else np.full(copies, value)
        for name, value in spec.items()
        if isinstance(value, float)
    }
    steps = -int(-period // CAR_STEP)
    length = period / steps
    state = np.zeros((6, copies))
    state[:3] = start[:, None]
    path = [state[:2]]
    for inputs in held:
        for _ in range(steps):
            first = car_slopes(state, inputs, car)
            second = car_slopes(state + length / 2 * first, inputs, car)
            third = car_slopes(state + length / 2 * second, inputs, car)
            fourth = car_slopes(state + length * third, inputs, car)
            state = state + length / 6 * (first + 2 * second + 2 * third + fourth)
            path.append(state[:2])
    x, y = np.array(path).transpose(1, 2, 0)
    return x, y


def car_slopes(state: Array, inputs: Array, car: Mapping[str, Array]) -> Array:
    """Return the derivatives (6, K) of pose and speeds of cars with linear tyres.

    Args:
        state: x, y, heading, forward speed, lateral speed and yaw rate, (6, K), SI.
        inputs: throttle and steering angle [rad], (2,).
        car: parameters by name, (K,) each, SI.
    """
    _, _, heading, ahead, left, yaw_rate = state
    throttle, angle = inputs
    soft = np.hypot(ahead, CAR_SLOW)
    across = (left + car["front_axle"] * yaw_rate) * np.cos(angle) - ahead * np.sin(angle)
    front = -car["stiffness_front"] * across / soft
    rear = -car["stiffness_rear"] * (left - car["rear_axle"] * yaw_rate) / soft
    driven = car["drive_gain"] * throttle - car["viscous_drag"] * ahead
    moment = car["front_axle"] * front * np.cos(angle) - car["rear_axle"] * rear
    return np.array(
        [
            ahead * np.cos(heading) - left * np.sin(heading),
            ahead * np.sin(heading) + left * np.cos(heading),
            yaw_rate,
            driven - front * np.sin(angle) + yaw_rate * left,
            front * np.cos(angle) + rear - yaw_rate * ahead,
            moment / car["gyration_radius"] ** 2,
        ]
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a row for each folder; return 1 where an upper bound is above what is allowed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.first_drives", description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="DIR")
    results = [outside(folder) for folder in parser.parse_args(arguments).folders]
    for result in results:
        print(
            f"{result.folder.name:20} {result.count:5d} of {result.draws} outside, upper bound "
            f"{100 * result.upper:.2f} %, farthest {1000 * result.farthest:+.1f} mm"
        )
    return int(any(result.upper > ALLOWED for result in results))


if __name__ == "__main__":
    raise SystemExit(main())
