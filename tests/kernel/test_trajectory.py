"""Drives: what is held, what is refused, and how the design space describes them."""

from __future__ import annotations

import numpy as np
import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oed.foundation.errors import PartError
from oed.kernel.dynamics.embedding import Embedding
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory, bounding_values, middles
from oed.robots.space import DesignSpace, StartPose

START = (0.1, -0.2, 0.3)


def random_space_drive(space: DesignSpace, seed: int = 0) -> Trajectory:
    count = space.spline.coefficients
    return space.trajectory(np.random.default_rng(seed).uniform(-9, 9, (count, 2)), START)


@given(
    rows=st.lists(st.tuples(st.floats(-10, 10), st.floats(-10, 10)), min_size=1, max_size=30),
    duration=st.floats(0.1, 100),
    rest=st.booleans(),
)
def test_from_samples_holds_exactly_these_inputs(rows, duration, rest):
    drive = Trajectory.from_samples(rows, duration, START, rest_to_rest=rest)
    assert drive.samples == len(rows)
    assert drive.duration == duration
    np.testing.assert_allclose(drive.inputs, rows, rtol=0, atol=1e-13)
    ends = drive.inputs_at(np.array([0.0, duration]))
    expected = np.zeros((2, 2)) if rest else np.array([rows[0], rows[-1]])
    np.testing.assert_allclose(ends, expected, rtol=0, atol=1e-13)


def test_from_samples_is_the_polygon_through_the_middles():
    rows = np.random.default_rng(1).uniform(-5, 5, (6, 2))
    drive = Trajectory.from_samples(rows, 3.0, START)
    times = np.linspace(0, 3, 50)
    knots = [0.0, *middles(3.0, 6), 3.0]
    for column in range(2):
        expected = np.interp(times, knots, [0.0, *rows[:, column], 0.0])
        np.testing.assert_allclose(drive.inputs_at(times)[:, column], expected, rtol=0, atol=1e-13)


def test_arrays_are_read_only_copies():
    coefficients = np.ones((5, 2))
    drive = DesignSpace(duration=2, spline=Spline(coefficients=5)).trajectory(coefficients, START)
    coefficients[:] = 7
    assert drive.coefficients.max() == 1
    for name in ("knots", "coefficients", "start"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(drive, name)[0] = 1


@pytest.mark.parametrize("duration", [-10, 0, float("nan"), float("inf")])
def test_a_duration_that_is_none_is_refused(duration):
    with pytest.raises(ValueError, match="expected a positive, finite duration"):
        Trajectory.from_samples(np.ones((5, 2)), duration, START)


@pytest.mark.parametrize("rows", [np.zeros((0, 2)), np.ones(5), np.ones((5, 2, 1))])
def test_inputs_that_are_no_table_are_refused(rows):
    with pytest.raises(ValueError, match="expected inputs of shape"):
        Trajectory.from_samples(rows, 1.0, START)


@pytest.mark.parametrize("knots", [[], [0, 0, 0, 0], [0, 0, -1, -1], [1, 1, 2, 2], [0, 0, 2, 1, 2, 2]])
def test_knots_that_are_no_times_are_refused(knots):
    with pytest.raises(ValueError, match="expected knots that rise from 0"):
        Trajectory(np.array(knots), 1, np.zeros((max(len(knots) - 2, 0), 2)), START, 4)


@pytest.mark.parametrize("shape", [(4, 2), (6, 2), (5,), (5, 2, 1)])
def test_coefficients_of_another_shape_are_refused(shape):
    space = DesignSpace(duration=2, spline=Spline(coefficients=5))
    with pytest.raises(ValueError, match=r"expected coefficients of shape \(5, inputs\)"):
        space.trajectory(np.zeros(shape), START)


@pytest.mark.parametrize("name", ["coefficients", "start"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(name, wrong):
    space = DesignSpace(duration=2, spline=Spline(coefficients=5))
    arrays = {"coefficients": np.zeros((5, 2)), "start": np.zeros(3)}
    arrays[name][0] = wrong
    with pytest.raises(ValueError, match=f"{name} must be finite"):
        space.trajectory(**arrays)


@pytest.mark.parametrize("degree", range(6))
def test_inputs_are_the_spline_in_the_middle_of_each_period(degree: int):
    space = DesignSpace(duration=4, samples=25, spline=Spline(degree=degree, coefficients=9))
    drive = random_space_drive(space)
    times = (np.arange(25) + 0.5) * 0.16
    assert drive.inputs.shape == (25, 2)
    np.testing.assert_allclose(drive.inputs, oracle.spline_values(drive, times), rtol=0, atol=1e-12)
    held = Embedding(DesignSpace(**{**space.as_data(), "rest_to_rest": False}), 2).held
    found = np.stack(
        [matrix @ column for matrix, column in zip(held, drive.coefficients.T, strict=True)], axis=1
    )
    np.testing.assert_allclose(found, drive.inputs, rtol=0, atol=1e-12)
    assert (drive.period, space.period) == pytest.approx((0.16, 0.16))


@pytest.mark.parametrize("degree", range(1, 6))
def test_rates_are_the_splines_derivative(degree: int):
    drive = random_space_drive(DesignSpace(duration=4, spline=Spline(degree=degree, coefficients=9)))
    times = np.random.default_rng(2).uniform(0, 4, 40)
    expected = oracle.spline_values(drive, times, order=1)
    np.testing.assert_allclose(drive.inputs_at(times, 1), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("degree", range(1, 6))
def test_coefficients_of_the_derivative_bound_the_rates(degree: int):
    space = DesignSpace(duration=4, spline=Spline(degree=degree, coefficients=9))
    drive = random_space_drive(space)
    bounds = bounding_values(space.knots, degree, drive.coefficients, space.samples, 1)
    rates = drive.inputs_at(np.linspace(0, 4, 500), 1)
    assert np.all(rates.max(axis=0) <= bounds.max(axis=0) + 1e-9)
    assert np.all(rates.min(axis=0) >= bounds.min(axis=0) - 1e-9)


def test_rates_of_a_piecewise_constant_drive_are_jumps_over_a_period():
    space = DesignSpace(duration=4, samples=8, spline=Spline(degree=0, coefficients=4))
    drive = space.trajectory([[0, 0], [2, -4], [2, 0], [0, 0]], START)
    jumps = drive.inputs_at(np.array([0.0]), 1)
    assert jumps.shape == (9, 2)
    assert jumps[:, 0] == pytest.approx([0, 0, 4, 0, 0, 0, -4, 0, 0])
    assert jumps[:, 1] == pytest.approx([0, 0, -8, 0, 8, 0, 0, 0, 0])
    matrix = bounding_values(space.knots, 0, np.eye(4), 8, 1)
    np.testing.assert_allclose(matrix @ drive.coefficients, jumps, atol=1e-12)


@pytest.mark.parametrize("count", [6, 12, 13, 18, 36])
def test_rates_of_held_steps_are_those_of_the_polygon_through_the_middles(count: int):
    # From rest and to rest as well, however many coefficients share a period.
    space = DesignSpace(duration=4, samples=12, spline=Spline(degree=0, coefficients=count))
    coefficients = np.random.default_rng(count).normal(size=(count, 2))
    coefficients[[0, -1]] = 0
    drive = space.trajectory(coefficients, START)
    polygon = Trajectory.from_samples(drive.inputs, 4.0, START)
    expected = polygon.inputs_at(np.concatenate([[0.0], np.arange(12) * 4 / 12 + 4 / 24 + 1e-9]), 1)
    np.testing.assert_allclose(drive.inputs_at(np.zeros(0), 1), expected, atol=1e-9)
    np.testing.assert_allclose(bounding_values(space.knots, 0, coefficients, 12, 1), expected, atol=1e-9)
    assert np.abs(drive.extremes(1)).max() == pytest.approx(np.abs(expected).max())


@pytest.mark.parametrize(("rest", "expected"), [(True, [1, 2, 3, 4]), (False, [0, 1, 2, 3, 4, 5])])
def test_rest_fixes_the_outer_coefficients(rest, expected):
    space = DesignSpace(duration=2, spline=Spline(coefficients=6), rest_to_rest=rest)
    assert list(space.free_rows) == expected


def test_start():
    fixed = DesignSpace(duration=2, start=StartPose(x="10 cm", heading="90 deg"))
    assert fixed.fixed_starts[0] == pytest.approx((0.1, 0.0, np.pi / 2))
    assert not fixed.start_is_free
    free = DesignSpace(duration=2, start="free")
    assert free.fixed_starts is None
    assert free.start_is_free


@pytest.mark.parametrize(
    "wrong",
    [
        {"duration": 0},
        {"duration": -1},
        {"samples": 0},
        {"samples": 2.5},
        {"start": "anywhere"},
        {"start": {"z": 0}},
        {"integration": "euler"},
        {"spline": {"degree": -1}},
        {"spline": {"coefficients": 0}},
        {"knots": 3},
    ],
)
def test_wrong_design_spaces_are_refused(wrong):
    with pytest.raises(PartError, match=next(iter(wrong))):
        DesignSpace(**{"duration": "20 s", **wrong})
