"""The search for the most likely unknowns of whole logs, where clocks make the likelihood rough."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from simulated import course, fit_of, log_of, truth_of, unknowns_of

from oed.estimation.methods.fit import Fit
from oed.estimation.methods.whole_logs import WholeLogs
from oed.robots.models import DifferentialDrive

ROBOT = DifferentialDrive(wheel_radius=0.098, track=0.376)
TRUTH = truth_of(ROBOT, wheel_radius_right=0.0924, wheel_radius_left=0.0921, track=0.537)


@cache
def fit_with_uneven_stamps(seed: int, seconds: float = 8.0, period: float = 0.02) -> Fit:
    """The fit to segments of a drive that hardly turns, with noisy wheels and stamps uneven by 10 ms."""
    rng, times = np.random.default_rng([seed, 8]), period * np.arange(round(seconds / period))
    turning = 0.1 * np.sin(2 * np.pi * times / 7 + rng.uniform(0, 6))
    mean = 0.72 + 0.3 * np.sin(2 * np.pi * times / 9 + rng.uniform(0, 6))
    inputs = np.column_stack([mean + turning, mean - turning])
    drive = course(ROBOT, TRUTH, seconds=seconds, period=period, inputs=inputs, seed=seed)
    log = log_of(drive, noise=(0.02, 0.005), place=(-0.171, 0.01, 0.0), offset=0.05, every=5, seed=seed)
    wheels = 0.3 * period * np.cumsum(rng.normal(size=log.integrals.shape), axis=0)
    stamps = log.pose_times + rng.uniform(-0.01, 0.01, len(log.pose_times))
    log = replace(log, pose_times=stamps, integrals=log.integrals + np.vstack([0 * wheels[:1], wheels[:-1]]))
    return fit_of([log], unknowns_of(ROBOT, clocks=1), seconds=4.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_it_converges_where_stamps_are_uneven(seed: int):
    assert WholeLogs(fit_with_uneven_stamps(seed)).found().fit.converged


@pytest.mark.slow
def test_it_does_not_run_away_from_a_start_that_is_far_off():
    fit = fit_with_uneven_stamps(2)
    deviations = np.sqrt(np.diag(np.linalg.inv(fit.information.sum(axis=0))))
    far = replace(fit, values=fit.values + 30 * deviations * [1, -1, 1, 1])
    near, found = WholeLogs(fit).found(), WholeLogs(far).found()
    np.testing.assert_allclose(found.fit.values[:3], near.fit.values[:3], rtol=0.3)


def test_a_step_is_shortened_or_left_out_where_it_leads_to_less_likely_unknowns():
    search = WholeLogs(fit_with_uneven_stamps(1))
    errors = search._errors
    here = search._iterate(search.fit.values, search._first_paths)
    step, _ = here.linear.step(errors.guess)
    shortened, gain = search._likelier(here, 8 * step, errors.guess)
    assert gain > 0
    assert here.linear.score(errors, errors.guess) - shortened.linear.score(errors, errors.guess) == gain
    left_out, none = search._likelier(here, -step, errors.guess)
    assert left_out is here
    assert none == 0


def test_clocks_may_be_held():
    fit = fit_with_uneven_stamps(1)
    search = WholeLogs(fit)
    linear = search._iterate(fit.values, search._first_paths).linear
    step, covariance = linear.step(search._errors.guess, hold_clocks=True)
    assert step[fit.unknowns.size - 1] == pytest.approx(0, abs=1e-12)
    free, same = linear.step(search._errors.guess)
    assert not np.allclose(step[:3], free[:3], rtol=1e-3)
    np.testing.assert_array_equal(covariance, same)
