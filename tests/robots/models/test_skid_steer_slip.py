"""Skid steer with slip put together: what each effect is by itself, and the lag against its own equation."""

from __future__ import annotations

import casadi as ca
import numpy as np
import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_robots import twist_of
from scipy.integrate import solve_ivp

from oed.foundation.errors import PartError
from oed.kernel.dynamics.system import stepper
from oed.robots.models import (
    DifferentialDrive,
    Model,
    PythonRobot,
    SkidSteerIcr,
    SkidSteerSlip,
    follows_state,
)
from oed.robots.models.model import CoefficientRobot

SIZES = {"wheel_radius_right": 0.051, "wheel_radius_left": 0.047, "track": 0.18}
EFFECTS = {
    "yaw_lag": 0.3,
    "track_per_yaw_rate": 0.02,
    "track_per_curvature": 0.07,
    "x_icr": -0.03,
    "y_icr": 0.02,
    "drift": 0.03,
}
FULL = SkidSteerSlip(**SIZES, **EFFECTS)
LAG = SkidSteerSlip(**SIZES, yaw_lag=0.3)
PLAIN = DifferentialDrive(**SIZES)
speeds = st.floats(-10, 10)


def after(model: Model, state, inputs, period: float, parameters=None) -> np.ndarray:
    values = model.nominal if parameters is None else parameters
    return np.array(stepper(model)(state, inputs, values, period)).ravel()


class TestEffects:
    @pytest.mark.slow
    @given(right=speeds, left=speeds)
    def test_none_is_the_differential_drive(self, right: float, left: float):
        bare = SkidSteerSlip(**SIZES)
        assert np.array_equal(twist_of(bare, [right, left]), twist_of(PLAIN, [right, left]))
        assert (bare.states, bare.coefficient_names) == (PLAIN.states, PLAIN.coefficient_names)
        assert bare.nominal == PLAIN.nominal
        assert not follows_state(bare)

    @given(right=speeds, left=speeds)
    def test_effects_of_no_size_change_nothing(self, right: float, left: float):
        none = SkidSteerSlip(**SIZES, track_per_yaw_rate=0, track_per_curvature=0, x_icr=0, y_icr=0, drift=0)
        assert twist_of(none, [right, left]) == pytest.approx(twist_of(PLAIN, [right, left]), abs=1e-14)
        assert [entry.scale for entry in none.parameters[3:]] == [0.18] * 4 + [1.0]

    @pytest.mark.parametrize("forwards", [1, -1])
    @pytest.mark.parametrize("left", [1, -1])
    def test_it_drifts_out_of_the_bend(self, forwards: int, left: int):
        drifting = SkidSteerSlip(wheel_radius=0.05, track=0.18, drift=0.04)
        inputs = forwards * (np.array([6.0, 5.0]) if left * forwards > 0 else np.array([5.0, 6.0]))
        speed, lateral, yaw_rate = twist_of(drifting, inputs)
        assert np.sign([speed, yaw_rate]).tolist() == [forwards, left]
        # The bend's middle lies to the side that speed times yaw rate points to.
        assert lateral == pytest.approx(-0.04 * speed * yaw_rate * abs(yaw_rate), rel=1e-2)
        assert np.sign(lateral) == -forwards * left

    @given(right=speeds, left=speeds)
    def test_a_centre_alone_is_that_of_centres_of_rotation(self, right: float, left: float):
        icr = SkidSteerIcr(wheel_radius=0.05, y_icr_left=0.09, y_icr_right=-0.09, x_icr=-0.03)
        slip = SkidSteerSlip(wheel_radius=0.05, track=0.18, x_icr=-0.03)
        assert twist_of(slip, [right, left]) == pytest.approx(twist_of(icr, [right, left]), abs=1e-14)
        assert slip.coefficient_names == icr.coefficient_names
        assert np.array(slip.coefficients(slip.nominal)) == pytest.approx(
            np.array(icr.coefficients(icr.nominal))
        )

    def test_any_other_effect_is_not_linear(self):
        for name in ("yaw_lag", "track_per_yaw_rate", "track_per_curvature", "y_icr", "drift"):
            model = SkidSteerSlip(**SIZES, **{name: EFFECTS[name]})
            assert model.coefficient_names == ()
            with pytest.raises(NotImplementedError, match="skid_steer_slip"):
                model.coefficients(ca.DM(model.nominal))

    @pytest.mark.parametrize(
        ("inputs", "expected"),
        [((5, 5), 0), ((5, 0), 0.5), ((0, -5), 0.5), ((5, -5), 1), ((3, 1), 0.2), ((0, 0), 0)],
    )
    def test_tightness(self, inputs, expected: float):
        assert float(FULL.tightness(ca.DM(inputs))) == pytest.approx(expected, abs=1e-3)

    @given(right=speeds, left=speeds)
    def test_tightness_is_bounded_and_even(self, right: float, left: float):
        found = [
            float(FULL.tightness(ca.DM(one)))
            for one in ([right, left], [left, right], [-right, -left], [2 * right, 2 * left])
        ]
        assert 0 <= found[0] <= 1
        assert found[1:3] == [found[0]] * 2
        assert found[3] >= found[0] * (1 - 1e-12)

    @pytest.mark.parametrize("curvature", [0.1, 1.0, 5.0, 50.0])
    def test_tightness_is_the_squared_curvature_saturated(self, curvature: float):
        model = SkidSteerSlip(wheel_radius=0.05, track=0.18, track_per_curvature=0.0)
        half = 0.18 * curvature / 2
        inputs = 50 * np.array([1 + half, 1 - half])
        forward, _, yaw_rate = twist_of(model, inputs)
        assert yaw_rate / forward == pytest.approx(curvature)
        assert float(model.tightness(ca.DM(inputs))) == pytest.approx(half**2 / (1 + half**2), rel=1e-4)

    def test_the_track_in_turns(self):
        curve = SkidSteerSlip(**SIZES, track_per_curvature=0.07)
        rate = SkidSteerSlip(**SIZES, track_per_yaw_rate=0.02)
        spin = [9.0, -9.0]
        plain = twist_of(PLAIN, spin)[2]
        assert plain / twist_of(curve, spin)[2] == pytest.approx((0.18 + 0.07) / 0.18, rel=1e-4)
        assert plain / twist_of(rate, spin)[2] == pytest.approx(1 + 0.02 * (plain - 0.05) / 0.18, rel=1e-3)

    def test_a_track_that_a_spin_leaves_nothing_of(self):
        with pytest.raises(PartError, match="no track on a spin"):
            SkidSteerSlip(**SIZES, track_per_curvature=-0.18)

    @pytest.mark.parametrize("wrong", [{"yaw_lag": 0}, {"yaw_lag": -1}, {"x_icr": 3}, {"y_icr": -3}])
    def test_wrong_values_are_refused(self, wrong):
        with pytest.raises(PartError, match=next(iter(wrong))):
            SkidSteerSlip(**SIZES, **wrong)

    def test_units(self):
        model = SkidSteerSlip(**SIZES, yaw_lag="200 ms", track_per_yaw_rate="2 cm*s/rad")
        assert model.nominal[3:] == pytest.approx([0.2, 0.02])

    def test_other_values(self):
        model = FULL.with_values({"yaw_lag": 0.4, "x_icr": 0.01})
        assert model.nominal == pytest.approx([*SIZES.values(), 0.4, 0.02, 0.07, 0.01, 0.02, 0.03])
        bare = SkidSteerSlip(**SIZES).with_values({"track": 0.2})
        assert bare.states == ("x", "y", "heading")


class TestLag:
    INPUTS = np.array([[6.0, 2.0], [1.0, 5.0], [-4.0, 4.0], [3.0, 3.0], [0.0, 0.0]])

    def true(self, model: Model, times: np.ndarray, period: float, start) -> np.ndarray:
        """States (K, 4) of inputs held for `period` each, by SciPy."""
        states, state = [np.array(start)], np.array(start)
        lag = model.nominal[3]
        ahead, beside, drift = model.nominal[6:] if len(model.nominal) > 4 else (0.0, 0.0, 0.0)
        for inputs in self.INPUTS:
            moved, _, asked = twist_of(model, inputs)

            def rate(_, now, speed=moved - beside * asked, asked=asked):
                heading, turning = now[2:]
                forward = speed + beside * turning
                left = -ahead * turning - drift * speed * turning * np.hypot(turning, 0.01)
                return [
                    forward * np.cos(heading) - left * np.sin(heading),
                    forward * np.sin(heading) + left * np.cos(heading),
                    turning,
                    (asked - turning) / lag,
                ]

            found = solve_ivp(rate, (0, period), state, t_eval=times[1:], rtol=1e-11, atol=1e-12)
            states += list(found.y.T)
            state = states[-1]
        return np.array(states)

    @pytest.mark.slow
    @pytest.mark.parametrize("model", [LAG, FULL], ids=["lag", "all"])
    def test_heading_is_exact_and_position_of_second_order(self, model: Model):
        period, start, errors = 0.8, [0.1, -0.2, 0.4, 0.7], []
        for count in (4, 8, 16):
            times = np.linspace(0, period, count + 1)
            expected, states = self.true(model, times, period, start), [np.array(start)]
            for inputs in np.repeat(self.INPUTS, count, axis=0):
                states.append(after(model, states[-1], inputs, period / count))
            off = np.abs(np.array(states) - expected).max(axis=0)
            assert off[2:].max() < 1e-8
            errors.append(off[:2].max())
        assert errors[-1] < 1e-3
        assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.15)

    def test_a_long_period_is_that_of_the_twist_asked_for(self):
        found = after(FULL, [0, 0, 0, 2.0], [6.0, 2.0], 1e4)
        asked = twist_of(FULL, [6.0, 2.0])[2]
        assert found[3] == pytest.approx(asked, rel=1e-12)
        assert found[2] == pytest.approx(1e4 * asked + 0.3 * (2.0 - asked), rel=1e-12)

    def test_hardly_any_lag_is_none(self):
        model = SkidSteerSlip(**SIZES, yaw_lag=1e-9)
        found = after(model, [0.1, 0.2, 0.3, 5.0], [6.0, 2.0], 0.1)
        assert found[:3] == pytest.approx(after(PLAIN, [0.1, 0.2, 0.3], [6.0, 2.0], 0.1), abs=1e-7)

    @pytest.mark.parametrize("period", [0.0, 1e-12, 1e-3, 0.0149, 0.0151, 0.1, 10.0, 149.0, 151.0])
    def test_derivatives_are_those_of_the_equation(self, period: float):
        # At no time at all, on both sides of where series stand in, where nothing is left of the beginning.
        state, inputs = np.array([0.1, 0.2, 0.3, 1.5]), np.array([6.0, 2.0])
        symbol = ca.SX.sym("p", len(LAG.nominal))
        following = stepper(LAG)(state, inputs, symbol, period)
        jacobian = ca.jacobian(following, symbol)
        both = ca.Function("both", [symbol], [jacobian, ca.jacobian(ca.vec(jacobian), symbol)])
        first, second = (np.array(one) for one in both(LAG.nominal))
        assert np.isfinite(second).all()
        asked, lag = twist_of(LAG, inputs)[2], 0.3
        left = np.exp(-period / lag)
        by_lag = (1.5 - asked) * np.array([1 - left - left * period / lag, left * period / lag**2])
        assert first[2:, 3] == pytest.approx(by_lag, rel=1e-9, abs=1e-12)

    @pytest.mark.parametrize("lag", [0.0, -0.1, 1e-4])
    def test_a_search_may_pass_lags_that_are_none(self, lag: float):
        values = [*SIZES.values(), lag]
        asked = twist_of(LAG, [6.0, 2.0])[2]
        for period in (0.0, 0.1):
            state, symbol = np.array([0.0, 0.0, 0.0, 2.0]), ca.SX.sym("p", 4)
            following = stepper(LAG)(state, [6.0, 2.0], symbol, period)
            slopes = ca.Function("s", [symbol], [following, ca.jacobian(following, symbol)])
            found, by = (np.array(one) for one in slopes(values))
            assert np.isfinite(by).all()
            expected = [asked * period + (2 - asked) * lag, asked] if period else [0.0, 2.0]
            assert found[2:].ravel() == pytest.approx(expected, abs=1e-12)

    def test_a_period_of_no_time_changes_nothing(self):
        state = np.array([0.1, -0.2, 0.3, 1.5])
        assert np.array_equal(after(FULL, state, [9.0, -9.0], 0.0), state)
        asked = FULL.twist(ca.DM([9, -9]), ca.DM(FULL.nominal))
        instant = ca.evalf(FULL.mean_twist(ca.DM(state), asked, ca.DM(FULL.nominal), ca.DM(0)))
        # Wheels that turn against each other, the right one larger: the mean speed is theirs.
        speed = (0.051 - 0.047) * 9 / 2
        lateral = 0.03 * 1.5 - 0.03 * speed * 1.5 * np.hypot(1.5, 0.01)
        assert np.array(instant).ravel() == pytest.approx([speed + 0.02 * 1.5, lateral, 1.5])


class TestSeam:
    def test_only_a_lag_follows_the_state(self):
        assert follows_state(LAG)
        assert not follows_state(SkidSteerSlip(**SIZES, track_per_yaw_rate=0.02))

    def test_a_robot_of_ones_own_lags_as_well(self):
        own = PythonRobot(object="oed.robots.models.skid_steer_slip:SkidSteerSlip", **SIZES, **EFFECTS).made(
            Model
        )
        assert follows_state(own)
        state, inputs = [0.1, 0.2, 0.3, 1.5], [6.0, 2.0]
        assert np.array_equal(after(own, state, inputs, 0.1), after(FULL, state, inputs, 0.1))

    def test_seen_through_coefficients_a_robot_lags_as_well(self):
        class Lagging(SkidSteerSlip):
            """Named by its coefficients all the same."""

            @property
            def coefficient_names(self):
                return DifferentialDrive.coefficient_names

            def coefficients(self, parameters):
                return PLAIN.coefficients(parameters)

        model = CoefficientRobot(base=Lagging(**SIZES, yaw_lag=0.3))
        state, inputs = [0.1, 0.2, 0.3, 1.5], [6.0, 2.0]
        assert after(model, state, inputs, 0.1) == pytest.approx(after(LAG, state, inputs, 0.1), abs=1e-14)

    def test_mirrored_inputs_make_the_mirrored_turn(self):
        alike = SkidSteerSlip(wheel_radius=0.05, track=0.18, **{**EFFECTS, "y_icr": 0.0})
        found, mirrored = (
            after(alike, [0, 0, 0, rate], inputs, 0.2) for rate, inputs in ((0.5, [6, 2]), (-0.5, [2, 6]))
        )
        assert mirrored == pytest.approx(found * [1, -1, -1, -1], abs=1e-14)


def test_the_step_is_the_oracles_from_rest():
    forward, _, asked = twist_of(LAG, [6.0, 2.0])
    mean = asked * (1 - 0.3 / 0.1 * (1 - np.exp(-0.1 / 0.3)))
    expected = oracle.advance([0, 0, 0], [forward, 0, mean], 0.1, "arc")
    assert after(LAG, np.zeros(4), [6.0, 2.0], 0.1)[:3] == pytest.approx(expected, abs=1e-14)
