"""The search for least squares against closed forms and SciPy, from near and far."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from oed.estimation.methods.gauss_newton import LeastSquares, downhill
from oed.estimation.methods.knowledge import Knowledge
from oed.estimation.setup.options import Loss

TIMES = np.linspace(0.0, 2.0, 40)
TRUE = np.array([3.0, 0.7, -0.5])
NOISE = 0.05
STARTS = ((3.0, 0.7, -0.5), (3.5, 0.9, -0.2), (6.0, 1.2, 0.5))
LOSSES: tuple[Loss, ...] = ("linear", "huber", "soft_l1", "cauchy")


def decay(values: np.ndarray) -> np.ndarray:
    return values[0] * np.exp(-values[1] * TIMES) + values[2]


def decay_slopes(values: np.ndarray) -> np.ndarray:
    fading = np.exp(-values[1] * TIMES)
    return np.column_stack([fading, -values[0] * TIMES * fading, np.ones_like(TIMES)])


def decay_rows(measured: np.ndarray):
    return lambda values: ((measured - decay(values)) / NOISE, decay_slopes(values) / NOISE)


def readings(outliers: int = 0) -> np.ndarray:
    rng = np.random.default_rng(1)
    found = decay(TRUE) + NOISE * rng.standard_normal(len(TIMES))
    found[rng.permutation(len(TIMES))[:outliers]] += 1.0
    return found


def test_linear_readings_and_knowledge_in_closed_form():
    rng = np.random.default_rng(0)
    design, measured = rng.standard_normal((20, 3)), rng.standard_normal(20)
    # Of rank 2: nothing is known along one direction.
    root = rng.standard_normal((2, 3))
    known = Knowledge(root.T @ root, np.array([1.0, -2.0, 0.5]))
    search = LeastSquares(lambda values: (measured - design @ values, design), np.ones(3), known)
    found, arrived = search.solved(np.full(3, 10.0))
    normal = design.T @ design + known.information
    expected = np.linalg.solve(normal, design.T @ measured + known.information @ known.centre)
    assert arrived
    np.testing.assert_allclose(found, expected, rtol=1e-10)


@pytest.mark.parametrize(
    ("loss", "start"),
    # Beyond outliers cauchy has minima of its own.
    [(loss, start) for loss in LOSSES for start in STARTS if loss != "cauchy" or start != STARTS[-1]],
)
def test_robust_losses_are_scipys(loss: Loss, start: tuple[float, ...]):
    measured = readings(outliers=6)
    search = LeastSquares(decay_rows(measured), np.abs(TRUE), Knowledge.nothing(3), loss, close=1e-12)
    found, arrived = search.solved(np.array(start))
    best = least_squares(
        lambda values: (decay(values) - measured) / NOISE, TRUE, loss=loss, xtol=1e-15, ftol=1e-15, gtol=1e-12
    )
    assert arrived
    np.testing.assert_allclose(found, best.x, atol=1e-6)


def test_what_nothing_tells_stays_where_it_was():
    # Only the sum of the first two is read.
    design = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, 1.0, 1.0]])
    search = LeastSquares(
        lambda values: (np.array([3.0, 2.0, 4.0]) - design @ values, design), np.ones(3), Knowledge.nothing(3)
    )
    found, arrived = search.solved(np.array([0.5, -0.5, 0.0]))
    assert arrived
    np.testing.assert_allclose(found, [2.0, 1.0, 1.0], atol=1e-12)


def test_held_at_a_corner_of_a_clock_the_others_go_on():
    # Misfit |clock| has its least where no slope is 0; the line beside it is found all the same.
    def rows(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        line, clock = values
        corner = 100.0 * (1 + abs(clock))
        slope = -100.0 * (1.0 if clock >= 0 else -1.0)
        residuals = np.concatenate([[corner], 2.0 - line * np.ones(5)])
        slopes = np.zeros((6, 2))
        slopes[0, 1], slopes[1:, 0] = slope, 1.0
        return residuals, slopes

    search = LeastSquares(rows, np.ones(2), Knowledge.nothing(2), clocks=1)
    found, arrived = search.solved(np.array([0.0, 0.0]))
    assert arrived
    np.testing.assert_allclose(found, [2.0, 0.0], atol=1e-9)


class Hill:
    def __init__(self, misfit: float) -> None:
        self.misfit = misfit


def test_steps_are_halved_until_they_lead_downhill():
    tried = []

    def after(share: float) -> Hill:
        tried.append(share)
        return Hill(1.0 + share - 0.2)

    here = Hill(1.0)
    assert downhill(here, after).misfit == pytest.approx(0.925)
    assert tried == [1.0, 0.5, 0.25, 0.125]
    assert downhill(here, lambda share: Hill(2.0)) is here
