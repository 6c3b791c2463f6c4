"""Generalised least squares on windows: exact without noise, honest with it."""

from __future__ import annotations

import numpy as np
import pytest
from pulls import require_pulls
from simulated import ROBOT, TRUTH, course, log_of, loosely, truth_of, unknowns_of
from windowed import (
    ICR,
    ICR_TRUTH,
    PLACE,
    SITS,
    TRICYCLE,
    TRICYCLE_TRUTH,
    drifting,
    gls,
    misses,
    windows_of,
)

from oed.estimation.assessment.covariance import blocks_of, bootstrap, sandwich
from oed.estimation.assessment.dead_reckoning import values_without
from oed.estimation.assessment.diagnostics import correlations, diagnostics
from oed.estimation.methods.fit import Fit
from oed.estimation.setup.unknowns import Knowledge
from oed.robots.sensors.logged import Noise

TRUE = truth_of(ROBOT, **TRUTH)


@pytest.mark.parametrize(
    ("model", "truth", "place"),
    [(ROBOT, TRUE, PLACE), (ICR, ICR_TRUTH, ("sensor_y",)), (TRICYCLE, TRICYCLE_TRUTH, PLACE)],
    ids=["differential", "icr", "tricycle"],
)
@pytest.mark.slow
def test_without_noise_everything_is_exact(model, truth, place):
    sits = [at if name in place else 0.0 for name, at in zip(PLACE, SITS, strict=True)]
    # The wheels' clock is off by a whole period, so that nothing lies between its knots.
    log = log_of(course(model, truth, seconds=40), place=sits, offset=0.1)
    # Lateral centre and a sensor off to the side are one and the same to both sides' centres.
    names = ("y_icr_right", "x_icr", "alpha_right", "alpha_left") if model is ICR else None
    unknowns = unknowns_of(model, place=place, clocks=1, names=names)
    if names:
        log = log_of(course(model, truth_of(model, **dict(zip(names, ICR_NAMED, strict=True)))), place=sits)
        truth = np.array(ICR_NAMED)
    fit = gls([log], unknowns)
    offset = 0.0 if names else 0.1
    expected = [*truth, *(at for at in sits if at), offset]
    assert fit.converged
    np.testing.assert_allclose(fit.values, expected, atol=1e-6)


ICR_NAMED = (-0.24, 0.06, 0.95, 1.02)


def test_rounds_that_do_not_settle_are_said(monkeypatch):
    log = log_of(course(), noise=(0.001, 0.005))
    monkeypatch.setattr("oed.estimation.methods.gls.ROUNDS", 1)
    assert gls([log]).converged
    # No change is small enough.
    monkeypatch.setattr("oed.estimation.methods.gls.CLOSE", 0.0)
    assert not gls([log]).converged


def test_a_first_guess_far_off_does_not_matter():
    true = truth_of(ROBOT, wheel_radius_right=0.03, wheel_radius_left=0.09, track=0.09)
    fit = gls([log_of(course(parameters=true))])
    np.testing.assert_allclose(fit.values, true, atol=1e-9)


@pytest.fixture(scope="module")
def noisy() -> Fit:
    drives = [
        drifting(course(seconds=60, period=0.2, seed=seed), TRUE, (0.004, 0.002, 0.02), seed)
        for seed in range(3)
    ]
    logs = [
        log_of(drive, place=SITS, noise=(0.001, 0.005), seed=seed, name=f"drive {seed}")
        for seed, drive in enumerate(drives)
    ]
    return gls(logs, unknowns_of(place=PLACE, clocks=3))


@pytest.mark.slow
def test_errors_are_as_large_as_they_are_said_to_be(noisy):
    off = noisy.values - [*TRUE, *SITS, 0, 0, 0]
    assert off @ noisy.total @ off < 22  # chi square of nine, 99 %


def test_a_fit_is_made_of_what_everything_after_it_needs(noisy):
    count, size = noisy.layout.count, noisy.unknowns.size
    assert noisy.layout.times.shape == (count, 2)
    assert noisy.motions
    assert not noisy.layout.valid[:, 0].any()
    assert noisy.layout.valid[:, 1].all()
    for name in ("residuals", "white", "weights", "redundancy"):
        assert getattr(noisy, name).shape == (count, 2, 3)
    assert noisy.information.shape == (count, size, size)
    assert noisy.scores.shape == (count, size)
    assert noisy.speeds.shape == (count, 2)
    # Each unknown takes up one of the rows' freedoms.
    assert noisy.redundancy[:, 1].sum() == pytest.approx(3 * count - size, abs=0.01)


def test_at_the_solution_scores_and_knowledge_pull_alike(noisy):
    pull = noisy.knowledge @ (noisy.unknowns.nominal - noisy.values)
    sizes = np.sqrt(np.diag(noisy.total))
    np.testing.assert_allclose((noisy.scores.sum(axis=0) + pull) / sizes, 0.0, atol=0.01)


def test_what_is_left_is_white(noisy):
    white = noisy.white[:, 1]
    assert white.var() == pytest.approx(1, abs=0.15)
    for places in ([0, 1], [2]):
        values, pairs = correlations(noisy, places)
        assert np.abs(values).max() < 4 / np.sqrt(pairs)
    for one in diagnostics(noisy, {"position": Noise(0.001), "heading": Noise(0.005)}):
        assert one.passed, one.message
        assert one.name != "stated_noise"


def test_every_row_counts_with_its_own_window(noisy):
    # Without the last log the others' information is what they alone would give.
    kept = noisy.layout.owner < 2
    alone = values_without(noisy, np.array([2]))
    off = alone[:6] - noisy.values[:6]
    change = np.sqrt(np.diag(np.linalg.inv(noisy.information[kept].sum(axis=0) + noisy.knowledge)))[:6]
    assert np.all(np.abs(off) < 3 * change)
    assert np.any(np.abs(off) > 0.01 * change)


def test_knowledge_from_before_holds_a_parameter():
    log = log_of(course(), noise=(0.002, 0.01))
    unknowns = unknowns_of()
    tight = Knowledge(np.diag([0.0, 0.0, 1e14]), np.array([0.0, 0.0, 0.21]))
    fit = gls([log], unknowns, known=tight)
    assert fit.values[2] == pytest.approx(0.21, abs=1e-6)
    assert np.sqrt(fit.inverse[2, 2]) < 1.01e-7


def test_volumes_are_log_determinants_of_the_noise():
    log = log_of(course(seconds=20), noise=(0.002, 0.01))
    one, other = (
        gls([log], specified={"position": Noise(0.02 * scale), "heading": Noise(0.1 * scale)})
        for scale in (1.0, 3.0)
    )
    # Three quantities of each window, the variance of each nine times as large; little of it is drift.
    np.testing.assert_allclose(other.volumes - one.volumes, 3 * np.log(9.0), rtol=0.03)


@pytest.mark.slow
def test_noise_that_is_stated_is_taken_as_it_is():
    log = log_of(course(seconds=30), noise=(0.001, 0.005))
    specified = {"position": Noise(0.002, 0.01), "heading": Noise(0.01)}
    fit, estimated = gls([log], specified=specified), gls([log])
    assert fit.noises == specified
    assert fit.white[:, 1].std() < 0.75 * estimated.white[:, 1].std()
    np.testing.assert_allclose(fit.values, TRUE, rtol=0.01)


@pytest.mark.slow
def test_nothing_need_be_known_beforehand():
    log = log_of(course(), noise=(0.001, 0.005))
    unknowns = unknowns_of()
    nothing = Knowledge.nothing(unknowns.size)
    with_, without = gls([log], known=loosely(unknowns, 100)), gls([log], known=nothing)
    np.testing.assert_allclose(with_.values, without.values, rtol=1e-6)


def test_what_the_drive_does_not_tell_stays_nominal():
    times = 0.1 * np.arange(201)
    straight = course(inputs=np.full((200, 2), 3.0) + np.sin(times[:-1])[:, None], times=times)
    fit = gls([log_of(straight, noise=(0.001, 0.005))], unknowns_of(ROBOT))
    assert fit.values[:2].mean() == pytest.approx(TRUE[:2].mean(), rel=0.01)


@pytest.mark.slow
def test_a_thousand_windows_are_no_burden():
    log = log_of(course(seconds=1000, period=0.5), noise=(0.001, 0.005))
    fit = gls([log], seconds=1.0)
    assert fit.layout.count == 1000
    assert fit.converged
    np.testing.assert_allclose(fit.values, TRUE, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("drift", "count"), [((0, 0, 0), 60), ((0.005, 0.002, 0.02), 40)], ids=["poses", "drift"]
)
def test_standard_errors_match_the_scatter(drift, count):
    drive = course(seconds=40, period=0.25)

    def fit(seed: int) -> Fit:
        log = log_of(drifting(drive, TRUE, drift, seed), noise=(0.001, 0.005), seed=seed)
        return gls([log], seconds=1.0)

    # So many sets: errors of 1.24 times those said, which 30 may have, are refused.
    errors, fits = misses(fit, TRUE, count)
    assert np.abs(errors.mean(axis=0)).max() < 4 * (errors.std(axis=0) / np.sqrt(count)).max()
    require_pulls(errors, [one.inverse[:3, :3] for one in fits])


def test_sandwich_and_bootstrap_agree_with_information(noisy):
    blocks = blocks_of(noisy, 6.0)
    sizes = np.sqrt(np.diag(noisy.inverse))[:3]
    for one in (sandwich(noisy, blocks), bootstrap(noisy, blocks, 500, np.random.default_rng(0))):
        assert np.all(np.abs(np.log(one.deviations[:3] / sizes)) < np.log(1.5))


def test_windows_are_those_of_the_layout():
    log = log_of(course(seconds=20))
    assert gls([log], seconds=2.0).layout.count == windows_of([log]).layout.count == 10
