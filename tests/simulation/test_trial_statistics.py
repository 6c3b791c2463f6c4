"""Medians, scatter and ratios over repeats, with their intervals."""

from __future__ import annotations

import numpy as np
import pytest

from oed.simulation.trial.statistics import Repeats, resampled_pair, scatter, total


def repeats(errors: np.ndarray, resamples: int = 4000) -> Repeats:
    return Repeats(errors, resamples, seed=1)


def test_medians_and_ratios():
    errors = np.stack([[[1.0, 4.0], [2.0, 8.0]], [[3.0, 5.0], [6.0, 10.0]], [[2.0, 6.0], [4.0, 12.0]]])
    found = repeats(errors)
    np.testing.assert_array_equal(found.medians, [[2, 5], [4, 10]])
    # Twice as large in every repeat is twice as large in every resample.
    ratio = found.ratio([(0, 0)], [(1, 0)])
    assert (ratio.value, ratio.low, ratio.high) == (0.5, 0.5, 0.5)
    assert found.best([(1, 0), (0, 1), (1, 1)]) == (1, 0)
    assert found.ratio([(0, 1), (1, 0)], [(0, 0)]).value == 2.0


def test_the_best_is_chosen_anew_in_every_resample():
    rng = np.random.default_rng(0)
    errors = rng.lognormal(size=(15, 6, 1))
    one, many = [(0, 0)], [(drive, 0) for drive in range(6)]
    found = repeats(errors)
    ratio = found.ratio(many, one)
    assert ratio.value <= 1
    assert ratio.high <= 1
    assert found.ratio(many, many).high == 1.0


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


def test_ratios_of_scatter_by_the_same_repeats():
    rng = np.random.default_rng(4)
    one = rng.normal(size=(30, 3))
    picks = repeats(one[:, :, None]).picks

    def judged(values: np.ndarray) -> np.ndarray:
        return total(scatter(values, np.ones(3)))

    exact = resampled_pair(one, 2 * one + 5, picks, judged)
    assert exact.low == pytest.approx(0.5)
    assert exact.high == pytest.approx(0.5)
    other = resampled_pair(one, rng.normal(size=(30, 3)), picks, judged)
    assert other.low < 1 < other.high
