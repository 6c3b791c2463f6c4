"""Every listed sensor against loops and finite differences, and the laws of what several tell together."""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from functools import cache, partial
from typing import Any

import numpy as np
import oracle
import pytest
from builders import TRACK, input_limits, problem_of
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_robots import (
    COEFFICIENT_ROBOTS,
    CORE,
    PLANAR,
    ROBOTS,
    TWO_SIDED,
    draw_inputs,
    motion_by_coefficients,
    motion_by_parameters,
)
from sample_robots import Example as Robot
from sensors import (
    EXAMPLES,
    KNOWN,
    PERIOD,
    SAMPLES,
    SENSOR_EXAMPLES,
    UNKNOWN,
    Example,
    Experiment,
    named,
)

from oed.foundation.errors import PartError, ProblemError, UserMistake
from oed.kernel.criteria import E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.kernel.scorer import score
from oed.robots.models import DifferentialDrive
from oed.robots.sensors import (
    SENSORS,
    AbsoluteNoise,
    Landmarks,
    LeverArm,
    Poses,
    Ranges,
    Sensor,
    Several,
    Tags,
    YawRate,
)

START = (0.2, -0.1, 0.4)
C = ("c11", "c12", "c21", "c22")
SIGMA = 2e-3

coefficient_robots = pytest.mark.parametrize(
    "robot", [one for one in COEFFICIENT_ROBOTS if one in PLANAR], ids=lambda robot: robot.name
)
two_sided = pytest.mark.parametrize("robot", TWO_SIDED, ids=lambda robot: robot.name)
PLAIN_SIDES = [
    one for one in TWO_SIDED if "sensor_offset" not in {entry.name for entry in one.model.parameters}
]
PLAIN = [example for example in SENSOR_EXAMPLES if not example.states]
# Every sensor on one robot; one of each kind and an arm on one of every sort; on one of every other kind one
# that reads the state and one that reads the twist, which is all that sensors see of a robot.
TYPICAL = [
    *(listed[0] for listed in EXAMPLES.values()),
    named("unknown_arm"),
    named("trailer_angle_with_bias"),
    named("trailer_angle_known_roughly"),
]
BY_STATE_AND_TWIST = [named("poses"), named("yaw_rate")]
# By class: one in somebody's Python has the kind of a shipped one.
KINDS = list({type(robot.model): robot for robot in ROBOTS}.values())


def sensors_on(robot: Robot) -> Sequence[Example]:
    if robot is ROBOTS[0]:
        return SENSOR_EXAMPLES
    if robot.name in CORE:
        return TYPICAL
    # Also those with a parameter that is nominally 0.
    return BY_STATE_AND_TWIST if robot in KINDS or 0 in robot.model.nominal else ()


PAIRS = [(robot, example) for robot in ROBOTS for example in sensors_on(robot) if example.suits(robot)]

# What is done with the information knows neither: sensors on one robot, poses on one of every sort, and on
# those with a parameter that is nominally 0.
INFORMED = [
    (robot, example)
    for robot, example in PAIRS
    if example in (TYPICAL if robot is ROBOTS[0] else TYPICAL[:1])
    and (robot.name in CORE or 0 in robot.model.nominal)
]
typical_pairs = pytest.mark.parametrize(
    ("robot", "example"), INFORMED, ids=[f"{example.name}-{robot.name}" for robot, example in INFORMED]
)
VARIANTS = {
    "ranges_to_unknown_beacons",
    "bearings_from_a_camera",
    "tags_of_unknown_pose",
    "tags_from_a_camera_somewhere",
    "late_positions",
    "yaw_rate_of_unknown_scale",
}
"""Examples whose code is that of others but for a line: quick on one robot."""


def slow_beyond_core(robot: Robot, example: Example) -> Any:
    quick = robot is ROBOTS[0] if example.name in VARIANTS else robot.name in CORE
    return () if quick else pytest.mark.slow


# Both rules on one robot: the integration knows nothing of the robot, nor of what reads it.
CASES = [(*pair, "arc") for pair in PAIRS] + [
    (*pair, "midpoint") for pair in PAIRS if pair[0] is ROBOTS[0] and pair[1] in TYPICAL
]
pairs_and_rules = pytest.mark.parametrize(
    ("robot", "example", "rule"),
    [
        pytest.param(
            *case, id="-".join((case[1].name, case[0].name, case[2])), marks=slow_beyond_core(*case[:2])
        )
        for case in CASES
    ],
)
seeds = st.integers(0, 2**32 - 1)


sensor_problem = cache(
    partial(
        problem_of,
        model=ROBOTS[0].model,
        period=PERIOD,
        samples=SAMPLES,
        rest_to_rest=False,
        start="free",
        criterion=E(scaling="none"),
        limits=input_limits,
    )
)
"""A problem with few limits, in SI units unless told otherwise."""


def driven(problem: Problem, inputs: np.ndarray, start: Sequence[float] = START) -> Evaluation:
    return score(problem, Trajectory.from_samples(inputs, PERIOD * len(inputs), start, rest_to_rest=False))


def told(measurement, inputs: np.ndarray, start: Sequence[float] = START, **parts) -> np.ndarray:
    """The joint information of a drive."""
    problem = sensor_problem(measurement=measurement, samples=len(inputs), **parts)
    return driven(problem, inputs, start).information["joint"]


def some_inputs(seed: int = 3, count: int = SAMPLES, model=None) -> np.ndarray:
    return draw_inputs(np.random.default_rng(seed), count, model)


def experiment(
    robot: Robot, sensors: Sequence[Example], rule: str = "arc", *, coefficients: bool = False
) -> Experiment:
    model = robot.model
    matrix = np.array(model.coefficients(model.nominal)).ravel() if coefficients else None
    return Experiment(
        motion=motion_by_coefficients(robot) if coefficients else motion_by_parameters(robot),
        parameters=np.array(model.nominal) if matrix is None else matrix,
        sensors=tuple(sensors),
        inputs=some_inputs(model=model),
        start=start_of(robot),
        rule=rule,
        internal=robot.internal,
        mean=robot.mean,
        pushed=robot.motion,
    )


def start_of(robot: Robot) -> tuple[float, ...]:
    return (*START, *np.linspace(0.2, 0.3, len(robot.model.states) - 3))


def assert_close(found: np.ndarray, expected: np.ndarray, sizes: np.ndarray, tolerance: float = 1e-6):
    """Equal to a share of the information there is before anything is eliminated."""
    scale = np.outer(sizes, sizes)
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=tolerance)


def assert_at_least(more: np.ndarray, less: np.ndarray):
    """In the order of Loewner: more - less has no negative eigenvalue but by rounding."""
    sizes = np.sqrt(np.diag(more))
    sizes = np.where(sizes > 0, sizes, 1.0)
    assert np.linalg.eigvalsh((more - less) / np.outer(sizes, sizes))[0] >= -1e-9


TOGETHER = (
    ("headings", "unknown_arm", "ranges"),
    ("poses", "yaw_rate"),
    ("unknown_arm", "yaw_rate", "unknown_arm", "yaw_rate_bias_known_roughly"),
    ("poses_of_known_start", "correlated_over_time", "ranges_to_one", "yaw_rate_known_bias"),
    ("yaw_rate_known_bias", "yaw_rate"),
)
"""Sensors used together, all of them by one robot, the first by one of every sort."""


class TestOracle:
    """Every listed sensor on every robot, against central differences of plain loops."""

    def test_every_listed_sensor_has_an_example(self):
        assert {sensor.model_fields["kind"].default for sensor in SENSORS} == set(EXAMPLES)
        for kind, listed in EXAMPLES.items():
            assert {example.sensor.kind for example in listed} == {kind}
        assert len({example.name for example in SENSOR_EXAMPLES}) == len(SENSOR_EXAMPLES)

    @coefficient_robots
    def test_motions_are_the_robots_own(self, robot: Robot):
        for inputs in draw_inputs(np.random.default_rng(1), 10, robot.model):
            by_parameters = motion_by_parameters(robot)(inputs, np.array(robot.model.nominal))
            by_coefficients = motion_by_coefficients(robot)(
                inputs, np.array(robot.model.coefficients(robot.model.nominal))
            )
            # Wheels of unequal size may all but cancel: what is left is rounded as its parts are.
            expected, rounding = robot.twist(inputs), 1e-16
            np.testing.assert_allclose(by_parameters, expected, rtol=1e-14, atol=rounding)
            np.testing.assert_allclose(by_coefficients, expected, rtol=1e-14, atol=rounding)

    @pairs_and_rules
    @pytest.mark.slow
    def test_readings_and_information(self, example: Example, robot: Robot, rule: str):
        expected = experiment(robot, [example], rule)
        found = driven(
            sensor_problem(measurement=example.sensor, model=robot.model, integration=rule),
            expected.inputs,
            expected.start,
        )
        size = len(expected.parameters)
        assert found.parameters["joint"] == tuple(entry.name for entry in robot.model.parameters)
        assert found.norm_y == pytest.approx(np.linalg.norm(expected.white_readings), rel=1e-6)
        white = expected.white_jacobian[:, :size]
        sizes = np.linalg.norm(white, axis=0)
        # The yaw rate says nothing of where on the robot the pose is taken.
        sizes = np.where(sizes > 0, sizes, 1.0)
        np.testing.assert_allclose(found.design_matrices["joint"] / sizes, white / sizes, atol=1e-6)
        assert_close(found.information["joint"], expected.information, sizes)

    @pytest.mark.slow
    @typical_pairs
    def test_relative_information_of_some_parameters(self, example: Example, robot: Robot):
        # A slip that is nominally 0 has no relative precision: it is taken as known.
        expected, names = experiment(robot, [example]), [entry.name for entry in robot.model.parameters]
        chosen = [index for index, value in enumerate(robot.model.nominal) if value != 0]
        parts = {"criterion": E(scaling="relative"), "estimate": tuple(names[index] for index in chosen)}
        found = driven(
            sensor_problem(measurement=example.sensor, model=robot.model, **parts),
            expected.inputs,
            expected.start,
        )
        kept = [*chosen, *range(len(names), len(expected.full))]
        matrix, scales = expected.full[np.ix_(kept, kept)], np.abs(expected.parameters[chosen])
        scaled = oracle.schur(matrix, len(chosen)) * np.outer(scales, scales)
        sizes = np.sqrt(np.diag(matrix)[: len(chosen)]) * scales
        assert_close(found.information["joint"], scaled, np.where(sizes > 0, sizes, 1.0))
        assert found.parameters["joint"] == tuple(names[index] for index in chosen)

    # Every sensor on one robot, by both rules; poses on all of them.
    @pytest.mark.parametrize(
        ("example", "robot", "rule"),
        [
            pytest.param(example, one, rule, id=f"{example.name}-{one.name}-{rule}")
            for example in (listed[0] for listed in EXAMPLES.values())
            if example in PLAIN
            for one in COEFFICIENT_ROBOTS
            for rule in ("arc", "midpoint")
            if one in PLANAR and (one is ROBOTS[0] or (rule == "arc" and example in TYPICAL[:1]))
        ],
    )
    @pytest.mark.slow
    def test_coefficients_of_every_robot(self, example: Example, robot: Robot, rule: str):
        expected = experiment(robot, [example], rule, coefficients=True)
        names = tuple(name for row in robot.model.coefficient_names for name in row)
        found = driven(
            sensor_problem(measurement=example.sensor, model=robot.model, integration=rule, estimate=names),
            expected.inputs,
        )
        sizes = np.linalg.norm(expected.white_jacobian[:, : len(names)], axis=0)
        sizes = np.where(sizes > 0, sizes, 1.0)
        assert_close(found.information["joint"], expected.information, sizes)

    @pytest.mark.parametrize(
        ("robot", "names"),
        [
            pytest.param(robot, names, id=f"{'+'.join(names)}-{robot.name}")
            for robot in ROBOTS
            if robot.name in CORE
            for names in (TOGETHER if robot is ROBOTS[0] else TOGETHER[:1])
        ],
    )
    @pytest.mark.slow
    def test_several_sensors_share_the_initial_pose_alone(self, robot: Robot, names: Sequence[str]):
        sensors = [named(name) for name in names]
        expected = experiment(robot, sensors)
        several = Several(sensors=[sensor.sensor for sensor in sensors])
        found = driven(
            sensor_problem(measurement=several, model=robot.model), expected.inputs, expected.start
        )
        white = expected.white_jacobian[:, : len(expected.parameters)]
        sizes = np.linalg.norm(white, axis=0)
        # The yaw rate says nothing of where on the robot the pose is taken.
        sizes = np.where(sizes > 0, sizes, 1.0)
        np.testing.assert_allclose(found.design_matrices["joint"] / sizes, white / sizes, atol=1e-6)
        assert_close(found.information["joint"], expected.information, sizes)


class TestMidpointFormulas:
    """The derivatives of a pose by the coefficients, written out for the midpoint rule."""

    @staticmethod
    def pose_derivatives(speeds: np.ndarray, c: np.ndarray, start: Sequence[float]) -> np.ndarray:
        """By c11, c12, c21, c22, x0, y0, th0 at every sample, ((N + 1) * 3, 7)."""
        pose, turned = np.array(start, dtype=float), np.zeros(2)
        by_c1, by_c2 = np.zeros((2, 2)), np.zeros((2, 2))
        rows = []
        for speed in [*speeds, np.zeros(2)]:
            x, y, heading = pose
            position = np.hstack([by_c1, by_c2, np.eye(2), [[start[1] - y], [x - start[0]]]])
            rows += [position, [[*turned, 0, 0, 0, 0, 1]]]
            forward, yaw_rate = c[2:] @ speed, c[:2] @ speed
            middle = heading + PERIOD * yaw_rate / 2
            along = np.array([np.cos(middle), np.sin(middle)])
            across = np.array([-along[1], along[0]])
            by_c1 = by_c1 + PERIOD * forward * np.outer(across, turned + PERIOD * speed / 2)
            by_c2 = by_c2 + PERIOD * np.outer(along, speed)
            turned = turned + PERIOD * speed
            pose = pose + np.array([*(PERIOD * forward * along), PERIOD * yaw_rate])
        return np.vstack(rows)

    @two_sided
    @pytest.mark.parametrize("initial_pose", ["unknown", "known"])
    def test_joint_information_of_the_coefficients(self, robot: Robot, initial_pose: str):
        position, heading = 1e-3, 0.01
        sensor = Poses(noise={"position": position, "heading": heading}, initial_pose=initial_pose)
        inputs = some_inputs(model=robot.model)
        found = driven(
            sensor_problem(measurement=sensor, model=robot.model, integration="midpoint", estimate=C), inputs
        )
        c = np.array(robot.model.coefficients(robot.model.nominal)).ravel()
        effective = np.array([robot.effective(row) for row in inputs])
        rows = self.pose_derivatives(effective, c, START)
        white = rows / np.tile([position, position, heading], SAMPLES + 1)[:, None]
        np.testing.assert_allclose(found.design_matrices["joint"], white[:, :4], rtol=1e-10, atol=1e-8)
        matrix = white.T @ white
        expected = oracle.schur(matrix, 4) if initial_pose == "unknown" else matrix[:4, :4]
        assert_close(found.information["joint"], expected, np.sqrt(np.diag(matrix)[:4]), 1e-11)


FREE = (UNKNOWN,) * 3
COMPATIBLE = [example for example in PLAIN if example.start in ((), FREE)]
OF_KNOWN_START = [
    example
    for example in PLAIN
    if example.start in ((), (KNOWN,) * 3) and getattr(example.sensor, "initial_pose", "known") == "known"
]


class TestSeveral:
    """Laws of sensors used together."""

    # One of each kind, and those of other blocks of the noise or the start.
    @pytest.mark.parametrize(
        "example",
        [one for one in PLAIN if one in TYPICAL or one.whole is not None or one.start not in ((), FREE)],
        ids=lambda one: one.name,
    )
    def test_a_list_of_one_is_the_sensor(self, example: Example):
        inputs = some_inputs()
        alone, listed = told(example.sensor, inputs), told(Several(sensors=[example.sensor]), inputs)
        np.testing.assert_allclose(listed, alone, rtol=1e-12, atol=1e-12 * np.trace(alone))

    def test_without_nuisances_information_adds_up(self):
        sensors = [example.sensor for example in OF_KNOWN_START if not example.own]
        assert len(sensors) > 2
        inputs = some_inputs()
        total = sum(told(sensor, inputs) for sensor in sensors)
        found = told(Several(sensors=sensors), inputs)
        np.testing.assert_allclose(found, total, rtol=1e-10, atol=1e-12 * np.trace(total))

    def test_two_alike_tell_twice_as_much(self):
        # With its own nuisances each, and one initial pose: nothing but the arm is unknown twice.
        sensor = Poses(noise={"position": SIGMA, "heading": 0.01}, lever_arm={"x": 0.1})
        inputs = some_inputs()
        other = Poses(noise={"position": (1 + 1e-12) * SIGMA, "heading": 0.01}, lever_arm={"x": 0.1})
        once, twice = told(sensor, inputs), told(Several(sensors=[sensor, other]), inputs)
        np.testing.assert_allclose(twice, 2 * once, rtol=1e-9, atol=1e-10 * np.trace(once))

    @pytest.mark.slow
    @settings(max_examples=6)
    @given(
        chosen=st.lists(st.sampled_from(COMPATIBLE), min_size=2, max_size=3, unique_by=id),
        order=st.randoms(use_true_random=False),
    )
    def test_their_order_does_not_matter(self, chosen: list[Example], order):
        sensors, inputs = [example.sensor for example in chosen], some_inputs()
        shuffled = order.sample(sensors, len(sensors))
        first, second = (told(Several(sensors=one), inputs) for one in (sensors, shuffled))
        np.testing.assert_allclose(first, second, rtol=0, atol=1e-9 * np.trace(first))

    @settings(max_examples=8)
    @given(
        pool=st.sampled_from([COMPATIBLE, OF_KNOWN_START]),
        places=st.lists(st.integers(0, 20), min_size=2, max_size=3),
        seed=seeds,
    )
    @pytest.mark.slow
    def test_one_more_never_tells_less(self, pool: list[Example], places: list[int], seed: int):
        sensors, inputs = [pool[place % len(pool)].sensor for place in places], some_inputs(seed)
        fewer, more = Several(sensors=sensors[:-1]), Several(sensors=sensors)
        assert_at_least(told(more, inputs), told(fewer, inputs))

    def test_nuisances_are_told_apart_by_their_sensor(self):
        arm = named("unknown_arm").sensor
        several = Several(sensors=[arm, YawRate(noise=0.01), arm, YawRate(noise=0.1, bias=0.01)])
        (estimation,) = sensor_problem(measurement=several).any_estimations
        names = [nuisance.name for nuisance in estimation.block.nuisances]
        assert names[:3] == ["initial_pose.x", "initial_pose.y", "initial_pose.heading"]
        assert names[3:] == [
            "poses.lever_arm.x",
            "poses.lever_arm.y",
            "yaw_rate.bias",
            "poses_2.lever_arm.x",
            "poses_2.lever_arm.y",
            "yaw_rate_2.bias",
        ]
        assert [nuisance.deviation for nuisance in estimation.block.nuisances] == [None] * 8 + [0.01]

    @pytest.mark.parametrize("other", ["known", {"position": 1e-3, "heading": 0.1}])
    def test_there_is_one_initial_pose(self, other):
        poses, noise = Poses(noise={"position": 1e-3, "heading": 0.1}), YawRate(noise=0.1)
        ranges = Ranges(beacons=[(1, 2)], noise=0.1, initial_pose=other)
        with pytest.raises(ProblemError) as caught:
            sensor_problem(measurement=Several(sensors=[noise, poses, ranges]))
        (issue,) = caught.value.issues
        assert issue.key == ("measurement", 2, "initial_pose")
        assert "differs from that of the sensors before" in issue.message

    def test_issues_of_every_sensor_are_listed(self):
        good = Poses(noise={"position": 1e-3, "heading": 0.1})
        several = Several(sensors=[Poses(), good, Poses(quantities=("x", "x"), noise={"x": 1})])
        with pytest.raises(ProblemError) as caught:
            sensor_problem(measurement=several)
        assert [(issue.key, issue.message) for issue in caught.value.issues] == [
            (
                ("measurement", 0, "noise"),
                "the noise of position and heading is needed to weight the readings: "
                "noise: {position: 1 cm, heading: 1 deg}",
            ),
            (("measurement", 2, "quantities"), "a quantity is listed twice"),
        ]


def moved(start: Sequence[float], x: float, y: float, turn: float) -> tuple[float, float, float]:
    return start[0] + x, start[1] + y, start[2] + turn


class TestInitialPose:
    """What is known of where the drive began."""

    WAYS = (
        Poses(noise={"position": SIGMA, "heading": 0.01}),
        Poses(noise={"position": SIGMA, "heading": 0.01}, initial_pose="known", lever_arm={"x": 0.1}),
        Poses(
            quantities=("x", "y"),
            noise={"position": SIGMA, "position_per_speed": 0.1},
            lever_arm={"x": 0.1, "known": False},
        ),
        Poses(
            noise={"position": SIGMA, "heading": 0.01},
            initial_pose={"position": 0.01, "heading": 0.1},
            lever_arm={"known": False, "deviation": 0.01},
        ),
        YawRate(noise=0.01),
    )

    @settings(max_examples=12)
    @given(
        sensor=st.sampled_from(WAYS),
        x=st.floats(-20, 20),
        y=st.floats(-20, 20),
        turn=st.floats(-7, 7),
    )
    @pytest.mark.slow
    def test_where_the_drive_begins_is_of_no_matter(self, sensor, x: float, y: float, turn: float):
        inputs = some_inputs()
        here, there = (told(sensor, inputs, start) for start in (START, moved(START, x, y, turn)))
        assert_close(there, here, np.sqrt(np.diag(here)), 1e-8)

    @pytest.mark.slow
    @settings(max_examples=6)
    @given(x=st.floats(-20, 20), y=st.floats(-20, 20), turn=st.floats(-7, 7))
    def test_nor_does_it_matter_to_ranges_when_the_beacons_come_along(self, x: float, y: float, turn: float):
        def carried(place: tuple[float, float]) -> tuple[float, float]:
            # Turned about where the drive begins, then shifted.
            offset = complex(place[0] - START[0], place[1] - START[1]) * cmath.exp(1j * turn)
            return START[0] + offset.real + x, START[1] + offset.imag + y

        sensor = Ranges(beacons=[(4, 3), (-3, 2), (1, -4)], noise=0.01)
        beside = Ranges(beacons=[carried(place) for place in sensor.beacons], noise=0.01)
        here = told(sensor, some_inputs())
        there = told(beside, some_inputs(), moved(START, x, y, turn))
        np.testing.assert_allclose(there, here, rtol=0, atol=1e-8 * np.trace(here))

    @settings(max_examples=8)
    @given(position=st.floats(1e-5, 1.0), heading=st.floats(1e-4, 1.0), seed=seeds)
    @pytest.mark.slow
    def test_the_more_is_known_the_more_is_told(self, position: float, heading: float, seed: int):
        inputs = some_inputs(seed)
        noise, prior = {"position": SIGMA, "heading": 0.01}, {"position": position, "heading": heading}
        known, roughly, unknown = (
            told(Poses(noise=noise, initial_pose=way), inputs) for way in ("known", prior, "unknown")
        )
        assert_at_least(known, roughly)
        assert_at_least(roughly, unknown)

    @pytest.mark.parametrize(
        ("deviation", "limit"), [(1e-9, "known"), (1e6, "unknown")], ids=["tight", "loose"]
    )
    @pytest.mark.parametrize("kind", [Poses, Ranges])
    def test_limits_of_what_is_known_beforehand(self, kind, deviation: float, limit: str):
        parts = {"noise": {"position": SIGMA, "heading": 0.01}} if kind is Poses else {"noise": SIGMA}
        parts |= {} if kind is Poses else {"beacons": [(4, 3), (-3, 2), (1, -4)]}
        prior = {"position": deviation, "heading": deviation}
        found, expected = (told(kind(**parts, initial_pose=way), some_inputs()) for way in (prior, limit))
        np.testing.assert_allclose(found, expected, rtol=1e-5)


class TestNuisances:
    """Lever arms and biases, known or not."""

    @pytest.mark.parametrize(("deviation", "known"), [(1e-9, True), (1e6, False)], ids=["tight", "loose"])
    def test_limits_of_a_lever_arm_known_roughly(self, deviation: float, known: bool):
        inputs = some_inputs()
        noise, place = {"position": SIGMA, "heading": 0.01}, {"x": 0.1, "y": -0.05}
        roughly = {**place, "known": False, "deviation": deviation}
        found, expected = (
            told(Poses(noise=noise, lever_arm=arm), inputs) for arm in (roughly, {**place, "known": known})
        )
        np.testing.assert_allclose(found, expected, rtol=1e-5)

    @pytest.mark.parametrize(("deviation", "limit"), [(1e-9, "known"), (1e6, "unknown")])
    def test_limits_of_a_bias_known_roughly(self, deviation: float, limit: str):
        found, expected = (told(YawRate(noise=0.01, bias=bias), some_inputs()) for bias in (deviation, limit))
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.trace(expected))

    @settings(max_examples=6)
    @given(seed=seeds, deviation=st.floats(1e-4, 1.0))
    @pytest.mark.slow
    def test_the_more_is_known_the_more_is_told(self, seed: int, deviation: float):
        inputs, noise = some_inputs(seed), {"position": SIGMA, "heading": 0.01}
        arms = [{"x": 0.1}, {"x": 0.1, "known": False, "deviation": deviation}, {"x": 0.1, "known": False}]
        sensors = [
            [Poses(noise=noise, lever_arm=arm) for arm in arms],
            [YawRate(noise=0.01, bias=bias) for bias in ("known", deviation, "unknown")],
        ]
        for ways in sensors:
            known, roughly, unknown = (told(sensor, inputs) for sensor in ways)
            assert_at_least(known, roughly)
            assert_at_least(roughly, unknown)

    def test_an_arm_that_nothing_tells_is_no_obstacle(self):
        # On a straight the arm cannot be told from the initial pose, and the track not at all.
        inputs = np.full((SAMPLES, 2), 5.0)
        noise = {"position": SIGMA, "heading": 0.01}
        sensor = Poses(noise=noise, lever_arm={"x": 0.1, "known": False})
        expected = told(Poses(noise=noise, lever_arm={"x": 0.1}), inputs)
        found = told(sensor, inputs)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.trace(expected))


class TestNoise:
    """Noise of a reading."""

    @pytest.mark.parametrize("factor", [0.01, 30.0])
    def test_information_is_in_units_of_the_noise(self, factor: float):
        quiet, loud = ({"position": scale * SIGMA, "heading": scale * 0.01} for scale in (1.0, factor))
        expected = told(Poses(noise=quiet), some_inputs())
        np.testing.assert_allclose(told(Poses(noise=loud), some_inputs()) * factor**2, expected, rtol=1e-9)

    @pytest.mark.slow
    def test_a_diagonal_covariance_is_the_deviations(self):
        inputs, sizes = some_inputs(), np.array([1e-3, 2e-3, 0.01])
        apart = told(Poses(noise=dict(zip(("x", "y", "heading"), sizes, strict=True))), inputs)
        one = told(Poses(noise={"covariance": np.diag(sizes**2).tolist()}), inputs)
        every = np.diag(np.tile(sizes**2, SAMPLES + 1)).tolist()
        together = told(Poses(noise={"covariance": every}), inputs)
        np.testing.assert_allclose(one, apart, rtol=1e-10)
        np.testing.assert_allclose(together, apart, rtol=1e-10)

    def test_noise_that_grows_with_speed_tells_less(self):
        inputs, base = some_inputs(), {"position": SIGMA, "heading": 0.01}
        still = told(Poses(noise={**base, "position_per_speed": 0.0}), inputs)
        growing = told(Poses(noise={**base, "position_per_speed": 0.05, "heading_per_speed": 0.1}), inputs)
        np.testing.assert_allclose(still, told(Poses(noise=base), inputs), rtol=1e-12)
        assert_at_least(still, growing)
        assert np.trace(growing) < 0.8 * np.trace(still)

    @pytest.mark.parametrize("every", [1, 2, 5, 11, 100])
    def test_readings_are_every_so_many_from_the_first(self, every: int):
        inputs = some_inputs()
        sensors = {
            Poses(noise={"position": SIGMA, "heading": 0.01}, every=every): 3 * len(range(0, 12, every)),
            Ranges(beacons=[(4, 3), (3, 4)], noise=0.1, every=every): 2 * len(range(0, 12, every)),
            YawRate(noise=0.01, every=every): len(range(0, 11, every)),
        }
        for sensor, rows in sensors.items():
            found = driven(sensor_problem(measurement=sensor), inputs)
            assert found.design_matrices["joint"].shape == (rows, 3)

    def test_a_beacon_on_the_way_is_no_singularity(self):
        sensor = Ranges(beacons=[START[:2], (4, 3)], noise=0.1, initial_pose="known")
        found = told(sensor, some_inputs())
        assert np.isfinite(found).all()
        assert np.linalg.eigvalsh(found)[0] >= -1e-9 * np.trace(found)


class TestBounds:
    """The most that absolute poses can tell, relative to the parameters."""

    COUNT = 24
    PLAIN = ROBOTS[0].model
    UNEQUAL = DifferentialDrive(wheel_radius_right=0.06, wheel_radius_left=0.04, track=0.3)

    @staticmethod
    def score(inputs: np.ndarray, heading: float, model=PLAIN, estimate=None) -> Evaluation:
        sensor = Poses(noise={"position": SIGMA, "heading": heading})
        parts = {"samples": len(inputs), "estimate": estimate, "criterion": E()}
        return driven(sensor_problem(measurement=sensor, model=model, **parts), inputs)

    @settings(max_examples=15)
    @given(seed=seeds, amplitude=st.floats(0.5, 40), heading=st.sampled_from([1e-4, 0.5]))
    @pytest.mark.slow
    def test_coefficients(self, seed: int, amplitude: float, heading: float):
        inputs = np.random.default_rng(seed).uniform(-amplitude, amplitude, (self.COUNT, 2))
        found = self.score(inputs, heading, estimate=C)
        assert found.lambda_min <= (self.COUNT + 1) * TRACK**2 / (8 * SIGMA**2) * (1 + 1e-9)

    def test_coefficients_reach_their_bound(self):
        # Turns to either side, as wide as they are fast: headings spread, positions far apart.
        left, right = [60.0, 57.0], [57.0, 60.0]
        inputs = np.array([left] * 77 + [right] * 154 + [left] * 77)
        found = self.score(inputs, 1e-2, estimate=C)
        bound = (len(inputs) + 1) * TRACK**2 / (8 * SIGMA**2)
        assert 0.9 * bound <= found.lambda_min <= bound

    @settings(max_examples=15)
    @given(
        seed=seeds,
        amplitude=st.floats(0.5, 40),
        model=st.sampled_from([PLAIN, UNEQUAL]),
        heading=st.sampled_from([1e-4, 0.5]),
    )
    @pytest.mark.slow
    def test_radii_and_track(self, seed: int, amplitude: float, model: DifferentialDrive, heading: float):
        inputs = np.random.default_rng(seed).uniform(-amplitude, amplitude, (self.COUNT, 2))
        found = self.score(inputs, heading, model)
        places = found.states[:, :2]
        spread = ((places - places.mean(axis=0)) ** 2).sum()
        assert found.lambda_min <= spread / (3 * SIGMA**2) * (1 + 1e-9)


@pytest.mark.slow
class TestChainRule:
    """Information on the coefficients and on the robot's constants say the same."""

    # Every robot, and on one of them the other rule and the other sort of sensor.
    @pytest.mark.parametrize(
        ("robot", "rule", "name"),
        [
            *((robot, "arc", "ranges_with_arm") for robot in PLAIN_SIDES),
            (ROBOTS[0], "midpoint", "yaw_rate"),
        ],
        ids=lambda one: getattr(one, "name", one),
    )
    def test_constants_from_coefficients(self, robot: Robot, rule: str, name: str):
        model, inputs, sensor = robot.model, some_inputs(model=robot.model), named(name).sensor
        geometry = ("wheel_radius_right", "wheel_radius_left", "track")
        by_c = driven(
            sensor_problem(measurement=sensor, model=model, integration=rule, estimate=C), inputs
        ).information["joint"]
        found = driven(
            sensor_problem(measurement=sensor, model=model, integration=rule, estimate=geometry), inputs
        ).information["joint"]

        def coefficients(values: np.ndarray) -> np.ndarray:
            right, left, track = values
            return np.array([right / track, -left / track, right / 2, left / 2])

        nominal = {entry.name: entry.nominal for entry in model.parameters}
        point = np.array([nominal[name] for name in geometry])
        jacobian = oracle.central_difference(coefficients, point)
        expected = jacobian.T @ by_c @ jacobian
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * np.trace(expected))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"covariance": [[1, 2]]}, "square matrix"),
        ({"covariance": [[1, 2], [2, 1]]}, "positive definite"),
        ({"covariance": [[1, 0.5], [0.4, 1]]}, "symmetric"),
        ({"covariance": [[0]]}, "positive definite"),
        ({"covariance": [[-1]]}, "positive definite"),
        ({"position": 0}, "position"),
        ({"x": "3 deg"}, "expected a length"),
        ({"heading": -1}, "heading"),
        ({"position_per_speed": -0.1}, "position_per_speed"),
        ({"heading_per_speed": "1 m"}, "heading_per_speed"),
        ({"position_per_yaw_rate": "1 mm"}, "position_per_yaw_rate"),
        ({"heading_per_yaw_rate": -0.1}, "heading_per_yaw_rate"),
        ({"z": 1}, "z"),
    ],
)
def test_wrong_noise_is_refused(wrong, words: str):
    with pytest.raises(PartError, match=words):
        AbsoluteNoise(**wrong)


def test_noise_may_come_with_units():
    noise = AbsoluteNoise(
        position="1 mm",
        heading="1 deg",
        position_per_speed="2 ms",
        heading_per_speed="1 deg*s/m",
        position_per_yaw_rate="3 mm*s/rad",
        heading_per_yaw_rate="4 ms",
    )
    assert (noise.deviation("x"), noise.deviation("y")) == (1e-3, 1e-3)
    assert noise.deviation("heading") == pytest.approx(np.pi / 180)
    assert (noise.of("x").per_speed, noise.of("heading").per_speed) == pytest.approx((2e-3, np.pi / 180))
    assert (noise.of("y").per_yaw_rate, noise.of("heading").per_yaw_rate) == pytest.approx((3e-3, 4e-3))


@pytest.mark.parametrize(
    ("sensor", "key", "words"),
    [
        (Poses(), "noise", "the noise of position and heading is needed"),
        (
            Poses(noise={"x": 0.01, "heading": 0.01}),
            "noise",
            "the readings: noise: {y: 1 cm}",
        ),
        (Poses(noise={"position_per_speed": 1}, quantities=("x",)), "noise", "the noise of x is needed"),
        (Poses(quantities=("x", "x"), noise={"x": 1}), "quantities", "listed twice"),
        (
            Poses(noise={"covariance": [[1, 0], [0, 1]]}, every=4),
            "noise.covariance",
            "expected 3 rows (one pose) or 9 (all readings), got 2",
        ),
        (Landmarks(landmarks=[(1, 2)]), "noise", "noise: {range: 3 cm, bearing: 1 deg}"),
        (
            Tags(tags=[(1, 2, 0)], noise={"range": 0.01, "bearing": 0.01}),
            "noise",
            "noise of orientation is needed",
        ),
        (
            Landmarks(landmarks=[(1, 2)], quantities=("range", "range"), noise={"range": 1}),
            "quantities",
            "listed twice",
        ),
        (
            Landmarks(landmarks=[(1, 2), (3, 4)], quantities=("range",), noise={"range": 1}, ids=(7,)),
            "ids",
            "one id for each of the 2 landmarks, got 1",
        ),
        (
            Landmarks(landmarks=[(1, 2), (3, 4)], quantities=("range",), noise={"range": 1}, ids=(7, "7")),
            "ids",
            "the id 7 is listed twice",
        ),
    ],
)
def test_sensors_that_cannot_be_weighed_are_issues(sensor: Sensor, key: str, words: str):
    with pytest.raises(ProblemError) as caught:
        sensor_problem(measurement=sensor)
    (issue,) = caught.value.issues
    assert ".".join(map(str, issue.key)) == f"measurement.{key}"
    assert words in issue.message


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: LeverArm(x=0.1, deviation=0.01), "add known: false"),
        (lambda: LeverArm(known=False, deviation=0), "deviation"),
        (lambda: Poses(quantities=()), "quantities"),
        (lambda: Poses(quantities=("z",)), "quantities"),
        (lambda: Poses(every=0), "every"),
        (lambda: Poses(initial_pose="perhaps"), "initial_pose"),
        (lambda: Poses(initial_pose={"position": 0, "heading": 1}), "position"),
        (lambda: Ranges(beacons=[], noise=1), "beacons"),
        (lambda: Ranges(beacons=[(1, 2, 3)], noise=1), "beacons"),
        (lambda: Ranges(beacons=[(1, 2)]), "noise"),
        (lambda: YawRate(noise=0), "noise"),
        (lambda: Ranges(beacons=[(1, 2)], noise=1, map="guessed"), "map"),
        (lambda: Ranges(beacons=[(1, 2)], noise=1, bias=-1), "bias"),
        (lambda: Landmarks(landmarks=[]), "landmarks"),
        (lambda: Landmarks(landmarks=[(1, 2)], quantities=("orientation",)), "quantities"),
        (lambda: Landmarks(landmarks=[(1, 2)], noise={"centre": -1}), "centre"),
        (lambda: Landmarks(landmarks=[(1, 2)], lever_arm={"heading": "1 m"}), "expected an angle"),
        (lambda: Landmarks(landmarks=[(1, 2)], lever_arm={"heading_deviation": 1}), "add known: false"),
        (lambda: Tags(tags=[(1, 2)]), "tags"),
        (lambda: Tags(tags=[(1, 2, 0)], map=0.1), "map"),
        (lambda: Poses(latency="5 m"), "latency"),
        (lambda: YawRate(noise=1, scale="2 deg"), "scale"),
        (lambda: YawRate(noise=1, bias=0), "bias"),
        (lambda: YawRate(noise="1 deg"), "expected an angular speed"),
        (lambda: Several(sensors=[]), "sensors"),
    ],
)
def test_wrong_sensors_are_refused(build, words: str):
    with pytest.raises(PartError, match=words):
        build()


def test_a_small_covariance_has_to_be_symmetric_too():
    with pytest.raises(PartError, match="symmetric"):
        AbsoluteNoise(covariance=[[1e-8, 5e-9], [0.0, 1e-8]])


def test_a_covariance_stands_instead_of_deviations():
    with pytest.raises(PartError, match="covariance"):
        AbsoluteNoise(position=1e-3, covariance=[[1e-6, 0.0], [0.0, 1e-6]])


def test_a_covariance_of_all_readings_fits_drives_of_its_length_only():
    every = np.eye(2 * (SAMPLES + 1)).tolist()
    problem = sensor_problem(measurement=Poses(quantities=("x", "y"), noise={"covariance": every}))
    driven(problem, some_inputs())
    with pytest.raises((UserMistake, ValueError), match="readings"):
        driven(problem, some_inputs(count=SAMPLES - 1))
