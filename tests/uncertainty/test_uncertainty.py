"""What is not known of the robot: how it may be given, and the robots and start poses that it amounts to."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from builders import RADIUS, TRACK, problem_of
from hypothesis import given
from hypothesis import strategies as st
from oracle import central_difference
from pydantic import ValidationError

from oed.foundation.errors import ProblemError
from oed.kernel.criteria import E
from oed.kernel.dynamics.space import Spline
from oed.kernel.measurement.prior import Prior
from oed.robots.models import DifferentialDrive, SkidSteer
from oed.robots.sensors import Poses
from oed.robots.space import DesignSpace, StartPose
from oed.uncertainty.uncertainty import UncertainQuantities, Uncertainty
from oed.uncertainty.uncertainty import spread_of as spread_of_system

RIGHT, LEFT = "wheel_radius_right", "wheel_radius_left"
SENSOR = Poses(noise={"position": 0.01, "heading": 0.02})
CORRELATED = ((4e-6, 3e-6), (3e-6, 9e-6))


sensed_problem = partial(problem_of, measurement=SENSOR, criterion=E(scaling="relative"))


def spread_of(
    within: dict[str, Any] | None = None, distribution: str = "uniform", **parts: Any
) -> UncertainQuantities:
    """The spread of a problem whose robot is uncertain `within`."""
    if within is not None:
        parts["uncertainty"] = Uncertainty.model_validate({"within": within, "distribution": distribution})
    spread = spread_of_system(sensed_problem(**parts).uncertain_system)
    assert spread is not None
    return spread


def issues_of(within: dict[str, Any], distribution: str = "uniform", **parts: Any) -> dict[str, str]:
    uncertainty = Uncertainty.model_validate({"within": within, "distribution": distribution})
    with pytest.raises(ProblemError) as caught:
        sensed_problem(uncertainty=uncertainty, **parts)
    return {".".join(map(str, issue.key)): issue.message for issue in caught.value.issues}


def runs(count: int, **options: Any) -> DesignSpace:
    return DesignSpace(duration=10, samples=40, spline=Spline(coefficients=8), runs=count, **options)


class TestForms:
    def test_amounts_may_stand_alone(self):
        whole = Uncertainty(within={"track": "5 %", "x": "1 cm"}, distribution="normal")
        short = {"track": "5 %", "x": "1 cm", "distribution": "normal"}
        assert Uncertainty.model_validate(short) == whole
        assert Uncertainty.model_validate({"track": 0.1}).distribution == "uniform"

    def test_what_is_dumped_is_read_again(self):
        one = Uncertainty(within={"track": ("17 cm", 0.2), RIGHT: "5 %"})
        assert Uncertainty.model_validate(one.model_dump(mode="json")) == one

    def test_ranges(self):
        for amount, low, high in (
            ("5 %", 0.171, 0.189),
            ("5%", 0.171, 0.189),
            ("1 cm", 0.17, 0.19),
            (0.01, 0.17, 0.19),
            (("17 cm", "20 cm"), 0.17, 0.2),
            ((0.18, 0.2), 0.18, 0.2),
        ):
            spread = spread_of({"track": amount})
            found = [spread.low[0], spread.high[0]]
            np.testing.assert_allclose(found, [low, high], rtol=1e-12, err_msg=str(amount))

    def test_shares_of_negative_values_are_positive(self):
        robot = SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=-0.1, slip_inner=0.2)
        spread = spread_of({"slip_outer": "10 %"}, model=robot, estimate=("track",))
        np.testing.assert_allclose([spread.low[0], spread.high[0]], [-0.11, -0.09], rtol=1e-12)

    @pytest.mark.parametrize(
        "values",
        [
            ({}, {"within": {}}, {"distribution": "normal"}),
            ({"track": [1, 2, 3]}, {"track": 0.1, "distribution": "triangular"}),
        ],
        ids=["nothing named", "other shapes"],
    )
    def test_what_says_nothing_is_refused(self, values):
        for value in values:
            with pytest.raises(ValidationError):
                Uncertainty.model_validate(value)


class TestIssues:
    def test_wrong_ones_are_named(self):
        for name, amount, words in (
            ("width", "1 cm", "expected one of wheel_radius_right, wheel_radius_left, track, x, y, heading"),
            ("wheel_base", "5 %", "got 'wheel_base'"),
            ("track", "-1 cm", "expected a positive amount, got '-1 cm'"),
            ("track", "-5 %", "expected a positive amount, got '-5 %'"),
            ("track", 0, "expected a positive amount, got 0"),
            ("track", "1 kg", "expected a length [m], got '1 kg'"),
            ("track", "wide", "does not begin with a number"),
            ("track", float("nan"), "finite"),
            ("track", ("19 cm", "20 cm"), "expected a range around the nominal 0.18 m"),
            ("track", ("10 cm", "17 cm"), "expected a range around the nominal 0.18 m"),
            ("track", ("19 cm", "17 cm"), "expected a range around"),
            ("track", (0.18, 0.18), "expected a range around"),
            ("track", ("17 cm", "1 kg"), "expected a length [m]"),
            ("x", "5 %", "a share of a nominal value of 0 is nothing; give an amount in m"),
            ("heading", "5 %", "a share of a nominal value of 0 is nothing; give an amount in rad"),
            ("x", "1 deg", "expected a length [m]"),
            ("heading", "1 cm", "expected an angle"),
        ):
            found = issues_of({RIGHT: "5 %", name: amount})
            assert list(found) == [f"uncertainty.{name}"], amount
            assert words in found[f"uncertainty.{name}"]

    def test_a_range_has_no_standard_deviation(self):
        found = issues_of({"track": ("17 cm", "19 cm")}, "normal")
        assert "expected a standard deviation, got the range" in found["uncertainty.track"]

    def test_all_wrong_ones_are_listed(self):
        found = issues_of({"track": "-1 cm", "width": 1, "x": "5 %", RIGHT: "5 %"})
        assert set(found) == {"uncertainty.track", "uncertainty.width", "uncertainty.x"}

    def test_coefficients_are_known_where_they_are_estimated(self):
        spread = spread_of({"c21": "5 %"}, estimate=("c11", "c12", "c21", "c22"))
        assert spread.names == ("c21",)
        assert list(issues_of({"c21": "5 %"})) == ["uncertainty.c21"]

    def test_parameters_and_coefficients_do_not_mix(self):
        found = issues_of({"c21": "5 %", "track": "5 %"}, estimate=("c11", "c12", "c21", "c22"))
        assert list(found) == ["uncertainty.c21"]


class TestDraws:
    def test_the_same_seed_draws_the_same(self):
        spread = spread_of({"track": "5 %", "x": "1 cm"}, "normal")
        np.testing.assert_array_equal(spread.draws(50, 3), spread.draws(50, 3))
        assert not np.allclose(spread.draws(50, 3), spread.draws(50, 4))

    @given(seed=st.integers(0, 1000))
    def test_uniform_ones_stay_within_their_ranges(self, seed: int):
        spread = three_ranges()
        values = spread.draws(200, seed)
        assert np.all(values >= spread.low)
        assert np.all(values <= spread.high)

    def test_uniform_ones_fill_their_ranges(self):
        spread = spread_of({"track": ("17 cm", "20 cm"), RIGHT: "5 %"})
        values = (spread.draws(20_000, 0) - spread.low) / (spread.high - spread.low)
        np.testing.assert_allclose(
            np.quantile(values, [0, 0.25, 0.5, 0.75, 1], axis=0)[:, 0], [0, 0.25, 0.5, 0.75, 1], atol=0.02
        )
        np.testing.assert_allclose(np.cov(values.T) * 12, np.eye(2), atol=0.03)

    def test_normal_ones_have_these_standard_deviations(self):
        spread = spread_of({"track": "5 %", RIGHT: "1 mm"}, "normal")
        errors = (spread.draws(40_000, 0) - spread.nominal) / [1e-3, 0.009]
        np.testing.assert_allclose(np.cov(errors.T), np.eye(2), atol=0.03)
        np.testing.assert_allclose(np.mean(np.abs(errors) < 1, axis=0), 0.683, atol=0.01)

    def test_those_of_a_prior_are_correlated(self):
        prior = Prior(parameters=(RIGHT, "track"), covariance=CORRELATED)
        spread = spread_of({LEFT: "5 %"}, prior=prior)
        sizes = np.sqrt(np.diag(spread.covariance))
        errors = (spread.draws(40_000, 0) - spread.nominal) / sizes
        expected = spread.covariance / np.outer(sizes, sizes)
        np.testing.assert_allclose(np.cov(errors.T), expected, atol=0.03)
        assert np.all(np.abs(errors[:, spread.names.index(LEFT)]) <= np.sqrt(3) + 1e-12)


class TestNumbers:
    def test_uniform_ones_have_a_third_of_their_squared_half_width(self):
        spread = spread_of({RIGHT: "1 mm", "track": "1 cm"})
        np.testing.assert_allclose(spread.covariance, np.diag([1e-6, 1e-4]) / 3, rtol=1e-12)
        assert spread.uniform.all()

    def test_one_sided_ranges_have_second_moments_about_the_nominal_value(self):
        spread = spread_of({"track": (0.18, 0.21), "x": (-0.01, 0.03)})
        # The mean of (u - nominal)^2 over the range, by its antiderivative.
        np.testing.assert_allclose(
            np.diag(spread.covariance), [0.03**2 / 3, (0.03**3 + 0.01**3) / 0.12], rtol=1e-9
        )

    def test_extremes_of_a_few_are_all_corners(self):
        spread = spread_of({"track": ("17 cm", "21 cm"), RIGHT: "1 mm"})
        corners = {(a, b) for a in (RADIUS - 1e-3, RADIUS + 1e-3) for b in (0.17, 0.21)}
        found = {tuple(np.round(row, 12)) for row in spread.extremes(2.5)}
        assert found == {tuple(np.round(corner, 12)) for corner in corners}

    def test_extremes_of_many_are_the_ends_one_by_one(self):
        spread = spread_of({RIGHT: "1 mm", LEFT: "1 mm", "track": "1 cm", "x": "1 cm", "y": "2 cm"})
        moved = spread.extremes(2.5) - spread.nominal
        assert moved.shape == (10, 5)
        np.testing.assert_allclose(moved[:5], np.diag([1e-3, 1e-3, 0.01, 0.01, 0.02]), atol=1e-15)
        np.testing.assert_allclose(moved[5:], -moved[:5], atol=1e-15)

    def test_ends_of_normal_ones_are_so_many_standard_deviations_away(self):
        prior = Prior(parameters=(RIGHT, "track"), covariance=CORRELATED)
        spread = spread_of(prior=prior)
        moved = spread.ends(2.0) - spread.nominal
        whitened = moved @ np.linalg.inv(np.linalg.cholesky(spread.covariance)).T
        np.testing.assert_allclose(np.linalg.norm(whitened, axis=1), 2.0, rtol=1e-9)

    @pytest.mark.parametrize("distribution", ["uniform", "normal"])
    def test_moments_have_this_mean_and_covariance(self, distribution: str):
        prior = Prior(parameters=(RIGHT, LEFT), covariance=CORRELATED)
        spread = spread_of({"track": "5 %", "heading": "2 deg"}, distribution, prior=prior)
        values = spread.moments()
        errors = values - spread.nominal
        assert values.shape == (8, 4)
        np.testing.assert_allclose(values.mean(axis=0), spread.nominal, rtol=1e-9, atol=1e-12)
        sizes = np.sqrt(np.diag(spread.covariance))
        found = errors.T @ errors / len(errors) / np.outer(sizes, sizes)
        np.testing.assert_allclose(found, spread.covariance / np.outer(sizes, sizes), atol=1e-9)


class TestPriors:
    def test_a_prior_alone_is_what_is_uncertain(self):
        prior = Prior(parameters=("track", RIGHT), covariance=CORRELATED)
        spread = spread_of(prior=prior)
        # In the robot's order, not the prior's.
        assert spread.names == (RIGHT, "track")
        np.testing.assert_allclose(spread.covariance, np.array(CORRELATED)[::-1, ::-1], rtol=1e-9)
        assert not spread.uniform.any()

    def test_shares_of_a_prior_are_of_the_nominal_values(self):
        spread = spread_of(prior=Prior(standard_deviations={"track": "5 %"}))
        np.testing.assert_allclose(spread.covariance, [[0.009**2]], rtol=1e-9)

    def test_what_an_uncertainty_names_is_not_the_priors(self):
        prior = Prior(parameters=(RIGHT, "track"), covariance=CORRELATED)
        spread = spread_of({"track": "1 cm"}, prior=prior)
        assert spread.names == (RIGHT, "track")
        np.testing.assert_allclose(spread.covariance, np.diag([4e-6, 1e-4 / 3]), rtol=1e-9)
        assert spread.uniform.tolist() == [False, True]

    def test_nothing_said_is_no_spread(self):
        assert spread_of_system(sensed_problem().uncertain_system) is None

    def test_a_prior_on_coefficients_is_of_the_coefficients(self):
        names = ("c11", "c12", "c21", "c22")
        spread = spread_of(prior=Prior(standard_deviations={"c21": "1 mm"}), estimate=names)
        assert spread.names == ("c21",)
        values = spread.parameter_values(spread.nominal + np.array([[1e-3]]))
        expected = np.array([RADIUS / TRACK, -RADIUS / TRACK, RADIUS / 2 + 1e-3, RADIUS / 2])
        np.testing.assert_allclose(values, [expected], rtol=1e-9)


@cache
def three_ranges() -> UncertainQuantities:
    return spread_of({"track": ("17 cm", "20 cm"), RIGHT: "5 %", "heading": "2 deg"})


class TestRobots:
    def test_what_is_not_named_stays_nominal(self):
        spread = spread_of({"track": "5 %", "y": "1 cm"})
        np.testing.assert_allclose(
            spread.parameter_values(np.array([[0.19, 0.01]])), [[RADIUS, RADIUS, 0.19]], rtol=1e-12
        )

    def test_the_order_is_the_robots(self):
        spread = spread_of({"track": "5 %", LEFT: "1 mm", RIGHT: "1 mm"})
        assert spread.names == (RIGHT, LEFT, "track")
        assert spread.units == ("m", "m", "m")
        table = np.array([[0.05, 0.048, 0.19], [0.049, 0.047, 0.18]])
        np.testing.assert_array_equal(spread.parameter_values(table), table)

    def test_whatever_is_estimated_the_robots_are_simulated_by_their_own_parameters(self):
        # Coefficients would not tell what becomes of slip.
        uncertain = {RIGHT: "20 %", "slip_outer": 0.1}
        robot = SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=0.1)
        spread = spread_of(uncertain, model=robot, estimate=("c11", "c12", "c21", "c22"))
        assert spread.system == robot
        assert spread.parameter_values(np.array([[0.05, 0.2]]))[0].tolist() == [0.05, RADIUS, TRACK, 0.2, 0.0]

    @pytest.mark.parametrize("distribution", ["uniform", "normal"])
    def test_ranges_in_which_no_robot_can_be_are_refused(self, distribution):
        within = {"track": 5} if distribution == "uniform" else {"track": "40 %"}
        (message,) = issues_of(within, distribution).values()
        assert "cannot be: narrow the ranges" in message
        assert "track -" in message

    def test_what_is_left_without_some_parameters(self):
        model = DifferentialDrive(wheel_radius=RADIUS, track=TRACK)
        said = Uncertainty.model_validate({"wheel_radius": "5 %", "track": "1 cm", "x": 0.1})
        assert said.without([RIGHT, "track"], model).within == {LEFT: "5 %", "x": 0.1}
        assert said.without([RIGHT, LEFT, "track", "x"], model) is None

    def test_one_name_for_both_radii(self):
        assert spread_of({"wheel_radius": "5 %", "track": "1 cm"}).names == (RIGHT, LEFT, "track")

    @pytest.mark.parametrize("estimate", [(RIGHT, LEFT, "track"), ("c11", "c12", "c21", "c22")])
    def test_slopes_are_differences_of_robots(self, estimate):
        spread = spread_of({"track": "5 %", RIGHT: "5 %", "heading": "2 deg"}, estimate=estimate)
        expected = central_difference(
            lambda values: spread.parameter_values(values[None]), spread.nominal, 1e-7
        )
        np.testing.assert_allclose(spread.parameter_slopes, expected, atol=1e-6)


class TestStarts:
    def test_they_shift_the_start_state(self):
        spread = spread_of({"heading": "2 deg", "track": "5 %", "x": "1 cm"})
        assert spread.names == ("track", "x", "heading")
        shifts = spread.shifts(np.array([[0.19, 0.01, -0.02]]))
        np.testing.assert_allclose(shifts, [[[0.01, 0.0, -0.02]]], atol=1e-15)

    def test_every_run_is_put_down_by_itself(self):
        spread = spread_of({"y": "1 cm", "heading": "2 deg"}, design=runs(3))
        assert spread.names[:3] == ("y", "heading", "y, run 2")
        values = np.arange(6.0)[None] / 100
        expected = np.zeros((1, 3, 3))
        expected[0, :, 1:] = np.arange(6).reshape(3, 2) / 100
        np.testing.assert_allclose(spread.shifts(values), expected, atol=1e-15)
        np.testing.assert_allclose(np.cov(spread.draws(4000, 0).T)[0, 2], 0.0, atol=5e-6)

    def test_slopes_are_differences_of_shifts(self):
        spread = spread_of({"track": "5 %", "x": "1 cm", "heading": "2 deg"}, design=runs(2))
        for run in range(2):
            expected = central_difference(lambda q, run=run: spread.shifts(q[None])[0, run], spread.nominal)
            np.testing.assert_allclose(spread.start_slopes(run), expected, atol=1e-9)

    def test_it_is_about_the_start_wherever_that_is(self):
        space = runs(2, start=(StartPose(x=0.3), StartPose(x=-0.3)))
        fixed, free = (spread_of({"x": "1 cm"}, design=one) for one in (space, runs(2, start="free")))
        np.testing.assert_array_equal(fixed.nominal, [0.0, 0.0])
        np.testing.assert_array_equal(free.low, fixed.low)

    def test_a_start_alone_leaves_the_robot_nominal(self):
        spread = spread_of({"x": "1 cm"})
        assert spread.parameters == 0
        robot = DifferentialDrive(wheel_radius=RADIUS, track=TRACK)
        np.testing.assert_array_equal(spread.parameter_values(spread.draws(3, 0)), [robot.nominal] * 3)
