"""Medians and scatter over repeats, with their intervals."""

from __future__ import annotations

import numpy as np
import pytest

from oed.simulation.trial.outcome import Repeats, scatter, total


def repeats(errors: np.ndarray, resamples: int = 4000) -> Repeats:
    return Repeats(errors, resamples, seed=1)


def test_medians():
    errors = np.stack([[[1.0, 4.0], [2.0, 8.0]], [[3.0, 5.0], [6.0, 10.0]], [[2.0, 6.0], [4.0, 12.0]]])
    np.testing.assert_array_equal(repeats(errors).medians, [[2, 5], [4, 10]])


@pytest.mark.slow
def test_intervals_of_a_median_hold_it_as_often_as_they_say():
    rng = np.random.default_rng(2)
    held = [
        interval.low <= 0 <= interval.high
        for interval in (repeats(rng.normal(size=(20, 1, 1)), 200).median(0, 0) for _ in range(200))
    ]
    assert 0.9 < np.mean(held) < 0.99


def test_a_refused_calibration_is_infinitely_wrong():
    errors = np.array([[[1.0]], [[np.inf]], [[2.0]]])
    found = repeats(errors).median(0, 0)
    assert found.value == 2.0
    assert found.high == np.inf


def test_scatter_is_relative_to_sizes():
    rng = np.random.default_rng(3)
    values = np.array([1.0, 10.0]) + rng.normal(size=(40_000, 2)) * [0.02, 0.3]
    relative = scatter(values, np.array([1.0, 10.0]))
    np.testing.assert_allclose(relative, [0.02, 0.03], rtol=0.02)
    assert total(relative) == pytest.approx(np.hypot(*relative) / np.sqrt(2))
    assert np.isnan(scatter(values[:1], np.ones(2))).all()
