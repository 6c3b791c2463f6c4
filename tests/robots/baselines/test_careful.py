"""What a careful person does with a car, in several runs, and within limits of the body's speeds."""

from __future__ import annotations

import numpy as np
import pytest
from builders import ACCELERATION, problem_of

from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status
from oed.robots.baselines import NAMES, baselines
from oed.robots.baselines.patterns import rounded_square, slalom
from oed.robots.baselines.rolling import Roll, smallest_size, steering, tightest
from oed.robots.limits import (
    LateralAcceleration,
    Rectangle,
    SteeringAngle,
    SteeringRate,
    TurningRadius,
    WheelSpeed,
    YawRateLimit,
)
from oed.robots.models import Ackermann, DifferentialDrive, SkidSteer, Tricycle
from oed.robots.sensors import Displacements, Poses
from oed.workflow.studies import parse_study

POSES = Poses(noise={"position": 0.01, "heading": 0.02})
CAR = Ackermann(wheel_radius=0.05, wheelbase=0.33)
ROOM = Rectangle(x=(-2.5, 2.5), y=(-2.5, 2.5))


def car(model=CAR, angle: float = 0.436, **parts) -> Problem:
    limits = (
        WheelSpeed(bounds=(-20, 40)),
        ACCELERATION,
        SteeringAngle(bounds=angle),
        SteeringRate(bounds=2.0),
        LateralAcceleration(bounds=2.0),
        ROOM,
    )
    usual = {"model": model, "measurement": POSES, "limits": limits, "duration": 20, "samples": 40}
    return problem_of(**{**usual, **parts})


def runs(solution: Solution) -> list[np.ndarray]:
    """The path of every run."""
    return np.split(solution.evaluation.path, solution.trajectory.runs)


class TestCars:
    @pytest.mark.parametrize("model", [CAR, Tricycle(wheel_radius=0.05, wheelbase=0.33)])
    def test_the_tightest_arc_is_that_of_the_largest_angle(self, model):
        assert tightest(car(model)) == pytest.approx(0.33 / np.tan(0.436), rel=0.01)

    def test_a_limit_of_the_turning_radius_counts_too(self):
        assert tightest(car(also=(TurningRadius(bounds=1.1),))) == pytest.approx(1.1, rel=0.01)
        own = problem_of(also=(TurningRadius(bounds=0.4),))
        assert tightest(own) == pytest.approx(0.4, rel=0.01)
        assert tightest(problem_of()) == 0

    def test_a_small_square_is_as_round_as_the_car_turns(self):
        corners = [move for move in rounded_square(2.0, 0, 0.7) if move.turn]
        assert [abs(move.forward / move.turn) for move in corners] == pytest.approx([0.7] * 8)
        assert sum(move.forward for move in rounded_square(2.0, 0, 0.7)) == pytest.approx(
            2 * (4 * 0.6 + 2 * np.pi * 0.7)
        )

    def test_a_short_slalom_bends_less(self):
        arcs = slalom(2.0, 0, 0.7)
        assert [abs(arc.forward / arc.turn) for arc in arcs] == pytest.approx([0.7] * 6)
        assert 8 * 0.7 * np.sin(arcs[0].turn) == pytest.approx(2.0)

    def test_no_square_is_smaller_than_a_circle(self):
        problem = car()
        found = smallest_size(problem, lambda size, lap: rounded_square(size, lap, tightest(problem)))
        assert found == pytest.approx(2 * tightest(problem), rel=1e-6)

    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["rounded_square", "slalom"])
    def test_they_are_large_and_roll(self, name: str):
        (solution,) = baselines(car(), name)
        assert solution.evaluation.feasible
        assert np.ptp(solution.evaluation.path[:, :2], axis=0).max() > 2
        if name != "slalom":
            # A slalom's laps end where the car turns back.
            rolling = np.flatnonzero(np.abs(solution.trajectory.inputs[:, 0]) > 1e-9)
            np.testing.assert_array_equal(np.diff(rolling), 1)

    @pytest.mark.slow
    def test_what_no_size_allows_is_the_smallest_that_it_can_turn(self):
        (solution,) = baselines(car(duration=6, samples=30), "figure_eight")
        assert not solution.evaluation.feasible
        assert "steering_angle" not in solution.evaluation.violations
        assert "though the robot turns as tightly as it can" in solution.message


def rolled(way: float) -> Roll:
    return Roll(np.array([1.0, 2.0, 1.5]), np.array([0.0, 0.5, -0.5]), way)


@pytest.mark.parametrize("way", [1.0, -1.0])
class TestRolling:
    def test_turns_and_lengths_stay_what_they_are(self, way: float):
        lengths, turns = rolled(way).steps(np.linspace(0, 1, 41), 0.6)
        assert lengths.sum() == pytest.approx(4.5)
        assert turns.sum() == pytest.approx(way * (2.0 * 0.5 - 1.5 * 0.5))

    def test_the_curvature_changes_steadily_over_the_distance(self, way: float):
        lengths, turns = rolled(way).steps(np.linspace(0, 1, 401), 0.6)
        curvatures = way * turns / lengths
        assert np.abs(np.diff(curvatures)).max() <= 4.5 / 400 * 1.0 / 0.6 * (1 + 1e-6)
        assert curvatures.max() == pytest.approx(0.5)
        assert curvatures.min() == pytest.approx(-0.5)

    def test_angles_make_the_curvatures(self, way: float):
        steered = steering(car())
        wanted = np.array([-1.2, -0.3, 0.0, 0.7, 1.3])
        np.testing.assert_allclose(np.tan(steered.angles_of(wanted)) / 0.33, wanted, atol=1e-5)


@pytest.mark.slow
class TestRuns:
    def several(self, **parts) -> Problem:
        usual = {"measurement": POSES, "runs": 3, "start": "free", "duration": 10, "samples": 30}
        return problem_of(**{**usual, **parts})

    def turned(self, name: str, **parts) -> list[float]:
        return self.turns(*baselines(self.several(**parts), name))

    def turns(self, solution: Solution) -> list[float]:
        assert solution.evaluation.feasible
        return [float(path[-1, 2] - path[0, 2]) for path in runs(solution)]

    @pytest.mark.parametrize("name", ["circle", "square"])
    def test_they_take_turns_in_direction(self, name: str):
        first, second, third = self.turned(name)
        assert abs(first) == pytest.approx(2 * np.pi, rel=0.01)
        assert second == pytest.approx(-first)
        assert third == pytest.approx(first)

    def test_one_run_too_short_for_both_directions_has_one(self):
        (solution,) = baselines(self.several(runs=1), "square")
        assert "one way round" in solution.message
        assert self.turns(solution) == [pytest.approx(2 * np.pi, rel=0.01)]
        (longer,) = baselines(self.several(runs=1, duration=30), "square")
        assert "one way round" not in longer.message
        assert self.turns(longer) == [pytest.approx(0, abs=0.05)]

    def test_a_straight_begins_at_its_other_end_where_it_may(self):
        (solution,) = baselines(self.several(runs=2), "straight")
        there, back = runs(solution)
        assert abs(np.cos(there[0, 2] - back[0, 2]) + 1) < 1e-9
        (solution,) = baselines(self.several(runs=2, start={"x": 0}), "straight")
        there, back = runs(solution)
        np.testing.assert_allclose(there, back)

    def test_from_a_wall_the_same_way_in_every_run_may_be_better(self):
        found = self.turned("circle", runs=2, start={"y": 0.9}, limits=(WheelSpeed(bounds=(0, 10)), ROOM))
        assert abs(found[0]) > 6


class TestRandom:
    @pytest.mark.parametrize("samples", [30, 60])
    def test_some_limit_is_reached(self, samples: int):
        problem = problem_of(
            model=DifferentialDrive(wheel_radius=0.033, track=0.16),
            limits=(WheelSpeed(bounds=6.67),),
            measurement=POSES,
            samples=samples,
        )
        (solution,) = baselines(problem, "random")
        assert solution.evaluation.feasible
        (speed,) = [margin for margin in solution.evaluation.margins if margin.name == "wheel_speed"]
        assert speed.margin < 1e-6 * speed.size


@pytest.mark.slow
def test_slow_turns_leave_the_straights_fast():
    # Half of the drives below would be a tenth of the size, were all of it as slow as its turns.
    limits = (WheelSpeed(bounds=6), ACCELERATION, YawRateLimit(bounds=1.0), Rectangle(x=(-6, 6), y=(-6, 6)))
    husky = SkidSteer(wheel_radius=0.165, track=0.55)
    problem = problem_of(model=husky, limits=limits, measurement=POSES, duration=40, samples=30)
    for name in ("square", "straight_and_spin"):
        (solution,) = baselines(problem, name)
        assert solution.evaluation.feasible
        assert solution.evaluation.path_length > 10


@pytest.mark.slow
def test_a_heavy_robot_in_a_small_room_has_drives_that_identify_it():
    """A Husky in 3 m x 3 m, whose displacements are measured for 20 s."""
    limits = (
        WheelSpeed(bounds=6.06),
        ACCELERATION.model_copy(update={"bounds": (-6.06, 6.06)}),
        YawRateLimit(bounds=1.0),
        Rectangle(x=(-1.5, 1.5), y=(-1.5, 1.5)),
    )
    model = SkidSteer(wheel_radius=0.165, track=0.999, body_radius=0.598)
    measurement = Displacements(segments=10, noise={"position": 0.01})
    problem = problem_of(model=model, limits=limits, measurement=measurement, duration=20, samples=30)
    # With turns in place and without.
    for name in ("square", "slalom"):
        (solution,) = baselines(problem, name)
        assert solution.evaluation.feasible
        assert solution.evaluation.identifiable
        assert solution.evaluation.path_length > 1


def test_no_baseline_refuses_a_study():
    study = parse_study(
        "format: 1\n"
        "name: Car\n"
        "robot: {kind: ackermann, wheel_radius: 5 cm, wheelbase: 33 cm}\n"
        "trajectory: {duration: 10 s, samples: 40, spline: {coefficients: 8}}\n"
        "measurement: {kind: poses, noise: {position: 1 cm, heading: 1 deg}}\n"
        "limits: {wheel_speed: 20, steering_angle: 25 deg}\n"
        f"baselines: [{', '.join(NAMES)}]\n"
    )
    solutions = {name: baselines(study.problem, name)[0] for name in ("square", "sideways_straight")}
    assert {one.status for one in solutions.values()} == {Status.IMPOSSIBLE}
    assert "it cannot turn in place" in solutions["square"].message
    assert "it cannot move sideways" in solutions["sideways_straight"].message
