"""The search for least squares against closed forms and SciPy, from near and far."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from oed.estimation.methods.gauss_newton import SHARES, LeastSquares, Rows, downhill
from oed.estimation.setup.options import Loss
from oed.estimation.setup.unknowns import Knowledge

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
    return lambda values, _: Rows.of((measured - decay(values)) / NOISE, decay_slopes(values) / NOISE)


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
    search = LeastSquares(np.ones(3), known)
    found = search.solved(lambda values, _: Rows.of(measured - design @ values, design), np.full(3, 10.0))
    normal = design.T @ design + known.information
    expected = np.linalg.solve(normal, design.T @ measured + known.information @ known.centre)
    assert found.arrived
    np.testing.assert_allclose(found.values, expected, rtol=1e-10)


@pytest.mark.parametrize(
    ("loss", "start"),
    # Beyond outliers cauchy has minima of its own.
    [(loss, start) for loss in LOSSES for start in STARTS if loss != "cauchy" or start != STARTS[-1]],
)
def test_robust_losses_are_scipys(loss: Loss, start: tuple[float, ...]):
    measured = readings(outliers=6)
    search = LeastSquares(np.abs(TRUE), Knowledge.nothing(3), loss, close=1e-12)
    found = search.solved(decay_rows(measured), np.array(start))
    best = least_squares(
        lambda values: (decay(values) - measured) / NOISE, TRUE, loss=loss, xtol=1e-15, ftol=1e-15, gtol=1e-12
    )
    assert found.arrived
    np.testing.assert_allclose(found.values, best.x, atol=1e-6)


def test_what_nothing_tells_stays_where_it_was():
    # Only the sum of the first two is read.
    design = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, 1.0, 1.0]])
    measured = np.array([3.0, 2.0, 4.0])
    found = LeastSquares(np.ones(3), Knowledge.nothing(3)).solved(
        lambda values, _: Rows.of(measured - design @ values, design), np.array([0.5, -0.5, 0.0])
    )
    assert found.arrived
    np.testing.assert_allclose(found.values, [2.0, 1.0, 1.0], atol=1e-12)


def test_held_at_a_corner_of_a_clock_the_others_go_on():
    # Misfit |clock| has its least where no slope is 0; the line beside it is found all the same.
    def rows(values: np.ndarray, _: np.ndarray) -> Rows:
        line, clock = values
        corner = 100.0 * (1 + abs(clock))
        slope = -100.0 * (1.0 if clock >= 0 else -1.0)
        residuals = np.concatenate([[corner], 2.0 - line * np.ones(5)])
        slopes = np.zeros((6, 2))
        slopes[0, 1], slopes[1:, 0] = slope, 1.0
        return Rows.of(residuals, slopes)

    found = LeastSquares(np.ones(2), Knowledge.nothing(2), clocks=1).solved(rows, np.array([0.0, 0.0]))
    assert found.arrived
    np.testing.assert_allclose(found.values, [2.0, 0.0], atol=1e-9)


class Hill:
    def __init__(self, misfit: float, *, smooth: bool = True) -> None:
        self.misfit, self.smooth = misfit, smooth


def test_steps_are_shortened_until_they_lead_downhill():
    tried = []

    def after(share: float) -> Hill:
        tried.append(share)
        return Hill(1.0 + share - 0.2)

    here = Hill(1.0)
    found, vain = downhill(here, after, SHARES)
    assert (found.misfit, vain) == (pytest.approx(0.925), 3)
    assert tried == [1.0, 0.5, 0.25, 0.125]
    assert downhill(here, lambda share: Hill(2.0), SHARES[2:]) == (here, len(SHARES) - 2)


def test_no_step_leads_to_where_there_are_no_derivatives():
    found, vain = downhill(Hill(1.0), lambda share: Hill(0.5, smooth=share < 0.5), SHARES)
    assert (found.smooth, vain) == (True, 2)


@pytest.mark.parametrize("start", [(0.1, 8.0, 0.0), (100.0, 0.1, -100.0)])
def test_far_off_steps_are_damped(start: tuple[float, ...]):
    # Halved steps end where a decay is over at once, or nearly a line.
    found = LeastSquares(np.abs(TRUE), Knowledge.nothing(3), close=1e-12).solved(
        decay_rows(readings()), np.array(start)
    )
    assert found.arrived
    np.testing.assert_allclose(decay(found.values), decay(TRUE), atol=2 * NOISE)


def test_starts_of_segments_are_found_as_if_they_were_common():
    # Two decays that begin at levels of their own, which nobody asks for.
    rng = np.random.default_rng(2)
    measured = np.stack([decay(TRUE), decay(TRUE) + 1.5]) + NOISE * rng.standard_normal((2, len(TIMES)))
    known = Knowledge(np.diag([0.0, 4.0]), np.array([0.0, 0.6]))

    def apart(values: np.ndarray, levels: np.ndarray) -> Rows:
        predicted = decay(np.array([*values, 0.0])) + levels
        slopes = np.broadcast_to(decay_slopes(np.array([*values, 0.0]))[:, :2], (2, len(TIMES), 2))
        return Rows((measured - predicted) / NOISE, slopes / NOISE, np.ones((2, len(TIMES), 1)) / NOISE)

    def together(values: np.ndarray, _: np.ndarray) -> Rows:
        residuals, slopes, own = apart(values[:2], values[2:, None])
        levels = np.kron(np.eye(2), own[0])
        return Rows.of(residuals.ravel(), np.hstack([slopes.reshape(-1, 2), levels]))

    found = LeastSquares(np.ones(2), known, close=1e-12).solved(apart, np.array([2.0, 1.0]), np.zeros((2, 1)))
    wide = Knowledge(np.diag([0.0, 4.0, 0.0, 0.0]), np.array([0.0, 0.6, 0.0, 0.0]))
    expected = LeastSquares(np.ones(4), wide, close=1e-12).solved(together, np.array([2.0, 1.0, 0.0, 0.0]))
    assert found.arrived
    assert expected.arrived
    np.testing.assert_allclose([*found.values, *found.starts.ravel()], expected.values, rtol=1e-9)


def kinked(seed: int):
    """Readings with outliers of what speeds add up to, by stamps far apart: piecewise linear in the clock."""
    rng = np.random.default_rng(seed)
    stamps, times = np.arange(0.0, 20.0, 0.05), np.arange(1.0, 19.0, 0.05)
    turned = np.concatenate([[0.0], np.cumsum(0.05 * rng.choice([-4.0, 0.0, 2.0, 4.0], len(stamps) - 1))])
    wrong = np.where(rng.random(len(times)) < 0.1, 10.0, 1.0)
    measured = 1.03 * np.interp(times + 0.05, stamps, turned) + 0.2
    measured += 0.1 * wrong * rng.standard_normal(len(times))

    def rows(values: np.ndarray, _: np.ndarray) -> Rows:
        gain, level, clock = values
        found, after, before = (np.interp(times + clock + off, stamps, turned) for off in (0, 1e-3, -1e-3))
        slopes = np.column_stack([found, np.ones_like(times), gain * (after - before) / 2e-3])
        return Rows.of((measured - gain * found - level) / 0.02, slopes / 0.02)

    return rows


@pytest.mark.parametrize("seed", [1, 17])
def test_a_slow_search_in_kinks_of_a_clock_has_arrived(seed: int):
    known = Knowledge(np.diag([1e-4, 1e-4, 4.0]), np.zeros(3))
    search = LeastSquares(np.array([1.0, 1.0, 0.1]), known, "cauchy", clocks=1, close=1e-6, flat=1.0)
    found = search.solved(kinked(seed), np.array([1.0, 0.0, 0.0]))
    assert found.arrived
    np.testing.assert_allclose(found.values, [1.03, 0.2, 0.05], atol=0.02)


def test_a_search_that_runs_away_has_not_arrived():
    # Nothing but an exponent without end explains readings of 0: it grows twentyfold in every step.
    def rows(values: np.ndarray, _: np.ndarray) -> Rows:
        fading = np.maximum(values, 1.0) ** -0.05 * np.ones_like(TIMES) / NOISE
        return Rows.of(-fading, -0.05 * (fading / values)[:, None])

    found = LeastSquares(np.ones(1), Knowledge.nothing(1)).solved(rows, np.ones(1))
    assert found.values > 1e6
    assert not found.arrived


def test_clocks_that_are_held_stay():
    rows, known = kinked(0), Knowledge.nothing(3)
    search = LeastSquares(np.array([1.0, 1.0, 0.1]), known, clocks=1)
    found = search.solved(rows, np.array([1.0, 0.0, 0.03]), hold_clocks=True)
    assert found.arrived
    assert found.values[2] == 0.03
    assert found.values[0] != 1.0
