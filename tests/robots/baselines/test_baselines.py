"""Everyday paths: their geometry, that they fit the study, and that they are scored as designs are."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from builders import ACCELERATION, BOX, RADIUS, SPEED, TRACK, driven_once, make_flagship, problem_of

from oed.foundation.errors import ProblemError
from oed.kernel.criteria import E
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status
from oed.robots.baselines import NAMES, Move, baselines
from oed.robots.baselines.kinematics import Kinematics
from oed.robots.limits import Rectangle, WheelSpeed
from oed.robots.models import DifferentialDrive, SkidSteer, SkidSteerSlip
from oed.robots.sensors import Poses
from oed.robots.space import DesignSpace

FULL_TURN = 2 * np.pi
SAMPLING = 0.02
"""Share of a path's size by which sampling its speeds may bend it."""

OWN = tuple(name for name in NAMES if not name.startswith("sideways"))
"""What a differential drive can drive."""

# Of slaloms, eights and rounded squares the choice of laps and places is looked at with other robots.
CHOSEN = ("straight", "circle", "square", "straight_and_spin", "random")

every = pytest.mark.parametrize("name", CHOSEN)
patterns = pytest.mark.parametrize("name", [name for name in CHOSEN if name != "random"])
# What a study has is the same for all patterns: one that ends elsewhere, one that closes, and none.
some = pytest.mark.parametrize("name", ["straight", "circle", "random"])


LENGTH = 8.0
"""Of a drive [m], for which the room is too small for a single lap."""


@pytest.fixture(scope="module")
def flagship() -> Problem:
    """With a third of its samples, which are enough for all the paths."""
    return make_flagship(design=DesignSpace(duration=20, samples=70))


@pytest.fixture(scope="module")
def both(flagship: Problem) -> dict[str, list[Solution]]:
    """Every path as it is chosen, and of that length."""
    return {name: baselines(flagship, name, length=LENGTH) for name in CHOSEN}


@pytest.fixture(scope="module")
def chosen(both: dict[str, list[Solution]]) -> dict[str, Solution]:
    return {name: first for name, (first, _) in both.items()}


@pytest.fixture(scope="module")
def largest(flagship: Problem) -> dict[str, Solution]:
    return {name: driven_once(flagship, name) for name in (*CHOSEN[:-1], "figure_eight")}


def path(solution: Solution) -> np.ndarray:
    return solution.evaluation.path


@pytest.mark.slow
class TestInTheFlagship:
    """The paper's robot in a 2 m box, started in its middle."""

    @every
    def test_it_can_be_driven(self, chosen, name: str):
        assert chosen[name].evaluation.feasible
        assert chosen[name].evaluation.violations == {}

    @every
    def test_it_takes_the_studys_time_and_start(self, chosen, flagship: Problem, name: str):
        drive = chosen[name].trajectory
        assert drive.duration == flagship.design.duration
        assert drive.samples == flagship.design.samples
        assert drive.start.tolist() == [0, 0, 0]

    @every
    def test_it_is_scored_by_evaluate(self, chosen, flagship: Problem, name: str):
        solution = chosen[name]
        again = evaluate(flagship, solution.trajectory)
        assert solution.evaluation.objective == again.objective
        assert solution.evaluation.path_length == again.path_length
        np.testing.assert_array_equal(path(solution), again.path)
        assert (solution.name, solution.kind, solution.status) == (name, "baseline", Status.SCORED)

    @patterns
    def test_it_is_as_large_as_the_limits_allow(self, chosen, name: str):
        margins = {margin.name: margin for margin in chosen[name].evaluation.margins}
        limits = ("wheel_speed", "wheel_acceleration", "workspace")
        assert any(margins[limit].margin < 0.02 * margins[limit].size for limit in limits)

    def test_straight(self, largest):
        assert np.abs(path(largest["straight"])[:, 1:]).max() < 1e-9
        assert path(largest["straight"])[-1, 0] == pytest.approx(1, rel=1e-3)

    def test_a_straight_tells_nothing_apart(self, largest):
        assert largest["straight"].evaluation.singular
        assert largest["straight"].evaluation.objective == pytest.approx(0, abs=1e-9)

    def test_the_circle_closes(self, largest):
        poses = path(largest["circle"])
        diameter = np.ptp(poses[:, 1])
        assert diameter == pytest.approx(1, rel=SAMPLING)
        assert np.ptp(poses[:, 0]) == pytest.approx(diameter, rel=SAMPLING)
        assert np.hypot(*poses[-1, :2]) < SAMPLING * diameter
        assert poses[-1, 2] == pytest.approx(FULL_TURN, rel=1e-3)
        centre = np.array([0, diameter / 2])
        radii = np.hypot(*(poses[:, :2] - centre).T)
        np.testing.assert_allclose(radii, diameter / 2, rtol=SAMPLING)

    def test_the_squares_corners(self, largest):
        poses = path(largest["square"])
        side = largest["square"].evaluation.path_length / 8
        corners = [(x, y) for x in (0, 1) for y in (-1, 0, 1)]
        for corner in corners:
            distances = np.hypot(*(poses[:, :2] - np.array(corner) * side).T)
            assert distances.min() < 2 * SAMPLING * side
        # Along the sides and nowhere else, and as far to the left as to the right.
        to_sides = np.minimum(
            np.abs(poses[:, [0]] / side - [0, 1]).min(axis=1),
            np.abs(poses[:, [1]] / side - [-1, 0, 1]).min(axis=1),
        )
        assert to_sides.max() < 2 * SAMPLING
        assert poses[:, 2].max() == pytest.approx(FULL_TURN, rel=SAMPLING)
        assert poses[-1, 2] == pytest.approx(0, abs=SAMPLING)
        assert np.hypot(*poses[-1, :2]) < 2 * SAMPLING * side

    def test_figure_eight(self, largest):
        poses = path(largest["figure_eight"])
        assert poses[:, 1].max() == pytest.approx(-poses[:, 1].min(), rel=SAMPLING)
        assert poses[:, 2].max() == pytest.approx(FULL_TURN, rel=1e-3)
        np.testing.assert_allclose(poses[-1], 0, atol=SAMPLING)

    def test_straight_and_spin(self, largest):
        solution = largest["straight_and_spin"]
        poses = path(solution)
        assert poses[:, 2].max() == pytest.approx(FULL_TURN, rel=1e-3)
        assert poses[:, 2].min() == pytest.approx(0, abs=1e-2)
        np.testing.assert_allclose(poses[-1], 0, atol=SAMPLING)
        assert np.abs(poses[:, 1]).max() < SAMPLING
        assert solution.evaluation.path_length == pytest.approx(2 * poses[:, 0].max(), rel=SAMPLING)

    @patterns
    def test_nothing_is_lost_by_choosing(self, chosen, largest, name: str):
        assert chosen[name].evaluation.objective >= largest[name].evaluation.objective * (1 - 1e-3)

    @pytest.mark.slow
    @every
    def test_the_same_length(self, both, name: str):
        largest, fitted = both[name]
        assert fitted.name == f"{name}_same_length"
        assert fitted.evaluation.path_length == pytest.approx(LENGTH, rel=1e-3)
        assert fitted.trajectory.duration == largest.trajectory.duration == 20

    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["straight", "circle"])
    def test_a_long_way_takes_more_laps_not_more_room(self, both, name: str):
        largest, fitted = both[name]
        for axis in (0, 1):
            assert np.abs(path(fitted)[:, axis]).max() <= np.abs(path(largest)[:, axis]).max() * (
                1 + SAMPLING
            )


class TestForwardOnly:
    """Wheels that do not turn backwards cannot spin on the spot."""

    problem = problem_of(limits=(WheelSpeed(bounds=(0, 10)), ACCELERATION, BOX))

    @pytest.mark.parametrize("name", ["square", "straight_and_spin"])
    @pytest.mark.slow
    def test_spins_exceed_the_wheel_speed(self, name: str):
        (solution,) = baselines(self.problem, name)
        assert not solution.evaluation.feasible
        assert "wheel_speed" in solution.evaluation.violations
        assert "It cannot be driven here: it exceeds" in solution.message
        assert "wheel_speed" in solution.message

    @pytest.mark.parametrize("name", ["straight", "circle", "figure_eight", "random"])
    @pytest.mark.slow
    def test_the_others_can_be_driven(self, name: str):
        (solution,) = baselines(self.problem, name)
        assert solution.evaluation.feasible
        assert solution.evaluation.path_length > 0.1


ROBOTS = {
    "slip": SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=0.12, slip_inner=-0.05),
    "unequal radii": DifferentialDrive(wheel_radius_right=0.052, wheel_radius_left=0.047, track=TRACK),
}


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS.keys())
class TestOtherRobots:
    @pytest.mark.parametrize("name", ["circle", "figure_eight", "square", "straight_and_spin"])
    def test_the_path_still_closes(self, robot, name: str):
        solution = driven_once(problem_of(model=robot, duration=20, samples=70), name)
        assert solution.evaluation.feasible
        size = np.ptp(path(solution)[:, :2], axis=0).max()
        assert size > 0.3
        assert np.hypot(*path(solution)[-1, :2]) < 2 * SAMPLING * size

    def test_the_straight_is_straight(self, robot):
        solution = driven_once(problem_of(model=robot), "straight")
        assert np.abs(path(solution)[:, 1:]).max() < 1e-6


class TestStudies:
    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["circle", "random"])
    def test_a_short_length(self, name: str):
        fitted = baselines(problem_of(), name, length=0.5)[1]
        assert fitted.evaluation.path_length == pytest.approx(0.5, rel=1e-3)

    @pytest.mark.slow
    @some
    def test_of_a_free_start_lies_in_the_middle_of_the_room(self, name: str):
        problem = problem_of(
            design=DesignSpace(duration=10, samples=40, start="free"),
            limits=(SPEED, ACCELERATION, Rectangle(x=(3, 5), y=(-1, 0))),
        )
        (solution,) = baselines(problem, name)
        assert solution.evaluation.feasible
        if name == "random":
            assert solution.trajectory.start.tolist() == [4, -0.5, 0]
            return
        low, high = path(solution)[:, :2].min(axis=0), path(solution)[:, :2].max(axis=0)
        np.testing.assert_allclose((low + high) / 2, [4, -0.5], atol=2 * SAMPLING)

    @pytest.mark.slow
    @some
    def test_without_room_or_acceleration_limit(self, name: str):
        problem = problem_of(limits=(SPEED,))
        (solution,) = baselines(problem, name)
        assert solution.evaluation.feasible
        assert solution.evaluation.path_length > 0.1

    @pytest.mark.slow
    @some
    def test_a_start_with_a_heading(self, name: str):
        start = {"x": 0.3, "y": -0.2, "heading": 2.5}
        problem = problem_of(start=start)
        (solution,) = baselines(problem, name)
        assert solution.trajectory.start.tolist() == [0.3, -0.2, 2.5]
        assert solution.evaluation.feasible

    @pytest.mark.slow
    def test_random_paths_are_reproducible(self):
        problem = problem_of()
        first, again, other = (baselines(problem, "random", seed=seed)[0].trajectory for seed in (1, 1, 2))
        np.testing.assert_array_equal(first.coefficients, again.coefficients)
        assert np.abs(first.coefficients - other.coefficients).max() > 0.1

    @pytest.mark.slow
    def test_patterns_do_not_depend_on_the_seed(self):
        problem = problem_of()
        first, other = (baselines(problem, "circle", seed=seed)[0].trajectory for seed in (1, 2))
        np.testing.assert_array_equal(first.coefficients, other.coefficients)

    def test_an_unknown_name(self):
        with pytest.raises(ProblemError, match=r"expected one of straight, circle, .*got 'triangle'"):
            baselines(problem_of(), "triangle")


def slipping(per_yaw_rate: float) -> SkidSteerSlip:
    return SkidSteerSlip(wheel_radius=RADIUS, track=TRACK, track_per_yaw_rate=per_yaw_rate)


@pytest.mark.slow
class TestRobotsThatCannotTurnFaster:
    """The effective track grows with the yaw rate, which therefore has a least upper bound: track / k."""

    @pytest.mark.parametrize(
        ("per_yaw_rate", "names"),
        [(0.04, ["straight_and_spin"]), (5.0, ["straight", "circle"])],
    )
    def test_every_path_is_finite_and_says_what_it_exceeds(self, per_yaw_rate: float, names: list[str]):
        problem = problem_of(
            model=slipping(per_yaw_rate),
            measurement=Poses(noise={"position": 0.01, "heading": 0.01}),
            limits=(SPEED, ACCELERATION, BOX),
            criterion=E(),
        )
        for name in names:
            for solution in baselines(problem, name, length=1.0):
                assert np.isfinite(solution.trajectory.inputs).all()
                assert np.isfinite(path(solution)).all()
                assert set(solution.evaluation.violations) <= {"wheel_speed", "wheel_acceleration"}
                assert ("exceeds" in solution.detail) == (not solution.evaluation.feasible)
                assert solution.evaluation.feasible or name != "straight"

    @pytest.mark.parametrize("per_yaw_rate", [0.0, 0.04, 0.4])
    def test_inputs_make_what_can_be_made(self, per_yaw_rate: float):
        robot = slipping(per_yaw_rate)
        inverse, fastest = Kinematics(robot), TRACK / max(per_yaw_rate, 1e-3)
        for share in (0.01, 0.3, 0.9):
            wanted = np.array([[0.2, share * fastest]])
            (inputs,) = inverse.inputs(wanted, np.zeros((1, 0)))
            made = np.array(ca.evalf(robot.twist(ca.DM(inputs), ca.DM(robot.nominal)))).ravel()
            np.testing.assert_allclose(made[[0, 2]], wanted[0], rtol=1e-6)
        (inputs,) = inverse.inputs(np.array([[0.2, 1.5 * fastest]]), np.zeros((1, 0)))
        assert np.isfinite(inputs).all()

    def test_moves_beyond_it_are_made_more_slowly(self):
        robot = slipping(0.4)
        values, made = Kinematics(robot).directions([Move(0.0, FULL_TURN), Move(1.0, 0.0)], np.zeros((2, 2)))
        assert made.all()
        assert np.isfinite(values).all()
        assert values[0, 0] == pytest.approx(-values[0, 1])
        # No less than wheels that never slip would need.
        assert FULL_TURN * TRACK / 2 / RADIUS < values[0, 0] < 10 * FULL_TURN * TRACK / 2 / RADIUS
