"""The largest values within reach of any place are never above what a grid says."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from oed.bounds.starts import Start
from oed.bounds.stencils import stencil
from oed.bounds.value_grid import NOWHERE, ValueGrid, dilated

Array = npt.NDArray[np.float64]


def bilinear(grid: ValueGrid, table: Array, places: Array) -> Array:
    """A function at places (k, 2), which count as on the nearest wall where they are beyond one."""
    cells = np.clip((places - grid.low) / grid.sizes, 0, grid.cells)
    corner = np.minimum(cells.astype(int), np.array(grid.cells) - 1)
    (fx, fy), (i, j) = (cells - corner).T, corner.T
    low, high = (table[i, one] * (1 - fx) + table[i + 1, one] * fx for one in (j, j + 1))
    return np.asarray(low * (1 - fy) + high * fy)


def drawn_values(kind: int, grid: ValueGrid, rng: np.random.Generator) -> Array:
    x, y = np.meshgrid(*grid.axes, indexing="ij")
    if kind == 0:
        return rng.normal(size=x.shape)
    if kind == 1:
        return -np.abs(x - rng.uniform(0, 9)) - 2 * np.abs(y - rng.uniform(0, 9))
    return np.minimum(x, rng.uniform(0, 20)) + np.sin(y) * np.cos(x / 3)


@pytest.mark.slow
@pytest.mark.parametrize("kind", range(3))
def test_nothing_within_reach_of_any_place_is_larger(kind: int) -> None:
    rng = np.random.default_rng(kind)
    for _ in range(40):
        cells = int(rng.integers(4, 30)), int(rng.integers(4, 30))
        grid = ValueGrid((0.0, -1.0), (float(cells[0]), cells[1] * rng.uniform(0.8, 1.2) - 1), cells)
        values = drawn_values(kind, grid, rng)
        reach = float(rng.uniform(0.2, 8))
        found = grid.within(np.float32(values)[None], reach)[0]
        places = rng.uniform(grid.low, grid.high, (300, 2))
        places[:80, 0] = rng.choice([grid.low[0], grid.high[0]], 80)
        places[80:120, 1] = grid.high[1] - rng.uniform(0, 1, 40)
        angles = rng.uniform(0, 2 * np.pi, 50)
        steps = reach * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        steps[::2] *= rng.uniform(0, 1, (25, 1))
        bounds = bilinear(grid, found, places)
        for step in steps:
            best = bilinear(grid, values, np.clip(places + step, grid.low, grid.high))
            assert np.all(best <= bounds + 1e-5)


@pytest.mark.parametrize("edge", [0, 1])
def test_nothing_within_reach_is_larger_where_cells_are_twisted_and_their_neighbours_are_not(
    edge: int,
) -> None:
    # So convex along x that no node bends downwards, and along y linear: only the twists of cells count.
    grid, reach = ValueGrid((0.0, 0.0), (12.0, 12.0), (12, 12)), 1.98
    slopes = np.array([-1, 1, 0, 1, 1, -1, -1, -1, -1, 1, -1, 0, 0])
    x, y = np.meshgrid(*grid.axes, indexing="ij")
    values = 4 * (x - 6) ** 2 - 2 * x + 4 * y + slopes[:, None] * (y - 8)
    # Also where no path comes to the walls: to nodes so near, or to their neighbours.
    inner = np.minimum(np.minimum(x, 12 - x), np.minimum(y, 12 - y))
    given = np.where(inner < edge, NOWHERE, values)
    found = grid.within(np.float32(given)[None], reach, inner > edge if edge else None)[0]
    across, along = np.meshgrid(np.linspace(3, 9, 49), np.linspace(3, 9, 49))
    places = np.column_stack([across.ravel(), along.ravel()])
    bounds = bilinear(grid, found, places)
    for angle in np.linspace(0, 2 * np.pi, 73):
        there = places + reach * np.array([np.cos(angle), np.sin(angle)])
        assert np.all(bilinear(grid, values, there) <= bounds + 1e-4)


@pytest.mark.parametrize("radii", [(6.66, 6.66), (8.88, 5.1), (1.3, 0.4)])
def test_points_that_mirror_one_another_share_their_column(radii: tuple[float, float]) -> None:
    # One column is mixed for both, and no point counts twice.
    points = {tuple(point) for point in stencil(*radii).points}
    assert all({(-x, y), (x, -y)} <= points for x, y in points)
    assert len({tuple(np.round(point, 6) + 0.0) for point in points}) == len(points)


def test_a_convex_function_is_exact_along_the_axes() -> None:
    grid = ValueGrid((-1.0, -1.0), (1.0, 1.0), (64, 64))
    squares = grid.squares(np.zeros((1, 2)))
    found = grid.within(squares, 6 * 2 / 64)[0]
    # From (0.5, 0) to (0.5 + 6 cells, 0), and no farther than the wall.
    assert found[48, 32] == pytest.approx((0.5 + 6 / 32) ** 2, abs=2e-3)
    assert found[64, 64] == pytest.approx(2.0, abs=1e-6)
    # Two cells from the wall: there, and along it with what is left.
    assert found[62, 32] == pytest.approx(1 + (6**2 - 2**2) / 32**2, abs=2e-2)


def test_nodes_that_no_path_comes_to_raise_nothing() -> None:
    grid = ValueGrid((-1.0, -1.0), (1.0, 1.0), (40, 40))
    start = Start((0.1, 0.0))
    known = start.reached(grid, 0.4)
    values = dilated(np.where(known, grid.squares(np.zeros((1, 2))), NOWHERE))
    found = grid.within(values, 0.05, known)[0]
    assert found[known].max() < 0.5
    assert found[0, 0] < NOWHERE / 2


TURNING, SPEED = 0.1, 0.02


def driven(speeds: Array, turns: Array) -> Array:
    """Places (runs, samples, 2) of robots that begin at 0 with heading 0, of shares of the top speed."""
    headings = np.cumsum(turns, axis=1) / TURNING
    middles = headings - turns / TURNING / 2
    moves = speeds[..., None] * np.stack([np.cos(middles), np.sin(middles)], axis=-1)
    return np.cumsum(moves, axis=1)


@pytest.mark.slow
def test_no_robot_is_where_turning_leaves_it_no_time_to_come_to() -> None:
    # Robots that shunt, too; those nearest to the limit are varied.
    rng, samples, runs = np.random.default_rng(0), 24, 400
    grid = ValueGrid((-0.5, -0.5), (0.5, 0.5), (100, 100))
    start = Start((0.0, 0.0), 0.0, 0.0, 0.0, TURNING)
    masks = np.stack([start.reached(grid, SPEED * (index + 1)) for index in range(samples)])
    share, signs = rng.random((runs, samples)), rng.choice([-1.0, 1.0], (runs, samples, 2))
    lengths = SPEED * np.arange(1, samples + 1)
    for _ in range(60):
        places = driven(SPEED * share * signs[..., 0], SPEED * (1 - share) * signs[..., 1])
        cells = np.rint((places - grid.low) / grid.sizes).astype(int)
        assert masks[np.arange(samples), cells[..., 0], cells[..., 1]].all()
        distance = np.hypot(places[..., 0], places[..., 1])
        angle = np.arctan2(np.abs(places[..., 1]), np.abs(places[..., 0]))
        needed = np.where(distance >= TURNING, distance + TURNING * angle, distance)
        assert np.all(needed <= lengths * (1 + 1e-9))
        best = np.argsort(-(needed / lengths)[:, 8:].max(axis=1))[:40]
        chosen = np.tile(best, runs // len(best))
        flipped = rng.random((runs, samples, 2)) < 0.05
        signs = np.where(flipped, -signs[chosen], signs[chosen])
        moved = np.where(rng.random((runs, samples)) < 0.2, rng.normal(0, 0.3, (runs, samples)), 0.0)
        share = np.clip(share[chosen] + moved, 0.0, 1.0)
