"""A prior beside logs that drift: neither is believed more than it is sure."""

from __future__ import annotations

import numpy as np
import pytest
from simulated import ROBOT, TRUTH, course, log_of, logged_problem, options, truth_of
from windowed import drifting

from oed.estimation import Calibration, calibrate
from oed.estimation.assessment.prior_weight import weighted_with_prior
from oed.estimation.methods.drift_rates import USUAL
from oed.kernel.measurement.prior import Prior
from oed.logs.log import Log

TRUE = truth_of(ROBOT, **TRUTH)
ASKED = options(segment="log", noise="constant", clock_offset=False, sensor_place=(), replicates=100)
NAMES = tuple(one.name for one in ROBOT.parameters)
KNOWN = np.array([5e-5, 5e-5, 2.5e-4])
"""Standard errors of what half a dozen drives showed before [m]."""


def drifted(seed: int) -> Log:
    drive = drifting(course(seconds=10.0, period=0.2, seed=seed), TRUE, np.sqrt(USUAL), seed)
    return log_of(drive, noise=(0.0005, 0.003), seed=seed)


def estimate(seed: int, values: np.ndarray, covariance: np.ndarray) -> Calibration:
    robot = ROBOT.with_values(dict(zip(NAMES, map(float, values), strict=True)))
    prior = Prior(parameters=NAMES, covariance=tuple(tuple(map(float, row)) for row in covariance))
    problem = logged_problem(model=robot, prior=prior)
    return calibrate(problem, [drifted(seed)], ASKED)


@pytest.mark.slow
def test_a_log_that_drifts_makes_no_estimate_worse_than_what_was_known():
    rng, off, errors = np.random.default_rng(0), [], []
    for seed in range(5):
        before = TRUE + KNOWN * rng.normal(size=3)
        found = estimate(seed, before, np.diag(KNOWN**2))
        off.append((found.values - TRUE, before - TRUE))
        errors.append(np.sqrt(np.diag(found.covariance)) / KNOWN)
        assert any("logs weigh beside what was known" in note for note in found.notes)
    after, before = np.sqrt(np.mean(np.square(off), axis=0))
    # Weighted by F^-1 alone, the log made it twice as far off, and as unsure.
    assert np.all(after < 1.2 * before)
    assert np.all(np.median(errors, axis=0) < 1)
    assert np.max(errors) < 1.25


@pytest.mark.slow
def test_is_generalised_least_squares_of_both():
    found = estimate(3, TRUE + KNOWN, np.diag(KNOWN**2))
    alone = calibrate(
        logged_problem(),
        [drifted(3)],
        ASKED.model_copy(update={"covariance": "drift"}),
    )
    logs, known = (np.linalg.inv(one) for one in (alone.covariances[0].matrix, np.diag(KNOWN**2)))
    wanted = np.linalg.solve(logs + known, logs @ alone.values + known @ (TRUE + KNOWN))
    errors = np.sqrt(np.diag(np.linalg.inv(logs + known)))
    assert np.all(np.abs(found.values - wanted) < 0.2 * errors)
    (drift,) = (one for one in found.covariances if one.name == "drift")
    assert np.sqrt(np.diag(drift.matrix)) == pytest.approx(errors, rel=0.15)


@pytest.mark.slow
def test_a_prior_of_no_weight_changes_nothing():
    found = estimate(3, TRUE + KNOWN, np.diag(KNOWN**2) * 1e8)
    fit, covariances, notes = weighted_with_prior(found.fit, found.covariances)
    assert fit is found.fit
    assert covariances == found.covariances
    assert notes == ()
