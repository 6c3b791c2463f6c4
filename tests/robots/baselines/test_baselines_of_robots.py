"""Everyday paths of every robot: that it makes the moves asked, or says why it cannot."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from builders import ACCELERATION, driven_once, input_limits, problem_of
from sample_robots import ROBOTS, Example

from oed.kernel.criteria import E
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status
from oed.robots.baselines import NAMES, PATTERNS, Move, baselines, refusal, suited
from oed.robots.limits import (
    Polygon,
    Rectangle,
    SteeringAngle,
    SteeringRate,
    TrailerAngle,
    TurningRadius,
    WheelSpeed,
)
from oed.robots.models import Ackermann, DifferentialDrive, Mecanum, Model, SkidSteer, Tricycle
from oed.robots.sensors import Poses
from oed.robots.space import DesignSpace

FULL_TURN = 2 * np.pi
SAMPLING = 0.02
"""Share of a path's size by which sampling its speeds may bend it."""
STEERING_RATE = 1.0
ROOM = Rectangle(x=(-3, 3), y=(-3, 3))

SPINNING = ("square", "straight_and_spin")
SIDEWAYS = ("sideways_straight", "sideways_square")
REFUSED = {
    "tricycle": SPINNING + SIDEWAYS,
    "ackermann": SPINNING + SIDEWAYS,
    "mecanum": (),
    "omni_three": (),
    "bicycle_dynamic": tuple(name for name in NAMES if name != "random"),
}
"""What robots cannot drive, by kind; two-sided ones cannot move sideways."""

ENDS = {
    "circle": (0.0, FULL_TURN),
    "square": (0.0, 0.0),
    "rounded_square": (0.0, 0.0),
    "figure_eight": (0.0, 0.0),
    "slalom": (1.0, 0.0),
    "straight": (1.0, 0.0),
    "straight_and_spin": (0.0, 0.0),
    "sideways_straight": (1j, 0.0),
    "sideways_square": (0.0, 0.0),
}
"""Where a path ends, x + j y in sizes, and how far it has turned [rad]."""
LARGEST_TURN = {
    "circle": FULL_TURN,
    "square": FULL_TURN,
    "rounded_square": FULL_TURN,
    "figure_eight": FULL_TURN,
    "slalom": FULL_TURN / 12,
    "straight_and_spin": FULL_TURN,
}

ACKERMANN = Ackermann(wheel_radius=0.05, wheelbase=0.33)
TRICYCLE = Tricycle(wheel_radius=0.1, wheelbase=0.4)
TWO_SIDED = DifferentialDrive(wheel_radius=0.049, track=0.18)
MECANUM = Mecanum(wheel_radius=0.05, half_wheelbase_plus_half_track=0.3)


def steers(model: Model) -> bool:
    return any(entry.quantity == "steering_angle" for entry in model.inputs)


def turns_wheels(model: Model) -> bool:
    return any(entry.quantity == "wheel_speed" for entry in model.inputs)


def usual_limits(model: Model) -> tuple:
    limits = (*input_limits(model), *((ACCELERATION,) if turns_wheels(model) else ()), ROOM)
    limits += (SteeringRate(bounds=STEERING_RATE),) if steers(model) else ()
    return limits + ((TrailerAngle(bounds=1.0),) if "trailer_angle" in model.states else ())


def robot_problem(model: Model, **parts: Any) -> Problem:
    usual = {
        "duration": 60,
        "samples": 120,
        "spline": Spline(),
        "measurement": Poses(noise={"position": 0.01, "heading": 0.02}),
        "limits": usual_limits,
        "criterion": E(scaling={entry.name: entry.scale or 1.0 for entry in model.parameters}),
    }
    return problem_of(model=model, **{**usual, **parts})


def refused(model: Model) -> tuple[str, ...]:
    return REFUSED.get(model.kind, SIDEWAYS)


def driven(model: Model) -> list[str]:
    return [name for name in NAMES if name not in refused(model)]


def steering(trajectory: Trajectory, model: Model) -> np.ndarray:
    places = [place for place, entry in enumerate(model.inputs) if entry.quantity == "steering_angle"]
    return trajectory.inputs[:, places]


def speeds(trajectory: Trajectory, model: Model) -> np.ndarray:
    places = [place for place, entry in enumerate(model.inputs) if entry.drives]
    return trajectory.inputs[:, places]


def assert_the_moves_are_made(name: str, solution: Solution, size: float, lag: float = 0.0):
    path = solution.evaluation.path
    # A robot that lags still turns where the drive ends; one that steers while it rolls cuts a turn's peak.
    missing = (1 + 8 * lag) * SAMPLING
    place, turn = ENDS[name]
    assert abs(complex(*path[-1, :2]) - size * place) < 2 * SAMPLING * size
    assert path[-1, 2] == pytest.approx(turn, abs=missing)
    assert path[:, 2].max() == pytest.approx(LARGEST_TURN.get(name, 0.0), abs=missing)


def assert_it_steers_without_a_stop(trajectory: Trajectory, model: Model):
    angles = steering(trajectory, model)
    changes = np.abs(np.diff(angles, axis=0)).max(axis=1)
    assert changes.max() > 1e-3
    assert changes.max() / trajectory.period <= STEERING_RATE * (1 + 1e-9)
    # From the rest at the start, in half a period.
    assert np.abs(angles[0]).max() <= STEERING_RATE * trajectory.period / 2 + 1e-9
    rolling = np.flatnonzero(np.abs(speeds(trajectory, model)).max(axis=1) > 1e-9)
    np.testing.assert_array_equal(np.diff(rolling), 1)


# One of every kind: what a second one of a kind changes is its numbers. Every path by one robot that steers
# and one that drags a trailer, sideways by one that can, straight ahead by one that lags, too; the others to
# both sides. One that spins drives every path of the paper's study.
KINDS = list({example.model.kind: example for example in ROBOTS}.values())
FEW = ("figure_eight", "random")
EVERY = ("ackermann", "tractor_trailer")
SOME = {"mecanum": SIDEWAYS, "unicycle": ("straight",)}
PAIRS = [
    (example, name)
    for example in KINDS
    for name in driven(example.model)
    if name in FEW or example.model.kind in EVERY or name in SOME.get(example.model.kind, ())
]
# A trailer that a spin on the spot folds up beyond its limit.
FOLDED = [pair for pair in PAIRS if "trailer_angle" in pair[0].model.states and pair[1] in SPINNING]


def of_robots(pairs: list[tuple[Example, str]]) -> Any:
    return pytest.mark.parametrize(
        ("example", "name"), pairs, ids=[f"{example.name}-{name}" for example, name in pairs]
    )


# The choice of a place and a number of laps knows little of a robot: one that steers, that lags, that drags a
# trailer and that moves sideways. Random drives are made of what each can do.
CHOSEN = {
    ("differential_drive", "figure_eight"),
    ("ackermann", "figure_eight"),
    ("unicycle", "straight"),
    ("tractor_trailer", "rounded_square"),
    ("mecanum", "sideways_square"),
}


def problem_for(example: Example, name: str) -> Problem:
    # What limits may be exceeded by between samples is bounded the sooner the shorter a car's periods are.
    duration, samples = (30, 75) if example.motion is None else (0.6, 6)
    if name == "figure_eight":
        # As slowly as lags need that the turns are made as exactly as is asked.
        duration, samples = 60, 120
    return problem_of_robot(example, duration, samples)


@cache
def problem_of_robot(example: Example, duration: float = 60, samples: int = 120) -> Problem:
    return robot_problem(example.model, duration=duration, samples=samples)


@cache
def largest_of(example: Example, name: str) -> Solution:
    """The pattern driven once."""
    return driven_once(problem_for(example, name), name)


@pytest.mark.slow
@of_robots([pair for pair in PAIRS if pair not in FOLDED and pair[1] != "random"])
def test_every_robot_drives_what_suits_it(example: Example, name: str):
    largest = largest_of(example, name)
    assert largest.evaluation.feasible
    size = np.ptp(largest.evaluation.path[:, :2], axis=0).max() / (2 if name == "square" else 1)
    lag = getattr(example.model, "lag_omega", None) or (
        0.25 if example.mean or steers(example.model) else 0.0
    )
    assert_the_moves_are_made(name, largest, size, lag)
    if steers(example.model) and name != "straight":
        assert_it_steers_without_a_stop(largest.trajectory, example.model)


@pytest.mark.slow
@of_robots([pair for pair in PAIRS if (pair[0].model.kind, pair[1]) in CHOSEN or pair[1] == "random"])
def test_what_is_chosen_can_be_driven_and_is_no_worse(example: Example, name: str):
    problem, length = problem_for(example, name), 4.0 if example.motion is None else 0.1
    duration = problem.design.duration
    chosen, fitted = baselines(problem, name, length=length)
    assert chosen.evaluation.feasible
    assert chosen.trajectory.duration == duration
    np.testing.assert_allclose(chosen.trajectory.inputs_at(np.array([0.0, duration])), 0, atol=1e-6)
    assert fitted.evaluation.path_length == pytest.approx(length, rel=0.01)
    assert fitted.trajectory.duration == duration
    if name != "random":
        once = largest_of(example, name).evaluation.objective
        assert chosen.evaluation.objective >= once * (1 - 1e-3)


@pytest.mark.slow
@of_robots(FOLDED)
def test_a_trailer_that_folds_up_is_named(example: Example, name: str):
    (solution,) = baselines(problem_of_robot(example), name)
    assert "trailer_angle" in solution.evaluation.violations
    assert "it exceeds" in solution.message


@pytest.mark.parametrize("example", KINDS, ids=lambda example: example.name)
class TestSuited:
    @pytest.mark.slow
    def test_names(self, example: Example):
        assert suited(problem_of_robot(example)) == tuple(driven(example.model))

    @pytest.mark.slow
    def test_the_others_say_why(self, example: Example):
        problem = problem_of_robot(example)
        refusals = {name: reason for name in NAMES if (reason := refusal(problem, name))}
        assert tuple(refusals) == tuple(name for name in NAMES if name in refused(example.model))
        for name, found in refusals.items():
            reason = f"it cannot {'move sideways' if name in SIDEWAYS else 'turn in place'}"
            if example.motion is not None:
                reason = "it is made of speeds, and throttle is none"
            able = ", ".join(driven(example.model))
            expected = f"{example.model.kind} cannot drive a {name} ({reason}); it can drive {able}"
            assert found == expected
            (solution,) = baselines(problem, name, length=1.0)
            assert (solution.name, solution.kind, solution.status) == (name, "baseline", Status.IMPOSSIBLE)
            assert (solution.evaluation, solution.trajectory) == (None, None)
            assert solution.message == f"The robot cannot make this drive. {expected}."


class TestIssues:
    def test_slip_is_no_obstacle(self):
        slips = {"slip_outer": -0.5, "slip_inner": 0.3}
        model = SkidSteer(wheel_radius=0.049, track=0.18, **slips)
        assert suited(robot_problem(model)) == tuple(driven(model))

    @pytest.mark.slow
    @pytest.mark.parametrize(("bounds", "able"), [(1.55, False), (1.59, True)])
    def test_a_tricycle_spins_with_its_wheel_across(self, bounds: float, able: bool):
        # The angle that acts is 0.01 rad more: one way of spinning needs 1.561 rad.
        model = TRICYCLE.model_copy(update={"steering_offset": 0.01})
        limits = (WheelSpeed(bounds=10), SteeringAngle(bounds=bounds), ROOM)
        problem = robot_problem(model, limits=limits)
        assert ("straight_and_spin" in suited(problem)) == able

    @pytest.mark.slow
    def test_too_few_periods_to_steer_in(self):
        # A change of steering before the arcs and one after, of a period at least, and a period between.
        enough, few = (
            robot_problem(ACKERMANN, design=DesignSpace(duration=60, samples=samples)) for samples in (3, 2)
        )
        assert refusal(enough, "figure_eight") == ""
        reason = "it stops to steer, for which it needs 3 samples, not 2"
        assert reason in refusal(few, "figure_eight")
        assert reason in baselines(few, "figure_eight")[0].message


def walked(moves: list[Move]) -> tuple[complex, float]:
    """Place x + j y [m] and heading [rad] after moves, each along an arc of its own."""
    place, heading = 0j, 0.0
    for move in moves:
        shift = complex(move.forward, move.sideways)
        if move.turn:
            shift *= (np.exp(1j * move.turn) - 1) / (1j * move.turn)
        place += shift * np.exp(1j * heading)
        heading += move.turn
    return place, heading


class TestPatterns:
    @pytest.mark.parametrize("name", PATTERNS)
    def test_where_they_end(self, name: str):
        place, turn = walked(PATTERNS[name](2.0, 0))
        assert abs(place - 2.0 * ENDS[name][0]) < 1e-12
        assert turn == pytest.approx(ENDS[name][1], abs=1e-12)

    @pytest.mark.parametrize("name", ["straight", "slalom", "sideways_straight"])
    def test_the_next_lap_leads_back(self, name: str):
        place, turn = walked(PATTERNS[name](2.0, 0) + PATTERNS[name](2.0, 1))
        assert abs(place) < 1e-12
        assert abs(turn) < 1e-12

    def test_the_corners_of_a_rounded_square(self):
        arcs = [move for move in PATTERNS["rounded_square"](2.0, 0) if move.turn]
        assert {round(move.forward / abs(move.turn), 12) for move in arcs} == {0.5}
        assert len(arcs) == 8

    def test_a_slaloms_arcs_are_alike(self):
        arcs = PATTERNS["slalom"](2.0, 0)
        assert len({round(move.forward / abs(move.turn), 12) for move in arcs}) == 1
        assert walked(arcs[:3])[0].real == pytest.approx(1.0)


class TestSpins:
    @pytest.mark.slow
    @pytest.mark.parametrize("name", SPINNING)
    def test_of_a_tricycle(self, name: str):
        limits = (WheelSpeed(bounds=10), SteeringAngle(bounds=1.7), ACCELERATION, ROOM)
        solution = driven_once(robot_problem(TRICYCLE, limits=limits), name)
        assert solution.evaluation.feasible
        turns = np.diff(solution.evaluation.states[:, 2])
        steps = np.hypot(*np.diff(solution.evaluation.states[:, :2], axis=0).T)
        assert np.abs(turns).sum() == pytest.approx(2 * FULL_TURN, rel=1e-6)
        assert steps[np.abs(turns) > 1e-6].max() < 1e-6
        assert np.abs(solution.evaluation.states[-1, :3]).max() < 1e-6

    @pytest.mark.slow
    def test_a_move_on_the_spot_is_no_move_ahead(self):
        # The check of the moves made can fail.
        straight = driven_once(robot_problem(TWO_SIDED), "straight")
        with pytest.raises(AssertionError):
            assert_the_moves_are_made("sideways_straight", straight, 3.0)
        with pytest.raises(AssertionError):
            assert_the_moves_are_made("straight", straight, 2.0)


class TestSideways:
    @pytest.mark.slow
    def test_a_square_without_turning(self):
        solution = driven_once(robot_problem(MECANUM), "sideways_square")
        path = solution.evaluation.path
        assert np.abs(path[:, 2]).max() < 1e-9
        assert path[:, :2].min() == pytest.approx(0, abs=0.02)
        assert path[:, :2].max() == pytest.approx(3, rel=0.02)
        to_sides = np.minimum(*(np.abs(path[:, [axis]] - [0, 3]).min(axis=1) for axis in (0, 1)))
        assert to_sides.max() < 3 * SAMPLING
        # First ahead and to the left, later to the left and ahead: every corner twice.
        for corner in ((3, 0), (0, 3)):
            assert np.hypot(*(path[:, :2] - corner).T).min() < 3 * SAMPLING


class TestSteering:
    def problem(self, *limits: Any, **space: Any) -> Problem:
        design = DesignSpace(**{"duration": 60, "samples": 120, **space})
        usual = (WheelSpeed(bounds=10), SteeringAngle(bounds=0.6), ACCELERATION, ROOM)
        return robot_problem(ACKERMANN, limits=usual + limits, design=design)

    def steered(self, *limits: Any, name: str = "circle", **space: Any) -> Solution:
        return driven_once(self.problem(*limits, **space), name)

    def standing(self, solution: Solution) -> float:
        """Seconds at a standstill before the first move."""
        still = np.abs(solution.trajectory.inputs[:, 0]) < 1e-9
        return float(np.argmin(still)) * solution.trajectory.period

    @pytest.mark.parametrize("rate", [0.05, 1.0])
    @pytest.mark.slow
    def test_takes_its_time(self, rate: float):
        solution = self.steered(SteeringRate(bounds=rate))
        assert solution.evaluation.feasible
        angle = solution.trajectory.inputs[:, 1].max()
        needed = angle / rate
        assert needed <= self.standing(solution) <= needed + 2 * solution.trajectory.period

    @pytest.mark.slow
    def test_takes_a_quarter_second_without_a_limit(self):
        # In periods of 0.4 s: it is told to two of them.
        solution = self.steered(samples=150)
        period = solution.trajectory.period
        assert 0.25 <= self.standing(solution) <= 0.25 + 2 * period

    @pytest.mark.slow
    def test_a_one_sided_rate(self):
        problem = self.problem(SteeringRate(bounds=(-0.1, 2.0)), duration=40, samples=200)
        (solution,) = baselines(problem, "figure_eight")
        assert solution.evaluation.feasible
        rates = np.diff(solution.trajectory.inputs[:, 1]) / solution.trajectory.period
        assert rates.min() == pytest.approx(-0.1, rel=0.1)
        assert rates.max() > 0.2

    @pytest.mark.slow
    def test_keeps_its_angle_at_ends_that_need_no_rest(self):
        solution = self.steered(rest_to_rest=False)
        assert solution.evaluation.feasible
        assert np.ptp(solution.trajectory.inputs[:, 1]) < 1e-12
        assert solution.trajectory.inputs[0, 1] > 0.1

    @pytest.mark.slow
    def test_hurried_steering_is_named(self):
        solution = self.steered(SteeringRate(bounds=0.01), name="figure_eight")
        assert not solution.evaluation.feasible
        assert "steering_rate" in solution.evaluation.violations

    @pytest.mark.slow
    def test_random_paths(self):
        (solution,) = baselines(self.problem(SteeringRate(bounds=0.3)), "random")
        assert solution.evaluation.feasible
        assert solution.evaluation.path_length > 0.1
        assert np.abs(solution.trajectory.inputs[:, 1]).max() > 0.01

    @pytest.mark.slow
    def test_every_run_drives_from_its_own_start_and_the_other_way(self):
        starts = ({"x": -1}, {"x": 1, "heading": 1.0})
        solution = self.steered(name="figure_eight", runs=2, start=starts)
        assert solution.evaluation.feasible
        first, second = np.split(solution.trajectory.inputs, 2)
        np.testing.assert_allclose(first[:, 0], second[:, 0], atol=1e-9)
        np.testing.assert_allclose(first[:, 1], -second[:, 1], atol=1e-9)
        assert np.abs(first).max() > 1
        assert solution.trajectory.starts.tolist() == [[-1, 0, 0], [1, 0, 1]]


class TestSizes:
    @pytest.mark.slow
    @pytest.mark.parametrize("radius", [0.3, 1.49])
    def test_a_turning_radius_leaves_an_interval_of_sizes(self, radius: float):
        limits = (*usual_limits(TWO_SIDED), TurningRadius(bounds=radius))
        solution = driven_once(robot_problem(TWO_SIDED, limits=limits), "circle")
        assert solution.evaluation.feasible
        assert np.ptp(solution.evaluation.path[:, 1]) == pytest.approx(3, rel=1e-3)

    @pytest.mark.slow
    def test_no_size_at_all(self):
        limits = (*usual_limits(TWO_SIDED), TurningRadius(bounds=1.6))
        (solution,) = baselines(robot_problem(TWO_SIDED, limits=limits), "circle")
        assert not solution.evaluation.feasible
        assert set(solution.evaluation.violations) <= {"turning_radius", "workspace"}

    @pytest.mark.slow
    def test_the_tightest_room_for_a_car(self):
        # Steered 0.6 rad, the car's circle is 0.965 m wide: one room has place for it, the other not.
        for half, fits in ((0.98, True), (0.95, False)):
            limits = (*usual_limits(ACKERMANN)[:3], Rectangle(x=(-2, 2), y=(-half, half)))
            (solution,) = baselines(robot_problem(ACKERMANN, limits=limits), "circle")
            assert solution.evaluation.feasible == fits

    @pytest.mark.slow
    def test_a_free_start_uses_a_room_with_a_corner(self):
        room = Polygon(points=((0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)))
        problem = robot_problem(
            TWO_SIDED,
            design=DesignSpace(duration=30, samples=60, start="free"),
            limits=(*usual_limits(TWO_SIDED)[:2], room),
        )
        (solution,) = baselines(problem, "straight")
        assert solution.evaluation.feasible
        # Along one of its arms, not in the corner between them.
        assert np.ptp(solution.evaluation.path[:, :2], axis=0).max() > 3
