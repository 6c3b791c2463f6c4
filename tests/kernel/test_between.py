"""Limits between the points at which a drive is looked at: nothing slips through a grid."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca
import numpy as np
import oracle
import pytest
from builders import RADIUS, TRACK, problem_of, random_drive

from oed.bounds import bound
from oed.kernel.criteria import E
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.limit import Limit, Rows
from oed.kernel.problem import Problem
from oed.kernel.results import TOLERANCE
from oed.kernel.scorer import limits_exceeded
from oed.robots.limits import (
    BodySpeed,
    LateralAcceleration,
    Obstacles,
    Polygon,
    Rectangle,
    TrailerAngle,
    TurningRadius,
    WheelAcceleration,
    WheelSpeed,
    YawRate,
)
from oed.robots.models import SkidSteerSlip, TractorTrailer
from oed.robots.sensors import Displacements, Poses
from oed.robots.space import DesignSpace
from oed.uncertainty.robust import Robust
from oed.uncertainty.uncertainty import Uncertainty

FAST = WheelSpeed(bounds=100)


def moving(*limits: Limit, duration: float = 10.0, samples: int = 10, **parts) -> Problem:
    """A problem whose drives need not begin or end at rest."""
    space = {"duration": duration, "samples": samples, "rest_to_rest": False, "start": "free"}
    space |= parts.pop("space", {})
    parts.setdefault("measurement", Poses(noise={"position": 0.01, "heading": 0.01}))
    parts.setdefault("criterion", E(scaling="relative"))
    bounds = () if any(isinstance(limit, WheelSpeed) for limit in limits) else (FAST,)
    return problem_of(design=DesignSpace(**space), limits=(*bounds, *limits), **parts)


def steady(problem: Problem, speed: float, yaw_rate: float, start=(0.0, 0.0, 0.0)) -> Trajectory:
    """A drive of one speed [m/s] and yaw rate [rad/s]."""
    wheels = (speed + np.array([1, -1]) * yaw_rate * TRACK / 2) / RADIUS
    inputs = np.tile(wheels, (problem.design.samples, 1))
    state = problem.start_states([start])[0]
    return Trajectory.from_samples(inputs, problem.design.duration, state, rest_to_rest=False)


def margin(problem: Problem, drive: Trajectory, name: str):
    (found,) = [one for one in evaluate(problem, drive).margins if one.name == name]
    return found


def test_a_post_between_two_points_is_hit():
    post = Obstacles.model_validate([{"kind": "circle", "x": 2.525, "y": 0, "radius": 0.02}])
    problem = moving(post)
    drive = steady(problem, 0.5, 0.0)
    # None of the evaluation's own points is inside.
    assert np.abs(evaluate(problem, drive).path[:, 0] - 2.525).min() > 0.02
    assert margin(problem, drive, "obstacles").margin == pytest.approx(-0.02, abs=2e-5)
    beside = steady(problem, 0.5, 0.0, (0.0, 0.021, 0.0))
    assert margin(problem, beside, "obstacles").margin == pytest.approx(0.001, abs=1e-6)


@pytest.mark.slow
def test_a_wall_of_millimetres_is_not_crossed():
    wall = {"kind": "polygon", "points": [[1.01, -2], [1.015, -2], [1.015, 2], [1.01, 2]]}
    problem = moving(Obstacles.model_validate([wall]), Rectangle(x=(-1, 6), y=(-2, 2)))
    evaluation = evaluate(problem, steady(problem, 0.4, 0.0))
    assert np.abs(evaluation.path[:, 0] - 1.0125).min() > 0.0025
    assert not evaluation.feasible
    assert evaluation.violations["obstacles"] == pytest.approx(0.0025, rel=0.01)


@pytest.mark.parametrize("rule", ["arc", "midpoint"])
@pytest.mark.slow
def test_an_arc_outside_the_room_is_seen(rule: str):
    # A quarter turn between two points: the path bulges by centimetres.
    space = {"integration": rule}
    problem = moving(Rectangle(x=(-5, 5), y=(-5, 5)), duration=8.0, samples=1, space=space)
    drive = steady(problem, 2.0, np.pi / 2.2, (0.0, 0.0, 0.4))
    twist = np.array([[2.0, 0.0, np.pi / 2.2]])
    path = oracle.fine_path(twist, (0, 0, 0.4), 8.0, rule, 4000)
    reach = np.abs(path[:, :2]).max()
    # The midpoint rule's chords grow to their ends; an arc bulges between two points.
    assert rule == "midpoint" or reach > np.abs(evaluate(problem, drive).path[:, :2]).max() + 1e-3
    room = Rectangle(x=(-reach + 0.003, reach - 0.003), y=(-reach + 0.003, reach - 0.003))
    narrower = moving(room, duration=8.0, samples=1, space=space)
    assert margin(narrower, drive, "workspace").margin == pytest.approx(-0.003, abs=1e-5)


@pytest.mark.slow
def test_the_edge_of_a_turned_room_is_exact():
    angle = 1.3
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ turn.T
    problem = moving(Polygon(points=corners.tolist()), samples=6)
    drive = steady(problem, 0.9, 0.93)
    path = oracle.fine_path(np.tile([[0.9, 0.0, 0.93]], (6, 1)), (0, 0, 0), 10 / 6, "arc", 1000)[:, :2]
    truth = 1 - np.abs(path @ turn).max()
    assert margin(problem, drive, "workspace").margin == pytest.approx(truth, abs=1e-5 * max(1, -truth))


@pytest.mark.parametrize(
    ("degree", "coefficients", "samples"), [(2, 602, 6), (3, 34, 3), (1, 40, 3), (5, 60, 4)]
)
def test_splines_of_many_coefficients_are_looked_at_between_few_samples(degree, coefficients, samples):
    spline = Spline(degree=degree, coefficients=coefficients)
    space = DesignSpace(duration=6, samples=samples, spline=spline)
    problem = problem_of(
        design=space,
        limits=(WheelSpeed(bounds=10), WheelAcceleration(bounds=2)),
        measurement=Displacements(segments=2),
    )
    rng = np.random.default_rng(degree)
    table = rng.uniform(-9, 9, (coefficients, 2))
    table[[0, -1]] = 0
    drive = space.trajectory(table, np.zeros(3))
    times = np.union1d(np.linspace(0, 6, 40 * coefficients), drive.knots)
    for order, name, largest in ((0, "wheel_speed", 10), (1, "wheel_acceleration", 2)):
        truth = largest - np.abs(oracle.spline_values(drive, times, order)).max()
        found = margin(problem, drive, name).margin
        assert found <= truth + 1e-9
        assert found == pytest.approx(truth, rel=5e-3)


@pytest.mark.slow
def test_no_feasible_drive_of_many_coefficients_beats_its_bound():
    spline = Spline(degree=2, coefficients=602)
    space = DesignSpace(duration=6, samples=6, spline=spline)
    measured = Displacements(segments="samples", regressor="heading")
    problem = problem_of(
        design=space,
        limits=(WheelSpeed(bounds=10), WheelAcceleration(bounds=2)),
        measurement=measured,
        criterion=E(scaling="none"),
    )
    # At full speed in the middle of every period, at rest in between.
    place = np.arange(602) / 601 * 6
    pulses = np.where(np.abs(place % 1 - 0.5) < 0.1, 10.0, 0.0)
    turned = np.where(place.astype(int) % 2, -1, 1)
    drive = space.trajectory(np.column_stack([pulses, pulses * turned]), np.zeros(3))
    evaluation = evaluate(problem, drive)
    assert evaluation.objective == pytest.approx(600)
    assert bound(problem, nodes=10).upper_bound < 100
    assert not evaluation.feasible


@pytest.mark.parametrize("coefficients", [6, 12, 13, 36])
def test_held_steps_begin_and_end_at_rest(coefficients: int):
    space = DesignSpace(duration=6, samples=12, spline=Spline(degree=0, coefficients=coefficients))
    problem = problem_of(design=space, limits=(FAST, WheelAcceleration(bounds=2)))
    inner = np.full((coefficients, 2), 1.0)
    inner[[0, -1]] = 0
    drive = space.trajectory(inner, np.zeros(3))
    # A change within half a period where the first one is driven, else within a whole one.
    largest = np.abs(drive.inputs[0]).max() / 0.25 or 1 / 0.5
    assert margin(problem, drive, "wheel_acceleration").margin == pytest.approx(2 - largest)


def test_held_steps_move_as_they_are_held():
    # Of many coefficients in a period one is held; nobody drives the others.
    space = {"spline": Spline(degree=0, coefficients=40)}
    problem = moving(YawRate(bounds=1.0), duration=4.0, samples=4, space=space)
    table = np.random.default_rng(2).uniform(-3, 3, (40, 2))
    drive = problem.design.trajectory(table, np.zeros(3))
    rates = RADIUS * (drive.inputs[:, 0] - drive.inputs[:, 1]) / TRACK
    assert np.abs(table[:, 0] - table[:, 1]).max() > np.abs(drive.inputs[:, 0] - drive.inputs[:, 1]).max()
    assert margin(problem, drive, "yaw_rate").margin == pytest.approx(1 - np.abs(rates).max())


LAGGING = SkidSteerSlip(wheel_radius=RADIUS, track=TRACK, yaw_lag=0.5)


def lagging_motion(drive: Trajectory) -> np.ndarray:
    """Speed and yaw rate (K, 2) of the lagging robot, at many times of each period."""
    rate, found = 0.0, []
    times = np.linspace(0, drive.period, 400)
    for right, left in drive.inputs:
        asked, speed = RADIUS * (right - left) / TRACK, RADIUS * (right + left) / 2
        rates = asked + (rate - asked) * np.exp(-times / 0.5)
        found.append(np.column_stack([np.full(400, speed), rates]))
        rate = rates[-1]
    return np.concatenate(found)


@pytest.mark.slow
def test_limits_are_on_the_motion_that_a_lagging_robot_has():
    limits = (
        YawRate(bounds=0.8),
        LateralAcceleration(bounds=0.1),
        TurningRadius(bounds=0.2),
        BodySpeed(bounds=1),
    )
    problem = moving(
        *limits, model=LAGGING, duration=6.0, samples=12, space={"spline": Spline(coefficients=9)}
    )
    drive = random_drive(problem, 2, amplitude=6.0)
    speed, rate = lagging_motion(drive).T
    # Turning at rest begins every drive, so its radius is left out where it hardly moves.
    truth = {"yaw_rate": 0.8 - np.abs(rate).max(), "lateral_acceleration": 0.1 - np.abs(speed * rate).max()}
    squares = speed**2, (0.2 * rate) ** 2
    truth["turning_radius"] = (0.2 * (squares[0] - squares[1]) / (sum(squares) + 2 * (4e-4) ** 2)).min()
    truth["body_speed"] = 1 - np.abs(speed).max()
    for name, expected in truth.items():
        found = margin(problem, drive, name)
        assert found.certain
        assert found.margin == pytest.approx(expected, abs=1e-4), name


@pytest.mark.slow
def test_motion_between_the_samples_counts():
    problem = moving(
        LateralAcceleration(bounds=0.1),
        YawRate(bounds=0.5),
        duration=6.0,
        samples=3,
        space={"spline": Spline(coefficients=24)},
    )
    drive = random_drive(problem, 4, amplitude=8.0)
    times = np.union1d(np.linspace(0, 6, 20_000), drive.knots)
    twists = np.array(
        [oracle.differential_twist(row, RADIUS, RADIUS, TRACK) for row in oracle.spline_values(drive, times)]
    )
    across = np.abs(twists[:, 0] * twists[:, 2]).max()
    assert margin(problem, drive, "lateral_acceleration").margin == pytest.approx(0.1 - across, rel=1e-4)
    assert margin(problem, drive, "yaw_rate").margin == pytest.approx(
        0.5 - np.abs(twists[:, 2]).max(), rel=1e-4
    )


@pytest.mark.slow
def test_a_trailer_between_the_samples():
    model = TractorTrailer(wheel_radius=RADIUS, track=TRACK, hitch_offset=0.1, trailer_length=0.4)
    problem = moving(TrailerAngle(bounds=0.5), model=model, duration=4.0, samples=1)
    drive = steady(problem, 0.3, 0.9)
    finer = moving(TrailerAngle(bounds=0.5), model=model, duration=4.0, samples=400)
    angles = evaluate(finer, steady(finer, 0.3, 0.9)).states[:, 3]
    found = margin(problem, drive, "trailer_angle")
    assert found.certain
    assert found.margin == pytest.approx(0.5 - np.abs(angles).max(), abs=1e-5)


class Corridor(Limit):
    """A user's own limit on instants: |y| below 0.1 m + x^2."""

    name: ClassVar[str] = "corridor"
    looks_at: ClassVar[Literal["state"]] = "state"

    def rows(self, drive: Drive) -> Rows:
        x, y = drive.path[:, 0], drive.path[:, 1]
        count = x.shape[0]
        half = 0.1 + x**2
        return Rows(
            ca.vertcat(y - half, -y - half), np.full(2 * count, -np.inf), np.zeros(2 * count), 0.1, "m"
        )


class Vague(Corridor):
    """The same, which does not say what it looks at."""

    looks_at: ClassVar[None] = None  # type: ignore[assignment]


class Rough(Corridor):
    """The same by an operation that has no bounds."""

    def rows(self, drive: Drive) -> Rows:
        rows = super().rows(drive)
        return Rows(
            rows.expression + 0 * ca.erf(rows.expression) + ca.erf(rows.expression) * 1e-30,
            rows.lower,
            rows.upper,
            rows.size,
            rows.unit,
        )


def test_limits_of_the_users_own_are_checked_between_the_points():
    problem = moving(Corridor(), samples=2, duration=1.0)
    drive = steady(problem, 3.0, 0.0, (-1.49, -1.5 * np.tan(0.3), 0.3))
    times = np.linspace(0, 3, 400_000)
    x, y = -1.49 + times * np.cos(0.3), -1.5 * np.tan(0.3) + times * np.sin(0.3)
    truth = (0.1 + x**2 - np.abs(y)).min()
    assert margin(problem, drive, "corridor").margin == pytest.approx(truth, abs=1e-6)
    assert margin(problem, drive, "corridor").certain


@pytest.mark.parametrize("limit", [Vague(), Rough()])
def test_what_cannot_be_bounded_is_said_to_be_checked_at_points(limit: Limit):
    problem = moving(limit, samples=20)
    found = margin(problem, steady(problem, 0.1, 0.0), "corridor")
    assert not found.certain
    assert evaluate(problem, steady(problem, 0.1, 0.0)).checked_at_points == ("corridor",)


@pytest.mark.parametrize("kind", ["chance", "scenarios"])
@pytest.mark.slow
def test_robust_limits_hold_between_the_points(kind: str):
    uncertain = {
        "uncertainty": Uncertainty(track="5 %", wheel_radius_right="5 %"),
        "robust": Robust(kind=kind),
    }
    room = Rectangle(x=(-3, 3), y=(-3, 3))
    margins = []
    for samples in (2, 40):
        problem = moving(room, samples=samples, duration=4.0, **uncertain)
        found = margin(problem, steady(problem, 1.0, 1.1), "workspace")
        assert found.certain
        margins.append(found.margin)
    # The same motion, cut in few periods or in many.
    assert margins[0] == pytest.approx(margins[1], abs=2e-5)


def test_the_tolerance_is_the_only_one():
    problem = moving(Rectangle(x=(-1, 1), y=(-1, 1)), samples=8)
    for share, kept in ((0.99, True), (1.01, False)):
        start = (1 + share * TOLERANCE, 0.0, np.pi / 2)
        drive = steady(problem, 0.05, 0.0, start)
        assert evaluate(problem, drive).feasible == kept


@pytest.mark.parametrize("angle", [0.0, 0.6])
@pytest.mark.slow
def test_thin_walls_of_large_rooms_are_not_tolerated_away(angle: float):
    # A wall of 4 mm that is a part of the outline of a room of 12 m, or an obstacle, however they are turned.
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    comb = (
        np.array([[-6, -6], [6, -6], [6, 6], [1.014, 6], [1.014, -3], [1.01, -3], [1.01, 6], [-6, 6]]) @ turn
    )
    wall = np.array([[1.01, -3], [1.014, -3], [1.014, 5], [1.01, 5]]) @ turn
    obstacle = Obstacles.model_validate([{"kind": "polygon", "points": wall.tolist()}])
    for limit in (Polygon(points=comb.tolist()), obstacle):
        problem = moving(limit)
        drive = steady(problem, 0.3, 0.0, (0.0, 0.0, angle))
        assert not evaluate(problem, drive).feasible
        assert evaluate(problem, steady(problem, 0.09, 0.0, (0.0, 0.0, angle))).feasible


class Brisk(Limit):
    """A user's own limit on the motion that does not say what it looks at."""

    name: ClassVar[str] = "brisk"

    def rows(self, drive: Drive) -> Rows:
        count = drive.motion.shape[0]
        return Rows(drive.motion[:, 2], np.full(count, -0.5), np.full(count, 0.5), 0.5, "rad/s")


def test_what_is_checked_at_points_is_checked_between_the_samples_too():
    space = {"spline": Spline(coefficients=24)}
    problem = moving(Brisk(), duration=6.0, samples=3, space=space)
    drive = random_drive(problem, 4, amplitude=8.0)
    values = oracle.spline_values(drive, np.linspace(0, 6, 31))
    rates = np.array([oracle.differential_twist(row, RADIUS, RADIUS, TRACK)[2] for row in values])
    assert margin(problem, drive, "brisk").margin == pytest.approx(0.5 - np.abs(rates).max())
    assert not margin(problem, drive, "brisk").certain


@pytest.mark.parametrize(
    ("limit", "knots", "degree", "coefficients", "worst"),
    [
        (WheelSpeed(bounds=5), [0, 0, 1, 1, 2, 2], 1, [0, 9, 0, 0], -4.0),
        (WheelAcceleration(bounds=6), [0, 0, 0, 1, 1, 2, 2, 2], 2, [0, 0, 5, 5, 5], -4.0),
        (WheelAcceleration(bounds=6), [0, 0, 1, 1, 2, 2], 1, [0, 4, -8, -8], -4.0),
    ],
    ids=["speeds that jump", "rates that jump", "speeds that jump have rates"],
)
def test_jumps_at_knots_are_seen_from_both_sides(limit, knots, degree, coefficients, worst):
    problem = moving(limit, duration=2.0, samples=2)
    table = np.repeat(np.array(coefficients, dtype=float)[:, None], 2, axis=1)
    drive = Trajectory(np.array(knots, dtype=float), degree, table, np.zeros(3), 2)
    assert margin(problem, drive, limit.name).margin == pytest.approx(worst)


@pytest.mark.parametrize(("degree", "runs"), [(0, 1), (1, 1), (3, 2), (5, 1)])
def test_speeds_that_are_weighted_sums_of_splines_are_exact(degree: int, runs: int):
    space = {"spline": Spline(degree=degree, coefficients=11), "runs": runs, "duration": 7.0, "samples": 5}
    problem = moving(BodySpeed(bounds=(-0.05, 0.1)), YawRate(bounds=0.5), space=space)
    drive = random_drive(problem, degree)
    knots = np.unique(drive.each[0].knots)
    times = np.union1d(np.linspace(0, 7, 20_001), np.concatenate([knots - 1e-9, knots + 1e-9]).clip(0, 7))
    each = [oracle.spline_values(one, times, 0) for one in drive.each]
    right, left = (drive.inputs if degree == 0 else np.concatenate(each)).T
    speed, yaw_rate = RADIUS * (right + left) / 2, RADIUS * (right - left) / TRACK
    worst = max(speed.max() - 0.1, -0.05 - speed.min())
    assert margin(problem, drive, "body_speed").margin == pytest.approx(-worst, rel=1e-6, abs=1e-9)
    assert margin(problem, drive, "yaw_rate").margin == pytest.approx(0.5 - np.abs(yaw_rate).max(), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("robust", [None, "chance", "scenarios"])
def test_which_limits_are_exceeded_is_what_the_margins_say(robust: str | None):
    """Drives that grow through their limits: what is known without margins is what the margins say."""
    room = Rectangle(x=(-1.6, 1.6), y=(-0.9, 1.2))
    limits = (room, BodySpeed(bounds=0.35), LateralAcceleration(bounds=0.1), YawRate(bounds=1.0))
    uncertain = {"uncertainty": Uncertainty(track="5 %"), "robust": Robust(kind=robust)} if robust else {}
    problem = moving(*limits, **uncertain)
    seen = set[frozenset[str]]()
    for size in np.linspace(0.1, 1.0, 6):
        drive = steady(problem, 0.6 * size, 1.2 * size)
        margins = evaluate(problem, drive).margins
        names = {one.name for one in margins if one.violation > 1e-9 * one.size}
        assert limits_exceeded(problem, drive, 1e-9) == names
        seen.add(frozenset(names))
    assert len(seen) > 2
