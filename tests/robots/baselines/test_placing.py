"""Where baselines are driven, how often, and what a careful person gains by it."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from builders import ACCELERATION, BOX, SPEED, driven_once, make_flagship, problem_of

from oed.robots.baselines import Move, baselines
from oed.robots.baselines.patterns import circle, figure_eight, square, straight
from oed.robots.baselines.placing import approach, joined, placements, traced
from oed.robots.limits import CircularObstacle, Obstacles, Rectangle, WheelSpeed
from oed.robots.space import DesignSpace


def problem(start, limits=(SPEED, ACCELERATION, BOX), duration=40.0):
    return problem_of(design=DesignSpace(duration=duration, samples=80, start=start), limits=limits)


class TestTraced:
    def test_a_circle(self):
        points = traced(circle(2.0, 0), (1.0, 2.0, 0.0))
        np.testing.assert_allclose(np.hypot(points[:, 0] - 1, points[:, 1] - 3), 1, rtol=1e-12)
        np.testing.assert_allclose(points[-1], [1, 2], atol=1e-12)

    def test_a_square_closes(self):
        np.testing.assert_allclose(traced(square(0.7, 0), (0.0, 0.0, 0.3))[-1], 0, atol=1e-12)

    def test_sideways(self):
        np.testing.assert_allclose(
            traced([Move(0, 0, 2.0)], (0.0, 0.0, math.pi / 2))[-1], [-2, 0], atol=1e-12
        )


class TestJoined:
    def test_laps_of_a_circle_are_one_arc(self):
        (arc,) = joined([*circle(1.0, 0), *circle(1.0, 1)])
        assert (arc.forward, arc.turn) == pytest.approx((2 * math.pi, 4 * math.pi))

    def test_there_and_back_are_two(self):
        assert len(joined([*straight(1.0, 0), *straight(1.0, 1)])) == 2

    def test_an_eight_stays_two_circles(self):
        assert len(joined(figure_eight(1.0, 0))) == 2


@pytest.mark.parametrize("goal", [(1.0, 2.0, 0.5), (-1.0, 0.0, math.pi), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)])
def test_the_approach_arrives(goal):
    moves = approach((0.0, 0.0, 0.2), goal)
    end = traced(moves, (0.0, 0.0, 0.2))[-1]
    np.testing.assert_allclose(end, goal[:2], atol=1e-12)
    turned = 0.2 + sum(move.turn for move in moves)
    assert math.remainder(turned - goal[2], math.tau) == pytest.approx(0, abs=1e-12)


def test_where_there_is_no_way_there_is_one_turn_at_most():
    # The direction of a rounding error is none: a robot would turn to it, stop, and turn again.
    (turn,) = approach((0.0, 0.0, 0.0), (2e-17, 1e-17, -0.8))
    assert (turn.forward, turn.turn) == (0.0, -0.8)


class TestPlaced:
    def test_from_the_middle_a_circle_drives_off_to_be_twice_as_large(self):
        anchored, anywhere = placements(problem({"x": 0}), circle, 3.0)
        assert anchored.largest == pytest.approx(1, rel=0.06)
        assert anywhere.largest == pytest.approx(2, rel=0.06)

    def test_a_straight_lies_along_the_diagonal(self):
        *_, anywhere = placements(problem({"x": 0}), straight, 3.0)
        assert anywhere.largest == pytest.approx(2 * math.sqrt(2), rel=0.01)

    def test_beside_a_wall_left_and_right_are_exchanged(self):
        anchored, *_ = placements(problem({"y": 0.9}), circle, 3.0)
        assert anchored.mirrored
        assert anchored.largest > 1

    def test_before_a_wall_the_straight_is_driven_backwards(self):
        anchored, *_ = placements(problem({"x": 0.9}), straight, 3.0)
        assert anchored.reversed
        assert anchored.largest == pytest.approx(1.9, rel=0.01)

    def test_a_free_start_needs_no_approach(self):
        (only,) = placements(problem("free"), circle, 3.0)
        assert only.largest == pytest.approx(2, rel=0.06)

    def test_wheels_that_only_turn_forwards_cannot_turn_round_first(self):
        forward = (WheelSpeed(bounds=(0, 10)), ACCELERATION, BOX)
        (only,) = placements(problem({"x": 0.9}, forward), straight, 3.0)
        assert not only.reversed
        assert only.largest == pytest.approx(0.1, rel=0.05)

    @pytest.mark.slow
    def test_around_an_obstacle_it_goes_elsewhere(self):
        room = Rectangle(x=(-2, 2), y=(-1, 1))
        post = Obstacles(shapes=(CircularObstacle(x=0, y=0, radius=0.3),))
        (only,) = placements(problem("free", (SPEED, ACCELERATION, room, post)), figure_eight, 4.0)
        x, y = only.centre
        assert abs(x) > 0.5 or abs(y) > 0.3
        assert only.largest > 0.5


def legs(solution):
    """Of a drive that turns in place and drives straight on in turns: by how much [deg, m], in order."""
    found = []
    for x, y, turn in np.diff(solution.evaluation.path, axis=0):
        turning, amount = abs(turn) > 1e-9, math.degrees(abs(turn)) + math.hypot(x, y)
        if amount > 1e-6:
            known = found and found[-1][0] == turning
            found[-1:] = [(turning, found[-1][1] + amount)] if known else [*found[-1:], (turning, amount)]
    return [amount for _, amount in found]


@pytest.mark.slow
class TestChosen:
    def test_from_a_corner_the_square_is_as_good_as_from_the_middle(self):
        corner = {"x": -0.95, "y": -0.95, "heading": -2.3}
        (solution,) = baselines(problem(corner), "square")
        assert solution.evaluation.feasible
        assert solution.trajectory.start.tolist() == [-0.95, -0.95, -2.3]
        assert np.ptp(solution.evaluation.path[:, :2], axis=0).min() > 0.3

    def test_more_laps_than_one_where_they_pay(self):
        flagship = make_flagship(design=DesignSpace(duration=20, samples=80))
        chosen, once = baselines(flagship, "figure_eight")[0], driven_once(flagship, "figure_eight")
        assert chosen.evaluation.objective > 2 * once.evaluation.objective
        turned = np.abs(np.diff(chosen.evaluation.path[:, 2])).sum()
        assert turned > 1.9 * np.abs(np.diff(once.evaluation.path[:, 2])).sum()

    def test_a_message_says_laps_size_and_the_way_there(self):
        turn = r"turning by (.*) deg in place"
        pattern = rf"1 lap of (.*) m, after {turn}, driving (.*) m and {turn}\."
        for solution in baselines(problem({"x": 0}), "straight", length=2.0):
            size, *way = map(float, re.fullmatch(pattern, solution.message).groups())
            assert [*way, size] == pytest.approx(legs(solution), rel=0.01)

    def test_from_a_free_start_there_is_no_way(self):
        (solution,) = baselines(problem("free"), "circle")
        assert re.fullmatch(r"\d+ laps? of [\d.]+ m\.", solution.message)

    def test_what_cannot_be_made_says_why(self):
        forward = (WheelSpeed(bounds=(0, 10)), ACCELERATION, BOX)
        (solution,) = baselines(problem({"x": 0}, forward), "straight_and_spin")
        assert not solution.evaluation.feasible
        assert "it exceeds wheel_speed" in solution.message
