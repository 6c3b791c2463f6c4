"""The paper's two stages on windows of logs."""

from __future__ import annotations

import numpy as np
import pytest
from simulated import ROBOT, TRUTH, course, log_of, loosely, truth_of, unknowns_of
from windowed import (
    ICR,
    ICR_TRUTH,
    PLACE,
    SITS,
    TRICYCLE,
    TRICYCLE_TRUTH,
    drifting,
    misses,
    spread,
    two_stage,
    windows_of,
)

from oed.estimation.assessment.covariance import blocks_of, bootstrap, sandwich
from oed.estimation.assessment.dead_reckoning import values_without
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.two_stage import SensorFrame, robot_at_sensor
from oed.estimation.setup.unknowns import Knowledge
from oed.foundation.errors import ProblemError
from oed.robots.models.model import CoefficientRobot
from oed.robots.models.twists import coefficient_values
from oed.robots.sensors.logged import Noise

TRUE = truth_of(ROBOT, **TRUTH)
COEFFICIENTS = CoefficientRobot(base=ROBOT)


def by_hand(log, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """The coefficients and the paper's standard errors, with regressors written out here."""
    layout = windows_of([log], seconds=seconds).layout
    moves = layout.inputs(np.zeros(1)) * layout.steps[..., None]
    first, end = layout.readings[:, 0], layout.readings[np.arange(layout.count), layout.last]
    regressor, turns = moves.sum(axis=1), end[:, 2] - first[:, 2]
    yaw = np.linalg.lstsq(regressor, turns, rcond=None)[0]
    steps = moves @ yaw
    headings = np.cumsum(steps, axis=1) - steps / 2
    gain = np.sinc(steps / 2 / np.pi) * np.exp(1j * headings)
    along = (gain[..., None] * moves).sum(axis=1)
    displacement = (end[:, 0] - first[:, 0] + 1j * (end[:, 1] - first[:, 1])) * np.exp(-1j * first[:, 2])
    design = np.stack([along.real, along.imag], axis=1).reshape(-1, 2)
    measured = np.column_stack([displacement.real, displacement.imag]).ravel()
    speed = np.linalg.lstsq(design, measured, rcond=None)[0]
    errors = []
    for rows_, left in ((regressor, turns - regressor @ yaw), (design, measured - design @ speed)):
        variance = left @ left / (len(left) - 2)
        errors += [*np.sqrt(variance * np.diag(np.linalg.inv(rows_.T @ rows_)))]
    return np.concatenate([yaw, speed]), np.array(errors)


def test_it_is_the_papers_least_squares():
    log = log_of(course(), noise=(0.002, 0.01))
    fit = two_stage([log], unknowns_of(COEFFICIENTS), known=Knowledge.nothing(4))
    values, errors = by_hand(log, 2.0)
    np.testing.assert_allclose(fit.values, values, rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(fit.inverse)), errors, rtol=1e-6)
    rows = fit.layout.count
    assert fit.redundancy.sum() == pytest.approx(3 * rows - 4)
    # Of the motions alone: a window's first pose, which it begins with, is no residual.
    assert fit.misfit == pytest.approx(1 - 4 / (3 * rows), rel=0.01)


@pytest.mark.slow
def test_without_noise_everything_is_exact():
    log = log_of(course(seconds=40), place=SITS, offset=0.1)
    fit = two_stage([log], unknowns_of(place=PLACE, clocks=1))
    assert fit.converged
    np.testing.assert_allclose(fit.values, [*TRUE, *SITS, 0.1], atol=1e-6)


@pytest.mark.slow
def test_three_rows_of_coefficients():
    fit = two_stage([log_of(course(ICR, ICR_TRUTH, seconds=40))], unknowns_of(ICR, clocks=1))
    np.testing.assert_allclose(fit.values, [*ICR_TRUTH, 0.0], atol=1e-6)


@pytest.mark.slow
def test_a_place_that_is_known_is_taken_off():
    log = log_of(course(seconds=40), place=(0.05, 0.04, 0.0))
    fit = two_stage([log], unknowns_of(place=("sensor_heading",), sits=(0.05, 0.04, 0.0)))
    np.testing.assert_allclose(fit.values, [*TRUE, 0.0], atol=1e-6)


def test_a_robot_without_coefficients_is_refused():
    log = log_of(course(TRICYCLE, TRICYCLE_TRUTH))
    with pytest.raises(ProblemError, match=r"calibration\.method: tricycle has no coefficients"):
        two_stage([log], unknowns_of(TRICYCLE))


@pytest.mark.parametrize("model", [ROBOT, ICR, COEFFICIENTS], ids=lambda one: one.kind)
def test_what_the_sensor_sees_is_another_robot(model):
    unknowns = unknowns_of(model, place=PLACE, clocks=1)
    values = np.concatenate([1.05 * unknowns.nominal[:-4], [0.05, -0.03, 0.2, 0.0]])
    seen, slopes = SensorFrame(unknowns)(values)
    log = log_of(course())
    own = windows_of([log], unknowns).motions(values)
    other = windows_of([log], robot_at_sensor(unknowns)).motions(seen)
    np.testing.assert_allclose(other.residuals, own.residuals, atol=1e-12)
    np.testing.assert_allclose(other.slopes @ slopes, own.slopes, atol=1e-6)


def test_a_sensor_to_the_side_shifts_the_coefficients_along_each_other():
    log = log_of(course(), place=(0.0, 0.03, 0.0))
    fit = two_stage([log], unknowns_of(COEFFICIENTS))
    _, true, _ = coefficient_values(ROBOT, TRUE)
    np.testing.assert_allclose(fit.values, [*true[:2], *(true[2:] - 0.03 * true[:2])], rtol=1e-6)


@pytest.mark.slow
def test_parameters_are_the_coefficients_best_fit():
    # Three parameters for four coefficients: the misfit weighted by their covariance is least.
    log = log_of(course(), noise=(0.002, 0.01))
    stages = two_stage([log], unknowns_of(COEFFICIENTS), known=Knowledge.nothing(4))
    fit = two_stage([log], known=Knowledge.nothing(3))

    def misfit(values: np.ndarray) -> float:
        off = coefficient_values(ROBOT, values)[1] - stages.values
        return float(off @ stages.total @ off)

    for move in 1e-4 * np.diag(fit.values):
        assert misfit(fit.values) < min(misfit(fit.values + move), misfit(fit.values - move))
    _, _, slopes = coefficient_values(ROBOT, fit.values)
    np.testing.assert_allclose(fit.total, slopes.T @ stages.total @ slopes, rtol=1e-3)
    sizes = np.sqrt(np.diag(fit.total))
    np.testing.assert_allclose(fit.scores.sum(axis=0) / sizes, 0.0, atol=0.02)


@pytest.mark.slow
def test_scores_say_what_a_log_does_to_the_estimate():
    logs = [
        log_of(course(seed=seed), noise=(0.001, 0.005), seed=seed, name=f"drive {seed}") for seed in range(6)
    ]
    fit, without = two_stage(logs), two_stage(logs[:-1])
    linear = values_without(fit, np.array([5]))
    moved = without.values - fit.values
    np.testing.assert_allclose(linear - fit.values, moved, atol=0.2 * np.abs(moved).max())


def test_knowledge_from_before_holds_a_parameter():
    log = log_of(course(), noise=(0.002, 0.01))
    tight = Knowledge(np.diag([0.0, 0.0, 1e14]), np.array([0.0, 0.0, 0.21]))
    assert two_stage([log], known=tight).values[2] == pytest.approx(0.21, abs=1e-6)


def test_clocks_that_turns_do_not_tell_stay_where_they_were():
    times = 0.1 * np.arange(201)
    steady = course(inputs=np.tile([4.0, 2.0], (200, 1)), times=times)
    unknowns = unknowns_of(clocks=1)
    # The wheels are logged before the poses begin and after they end.
    log = log_of(steady, noise=(0.001, 0.005), rows=np.arange(10, 190))
    fit = two_stage([log], unknowns, known=loosely(unknowns))
    assert fit.values[-1] == pytest.approx(0.0, abs=1e-6)


def test_stated_noise_gives_the_rows_their_size():
    log = log_of(course(), noise=(0.002, 0.01))
    specified = {"position": Noise(0.004), "heading": Noise(0.02)}
    fit = two_stage([log], unknowns_of(COEFFICIENTS), known=Knowledge.nothing(4), specified=specified)
    other = two_stage([log], unknowns_of(COEFFICIENTS), known=Knowledge.nothing(4))
    np.testing.assert_allclose(fit.values, other.values)
    ratio = np.sqrt(np.diag(fit.inverse) / np.diag(other.inverse))
    size = np.std(windows_of([log]).motions(TRUE).residuals, axis=0)
    np.testing.assert_allclose(ratio[:2], 0.02 * np.sqrt(2) / size[2], rtol=0.3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("drift", "naive", "count"),
    [((0, 0, 0), 0.85, 60), ((0.01, 0.005, 0.02), 1.2, 30)],
    ids=["poses", "drift"],
)
def test_the_sandwich_is_right_where_the_papers_errors_are_not(drift, naive, count):
    drive = course(seconds=40, period=0.25)

    def fit(seed: int) -> Fit:
        log = log_of(drifting(drive, TRUE, drift, seed), noise=(0.001, 0.005), seed=seed)
        return two_stage([log])

    errors, fits = misses(fit, TRUE, count)
    promised = spread(errors, [one.inverse for one in fits])
    assert np.all(promised < naive if naive < 1 else promised > naive), promised
    blocks = blocks_of(fits[0], 4.0)
    rng = np.random.default_rng(0)
    for found in (
        spread(errors, [sandwich(one, blocks).matrix for one in fits]),
        spread(errors, [bootstrap(one, blocks, 60, rng).matrix for one in fits]),
    ):
        assert np.all(np.abs(found - 1) < 0.3), found
