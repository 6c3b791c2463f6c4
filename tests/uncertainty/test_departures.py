"""How many robots leave their limits: against scoring them one by one."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from math import erf
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np
import pytest
from builders import ACCELERATION, RADIUS, SPEED, TRACK, problem_of, random_drive
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from oed.kernel.criteria import E
from oed.kernel.dynamics.system import Input, Parameter
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.limit import PathLimit, Rows
from oed.kernel.problem import Problem
from oed.kernel.results import TOLERANCE
from oed.kernel.solution import Violation
from oed.robots.limits import Obstacles, PathLength, Rectangle, TrailerAngle
from oed.robots.models import TractorTrailer
from oed.robots.models.model import Model
from oed.robots.sensors import Poses
from oed.robots.space import DesignSpace
from oed.uncertainty.departures import (
    departures,
    interval_of,
    path_limits,
    paths,
    violated,
    violation_probability,
)
from oed.uncertainty.uncertainty import spread_of

RIGHT, LEFT = "wheel_radius_right", "wheel_radius_left"
RADII = {RIGHT: "5 %", LEFT: "5 %", "track": "5 %"}
SENSOR = Poses(noise={"position": 0.01, "heading": 0.02})
COUNT, FEW = 12, 9
"""Robots of the case with two limits, and of the others."""


uncertain_problem = partial(
    problem_of,
    duration=6,
    samples=12,
    measurement=SENSOR,
    criterion=E(scaling="relative"),
    limits=(SPEED, ACCELERATION),
    within=RADII,
)


def farthest(within: dict[str, Any] = RADII, seed: int = 2, **parts: Any) -> tuple[Trajectory, np.ndarray]:
    """A drive, and how far its nominal path goes along x and y."""
    problem = uncertain_problem(within=within, **parts)
    drive = random_drive(problem, seed, 7.0)
    return drive, np.abs(evaluate(problem, drive).path[:, :2]).max(axis=0)


def boxed(share: float = 1.01, **parts: Any) -> tuple[Problem, Trajectory]:
    """A room that is larger than the nominal path by a share, and another limit that it touches."""
    drive, (x, y) = farthest(**parts)
    room = Rectangle(x=(-share * x, share * x), y=(-2 * y, 2 * y))
    tip = evaluate(uncertain_problem(**parts), drive).path[-1]
    column = {"kind": "circle", "x": tip[0] + 0.3, "y": tip[1], "radius": 0.3 - 0.005}
    return uncertain_problem(also=(room, Obstacles(shapes=[column]), PathLength(bounds=1000)), **parts), drive


def bulging() -> tuple[Problem, Trajectory]:
    """A room that a circle's top leaves between two samples: the nominal robot's just does not."""
    plain = uncertain_problem()
    coefficients = np.zeros((8, 2))
    coefficients[1:-1] = 7.4, 3.7
    drive = plain.design.trajectory(coefficients, plain.fixed_starts)
    top = evaluate(plain, drive).path[:, 1].max()
    return uncertain_problem(also=(Rectangle(x=(-3, 3), y=(-top, top)),)), drive


def trailing() -> tuple[Problem, Trajectory]:
    robot = TractorTrailer(wheel_radius=RADIUS, track=TRACK, hitch_offset=0.1, trailer_length=0.4)
    within = {RIGHT: "5 %", "trailer_length": "10 %"}
    drive, _ = farthest(within=within, model=robot)
    largest = np.abs(evaluate(uncertain_problem(within=within, model=robot), drive).path[:, 3]).max()
    return uncertain_problem(
        also=(TrailerAngle(bounds=(-largest, largest)),), within=within, model=robot
    ), drive


def other(problem: Problem, drive: Trajectory, values: np.ndarray) -> tuple[Problem, Trajectory]:
    """The problem of a robot with other values of what is uncertain, and the drive from where that begins."""
    spread = spread_of(problem.uncertain_system)
    own = dict(zip(spread.names[: spread.parameters], map(float, values), strict=False))
    starts = drive.starts + spread.shifts(values[None])[0]
    begun = replace(drive, start=starts if drive.runs > 1 else starts[0])
    return replace(problem, model=problem.model.with_values(own), uncertainty=None), begun


def draws_of(problem: Problem, count: int, seed: int) -> np.ndarray:
    return spread_of(problem.uncertain_system).draws(count, seed)


def excesses(problem: Problem, drive: Trajectory, values: np.ndarray) -> np.ndarray:
    """How far each robot exceeds each limit on its path, as shares of their sizes, by `evaluate`."""
    names = [limit.name for limit in path_limits(problem)]
    table = []
    for row in values:
        margins = {one.name: one for one in evaluate(*other(problem, drive, row)).margins}
        table.append([-margins[name].margin / margins[name].size for name in names])
    return np.array(table)


STARTS = {"track": "5 %", "x": "1 cm", "heading": "2 deg"}
CASES = {
    "box": lambda: boxed(),
    "two_runs": lambda: boxed(1.02, within=STARTS, runs=2),
    "bulge": bulging,
    "trailer": trailing,
}


@cache
def counted(name: str) -> tuple[Problem, Trajectory, Violation, np.ndarray]:
    problem, drive = CASES[name]()
    count = COUNT if name == "box" else FEW
    found = violation_probability(problem, drive, draws=count, seed=0)
    return problem, drive, found, excesses(problem, drive, draws_of(problem, count, 0))


every = pytest.mark.parametrize(
    "name", [name if name == "box" else pytest.param(name, marks=pytest.mark.slow) for name in CASES]
)


@pytest.mark.slow
class TestCounts:
    @every
    def test_they_are_those_of_scoring_one_by_one(self, name: str):
        _, _, found, exact = counted(name)
        beyond = exact > TOLERANCE
        assert 0.1 < found.probability < 0.9
        assert found.probability == beyond.any(axis=1).mean()
        assert list(found.by_limit.values()) == list(beyond.mean(axis=0))

    @every
    def test_each_robot_is_told_apart(self, name: str):
        problem, drive, _, exact = counted(name)
        values = draws_of(problem, len(exact), 0)
        np.testing.assert_array_equal(violated(problem, drive, values), (exact > TOLERANCE).any(axis=1))

    @every
    def test_the_worst_are_those_farthest_beyond(self, name: str):
        problem, _, found, exact = counted(name)
        assert found.farthest == pytest.approx(exact.max(), abs=1e-6)
        assert found.worst.shape == (4, len(spread_of(problem.uncertain_system).names))
        drawn = draws_of(problem, len(exact), 0)
        places = [np.flatnonzero((drawn == row).all(axis=1)).item() for row in found.worst]
        reached = exact[places].max(axis=1)
        # Beyond the samples' own order only as far as the path goes between two of them.
        assert reached.min() >= np.sort(exact.max(axis=1))[-8]
        assert reached.max() == pytest.approx(exact.max(), rel=1e-9)

    def test_limits_are_counted_each(self):
        _, _, found, exact = counted("box")
        assert list(found.by_limit) == ["workspace", "obstacles"]
        assert all(0 < share < found.probability for share in found.by_limit.values())
        assert exact.shape == (COUNT, 2)

    def test_limits_on_the_commands_are_not_counted(self):
        problem, drive = boxed()
        fast = replace(drive, coefficients=5 * drive.coefficients)
        room = replace(problem, limits=(SPEED, Rectangle(x=(-100, 100), y=(-100, 100))))
        assert not evaluate(replace(room, uncertainty=None), fast).feasible
        assert violation_probability(room, fast, draws=20).probability == 0.0

    def test_a_robot_may_leave_between_the_samples_alone(self):
        problem, drive = bulging()
        values = draws_of(problem, 400, 5)
        highest = paths(problem, drive, values)[:, :, 1].max(axis=1)
        room = next(limit for limit in problem.limits if limit.name == "workspace")
        beyond = highest > room.y[1] + TOLERANCE * (room.y[1] - room.y[0]) / 2
        found = violated(problem, drive, values)
        assert np.all(found[beyond])
        assert beyond.sum() + 5 < found.sum() < 380

    def test_nobody_leaves_a_room_that_is_large_enough(self):
        problem, drive = boxed(3.0)
        problem = replace(problem, limits=problem.limits[:3])
        found = violation_probability(problem, drive, draws=COUNT)
        assert (found.probability, found.farthest, found.by_limit) == (0.0, 0.0, {"workspace": 0.0})
        assert len(found.worst) == 0

    def test_everybody_leaves_a_room_that_is_too_small(self):
        problem, drive = boxed(0.5)
        found = violation_probability(problem, drive, draws=COUNT)
        assert (found.probability, found.interval[1]) == (1.0, 1.0)
        assert found.farthest > 0.8

    def test_without_limits_on_the_path_nobody_leaves(self):
        problem = uncertain_problem(also=(PathLength(bounds=1000),))
        drive = random_drive(problem, 0)
        found = violation_probability(problem, drive, draws=200)
        assert (found.probability, found.by_limit, found.farthest) == (0.0, {}, 0.0)
        assert not violated(problem, drive, draws_of(problem, 5, 0)).any()

    def test_it_needs_something_uncertain(self):
        problem, drive = boxed()
        with pytest.raises(ValueError, match="neither an uncertainty nor a prior"):
            violation_probability(replace(problem, uncertainty=None), drive)


class TestDepartures:
    """Robots that leave the workspace or hit an obstacle, and how far they get."""

    @pytest.mark.slow
    def test_share_and_distance_are_those_of_scoring_one_by_one(self):
        problem, drive, _, exact = counted("box")
        departing = departures(problem, drive, draws=COUNT, seed=0)
        beyond = exact > TOLERANCE
        assert departing.limits == ("workspace", "obstacles")
        assert departing.share == beyond.any(axis=1).mean()
        assert departing.interval == interval_of(int(beyond.any(axis=1).sum()), COUNT)
        limits = {limit.name: limit for limit in path_limits(problem)}
        sizes = [limits["workspace"].rows_for(np.zeros((1, 2)), 0.0).size, 0.295]
        outside = np.sort((exact * sizes).max(axis=1)[beyond.any(axis=1)])
        # Of few robots the 95th percentile is the farthest.
        assert departing.distance == pytest.approx(outside[-1], abs=1e-4)

    @pytest.mark.slow
    def test_distance_is_0_where_no_robot_leaves(self):
        problem, drive = boxed(3.0)
        departing = departures(replace(problem, limits=problem.limits[:3]), drive, draws=COUNT)
        assert (departing.share, departing.distance) == (0.0, 0.0)

    def test_limits_that_are_none_on_positions_are_not_looked_at(self):
        problem, drive = trailing()
        assert departures(problem, drive, draws=COUNT) is None


class TestDraws:
    @pytest.mark.slow
    def test_the_same_seed_tells_the_same(self):
        problem, drive, found, _ = counted("box")
        again = violation_probability(problem, drive, draws=COUNT, seed=0)
        assert replace(again, worst=None) == replace(found, worst=None)
        np.testing.assert_array_equal(again.worst, found.worst)

    @pytest.mark.slow
    def test_another_seed_draws_others(self):
        problem, drive, found, _ = counted("box")
        assert not np.array_equal(
            violation_probability(problem, drive, draws=COUNT, seed=1).worst, found.worst
        )

    @pytest.mark.slow
    def test_batches_do_not_matter(self, monkeypatch: pytest.MonkeyPatch):
        problem, drive, found, _ = counted("box")
        monkeypatch.setattr("oed.uncertainty.departures.BATCH", 7)
        again = violation_probability(problem, drive, draws=COUNT, seed=0)
        assert (again.probability, again.farthest) == (found.probability, pytest.approx(found.farthest))


class TestInterval:
    @given(draws=st.integers(1, 80), seed=st.integers(0, 99))
    @pytest.mark.slow
    def test_it_is_clopper_and_pearsons(self, draws: int, seed: int):
        problem, drive, _, _ = counted("box")
        found = violation_probability(problem, drive, draws=draws, seed=seed)
        expected = binomtest(round(found.probability * draws), draws).proportion_ci(0.95, "exact")
        np.testing.assert_allclose(found.interval, (expected.low, expected.high), atol=1e-9)


class TestPaths:
    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["box", pytest.param("two_runs", marks=pytest.mark.slow)])
    def test_they_are_those_of_the_robots(self, name: str):
        problem, drive, _, _ = counted(name)
        values = draws_of(problem, 3, 9)
        # Whatever their limits, which paths do not depend on and which take long to score.
        bare = replace(problem, limits=(SPEED,))
        expected = [evaluate(*other(bare, drive, row)).states for row in values]
        np.testing.assert_allclose(paths(problem, drive, values), expected, atol=1e-12)


@pytest.mark.slow
def test_a_post_between_the_samples_counts():
    # Straight through a post of 1 cm that no robot has a point of its grid in, whatever its radii.
    post = Obstacles.model_validate([{"kind": "circle", "x": 0.76, "y": 0, "radius": 0.01}])
    space = DesignSpace(duration=6, samples=6, rest_to_rest=False)
    problem = uncertain_problem(also=(post,), design=space, within={RIGHT: "0.01 %", LEFT: "0.01 %"})
    drive = Trajectory.from_samples(np.full((6, 2), 0.5 / RADIUS), 6.0, (0, 0, 0), rest_to_rest=False)
    found = violation_probability(problem, drive, draws=200, seed=3)
    assert found.probability == 1
    assert found.by_limit == {"obstacles": 1.0}
    assert violated(problem, drive, np.array([[RADIUS, RADIUS]])).all()


class Root(Model):
    """A robot whose forward speed is the root of what its gain leaves: not a number where that is below 0."""

    kind: Literal["root"] = "root"
    gain: float = 1.0
    bend: float = 0.0
    inputs: ClassVar = (Input("v", "wheel_speed", "rad/s"), Input("w", "wheel_speed", "rad/s"))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return Parameter("gain", self.gain, "", 1.0), Parameter("bend", self.bend, "", 1.0)

    def twist(self, inputs: Any, p: Any) -> Any:
        return ca.vertcat(inputs[0] * ca.sqrt(p[0] - inputs[1] ** 2), 0, inputs[1] + p[1] * inputs[0])


class Curved(PathLimit):
    """erf(y) below that of `top`: nobody knows bounds of erf."""

    name: ClassVar[str] = "curved"
    per_metre: ClassVar[float] = 1.2
    top: float

    def rows_at(self, path: Any, model: Model) -> Rows:
        each = np.ones(path.shape[0])
        return Rows(ca.erf(path[:, 1]), -np.inf * each, erf(self.top) * each, 1.0, "")


class Pointwise(Curved):
    """The same of a limit that does not say what it looks at."""

    looks_at: ClassVar = None


@pytest.mark.slow
def test_a_drive_that_is_not_a_number_anywhere_leaves():
    room = Rectangle(x=(-99, 99), y=(-99, 99))
    space = DesignSpace(duration=10, samples=10, rest_to_rest=False)
    problem = uncertain_problem(model=Root(), design=space, within={"gain": 0.5}, limits=(SPEED, room))
    inputs = np.column_stack([np.full(10, 0.3), np.linspace(0, 0.85, 10)])
    drive = Trajectory.from_samples(inputs, 10.0, (0, 0, 0), rest_to_rest=False)
    broken = draws_of(problem, 200, 0)[:, 0] < 0.85**2
    assert 10 < broken.sum() < 190
    np.testing.assert_array_equal(violated(problem, drive, draws_of(problem, 200, 0)), broken)
    found = violation_probability(problem, drive, draws=200, seed=0)
    assert found.probability == found.by_limit["workspace"] == broken.mean()
    assert found.farthest == np.inf
    assert np.all(found.worst[:, 0] < 0.85**2)


@pytest.mark.parametrize("kind", [Curved, Pointwise])
@pytest.mark.slow
def test_a_limit_without_bounds_is_checked_on_the_finer_grid(kind: type[Curved]):
    space = DesignSpace(duration=6, samples=6, rest_to_rest=False)
    parts: dict[str, Any] = {"design": space, "within": {"track": 1e-5}}
    speeds = np.tile([0.581, 0.419], (6, 1)) / RADIUS
    drive = Trajectory.from_samples(speeds, 6.0, (0, 0, 0), rest_to_rest=False)
    y = evaluate(uncertain_problem(**parts), drive).path[:, 1]
    # All robots are above between two samples, none at any.
    problem = uncertain_problem(also=(kind(top=(y[::10].max() + y.max()) / 2),), **parts)
    assert not evaluate(replace(problem, uncertainty=None), drive).feasible
    found = violation_probability(problem, drive, draws=50)
    assert found.probability == 1
    assert found.checked_at_points == ("curved",)
    assert "points only: curved" in found.sentence
    assert violated(problem, drive, draws_of(problem, 5, 0)).all()
    assert found.farthest == pytest.approx(excesses(problem, drive, found.worst).max(), abs=1e-9)


def test_what_patience_leaves_open_is_said(monkeypatch: pytest.MonkeyPatch):
    problem, drive = bulging()
    found = violation_probability(problem, drive, draws=5)
    assert found.checked_at_points == ()
    assert "points only" not in found.sentence
    monkeypatch.setattr("oed.kernel.between.search.PATIENCE", -(10**6))
    assert violation_probability(problem, drive, draws=5).checked_at_points == ("workspace",)
