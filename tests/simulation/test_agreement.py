"""How far errors may be from the predicted: the limit holds as often as it says, and is said everywhere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from oed.simulation.agreement import CONFIDENCE, agreement_text, largest_ratio

DRAWS = 500


def limits(ratios: list[float], replicates: int) -> np.ndarray:
    """Of `DRAWS` samples whose standard errors are `ratios` times as large as predicted, turned at random."""
    size = len(ratios)
    rng = np.random.default_rng([replicates, size])
    turn = np.linalg.qr(rng.standard_normal((size, size)))[0]
    predicted = turn @ np.diag(np.geomspace(1, 1e-6, size)) @ turn.T
    root = turn @ np.diag(np.sqrt(np.geomspace(1, 1e-6, size)) * ratios)
    degrees = replicates - 1
    found = np.atleast_3d(stats.wishart(degrees, np.eye(size)).rvs(DRAWS, random_state=rng)) / degrees
    found = found.reshape(DRAWS, size, size)
    return np.array([largest_ratio(predicted, root @ one @ root.T, replicates) for one in found])


@pytest.mark.parametrize("replicates", [10, 100, 10_000])
@pytest.mark.parametrize(
    "ratios",
    [[1.1], [1 / 1.1], [1.0, 1.1], [1.0, 1.0, 1 / 1.1], [1.1, 1 / 1.1], [1.0] * 5 + [3.0], [1.0, 1 / 3.0]],
    ids=str,
)
def test_the_true_ratio_is_beyond_the_limit_in_a_twentieth_of_samples_at_most(ratios, replicates: int):
    true = max(max(one, 1 / one) for one in ratios)
    share = float(np.mean(limits(ratios, replicates) >= true))
    assert share >= CONFIDENCE - 3 * math.sqrt(CONFIDENCE * (1 - CONFIDENCE) / DRAWS)


@pytest.mark.parametrize("ratio", [1.5, 1 / 1.5])
def test_of_a_single_parameter_the_limit_is_exact(ratio: float):
    share = float(np.mean(limits([ratio], 400) >= 1.5))
    assert share == pytest.approx(CONFIDENCE, abs=3 * math.sqrt(CONFIDENCE * (1 - CONFIDENCE) / DRAWS))


@pytest.mark.slow
def test_many_experiments_say_more_than_few():
    few, many, most = (float(np.median(limits([1.0, 1.0], count))) for count in (100, 10_000, 10**8))
    assert few > 1.1 > 1.03 > many > 1.01
    assert 1 < most < 1.0005


def test_what_cannot_be_known_is_not_said():
    assert largest_ratio(np.eye(3), np.eye(3), 3) == math.inf
    assert largest_ratio(np.eye(2), np.zeros((2, 2)), 100) == math.inf
    assert largest_ratio([[1.0, 1.0], [1.0, 1.0]], np.eye(2), 100) == math.inf
    assert agreement_text(math.inf) == "as far as so few experiments can tell"


@pytest.mark.parametrize(
    ("ratio", "said"),
    [
        (1.0231, "to within 2.4 % (95 % confidence)"),
        (1.02, "to within 2.0 % (95 % confidence)"),
        (1.385, "to within 39 % (95 % confidence)"),
        (2.31, "to within a factor of 2.4 (95 % confidence)"),
    ],
)
def test_the_limit_is_rounded_upwards(ratio: float, said: str):
    assert agreement_text(ratio) == said
