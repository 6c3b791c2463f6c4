"""Shapes: distances from convex polygons, rooms as walls and pockets, and what is no outline."""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from outlines import (
    COMB,
    L_SHAPE,
    MORE_CORNERS,
    OUTLINES,
    SPIRAL,
    SQUARE,
    STAR,
    U_SHAPE,
    convex_outlines,
    grid_around,
    outlines,
    rectilinear_outline,
    signed_distance,
)

from oed.foundation.errors import PartError
from oed.robots.limits import Polygon, PolygonalObstacle
from oed.robots.limits.shapes import (
    ConvexShape,
    convex_pieces,
    middle_of,
    polygon_issue,
    seamless,
    walls_and_pockets,
)

every_outline = pytest.mark.parametrize("outline", OUTLINES.values(), ids=OUTLINES)


def convex(outline) -> ConvexShape:
    return ConvexShape(tuple((float(x), float(y)) for x, y in outline))


def values(shapes, points) -> np.ndarray:
    """Clearances (shapes, points)."""
    table = ca.DM(np.asarray(points, dtype=float))
    return np.array([np.array(ca.evalf(shape.clearance(table))).ravel() for shape in shapes])


def room_rows(outline, points) -> np.ndarray:
    walls, pockets = walls_and_pockets([tuple(corner) for corner in outline])
    return values((*walls, *pockets), points)


def pieces_of(outline) -> tuple[ConvexShape, ...]:
    return convex_pieces(shapely.Polygon(outline))


@pytest.mark.slow
@given(outline=convex_outlines())
def test_distance_from_a_convex_shape(outline: np.ndarray):
    points = grid_around(outline, 15, 0.8)
    expected = -signed_distance(outline, points)
    np.testing.assert_allclose(values([convex(outline)], points)[0], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((3, 0.5), 2),
        ((0.2, -4), 3),
        ((4, 5), 5),
        ((-1.3, 1.4), 0.5),
        ((0, 0), -1),
        ((0.9, -0.2), -0.1),
        ((1, 0), 0),
        ((-1, -1), 0),
    ],
)
def test_distance_from_a_square(point, expected: float):
    assert values([convex(SQUARE)], [point]).item() == pytest.approx(expected, abs=1.1e-6)


@every_outline
def test_a_room_is_its_walls_and_pockets(outline):
    points = grid_around(outline)
    rows, truth = room_rows(outline, points).min(axis=0), signed_distance(outline, points)
    np.testing.assert_allclose(rows[truth > 0], truth[truth > 0], atol=1e-6)
    assert np.all(rows[truth < -1e-9] < 1e-9)


@given(outline=outlines(), seed=st.integers(0, 1000))
@pytest.mark.slow
def test_a_room_of_any_outline(outline: np.ndarray, seed: int):
    points = np.random.default_rng(seed).uniform(-3.5, 3.5, (400, 2))
    rows, truth = room_rows(outline, points).min(axis=0), signed_distance(outline, points)
    inside = truth > 0
    np.testing.assert_array_equal(rows >= 0, inside)
    np.testing.assert_allclose(rows[inside], truth[inside], atol=1e-6)


@given(outline=outlines(), seed=st.integers(0, 1000))
@pytest.mark.slow
def test_distance_from_an_obstacle_of_any_outline(outline: np.ndarray, seed: int):
    points = np.random.default_rng(seed).uniform(-3.5, 3.5, (400, 2))
    pieces = seamless(pieces_of(outline))
    distances, truth = values(pieces, points).min(axis=0), -signed_distance(outline, points)
    outside = truth > 0
    np.testing.assert_array_equal(distances >= 0, outside)
    np.testing.assert_allclose(distances[outside], truth[outside], atol=1e-6)


def assert_pieces(outline, pieces) -> None:
    shape = shapely.Polygon(outline)
    parts = [shapely.Polygon(piece.corners) for piece in pieces]
    for part in parts:
        assert part.exterior.is_ccw
        assert part.convex_hull.area == pytest.approx(part.area, rel=1e-9)
    assert sum(part.area for part in parts) == pytest.approx(shape.area, rel=1e-7)
    assert shapely.symmetric_difference(shapely.union_all(parts), shape).area == pytest.approx(
        0, abs=1e-7 * shape.area
    )


@every_outline
def test_pieces_make_up_the_shape(outline):
    assert_pieces(outline, pieces_of(outline))


@given(outline=outlines())
@pytest.mark.slow
def test_pieces_make_up_any_shape(outline: np.ndarray):
    assert_pieces(outline, pieces_of(outline))


@pytest.mark.parametrize(
    ("outline", "most"), [(L_SHAPE, 2), (U_SHAPE, 3), (COMB, 4), (SPIRAL, 5), (STAR, 7), (MORE_CORNERS, 1)]
)
def test_there_are_few_pieces(outline, most: int):
    assert len(pieces_of(outline)) <= most


@pytest.mark.slow
@given(outline=convex_outlines(), share=st.floats(0.1, 0.9))
def test_a_convex_shape_is_one_piece_without_pockets(outline: np.ndarray, share: float):
    between = share * outline[0] + (1 - share) * outline[-1]
    for corners in (outline, [between, *outline]):
        assert len(pieces_of(corners)) == 1
        walls, pockets = walls_and_pockets([tuple(corner) for corner in corners])
        assert (len(walls), len(pockets)) == (len(outline), 0)


@every_outline
@pytest.mark.slow
def test_direction_and_first_corner_do_not_matter(outline):
    points = grid_around(outline, 9)
    expected = room_rows(outline, points).min(axis=0)
    inside = signed_distance(outline, points) >= 0
    for other in (outline[::-1], outline[2:] + outline[:2], (*outline, outline[0])):
        rows = room_rows(other, points).min(axis=0)
        np.testing.assert_allclose(rows[inside], expected[inside], atol=1e-9)
        np.testing.assert_array_equal(rows >= -1e-9, expected >= -1e-9)


@every_outline
def test_corners_on_a_line_do_no_harm(outline):
    corners = np.array(outline, dtype=float)
    ahead = np.roll(corners, -1, axis=0)
    denser = np.stack([corners, 0.7 * corners + 0.3 * ahead, 0.2 * corners + 0.8 * ahead], axis=1)
    points = grid_around(outline, 9)
    denser = np.roll(denser.reshape(-1, 2), 1, axis=0)
    truth = signed_distance(outline, points)
    rows, distances = room_rows(denser, points).min(axis=0), values(pieces_of(denser), points).min(axis=0)
    np.testing.assert_allclose(rows[truth > 0], truth[truth > 0], atol=1e-6)
    np.testing.assert_allclose(distances[truth < 0], -truth[truth < 0], atol=1e-6)
    assert len(walls_and_pockets(denser)[0]) <= max(4, len(walls_and_pockets(outline)[0]))


@every_outline
def test_second_derivatives_are_finite_everywhere(outline):
    point = ca.SX.sym("point", 2)
    walls, pockets = walls_and_pockets(outline)
    rows = ca.vertcat(*(part.clearance(point.T) for part in (*walls, *pockets, *pieces_of(outline))))
    gradient = ca.jacobian(rows, point)
    function = ca.Function("derivatives", [point], [rows, gradient, ca.jacobian(gradient, point)])
    corners = np.array(outline, dtype=float)
    middles = (corners + np.roll(corners, 1, axis=0)) / 2
    for x, y in [*corners, *middles, corners.mean(axis=0), middle_of(outline), (50, -70)]:
        _, slopes, curvatures = (np.array(result) for result in function([x, y]))
        assert np.all(np.isfinite(curvatures))
        assert np.all(np.hypot(slopes[:, 0], slopes[:, 1]) <= 1 + 1e-9)


@every_outline
def test_the_middle_is_farthest_from_the_walls(outline):
    largest = signed_distance(outline, grid_around(outline, 61, 0)).max()
    assert signed_distance(outline, [middle_of(outline)]).item() >= largest - 0.005
    room = Polygon(points=outline)
    assert room.middle == pytest.approx(middle_of(outline))
    assert room.extent == pytest.approx(np.array([np.min(outline, 0), np.max(outline, 0)]).T.ravel())


@pytest.mark.parametrize("shape", [Polygon, PolygonalObstacle])
@pytest.mark.parametrize(
    ("corners", "reason"),
    [
        ([(0, 0), (1, 0), (2, 0)], "enclose an area"),
        ([(0.1, 0.1), (0.3, 0.3), (0.7, 0.7)], "enclose an area"),
        ([(1, 1), (1, 1), (1, 1)], "enclose an area"),
        ([(0, 0), (1, 0), (0, 0)], "enclose an area"),
        ([(0, 0), (1, 1), (1, 0), (0, 1)], "neither crosses nor touches itself"),
        ([(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)], "neither crosses nor touches itself"),
        ([(0, 0), (1, 0), (1, 1), (1, 0)], "neither crosses nor touches itself"),
        ([(0, 0), (4, 0), (4, 4), (3, 4), (3, -1)], "neither crosses nor touches itself"),
        ([(0, 0), (1, 0)], "at least 3"),
        ([(0, 0), (1, 0), (1, "2 rad")], "of another kind"),
        ([(0, 0), (1, 0), (1, float("nan"))], "finite"),
    ],
)
def test_what_is_no_outline_is_refused(shape, corners, reason: str):
    with pytest.raises(PartError, match=reason):
        shape(points=corners)


@every_outline
def test_outlines_are_accepted(outline):
    assert polygon_issue(outline) == ""


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
def test_shapes_of_any_size(size: float):
    outline = size * np.array(L_SHAPE)
    points = grid_around(outline, 11)
    truth = signed_distance(outline, points)
    np.testing.assert_allclose(
        room_rows(outline, points).min(axis=0)[truth > 0], truth[truth > 0], rtol=1e-9, atol=1.1e-6
    )
    assert polygon_issue([tuple(corner) for corner in outline]) == ""


def on_seams(outline) -> np.ndarray:
    """Points on the straight lines between any two corners and on the hull's edges: where pieces may meet."""
    corners = np.array(outline, dtype=float)
    shares = np.linspace(0.05, 0.95, 19)
    return np.array(
        [
            share * first + (1 - share) * second
            for first, second in itertools.combinations(corners, 2)
            for share in shares
        ]
    )


@every_outline
@pytest.mark.slow
def test_nothing_passes_where_pieces_meet(outline):
    points = on_seams(outline)
    truth = signed_distance(outline, points)
    assert np.all(room_rows(outline, points).min(axis=0)[truth < -1e-6] < -1e-6)
    distances = values(seamless(pieces_of(outline)), points).min(axis=0)
    assert np.all(distances[truth > 1e-6] < -1e-6)


def turned_room(seed: int) -> tuple[np.random.Generator, np.ndarray]:
    draw = np.random.default_rng([7, seed])
    outline = rectilinear_outline(draw)
    while polygon_issue([tuple(corner) for corner in outline]):
        outline = rectilinear_outline(draw)
    return draw, outline


@pytest.mark.slow
def test_turned_rooms_of_right_angles():
    for seed in range(10):
        draw, outline = turned_room(seed)
        # Anywhere, and on straight lines between corners, where pieces meet.
        anywhere = draw.uniform(outline.min(axis=0) - 0.3, outline.max(axis=0) + 0.3, (50, 2))
        begins, ends = outline[draw.integers(len(outline), size=(2, 50))]
        points = np.vstack([anywhere, begins + draw.random((50, 1)) * (ends - begins)])
        truth, room = signed_distance(outline, points), room_rows(outline, points).min(axis=0)
        obstacle = values(seamless(pieces_of(outline)), points).min(axis=0)
        clear, message = np.abs(truth) > 2e-6, f"seed {seed}"
        np.testing.assert_array_equal(room[clear] > 0, truth[clear] > 0, message)
        np.testing.assert_array_equal(obstacle[clear] < 0, truth[clear] > 0, message)
        inside, outside = truth > 2e-6, truth < -2e-6
        np.testing.assert_allclose(room[inside], truth[inside], atol=1.1e-6, err_msg=message)
        np.testing.assert_allclose(obstacle[outside], -truth[outside], atol=1.1e-6, err_msg=message)


@pytest.mark.slow
def test_many_turned_rooms():
    for seed in range(40):
        _, outline = turned_room(seed)
        walls, _ = walls_and_pockets([tuple(corner) for corner in outline])
        assert len(walls) >= 4, f"seed {seed}"
        pieces = pieces_of(outline)
        area = sum(shapely.Polygon(piece.corners).area for piece in pieces)
        assert area == pytest.approx(shapely.Polygon(outline).area, rel=1e-9), f"seed {seed}"
        assert len(seamless(pieces)) >= 2 * len(pieces) - 1, f"seed {seed}"
