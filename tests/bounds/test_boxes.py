"""The largest value over a box, against dense grids."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from oed.bounds import boxes
from oed.bounds.boxes import Landscape, enclose_maximum, local_maxima

Row = Callable[[Any], Any]

SHAPES: dict[str, tuple[Row, list[tuple[float, float]]]] = {
    "ridge": (lambda x: ca.horzcat(x[0] - 0.3, x[0] * x[0] - 1.2), [(-2, 1.5)]),
    "waves": (lambda x: ca.horzcat(ca.sin(5 * x[0]) + 0.1 * x[0], ca.cos(3 * x[0])), [(-2, 3)]),
    "flat": (lambda x: ca.horzcat(2 + 0 * x[0], ca.SX(1)), [(-1, 1)]),
    "corner": (lambda x: ca.horzcat(ca.fabs(x[0] - 0.3), ca.fmin(x[0], 0.5)), [(-1, 1.1)]),
    "jump": (lambda x: ca.horzcat(ca.sign(x[0] - 0.3) + 0.1 * x[0], 0.2 * x[0]), [(-1, 1.1)]),
    "jump upwards": (lambda x: ca.horzcat((x[0] > 0.3) * (2 - x[0]), ca.SX(1)), [(-1, 1.1)]),
    "jumps": (
        lambda x: ca.horzcat(ca.floor(3 * x[0]) - x[0], (x[1] <= x[0]) * (1 + x[1]), x[1] ** 2),
        [(-1, 1.1), (-1, 0.7)],
    ),
    "root": (lambda x: ca.horzcat(ca.sqrt(x[0]) - x[0], 0.3 * x[0] ** 1.7), [(0, 1)]),
    "plane": (lambda x: ca.horzcat(x[0] * ca.exp(-x[1]), ca.cos(x[0] + 2 * x[1])), [(-1, 2), (0, 3)]),
    "valley": (lambda x: ca.horzcat(x[0] ** 2 - x[1], 0.1 * (1 - x[0])), [(-1, 1), (-1, 1)]),
    "closed": (lambda x: ca.horzcat(x[0] * x[1], x[1]), [(0.5, 0.5), (-1, 2)]),
    "space": (
        lambda x: ca.horzcat(ca.sin(x[0] + x[1]), x[2] * ca.exp(-x[2]), x[0] * x[1] - x[2]),
        [(0, 2), (-1, 1), (0, 4)],
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_no_value_of_a_dense_grid_is_larger(name: str) -> None:
    row, ranges = SHAPES[name]
    low, high = np.array(ranges, dtype=float).T
    inputs = ca.SX.sym("x", len(ranges))
    landscape = Landscape(inputs, row(inputs))
    rng = np.random.default_rng(1)
    dense = {1: 10001, 2: 151, 3: 31}[len(ranges)]
    grid = np.array(list(itertools.product(*(np.linspace(*ends, dense) for ends in ranges))))
    rows = ca.Function("rows", [inputs], [ca.densify(row(inputs))])
    each = np.array(rows.map(len(grid))(grid.T)).reshape(len(grid), -1)
    for _ in range(3):
        factor = rng.normal(size=(each.shape[1],) * 2)
        expected = ((each @ factor.T) ** 2).sum(axis=1).max()
        starts = rng.uniform(low, high, (2, len(low)))
        found = enclose_maximum(landscape, factor, low, high, starts)
        assert expected <= found.upper * (1 + 1e-12)
        # The value is of a point of the box, and all but proved.
        assert np.all((low <= found.point) & (found.point <= high))
        own = np.array(rows(found.point)).ravel()
        assert ((factor @ own) ** 2).sum() == pytest.approx(found.value, rel=1e-12)
        # At a jump both sides count together.
        assert found.value <= found.upper <= found.value * (1.5 if "jump" in name else 1 + 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_the_largest_value_is_as_sure_whatever_its_unit(scale: float) -> None:
    row, ranges = SHAPES["plane"]
    low, high = np.array(ranges, dtype=float).T
    inputs = ca.SX.sym("x", 2)
    landscape, starts = Landscape(inputs, row(inputs)), (low + high)[None] / 2
    one, other = (
        enclose_maximum(landscape, factor * np.eye(2), low, high, starts) for factor in (1.0, scale)
    )
    assert other.upper == pytest.approx(scale**2 * one.upper, rel=1e-9, abs=0)
    assert other.value <= other.upper <= other.value * (1 + 1e-9)


def test_peaks_are_local_maxima() -> None:
    row, ranges = SHAPES["plane"]
    low, high = np.array(ranges, dtype=float).T
    inputs = ca.SX.sym("x", 2)
    landscape, factor, rng = Landscape(inputs, row(inputs)), np.eye(2), np.random.default_rng(0)
    starts = rng.uniform(low, high, (20, 2))
    found = local_maxima(landscape, factor, low, high, starts)
    values = landscape.at(found, factor)[0]
    assert np.all(values >= landscape.at(starts, factor)[0])
    for _ in range(50):
        near = np.clip(found + rng.normal(size=found.shape) * 1e-4, low, high)
        assert np.all(landscape.at(near, factor)[0] <= values * (1 + 1e-12))


def test_the_largest_value_is_as_sure_where_it_takes_many_steps_to_come_near_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Concave all over the box, whose middle is not the top: one step does not see how large it is there.
    monkeypatch.setattr(boxes, "NEWTON", 1)
    inputs = ca.SX.sym("x", 1)
    landscape, low, high = Landscape(inputs, ca.cos(inputs)), np.array([-0.3]), np.array([0.5])
    found = enclose_maximum(landscape, np.eye(1), low, high, low[None])
    assert found.upper * (1 + 1e-12) >= 1
    assert found.upper <= 1 + 1e-9
