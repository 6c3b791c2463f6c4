"""Example sensors: one or more of every listed kind, each with readings and noise written independently.

A new sensor is tested by being added to `EXAMPLES`; `test_sensors.py` fails until it is. `Experiment` is the
oracle for what such sensors tell together: plain loops, central differences, and NumPy's linear algebra.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import oracle
from sample_robots import Example as Robot
from sample_robots import Motion
from scipy.linalg import block_diag

from oed.robots.sensors import Landmarks, Poses, Ranges, RelativePoses, Sensor, Tags, TrailerAngle, YawRate

SAMPLES, PERIOD = 11, 0.2
UNKNOWN, KNOWN = math.inf, 0.0

Read = Callable[[np.ndarray, np.ndarray, Sequence[float]], Sequence[float]]


@dataclass(frozen=True)
class Example:
    """A sensor, and what it reads written independently of the package.

    Attributes:
        name: shown in test ids.
        sensor: of the package.
        read: its reading of a pose (3,), a twist (3,) and its own nuisances.
        covariance: of one reading's noise, for the robot's speed and yaw rate.
        own: nominal value of each of its own nuisances, and the standard deviation known beforehand.
        start: standard deviations known beforehand of the initial pose; () where it does not matter.
        every: reads every so many moments.
        periods: whether the moments are periods rather than samples.
        between: whether it reads the poses at two successive moments, (2, 3), and their mean motion.
        whole: covariance of all readings, where they are correlated over time.
        states: beyond the pose, that the robot must have.
    """

    name: str
    sensor: Sensor
    read: Read
    covariance: Callable[[float, float], np.ndarray]
    own: tuple[tuple[float, float], ...] = ()
    start: tuple[float, ...] = (UNKNOWN,) * 3
    every: int = 1
    periods: bool = False
    between: bool = False
    whole: np.ndarray | None = None
    states: tuple[str, ...] = ()

    def suits(self, robot: Robot) -> bool:
        """Whether the robot has all the states that the sensor reads."""
        return set(self.states) <= set(robot.model.states)

    def moments(self, samples: int) -> range:
        first = self.every if self.between else 0
        return range(first, samples if self.periods else samples + 1, self.every)


def constant(*deviations: float) -> Callable[[float, float], np.ndarray]:
    """Independent errors with these standard deviations at any speed."""
    return lambda speed, turning: np.diag(np.square(deviations))


def growing(*each: tuple[float, float, float]) -> Callable[[float, float], np.ndarray]:
    """Independent errors of variance sigma^2 + (k_v V)^2 + (k_w Omega)^2."""
    return lambda speed, turning: np.diag(
        [
            sigma**2 + (by_speed * speed) ** 2 + (by_turning * turning) ** 2
            for sigma, by_speed, by_turning in each
        ]
    )


def arm_end(pose: np.ndarray, ahead: float, left: float) -> tuple[float, float]:
    """Where a point of the robot is."""
    x, y, heading = pose[:3]
    return (
        x + ahead * math.cos(heading) + left * math.cos(heading + math.pi / 2),
        y + ahead * math.sin(heading) + left * math.sin(heading + math.pi / 2),
    )


def read_pose(quantities: str, arm: tuple[float, float] = (0.0, 0.0)) -> Read:
    """Some of x, y and heading ("xyh"), in that order; the arm is its own nuisance where it has any."""

    def read(pose, twist, own):
        x, y = arm_end(pose, *(own or arm))
        return [{"x": x, "y": y, "h": pose[2]}[quantity] for quantity in quantities]

    return read


def read_distances(beacons: Sequence[tuple[float, float]], arm: tuple[float, float] = (0.0, 0.0)) -> Read:
    """The distance to every beacon."""

    def read(pose, twist, own):
        place = arm_end(pose, *(own or arm))
        return [math.dist(place, beacon) for beacon in beacons]

    return read


def read_distances_and_bias(pose, twist, own):
    """The distances to beacons that are nuisances, as x, y of each, and a bias after them."""
    *places, bias = own
    return [math.dist(pose[:2], places[at : at + 2]) + bias for at in range(0, len(places), 2)]


def read_late(quantities: str) -> Read:
    """Some of x, y and heading as they were a while ago, its own nuisance."""

    def read(pose, twist, own):
        return read_pose(quantities)(oracle.advance(pose, twist, -own[0], "arc"), twist, ())

    return read


def read_sights(
    quantities: str, places: Sequence[Sequence[float]] = (), mounting: Sequence[float] = (0.0, 0.0, 0.0)
) -> Read:
    """Some of range, bearing and orientation ("rbo") of every place x, y(, heading), in complex numbers; its
    own nuisances are the mounting, if there are three of them, else the places.
    """

    def read(pose, twist, own):
        ahead, left, turn = own if len(own) == 3 else mounting
        size = 3 if "o" in quantities else 2
        points = places or [own[at : at + size] for at in range(0, len(own), size)]
        camera, looks = complex(*arm_end(pose, ahead, left)), pose[2] + turn
        values = []
        for point in points:
            seen = (complex(*point[:2]) - camera) * cmath.exp(-1j * looks)
            every = {"r": abs(seen), "b": cmath.phase(seen), "o": point[-1] - looks}
            values += [every[name] for name in quantities]
        return values

    return read


def read_yaw_rate(pose, twist, own):
    """The yaw rate, and the bias where it is a nuisance."""
    return [twist[2] + sum(own)]


def read_motion(place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Read:
    """How a sensor moved, seen from where it was; its place is its own nuisance where it has any."""

    def read(poses, twist, own):
        ahead, left, turned = own or place
        (before, after), (heading, later) = (
            [complex(*arm_end(pose, ahead, left)) for pose in poses],
            [pose[2] + turned for pose in poses],
        )
        moved = (after - before) * cmath.exp(-1j * heading)
        return [moved.real, moved.imag, later - heading]

    return read


def read_scaled_yaw_rate(pose, twist, own):
    """The yaw rate with a bias and a scale."""
    return [own[1] * twist[2] + own[0]]


def read_trailer_angle(pose, twist, own):
    """The trailer's angle, and the encoder's bias where it is a nuisance."""
    return [pose[3] + sum(own)]


POSE_COVARIANCE = np.array([[4.0, 1.0, -2.0], [1.0, 2.0, 0.5], [-2.0, 0.5, 90.0]]) * 1e-6
CORRELATED = 1e-6 * np.kron(0.6 ** np.abs(np.subtract.outer(range(3), range(3))), [[1.0, 0.3], [0.3, 2.0]])
BEACONS = ((4.0, 3.0), (-3.5, 2.5), (0.5, -4.0))
TAGS = tuple((*place, angle) for place, angle in zip(BEACONS, (2.0, -0.5, 1.0), strict=True))
SIGHT = {"range": 0.02, "bearing": 0.01, "orientation": 0.03, "centre": 0.0}
CAMERA = (0.2, -0.05, 0.4)

EXAMPLES: dict[str, tuple[Example, ...]] = {
    "poses": (
        Example(
            "poses",
            Poses(noise={"position": 1e-3, "heading": 0.01}),
            read_pose("xyh"),
            constant(1e-3, 1e-3, 0.01),
        ),
        Example(
            "poses_of_known_start",
            Poses(noise={"position": 2e-3, "heading": 0.02}, initial_pose="known", every=3),
            read_pose("xyh"),
            constant(2e-3, 2e-3, 0.02),
            start=(KNOWN,) * 3,
            every=3,
        ),
        Example(
            "headings",
            Poses(quantities=("heading",), noise={"heading": 0.01}),
            read_pose("h"),
            constant(0.01),
        ),
        Example(
            "some_quantities",
            Poses(
                quantities=("heading", "x"),
                noise={"x": 3e-3, "heading": 0.02},
                initial_pose={"position": 5e-3, "heading": 0.03},
                lever_arm={"x": 0.12, "y": -0.05},
            ),
            read_pose("hx", (0.12, -0.05)),
            constant(0.02, 3e-3),
            start=(5e-3, 5e-3, 0.03),
        ),
        Example(
            "unknown_arm",
            Poses(
                quantities=("x", "y"),
                noise={"position": 1e-3, "y": 2e-3},
                lever_arm={"x": 0.1, "y": 0.02, "known": False},
            ),
            read_pose("xy"),
            constant(1e-3, 2e-3),
            own=((0.1, UNKNOWN), (0.02, UNKNOWN)),
        ),
        Example(
            "arm_known_roughly",
            Poses(
                noise={"position": 2e-3, "heading": 0.01},
                initial_pose={"position": 2e-3, "heading": 0.01},
                lever_arm={"x": -0.08, "y": 0.03, "known": False, "deviation": 4e-3},
                every=2,
            ),
            read_pose("xyh"),
            constant(2e-3, 2e-3, 0.01),
            own=((-0.08, 4e-3), (0.03, 4e-3)),
            start=(2e-3, 2e-3, 0.01),
            every=2,
        ),
        Example(
            "late_positions",
            Poses(quantities=("x", "y"), noise={"position": 2e-3}, latency=0.05),
            read_late("xy"),
            constant(2e-3, 2e-3),
            own=((0.0, 0.05),),
        ),
        Example(
            "noise_grows_with_speed",
            Poses(
                noise={
                    "x": 1e-3,
                    "y": 2e-3,
                    "heading": 0.005,
                    "position_per_speed": 0.02,
                    "heading_per_speed": 0.1,
                }
            ),
            read_pose("xyh"),
            growing((1e-3, 0.02, 0), (2e-3, 0.02, 0), (0.005, 0.1, 0)),
        ),
        Example(
            "noise_grows_with_yaw_rate",
            Poses(
                noise={
                    "position": 1e-3,
                    "heading": 0.005,
                    "heading_per_speed": 0.1,
                    "position_per_yaw_rate": 0.004,
                    "heading_per_yaw_rate": 0.03,
                }
            ),
            read_pose("xyh"),
            growing((1e-3, 0, 0.004), (1e-3, 0, 0.004), (0.005, 0.1, 0.03)),
        ),
        Example(
            "correlated_quantities",
            Poses(noise={"covariance": POSE_COVARIANCE.tolist()}, every=2),
            read_pose("xyh"),
            lambda speed, turning: POSE_COVARIANCE,
            every=2,
        ),
        Example(
            "correlated_over_time",
            Poses(
                quantities=("x", "y"),
                noise={"covariance": CORRELATED.tolist()},
                lever_arm={"y": 0.07},
                every=5,
                initial_pose="known",
            ),
            read_pose("xy", (0.0, 0.07)),
            constant(1.0, 1.0),
            start=(KNOWN,) * 3,
            every=5,
            whole=CORRELATED,
        ),
    ),
    "relative_poses": (
        Example(
            "relative_poses",
            RelativePoses(
                noise={"position": 2e-3, "heading": 0.01}, mounting={"x": 0.1, "y": -0.04, "heading": 0.3}
            ),
            read_motion(),
            constant(2e-3, 2e-3, 0.01),
            own=((0.1, UNKNOWN), (-0.04, UNKNOWN), (0.3, UNKNOWN)),
            start=(),
            between=True,
        ),
        Example(
            "relative_poses_of_known_mounting",
            RelativePoses(
                noise={"x": 1e-3, "y": 2e-3, "heading": 0.02},
                mounting={"x": 0.06, "y": 0.02, "heading": -1.2, "known": True},
                every=3,
            ),
            read_motion((0.06, 0.02, -1.2)),
            constant(1e-3, 2e-3, 0.02),
            start=(),
            every=3,
            between=True,
        ),
        Example(
            "relative_poses_correlated",
            RelativePoses(
                noise={"covariance": POSE_COVARIANCE.tolist()},
                mounting={"heading": 0.5, "deviation": {"position": 0.02, "heading": 0.1}},
                every=2,
            ),
            read_motion(),
            lambda speed, turning: POSE_COVARIANCE,
            own=((0.0, 0.02), (0.0, 0.02), (0.5, 0.1)),
            start=(),
            every=2,
            between=True,
        ),
        Example(
            "relative_poses_noisier_at_speed",
            RelativePoses(
                noise={
                    "position": 1e-3,
                    "heading": 0.005,
                    "position_per_speed": 0.02,
                    "heading_per_yaw_rate": 0.03,
                },
                mounting={"x": 0.1, "y": 0.05, "known": True},
                every=2,
            ),
            read_motion((0.1, 0.05, 0.0)),
            growing((1e-3, 0.02, 0), (1e-3, 0.02, 0), (0.005, 0, 0.03)),
            start=(),
            every=2,
            between=True,
        ),
    ),
    "ranges": (
        Example(
            "ranges", Ranges(beacons=BEACONS, noise=0.02), read_distances(BEACONS), constant(0.02, 0.02, 0.02)
        ),
        Example(
            "ranges_to_one",
            Ranges(
                beacons=BEACONS[:1], noise=0.05, lever_arm={"x": 0.1, "y": 0.1}, initial_pose="known", every=2
            ),
            read_distances(BEACONS[:1], (0.1, 0.1)),
            constant(0.05),
            start=(KNOWN,) * 3,
            every=2,
        ),
        Example(
            "ranges_with_arm",
            Ranges(
                beacons=BEACONS[1:],
                noise=0.01,
                lever_arm={"x": 0.05, "known": False, "deviation": 0.02},
                initial_pose={"position": 0.01, "heading": 0.1},
            ),
            read_distances(BEACONS[1:]),
            constant(0.01, 0.01),
            own=((0.05, 0.02), (0.0, 0.02)),
            start=(0.01, 0.01, 0.1),
        ),
        Example(
            "ranges_to_unknown_beacons",
            Ranges(beacons=BEACONS, noise=0.01, map=0.05, bias="unknown"),
            read_distances_and_bias,
            constant(0.01, 0.01, 0.01),
            own=(*((value, 0.05) for place in BEACONS for value in place), (0.0, UNKNOWN)),
        ),
    ),
    "landmarks": (
        Example(
            "landmarks",
            Landmarks(landmarks=BEACONS, noise=SIGHT),
            read_sights("rb", BEACONS),
            constant(*(0.02, 0.01) * 3),
        ),
        Example(
            "bearings_from_a_camera",
            Landmarks(
                landmarks=BEACONS,
                quantities=("bearing",),
                noise=SIGHT,
                lever_arm=dict(zip(("x", "y", "heading"), CAMERA, strict=True)),
                every=2,
            ),
            read_sights("b", BEACONS, CAMERA),
            constant(*(0.01,) * 3),
            every=2,
        ),
        Example(
            "landmarks_of_unknown_place",
            Landmarks(landmarks=BEACONS, noise=SIGHT, map="unknown"),
            read_sights("rb"),
            constant(*(0.02, 0.01) * 3),
            own=tuple((value, UNKNOWN) for place in BEACONS for value in place),
            # The frame is that of the start.
            start=(KNOWN,) * 3,
        ),
    ),
    "tags": (
        Example(
            "tags",
            Tags(tags=TAGS, noise=SIGHT),
            read_sights("rbo", TAGS),
            constant(*(0.02, 0.01, 0.03) * 3),
        ),
        Example(
            "tags_of_unknown_pose",
            Tags(tags=TAGS[:2], noise=SIGHT, map={"position": 0.1, "heading": 0.2}, initial_pose="known"),
            read_sights("rbo"),
            constant(*(0.02, 0.01, 0.03) * 2),
            own=tuple(pair for place in TAGS[:2] for pair in zip(place, (0.1, 0.1, 0.2), strict=True)),
            start=(KNOWN,) * 3,
        ),
        Example(
            "tags_from_a_camera_somewhere",
            Tags(
                tags=TAGS,
                noise=SIGHT,
                lever_arm={"x": 0.2, "y": -0.05, "heading": 0.4, "known": False, "heading_deviation": 0.1},
            ),
            read_sights("rbo", TAGS),
            constant(*(0.02, 0.01, 0.03) * 3),
            own=((0.2, UNKNOWN), (-0.05, UNKNOWN), (0.4, 0.1)),
        ),
    ),
    "yaw_rate": (
        Example(
            "yaw_rate",
            YawRate(noise=0.01),
            read_yaw_rate,
            constant(0.01),
            own=((0.0, UNKNOWN),),
            start=(),
            periods=True,
        ),
        Example(
            "yaw_rate_known_bias",
            YawRate(noise=0.02, bias="known", every=3),
            read_yaw_rate,
            constant(0.02),
            start=(),
            every=3,
            periods=True,
        ),
        Example(
            "yaw_rate_of_unknown_scale",
            YawRate(noise=0.01, bias=0.004, scale="unknown"),
            read_scaled_yaw_rate,
            constant(0.01),
            own=((0.0, 0.004), (1.0, UNKNOWN)),
            start=(),
            periods=True,
        ),
        Example(
            "yaw_rate_bias_known_roughly",
            YawRate(noise=0.01, bias=0.004, every=2),
            read_yaw_rate,
            constant(0.01),
            own=((0.0, 0.004),),
            start=(),
            every=2,
            periods=True,
        ),
    ),
    "trailer_angle": (
        Example(
            "trailer_angle",
            TrailerAngle(noise=0.01),
            read_trailer_angle,
            constant(0.01),
            states=("trailer_angle",),
        ),
        Example(
            "trailer_angle_with_bias",
            TrailerAngle(noise=0.02, bias="unknown", initial_pose="known", every=2),
            read_trailer_angle,
            constant(0.02),
            own=((0.0, UNKNOWN),),
            start=(KNOWN,) * 3,
            every=2,
            states=("trailer_angle",),
        ),
        Example(
            "trailer_angle_known_roughly",
            TrailerAngle(noise=0.01, bias=0.005, initial_pose={"position": 0.01, "heading": 0.1}),
            read_trailer_angle,
            constant(0.01),
            own=((0.0, 0.005),),
            start=(0.01, 0.01, 0.1),
            states=("trailer_angle",),
        ),
    ),
}

SENSOR_EXAMPLES = [example for examples in EXAMPLES.values() for example in examples]


def named(name: str) -> Example:
    """The example of that name."""
    return next(example for example in SENSOR_EXAMPLES if example.name == name)


FOLLOWED: dict[tuple[Any, ...], tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
"""What was driven, by all that it follows from."""


@dataclass(frozen=True)
class Experiment:
    """What sensors tell of one drive together, by loops and central differences.

    Attributes:
        motion: twist (3,) of inputs and parameters.
        parameters: nominal values, (p,).
        sensors: used together.
        inputs: (N, inputs).
        start: initial state.
        internal: of a robot with further states, their values after one step.
        mean: of a robot that follows its inputs with a lag, what their twist comes to in one step.
        pushed: of a robot with inertia, mean twist and what follows, of state, inputs, period, parameters.
        rule: "arc" or "midpoint".
        period: [s].
    """

    motion: Motion
    parameters: np.ndarray
    sensors: tuple[Example, ...]
    inputs: np.ndarray
    start: Sequence[float]
    rule: str
    period: float = PERIOD
    internal: Callable[..., np.ndarray] | None = None
    mean: Callable[..., np.ndarray] | None = None
    pushed: Callable[..., tuple[np.ndarray, np.ndarray]] | None = None

    def readings(self, values: np.ndarray) -> np.ndarray:
        """All readings (rows,) for parameters, initial pose and the sensors' nuisances, stacked."""
        begin = len(self.parameters) + len(self.start)
        states, held, instants = self.driven(values[:begin])
        rows = []
        for sensor in self.sensors:
            own = values[begin : (begin := begin + len(sensor.own))].tolist()
            twists = held if sensor.periods else instants
            for index in sensor.moments(len(held)):
                state = states[[index - sensor.every, index]] if sensor.between else states[index]
                rows.append(sensor.read(state, twists[index], own))
        return np.concatenate(rows)

    def driven(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States (N + 1, states), mean twists of the periods (N, 3) and twists at the samples (N + 1, 3).

        Each drive is followed once, whatever sensors look at it.
        """
        ways = (self.motion, self.internal, self.mean, self.pushed, self.rule, self.period)
        key = (*ways, len(self.parameters), self.inputs.shape, self.inputs.tobytes(), values.tobytes())
        if key not in FOLLOWED:
            FOLLOWED[key] = self._followed(*np.split(values, [len(self.parameters)]))
            for one in FOLLOWED[key]:
                one.setflags(write=False)
        return FOLLOWED[key]

    def _followed(
        self, parameters: np.ndarray, start: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if self.pushed is not None:
            return self._pushed(parameters, start)
        asked = [self.motion(row, parameters) for row in self.inputs]
        states, held = [np.array(start, dtype=float)], []
        for twist in asked:
            state = states[-1]
            held.append(self._mean(state, twist, self.period, parameters))
            pose = oracle.advance(state, held[-1], self.period, self.rule)
            further = ()
            if self.internal is not None:
                further = self.internal(state, twist, self.period, parameters, steps=40)
            states.append(np.concatenate([pose, further]))
        # At the last sample's instant the inputs are those held until then.
        pairs = zip(states, [*asked, asked[-1]], strict=True)
        instants = [self._mean(state, twist, 0.0, parameters) for state, twist in pairs]
        return np.array(states), np.array(held), np.array(instants)

    def _pushed(self, parameters: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        assert self.pushed is not None
        states, held = [np.array(start, dtype=float)], []
        for row in self.inputs:
            twist, further = self.pushed(states[-1], row, self.period, parameters)
            held.append(twist)
            pose = oracle.advance(states[-1], twist, self.period, self.rule)
            states.append(np.concatenate([pose, further]))
        rows = [*self.inputs, self.inputs[-1]]
        instants = [
            self.pushed(state, row, 0.0, parameters)[0] for state, row in zip(states, rows, strict=True)
        ]
        return np.array(states), np.array(held), np.array(instants)

    def _mean(
        self, state: np.ndarray, twist: np.ndarray, period: float, parameters: np.ndarray
    ) -> np.ndarray:
        return twist if self.mean is None else self.mean(state, twist, period, parameters, steps=40)

    @cached_property
    def nominal(self) -> np.ndarray:
        own = [value for sensor in self.sensors for value, _ in sensor.own]
        return np.array([*self.parameters, *self.start, *own])

    @cached_property
    def noise(self) -> np.ndarray:
        """Covariance of all readings."""
        states, held, instants = self.driven(np.array([*self.parameters, *self.start]))
        blocks = []
        for sensor in self.sensors:
            if sensor.whole is not None:
                blocks.append(sensor.whole)
                continue
            for index in sensor.moments(len(held)):
                twist = (held if sensor.periods else instants)[index]
                if sensor.between:
                    own = [value for value, _ in sensor.own]
                    moved = sensor.read(states[[index - sensor.every, index]], twist, own)
                    twist = np.array(moved) / (sensor.every * self.period)
                blocks.append(sensor.covariance(math.hypot(twist[0], twist[1]), twist[2]))
        return block_diag(*blocks)

    @cached_property
    def known(self) -> np.ndarray:
        """Standard deviations known beforehand of all values, none of the parameters."""
        starts = [sensor.start for sensor in self.sensors if sensor.start]
        start = starts[0] if starts else (KNOWN,) * 3
        # Of a trailer's angle as much is known as of the heading.
        start = (*start, *start[2:] * (len(self.start) - 3))
        own = [deviation for sensor in self.sensors for _, deviation in sensor.own]
        return np.array([*[UNKNOWN] * len(self.parameters), *start, *own])

    @cached_property
    def white_readings(self) -> np.ndarray:
        """Readings in units of their noise."""
        return np.linalg.solve(np.linalg.cholesky(self.noise), self.readings(self.nominal))

    @cached_property
    def white_jacobian(self) -> np.ndarray:
        """Derivatives of the readings by all values that are not known, in units of the noise."""
        jacobian = oracle.central_difference(self.readings, self.nominal)[:, self.known > 0]
        return np.linalg.solve(np.linalg.cholesky(self.noise), jacobian)

    @cached_property
    def full(self) -> np.ndarray:
        """Information on all values that are not known, with what is known beforehand."""
        jacobian, known = self.white_jacobian, self.known[self.known > 0]
        return jacobian.T @ jacobian + np.diag(known**-2)

    @property
    def information(self) -> np.ndarray:
        """Information (p, p) on the parameters, nuisances eliminated, SI."""
        return oracle.schur(self.full, len(self.parameters))
