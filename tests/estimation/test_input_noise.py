"""Noise of the inputs makes what logs hardly drive look small; error bars allow for it, and it is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import (
    ROBOT,
    TRUTH,
    XYH,
    Course,
    course,
    fit_of,
    lasting,
    log_of,
    logged_problem,
    options,
    truth_of,
)

from oed.estimation import calibrate
from oed.estimation.assessment.input_noise import MOST, Dilution, dilution_doubts, dilution_of
from oed.logs.log import Log
from oed.robots.models import Unicycle

NOISE = (0.002, 0.003)
UNICYCLE = Unicycle(omega_per_v=0.0)
GAINS = truth_of(UNICYCLE, gain_v=0.955, gain_omega=0.96)
TRUE = np.array([*TRUTH.values()])
PERIOD, SECONDS = 0.05, 20.0


def straight(seed: int) -> Course:
    """A straight block: both wheels forward, and hardly any turning, slowly to and fro."""
    rng, times = np.random.default_rng([seed, 7]), PERIOD * np.arange(round(SECONDS / PERIOD))
    waves = zip(rng.uniform(0.3, 2.0, 3), rng.uniform(0.0, 6.3, 3), strict=True)
    turning = 0.15 * sum(np.sin(rate * times + phase) for rate, phase in waves)
    ahead = 4 * np.minimum(1.0, np.minimum(times, SECONDS - times) / 2 + 0.05)
    inputs = np.column_stack([ahead + turning, ahead - turning])
    return course(seconds=SECONDS, period=PERIOD, inputs=inputs, seed=seed)


def clean(seed: int) -> Log:
    return log_of(straight(seed), noise=NOISE, seed=seed)


def ticked(seed: int) -> Log:
    """By encoders of 31 ticks a turn."""
    return log_of(straight(seed), noise=NOISE, seed=seed, quantum=0.2, every=2)


def unsteady(seed: int) -> Log:
    """By speeds that are off by half a rad/s, each on its own."""
    log, rng = clean(seed), np.random.default_rng([seed, 8])
    errors = np.cumsum(PERIOD * rng.normal(0.0, 0.5, (len(log.integrals) - 1, 2)), axis=0)
    return replace(log, integrals=log.integrals + np.vstack([np.zeros((1, 2)), errors]))


def commanded(seed: int) -> Log:
    """By speeds that are commanded, of which the robot follows the slow part."""
    wanted = straight(seed).inputs + np.random.default_rng([seed, 5]).normal(0.0, 1.0, (400, 2))
    driven, kept = wanted.copy(), np.exp(-PERIOD / 0.25)
    for row in range(1, len(wanted)):
        driven[row] = kept * driven[row - 1] + (1 - kept) * wanted[row]
    drive = course(seconds=SECONDS, period=PERIOD, inputs=driven)
    return log_of(replace(drive, inputs=wanted), noise=NOISE, seed=seed)


def turning(seed: int) -> Log:
    """Of a drive that excites everything, by exact encoders."""
    return log_of(course(seconds=SECONDS, period=PERIOD, seed=seed), noise=NOISE, seed=seed)


def nearly_straight(seed: int, quantities: tuple[str, ...] = XYH) -> Log:
    """Odometry of a drive that hardly turns: play lets its heading err by 0.1 rad for 0.3 s."""
    rng, times = np.random.default_rng([seed, 9]), PERIOD * np.arange(round(12.0 / PERIOD))
    turning = 0.06 * np.sin(2 * np.pi * times / 9 + rng.uniform(0, 6))
    speeds = np.clip(np.minimum(times, 12.0 - times) / 2, 0, 0.5)
    drive = course(UNICYCLE, GAINS, seconds=12.0, period=PERIOD, inputs=np.column_stack([speeds, turning]))
    log = log_of(drive, noise=(0.001, 0.0026), quantities=quantities, seed=seed)
    play, kept = np.zeros(len(times) + 1), np.exp(-PERIOD / 0.3)
    for row in range(len(times)):
        play[row + 1] = kept * play[row] + 0.1 * np.sqrt(1 - kept**2) * rng.normal()
    return replace(log, integrals=log.integrals + np.column_stack([0 * play, play]))


def diluted(log: Log, seconds: float = 2.0) -> Dilution:
    found = dilution_of(fit_of([log], seconds=seconds))
    assert found is not None
    return found


def test_of_a_straight_block_with_coarse_ticks_the_track_may_be_far_too_large():
    fit = fit_of([ticked(1)], seconds=2.0)
    found = dilution_of(fit)
    assert found is not None
    # It is too large, and by no more than it may be.
    off = fit.values[2] - TRUE[2]
    assert 0.1 * TRUE[2] < off < found.bias[2] < 4 * off
    assert 0.1 < found.shares[2] < MOST
    (one,) = (one for one in dilution_doubts(fit, found, fit.inverse) if one.parameter == "track")
    assert one.name == "input_noise"
    assert "track may be too large by up to" in one.message
    assert "hardly drive" in one.message


@pytest.mark.parametrize("make", [clean, turning])
def test_where_the_poses_own_noise_explains_the_residuals_there_is_none(make):
    fit = fit_of([make(1)], seconds=2.0)
    found = dilution_of(fit)
    assert found is not None
    errors = np.sqrt(np.diag(fit.inverse))
    assert np.all(np.abs(found.bias) < 0.6 * errors)
    assert dilution_doubts(fit, found, fit.inverse) == ()


@pytest.mark.slow
def test_bias_by_more_than_noise_reaches_back_to_the_nominal_value_or_is_as_large_as_that():
    # Of a robot that does not turn at all its wheels' noise alone says how wide it is.
    still = course(seconds=8.0, inputs=np.full((80, 2), 4.0))
    rng = np.random.default_rng(0)
    log = log_of(still, noise=(0.002, 0.03))
    log = replace(log, integrals=log.integrals + np.cumsum(rng.normal(0.0, 0.05, (81, 2)), axis=0))
    fit = fit_of([log], seconds=np.inf)
    found, nominal = dilution_of(fit), np.array(ROBOT.nominal)
    assert found is not None
    assert np.all(np.abs(found.bias[:2]) <= nominal[:2] * (1 + 1e-9))
    assert found.shares[2] == 1
    assert found.bias[2] == pytest.approx(max(nominal[2], fit.values[2] - nominal[2]), rel=0.01)
    # Wheels that differ less would turn a narrower robot alike: they need not be off by all of their size.
    assert np.all(np.abs(fit.values - TRUE) < 2 * np.abs(found.bias))
    assert np.all(np.abs(found.bias[:2]) < 0.2 * nominal[:2])


def test_a_covariance_allows_for_it_in_its_direction_only():
    found = Dilution(np.array([[0.3], [0.0]]), np.array([0.1, 0.0]))
    np.testing.assert_allclose(found.widened(np.diag([0.16, 0.04])), np.diag([0.25, 0.04]))


def test_a_covariance_allows_for_each_of_several_combinations_whose_information_is_noise():
    moves = np.array([[0.1, 0.3, 0.0], [0.0, -0.3, 0.4], [0.0, 0.0, 0.4]])
    found = Dilution(moves, np.array([0.8, 0.9, 1.0]))
    wider = found.widened(np.zeros((3, 3)))
    np.testing.assert_allclose(np.sqrt(np.diag(wider)), np.abs(found.bias))
    # The first two change against each other in one of them and alone in others; their sum less the third is
    # as sure as what noise does to all of them together.
    sum_less_third = np.array([1.0, 1.0, -1.0])
    assert sum_less_third @ wider @ sum_less_third == pytest.approx(0.1**2)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_straight_drive_does_not_identify_the_track_and_knows_the_mean_radius_as_before(seed: int):
    still = course(seconds=8.0, inputs=np.full((80, 2), 4.0))
    log = log_of(still, noise=(0.002, 0.005), seed=seed)
    found = calibrate(logged_problem(), [log], options(clock_offset=False, sensor_place=()))
    assert found.dilution is not None
    assert found.dilution.lost(found.parameters) == {"track"}
    mean = np.array([0.5, 0.5, 0.0])
    before = found.covariance - found.dilution.moves @ found.dilution.moves.T
    assert mean @ found.covariance @ mean < 1.1**2 * (mean @ before @ mean)
    (sentence,) = (one for one in found.weak_directions if "do not identify" in one)
    assert "do not identify track" in sentence
    reach = found.covariances[0].half_width * np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(found.values - TRUE) < reach)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_noise_that_would_be_more_than_all_of_the_information_hardly_moves_the_mean_radius(seed: int):
    still = course(seconds=8.0, inputs=np.full((80, 2), 4.0))
    log = log_of(still, noise=(0.002, 0.03), seed=seed)
    errors = np.cumsum(np.random.default_rng(seed).normal(0.0, 0.05, (81, 2)), axis=0)
    asked = options(clock_offset=False, sensor_place=())
    found = calibrate(logged_problem(), [replace(log, integrals=log.integrals + errors)], asked)
    assert found.dilution is not None
    mean = np.array([0.5, 0.5, 0.0])
    before = found.covariance - found.dilution.moves @ found.dilution.moves.T
    assert mean @ found.covariance @ mean < 1.1**2 * (mean @ before @ mean)


@pytest.mark.slow
def test_it_is_said_beside_the_number():
    asked = options(segment=2.0, replicates=100, clock_offset=False, sensor_place=())
    found = calibrate(logged_problem(), [ticked(1)], asked)
    assert any((one.parameter, one.name) == ("track", "input_noise") for one in found.doubts)
    assert found.dilution is not None
    assert found.standard_deviations["track"] > abs(found.dilution.bias[2])
    ends = found.values[2] + found.covariances[0].half_width * found.standard_deviations["track"] * np.array(
        [-1, 1]
    )
    assert ends[0] < TRUE[2] < ends[1]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 5, 7])
def test_a_gain_whose_motion_may_be_noise_alone_is_not_identified(seed: int):
    found = calibrate(logged_problem(model=UNICYCLE), [nearly_straight(seed)], options())
    place = found.parameters.index("gain_omega")
    reach = found.covariances[0].half_width * found.standard_deviations["gain_omega"]
    assert abs(found.values[place] - GAINS[place]) < reach
    assert any("do not identify gain_omega" in sentence for sentence in found.weak_directions)
    # Neither its size nor its sign says anything of wheels or axes.
    doubts = {doubt.name: doubt.message for doubt in found.doubts if doubt.parameter == "gain_omega"}
    assert doubts.keys() == {"input_noise"}
    assert "100 % of the motion that identifies it" in doubts["input_noise"]
    # What the drive shows is known as well as before.
    assert found.standard_deviations["gain_v"] < 0.01


@pytest.mark.slow
def test_interval_of_a_gain_that_straight_positions_hardly_show_holds_the_truth():
    rng, period, count = np.random.default_rng([0, 9]), 0.05, 1000
    turning = 0.03 * np.sin(2 * np.pi * period * np.arange(count) / 9)
    inputs = np.column_stack([np.full(count, 0.95), turning])
    parameters = truth_of(UNICYCLE, gain_v=0.955, gain_omega=0.96)
    drive = course(UNICYCLE, parameters, seconds=50.0, period=period, inputs=inputs)
    log = lasting(log_of(drive, noise=(0.004, 0.0), quantities=("x", "y"), every=4), 0.01, 10.0)
    # Play makes the heading of odometry err by 0.1 rad, for 0.3 s.
    play, keep = np.zeros(count + 1), np.exp(-period / 0.3)
    for step in range(count):
        play[step + 1] = keep * play[step] + 0.1 * np.sqrt(1 - keep**2) * rng.normal()
    log = replace(log, integrals=log.integrals + np.column_stack([0 * play, play]))
    calibration = calibrate(logged_problem(model=UNICYCLE), [log], options())
    place = calibration.parameters.index("gain_omega")
    reach = calibration.covariances[0].half_width * calibration.standard_deviations["gain_omega"]
    assert abs(calibration.values[place] - 0.96) < reach


@pytest.mark.slow
@pytest.mark.parametrize("make", [ticked, unsteady, commanded])
def test_intervals_of_straight_blocks_cover(make):
    held = []
    for seed in range(4):
        asked = options(segment=2.0, replicates=100, clock_offset=False, sensor_place=())
        found = calibrate(logged_problem(), [make(seed)], asked)
        reach = found.covariances[0].half_width * np.sqrt(np.diag(found.covariance))
        held.append(np.abs(found.values - TRUE) < reach)
    assert np.mean(held) > 0.88


@pytest.mark.slow
def test_intervals_of_logs_that_excite_everything_stay_as_they_were():
    ratios = []
    for seed in range(4):
        fit = fit_of([turning(seed)])
        found = dilution_of(fit)
        assert found is not None
        ratios.append(np.diag(found.widened(fit.inverse)) / np.diag(fit.inverse))
    assert np.sqrt(np.max(ratios)) < 1.3
    assert np.sqrt(np.mean(ratios)) < 1.05
