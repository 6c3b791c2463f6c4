"""The noise that residuals show: steps of grids."""

from __future__ import annotations

import numpy as np
import pytest

from oed.estimation.setup.noise import step_of_grid


@pytest.fixture
def errors() -> np.ndarray:
    return np.random.default_rng(0).normal(size=400)


def test_residuals_most_of_which_are_zero_show_the_step_of_their_grid(errors: np.ndarray):
    assert step_of_grid(0.002 * np.round(errors / 2)) == pytest.approx(0.002)


def test_rounding_of_a_file_does_not_hide_a_grid(errors: np.ndarray):
    residuals = np.round(0.002 * np.round(errors / 2) + 1e-5 * errors, 5)
    assert step_of_grid(residuals) == pytest.approx(0.002, abs=1e-4)


@pytest.mark.parametrize("step", [0.5, 1.0])
def test_residuals_fewer_of_which_are_zero_show_no_grid(errors: np.ndarray, step: float):
    assert step_of_grid(0.002 * step * np.round(errors / step)) == 0


@pytest.mark.parametrize("size", [3e-5, 5e-5, 7e-5, 1e-4, 1.5e-4, 2e-4, 0.002])
@pytest.mark.parametrize("count", [400, 40_000])
def test_normal_residuals_show_no_grid(size: float, count: int):
    for seed in range(3):
        assert step_of_grid(size * np.random.default_rng(seed).normal(size=count)) == 0


@pytest.mark.parametrize("step", [3e-4, 0.002, 0.02])
def test_outliers_between_do_not_hide_a_grid(errors: np.ndarray, step: float):
    residuals = step * np.round(errors / 2)
    residuals[::100] = step * np.linspace(0.3, 0.7, 4)
    assert step_of_grid(residuals) == pytest.approx(step)


def test_flipped_headings_of_a_good_sensor_show_no_grid(errors: np.ndarray):
    assert step_of_grid(np.where(np.arange(400) % 9 == 0, np.pi, 0.002 * errors)) == 0


def test_outliers_among_exact_readings_show_no_grid(errors: np.ndarray):
    assert step_of_grid(np.where(np.arange(400) % 9 == 0, errors, 0.0)) == 0
