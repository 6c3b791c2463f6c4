"""Estimates that no robot has are doubted: their signs, their sizes, what the study knew of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import ROBOT, TRUTH, course, fit_of, log_of, logged_problem, options, truth_of, unknowns_of

from oed.estimation import Calibration, calibrate
from oed.estimation.assessment.doubts import Doubt, plausibility_doubts
from oed.estimation.assessment.exactness import exact_doubts
from oed.estimation.methods.fit import Fit
from oed.estimation.setup.unknowns import Knowledge
from oed.robots.models import Model, SkidSteerIcr, Tricycle
from oed.robots.sensors.logged import Noise

NOISE = (0.002, 0.005)
ICR = SkidSteerIcr(wheel_radius=0.05, y_icr_left=0.2, y_icr_right=-0.25, x_icr=0.05)


def doubts_at(model: Model = ROBOT, error: float = 1e-3, **values: float) -> tuple[Doubt, ...]:
    """Of a fit that ended at these values, nominal ones but for them."""
    drive = course(model, truth_of(model), seconds=4.0)
    fit = fit_of([log_of(drive, noise=NOISE)], unknowns_of(model))
    return plausibility_doubts(
        replace(fit, values=truth_of(model, **values)), error**2 * np.eye(fit.unknowns.size)
    )


def names(doubts: tuple[Doubt, ...]) -> list[tuple[str, str]]:
    return [(one.parameter, one.name) for one in doubts]


def test_nominal_values_are_not_doubted():
    assert doubts_at() == doubts_at(ICR) == ()


@pytest.mark.parametrize(
    ("model", "values", "expected"),
    [
        (ROBOT, {"track": -0.083}, ("track", "sign")),
        (ROBOT, {"wheel_radius_left": -0.05}, ("wheel_radius_left", "sign")),
        (ROBOT, {"track": 0.32}, ("track", "size")),
        (ROBOT, {"wheel_radius_left": 0.07}, ("wheel_radius_left", "size")),
        (ROBOT.by_coefficients, {"c12": 0.25}, ("c12", "sign")),
        (ROBOT.by_coefficients, {"c11": 0.9}, ("c11", "size")),
        (ICR, {"y_icr_right": 0.25}, ("y_icr_right", "sign")),
        (ICR, {"alpha_left": 0.2}, ("alpha_left", "size")),
        (ICR, {"x_icr": 3.0}, ("x_icr", "size")),
        (Tricycle(wheel_radius=0.05, wheelbase=0.3), {"wheelbase": 0.15}, ("wheelbase", "size")),
        (Tricycle(wheel_radius=0.05, wheelbase=0.3), {"steering_offset": -4.0}, ("steering_offset", "size")),
    ],
    ids=str,
)
def test_a_sign_or_a_size_that_no_robot_has(model, values, expected):
    (one,) = doubts_at(model, **values)
    assert (one.parameter, one.name) == expected


@pytest.mark.parametrize(
    ("model", "values"),
    [
        # A robot that skids turns as if it were wider; what is around 0 has either sign.
        (ICR, {"y_icr_left": 0.5, "x_icr": -0.1, "alpha_left": 0.6}),
        (Tricycle(wheel_radius=0.05, wheelbase=0.3), {"wheelbase": 0.22, "steering_offset": -0.4}),
        (ROBOT, {"wheel_radius_left": 0.06, "track": 0.27}),
    ],
    ids=str,
)
def test_what_robots_have_is_not_doubted(model, values):
    assert doubts_at(model, **values) == ()


def test_what_is_not_known_well_enough_is_not_doubted_for_its_size():
    assert doubts_at(track=0.32, error=0.1) == ()
    assert names(doubts_at(track=-0.02, error=0.1)) == [("track", "sign")]


def test_an_estimate_that_contradicts_the_prior():
    known = Knowledge(np.diag([0.0, 0.0, 0.004**-2.0]), np.array(ROBOT.nominal))
    known = Knowledge(known.information + np.diag(np.array(ROBOT.nominal) ** -2.0), known.centre)

    def fit(track: float) -> Fit:
        drive = course(parameters=truth_of(ROBOT, **{**TRUTH, "track": track}), seconds=8.0)
        return fit_of([log_of(drive, noise=NOISE)], known=known)

    def doubts(track: float) -> list[tuple[str, str]]:
        found = fit(track)
        return names(plausibility_doubts(found, found.inverse))

    assert doubts(0.23) == [("track", "prior")]
    assert doubts(0.205) == []


def test_of_what_may_be_noise_alone_neither_sign_nor_size_is_doubted_but_what_contradicts_the_prior():
    drive = course(seconds=8.0)
    known = Knowledge(np.diag(np.array([0.01, 0.01, 0.004]) ** -2.0), np.array(ROBOT.nominal))
    fit = fit_of([log_of(drive, noise=NOISE)], known=known)
    of_another_sign = replace(fit, values=truth_of(ROBOT, track=-0.083))
    assert names(plausibility_doubts(of_another_sign, fit.inverse)) == [("track", "sign")]
    assert names(plausibility_doubts(of_another_sign, fit.inverse, {"track"})) == [("track", "prior")]
    of_another_size = replace(fit, values=truth_of(ROBOT, wheel_radius_left=0.07))
    assert names(plausibility_doubts(of_another_size, fit.inverse)) == [("wheel_radius_left", "size")]
    assert plausibility_doubts(of_another_size, fit.inverse, {"wheel_radius_left"}) == ()


@pytest.mark.slow
@pytest.mark.parametrize(("seconds", "seed"), [(8.0, 0), (10.0, 2)])
def test_whole_logs_of_wheels_half_as_large_are_fitted_all_the_same(seconds: float, seed: int):
    # From nominal sizes the search ended at a track of -687 mm, or at residuals of 3 rad.
    log = log_of(course(seconds=seconds, seed=seed), noise=NOISE)
    geared = replace(log, integrals=2 * log.integrals)
    found: Calibration = calibrate(logged_problem(), [geared], options(segment="log"))
    assert found.fit.converged
    assert found.values == pytest.approx([0.0515 / 2, 0.0492 / 2, 0.213], rel=0.01)
    assert names(found.doubts) == [("wheel_radius_right", "size"), ("wheel_radius_left", "size")]
    assert all("check ticks_per_turn, gear and units" in one.message for one in found.doubts)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("share", "said", "segment"),
    [
        (0.0, True, "log"),
        (0.002, True, "log"),
        (0.002, True, 1.0),
        (0.05, False, "log"),
        (0.05, False, 1.0),
    ],
)
def test_a_log_without_noise_is_taken_for_none(share: float, said: bool, segment: str | float):
    log = log_of(course(seconds=6.0), noise=(share * NOISE[0], share * NOISE[1]))
    asked = options(segment=segment, sensor_place=(), clock_offset=False)
    found = calibrate(logged_problem(), [log], asked)
    exact = [one for one in found.doubts if one.name == "exact"]
    assert bool(exact) == said, found.doubts
    if said:
        assert found.doubts[0].message.startswith("position and heading follow the model exactly, to ")
        assert "of the noise that is specified: is this the design, or a simulation" in exact[0].message


def test_few_readings_that_happen_to_fit_are_not_doubted():
    drive = course(seconds=2.0)
    share = 0.005
    fit = fit_of([log_of(drive, noise=(share * NOISE[0], share * NOISE[1]))], unknowns_of(ROBOT))
    specified = {"position": Noise(NOISE[0]), "heading": Noise(NOISE[1])}
    assert fit.redundancy[fit.layout.valid].sum() > 5
    assert exact_doubts(fit, specified) == ()
    # Those that fit to rounding are, whether or not any noise is specified.
    exact = fit_of([log_of(drive)], unknowns_of(ROBOT))
    assert names(exact_doubts(exact, specified)) == [("", "exact")]
    (one,) = exact_doubts(exact, {})
    assert "of the noise that any sensor has" in one.message


def test_what_stands_still_at_a_noise_of_zero_is_no_share_of_it():
    fit = fit_of([log_of(course(seconds=4.0), noise=NOISE)], unknowns_of(ROBOT))
    assert exact_doubts(fit, {"position": Noise(0.0), "heading": Noise(0.0)}) == ()
