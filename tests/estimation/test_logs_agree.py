"""Do logs differ by more than noise and drift make them: how often that is said, and what helps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm
from simulated import ROBOT, TRUTH, course, fit_of, log_of, several, truth_of, unknowns_of
from windowed import drifting

from oed.estimation.assessment.diagnostics import BY_NOISE, Diagnostic, Expected, diagnostics
from oed.estimation.methods.drift_rates import USUAL, DriftRates
from oed.logs.log import Log

NOISE, FINE = (0.003, 0.006), (0.0005, 0.003)
TRUE = truth_of(ROBOT, **TRUTH)
DRIFT = Expected(DriftRates(USUAL, np.zeros((4, 4))))


def agreement(logs: list[Log], expected: Expected) -> Diagnostic:
    found = diagnostics(fit_of(logs, seconds=np.inf), {}, expected)
    return next(one for one in found if one.name == "logs_agree")


def pair(seed: int) -> list[Log]:
    """Two logs of a robot that drifts as robots usually do."""
    numbers = (2 * seed, 2 * seed + 1)
    drives = [
        drifting(course(seconds=10.0, period=0.2, seed=one), TRUE, np.sqrt(USUAL), seed=one)
        for one in numbers
    ]
    return [log_of(one, noise=FINE, seed=k, name=str(k)) for k, one in zip(numbers, drives, strict=True)]


@pytest.mark.slow
def test_logs_that_merely_drift_agree_as_often_as_they_should():
    pairs = [pair(seed) for seed in range(20)]
    found = [agreement(logs, DRIFT) for logs in pairs]
    values = np.array([one.p_value for one in found])
    assert np.sum(values < 0.05) <= 4
    assert values.mean() == pytest.approx(0.5, abs=0.25)
    # As far apart as that makes them, on average: once.
    squares = np.array([one.statistic**2 for one in found])
    assert squares.mean() == pytest.approx(1, abs=3 * squares.std() / np.sqrt(len(squares)))
    times = f"{found[0].statistic:.1f} times"
    assert found[0].message.endswith(f"{times} as much as noise and drift would make them")
    # By noise alone hardly any do.
    by_noise = [agreement(logs, BY_NOISE) for logs in pairs[:3]]
    assert not any(one.passed for one in by_noise)
    assert "times as much as the noise would make them" in by_noise[0].message


def test_two_logs_of_one_parameter_differ_by_one_number():
    """Which is as probable as a normal one of that size."""
    fit = fit_of(several(2, seconds=6.0, noise=NOISE), unknowns_of(names=("track",)))
    found = next(one for one in diagnostics(fit, {}) if one.name == "logs_agree")
    assert found.p_value == pytest.approx(2 * norm.sf(found.statistic), rel=1e-3)
    assert 0.05 < found.p_value < 0.95


@pytest.mark.slow
def test_robots_that_differ_from_log_to_log_do_not_agree_all_the_same():
    other = truth_of(ROBOT, **{**TRUTH, "track": 1.1 * TRUTH["track"]})
    drive = drifting(course(ROBOT, other, seconds=10.0, seed=1), other, np.sqrt(USUAL), seed=1)
    first, _ = pair(0)
    assert not agreement([first, log_of(drive, noise=FINE, seed=1, name="other")], DRIFT).passed


@pytest.mark.slow
def test_what_helps_goes_by_the_logs_and_by_what_errors_allow_for():
    drive = course(ROBOT, truth_of(ROBOT, **{**TRUTH, "track": 1.1 * TRUTH["track"]}), seconds=6.0)
    logs = [*several(7, seconds=6.0, noise=NOISE), log_of(drive, noise=NOISE, name="other")]
    few, many, allowed = (
        agreement(logs[5:], BY_NOISE),
        agreement(logs, BY_NOISE),
        agreement(logs, Expected(any=True)),
    )
    assert not any(one.passed for one in (few, many, allowed))
    assert [one.allowed_for for one in (few, many, allowed)] == [False, False, True]
    assert "log 8 runs or more, whose bootstrap allows for it" in few.message
    assert "trust the bootstrap" in many.message
    assert "for which the error bars allow" in allowed.message
