"""Areas: rooms and obstacles along a drive, between its samples too, and around the robot's own body."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
import shapely
from builders import RADIUS, TRACK, problem_of, random_drive
from driving import BY_NAME, fine_path, limited, margin_of
from hypothesis import given, settings
from hypothesis import strategies as st
from outlines import COMB, L_SHAPE, OUTLINES, U_SHAPE, grid_around, outlines, signed_distance
from pydantic import TypeAdapter, ValidationError

from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.robots.limits import LIMITS, Circle, Obstacles, Polygon, Rectangle
from oed.robots.models import DifferentialDrive
from oed.robots.space import DesignSpace, StartPose

ROBOT = BY_NAME["differential"]
COLUMN = {"kind": "circle", "x": 0.4, "y": 0.3, "radius": 0.2}
SHELF = {"kind": "polygon", "points": [[-1, 0.4], [-0.2, 0.4], [-0.2, 0.6], [-0.8, 0.6], [-0.8, 1], [-1, 1]]}
BODY = 0.15
every_outline = pytest.mark.parametrize("outline", OUTLINES.values(), ids=OUTLINES)


def obstacles(*shapes) -> Obstacles:
    return TypeAdapter(LIMITS["obstacles"]).validate_python(list(shapes))


def slack_at(area, points, radius: float = 0.0) -> np.ndarray:
    """(points,): how far inside its bounds the tightest row of every point is."""
    points = np.reshape(np.asarray(points, dtype=float), (-1, 2))
    rows = area.rows_for(ca.DM(points), radius)
    values = np.array(ca.evalf(rows.expression)).ravel()
    return np.minimum(values - rows.lower, rows.upper - values).reshape(-1, len(points)).min(axis=0)


def clearance(points: np.ndarray) -> np.ndarray:
    """Distance of points outside the column and the shelf from the nearer one."""
    column = np.hypot(points[:, 0] - COLUMN["x"], points[:, 1] - COLUMN["y"]) - COLUMN["radius"]
    return np.minimum(column, -signed_distance(SHELF["points"], points))


def with_body(radius: float) -> DifferentialDrive:
    return DifferentialDrive(wheel_radius=RADIUS, track=TRACK, body_radius=radius)


ROOMS = {
    "rectangle": (Rectangle(x=(-1, 3), y=(-2, 1)), ((-1, -2), (3, -2), (3, 1), (-1, 1))),
    "circle": (Circle(x=0.5, y=-0.3, radius=1.5), None),
    **{name: (Polygon(points=outline), outline) for name, outline in OUTLINES.items()},
}


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.0, 0.15])
@pytest.mark.parametrize("name", ROOMS)
def test_slack_in_a_room_is_the_distance_from_its_outline(name: str, radius: float):
    room, outline = ROOMS[name]
    x_min, x_max, y_min, y_max = room.extent
    points = grid_around(((x_min, y_min), (x_max, y_max)))
    if outline is None:
        truth = 1.5 - np.hypot(points[:, 0] - 0.5, points[:, 1] + 0.3)
    else:
        truth = signed_distance(outline, points)
    found, inside = slack_at(room, points, radius), truth > 0
    tolerance = 1e-3 * 1.5 if outline is None else 1e-6
    np.testing.assert_allclose(found[inside], truth[inside] - radius, atol=tolerance)
    assert np.all(found[~inside] < 1e-9 - radius)
    allowed = [room.allows(x, y, radius) for x, y in points[::31]]
    np.testing.assert_array_equal(allowed, found[::31] >= -1e-9)


@pytest.mark.slow
@settings(max_examples=5)
@given(outline=outlines(), body=st.floats(0, 0.5))
def test_a_body_moves_every_wall_by_its_radius(outline: np.ndarray, body: float):
    points = grid_around(outline, 9)
    room, obstacle = Polygon(points=outline), obstacles({"kind": "polygon", "points": outline.tolist()})
    for area in (room, obstacle, Circle(radius=2), Rectangle(x=(-1, 2), y=(-3, 1)), obstacles(COLUMN, SHELF)):
        np.testing.assert_allclose(slack_at(area, points, body), slack_at(area, points) - body, atol=1e-12)


def test_a_body_does_not_fit_into_narrow_ends():
    # The tips of the comb are walls as well, although its hull's edge along them is mostly open.
    room = Polygon(points=COMB)
    assert room.allows(0.5, 1.9)
    assert not room.allows(0.5, 1.9, radius=0.2)
    assert room.allows(0.5, 1.5, radius=0.45)
    assert not room.allows(0.5, 1.5, radius=0.55)


@pytest.mark.parametrize("body", [0.0, 0.3])
def test_a_circle_is_exact_at_its_line(body: float):
    angles = np.linspace(0, 2 * np.pi, 17)
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    room = Circle(x=2, y=-1, radius=2.5)
    np.testing.assert_allclose(slack_at(room, 2.5 * ring + (2, -1), body), -body, atol=1e-12)
    column = obstacles({"kind": "circle", "x": 2, "y": -1, "radius": 2.5})
    np.testing.assert_allclose(slack_at(column, 2.5 * ring + (2, -1), body), -body, atol=1e-12)


@given(x=st.floats(-4, 4), y=st.floats(-4, 4), radius=st.floats(0.1, 3))
def test_a_circle_is_close_everywhere(x: float, y: float, radius: float):
    found = slack_at(Circle(x=0.2, y=-0.1, radius=radius), (x, y)).item()
    truth = radius - np.hypot(x - 0.2, y + 0.1)
    assert found == pytest.approx(truth, abs=1e-3 * radius)
    assert found <= truth + 1e-12 or truth < 0


def motions(points: np.ndarray, angle: float, scale: float, shift) -> np.ndarray:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return scale * np.asarray(points) @ turn.T + np.asarray(shift)


@settings(max_examples=6)
@given(
    outline=outlines(),
    angle=st.floats(-4, 4),
    scale=st.floats(0.2, 5),
    shift=st.tuples(st.floats(-9, 9), st.floats(-9, 9)),
)
@pytest.mark.slow
def test_areas_move_turn_and_grow_with_their_points(outline, angle: float, scale: float, shift):
    points = grid_around(outline, 9)
    inside = signed_distance(outline, points) > 0
    moved, image = (motions(table, angle, scale, shift) for table in (points, outline))
    room, other = Polygon(points=outline), Polygon(points=image)
    expected = scale * slack_at(room, points)[inside]
    np.testing.assert_allclose(slack_at(other, moved)[inside], expected, atol=1e-5)
    shelf = obstacles({"kind": "polygon", "points": outline.tolist()})
    image_shelf = obstacles({"kind": "polygon", "points": image.tolist()})
    expected = scale * slack_at(shelf, points)[~inside]
    np.testing.assert_allclose(slack_at(image_shelf, moved)[~inside], expected, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["differential", "tricycle", "mecanum"])
def test_margins_along_a_drive(name: str):
    example = BY_NAME[name]
    room = ((-3, -3), (3, -3), (3, 3), (-3, 3), (-3, 0.5), (-2.5, 0), (-3, -0.5))
    problem = limited(example, Polygon(points=room), obstacles(COLUMN, SHELF))
    drive = random_drive(problem, 0, amplitude=0.5 if name == "tricycle" else 4.0)
    points = fine_path(example, drive)[:, :2]
    assert margin_of(problem, drive, "workspace").margin == pytest.approx(
        signed_distance(room, points).min(), abs=1e-6
    )
    assert clearance(points).min() > 0
    found = margin_of(problem, drive, "obstacles")
    assert found.margin == pytest.approx(clearance(points).min(), abs=1e-6)
    assert (found.size, found.unit) == (pytest.approx(0.1), "m")


def straight(distance: float, start=(0.0, 0.0, 0.0), samples: int = 4) -> Trajectory:
    speeds = np.full((samples, 2), distance / (RADIUS * 10))
    return Trajectory.from_samples(speeds, 10.0, start, rest_to_rest=False)


@pytest.mark.slow
def test_an_obstacle_between_the_samples_is_met():
    # Samples every 0.5 m, a post 2 cm thick halfway between two of them.
    post = {"kind": "polygon", "points": [[0.74, -0.1], [0.76, -0.1], [0.76, 0.1], [0.74, 0.1]]}
    problem = limited(ROBOT, obstacles(post), duration=10, rest_to_rest=False)
    drive = straight(2.0)
    poses = evaluate(problem, drive).states[:, :2]
    assert (-signed_distance(post["points"], poses)).min() > 0.2
    assert margin_of(problem, drive, "obstacles").margin == pytest.approx(-0.01)
    assert not evaluate(problem, drive).feasible
    assert evaluate(problem, straight(0.7)).feasible


@pytest.mark.slow
def test_a_pillar_of_the_room_between_the_samples_is_met():
    room = ((-1, -1), (3, -1), (3, 1), (0.76, 1), (0.75, -0.2), (0.74, 1), (-1, 1))
    problem = limited(ROBOT, Polygon(points=room), duration=10, rest_to_rest=False)
    drive = straight(2.0)
    poses = evaluate(problem, drive).states[:, :2]
    assert signed_distance(room, poses).min() > 0.2
    assert margin_of(problem, drive, "workspace").margin < -1e-3
    assert evaluate(problem, straight(0.7)).feasible


@pytest.mark.slow
@pytest.mark.parametrize(("distance", "expected"), [(0.5, 0.35), (0.9, -0.05)])
def test_a_body_counts_along_a_drive(distance: float, expected: float):
    shelf = {"kind": "polygon", "points": [[1, -1], [2, -1], [2, 1], [1, 1]]}
    parts = {
        "model": with_body(BODY),
        "design": DesignSpace(duration=10, samples=4, rest_to_rest=False),
    }
    base = limited(ROBOT, obstacles(shelf), Polygon(points=L_SHAPE), rest_to_rest=False)
    problem = problem_of(
        **parts, measurement=base.measurement, limits=base.limits[:2], criterion=base.criterion
    )
    assert margin_of(problem, straight(distance), "obstacles").margin == pytest.approx(expected)
    assert margin_of(problem, straight(distance), "obstacles").size == pytest.approx(0.5 + BODY)


@pytest.mark.parametrize(
    ("area", "inside", "outside"),
    [
        (Circle(radius=1), (0.6, 0.6), (0.8, 0.8)),
        (Polygon(points=L_SHAPE), (1, 3), (3, 2.5)),
        (Polygon(points=U_SHAPE), (0.5, 3.5), (2.5, 3)),
        (Rectangle(x=(0, 2), y=(0, 2)), (1, 1.5), (1, 2.1)),
    ],
)
def test_a_start_outside_the_room_is_an_issue(area, inside, outside):
    def issues(point, body: float = 0.0):
        return area.issues(with_body(body), DesignSpace(duration=9, start=StartPose(x=point[0], y=point[1])))

    (issue,) = issues(outside)
    assert issue.key == ("limits", "workspace")
    assert f"({outside[0]:g} m, {outside[1]:g} m) lies outside the workspace" in issue.message
    assert issues(inside) == []
    (issue,) = issues(inside, body=1.1)
    assert "for a robot of radius 1.1 m" in issue.message


def test_a_start_in_an_obstacle_is_an_issue():
    area = obstacles(COLUMN, SHELF)
    starts = (StartPose(), StartPose(x=0.4, y=0.4), StartPose(x=-0.9, y=0.9))
    (issue,) = area.issues(with_body(0), DesignSpace(duration=9, start=starts, runs=3))
    assert issue.key == ("limits", "obstacles")
    assert "(0.4 m, 0.4 m) touches an obstacle" in issue.message
    assert area.issues(with_body(0), DesignSpace(duration=9, start=starts[:1], runs=1)) == []
    (issue,) = area.issues(with_body(0.31), DesignSpace(duration=9))
    assert "for a robot of radius 0.31 m" in issue.message
    assert area.issues(with_body(0.31), DesignSpace(duration=9, start="free")) == []


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ([], "at least 1"),
        ([{"kind": "circle", "x": 0, "y": 0, "radius": 0}], "greater than 0"),
        ([{"kind": "circle", "x": 0, "radius": 1}], "y"),
        ([{"kind": "blob"}], "circle"),
        ([{"kind": "polygon", "points": [[0, 0], [1, 1], [2, 2]]}], "enclose an area"),
    ],
)
def test_wrong_obstacles_are_refused(wrong, reason: str):
    with pytest.raises(ValidationError, match=reason):
        obstacles(*wrong)


def test_quantities_of_areas_have_units():
    room = TypeAdapter(LIMITS["workspace"]).validate_python(
        {"kind": "circle", "radius": "150 cm", "x": "1 m"}
    )
    assert (room.x, room.y, room.radius) == pytest.approx((1, 0, 1.5))
    assert room.middle == pytest.approx((1, 0))
    shape = obstacles({"kind": "polygon", "points": [["0 m", "0 m"], ["50 cm", 0], [0.5, "1 m"]]}).shapes[0]
    assert shapely.Polygon(shape.points).area == pytest.approx(0.25)


@every_outline
def test_areas_used_are_equal_to_areas_unused(outline):
    used, unused = Polygon(points=outline), Polygon(points=outline)
    slack_at(used, (0, 0))
    assert used == unused
    assert used.model_dump() == unused.model_dump()
