"""The car with inertia: its dynamics against SciPy, cornering against the closed form, and studies of it."""

from __future__ import annotations

import cars
import casadi as ca
import numpy as np
import oracle
import pytest
from builders import problem_of
from sample_robots import twist_of
from scipy.integrate import solve_ivp

import oed
from oed.foundation.errors import PartError, ProblemError
from oed.kernel.dynamics.system import stepper
from oed.kernel.scorer import score
from oed.robots.baselines import NAMES, refusal, suited
from oed.robots.models.arcs import after_arc

CAR = oed.BicycleDynamic(**cars.CAR)
FULL = oed.BicycleDynamic(**cars.EFFECTS)
INPUTS = (oed.Throttle(bounds=1.0), oed.SteeringAngle(bounds="25 deg"))


def exact(state, inputs, period: float, car=cars.CAR) -> np.ndarray:
    """The state after a period, by SciPy's stiff integrator."""
    given = {"rtol": 1e-11, "atol": 1e-13, "method": "LSODA"}
    return solve_ivp(lambda _, now: cars.slopes(now, inputs, car), (0, period), state, **given).y[:, -1]


def stepped(model, state, inputs, period: float) -> np.ndarray:
    return np.array(stepper(model)(state, inputs, model.nominal, period)).ravel()


def driven(model, table: np.ndarray, period: float) -> np.ndarray:
    """The states (N + 1, 6) that inputs (N, 2) lead to from rest."""
    states = [np.zeros(6)]
    for inputs in table:
        states.append(stepped(model, states[-1], inputs, period))
    return np.array(states)


def swerving(count: int, duration: float = 4.0) -> np.ndarray:
    times = (np.arange(count) + 0.5) * duration / count
    return np.column_stack([0.5 * np.sin(0.9 * times) + 0.2, 0.35 * np.sin(2.5 * times)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("car", "speeds", "least", "error"),
    [
        (cars.CAR, (1.5, 0.1, -0.8), 2.8, 5e-4),
        (cars.EFFECTS, (1.5, 0.1, -0.8), 2.8, 5e-4),
        (cars.EFFECTS, (-1.0, 0.05, 0.4), 2.8, 2e-3),
        # From rest tyres settle within a hundredth of the period: only finer steps see all of it.
        (cars.EFFECTS, (0.0, 0.0, 0.0), 2.4, 5e-6),
        (cars.EFFECTS, (0.02, 0.0, 0.0), 2.4, 5e-6),
    ],
    ids=["plain", "ahead", "back", "at rest", "hardly moving"],
)
def test_steps_converge_to_the_solution_with_order_three(car, speeds, least: float, error: float):
    state, inputs, period = np.array([0.3, -0.2, 0.7, *speeds]), (0.6, 0.3), 0.2
    expected, counts, errors = exact(state, inputs, period, car), np.array([8, 32]), []
    for count in counts:
        found = stepped(oed.BicycleDynamic(**car, substeps=int(count)), state, inputs, period)
        errors.append(np.linalg.norm(found - expected))
    assert least < -np.polyfit(np.log(counts), np.log(errors), 1)[0] < 3.3
    assert errors[0] < error


@pytest.mark.parametrize("rule", ["arc", "midpoint"])
@pytest.mark.parametrize("car", [CAR, FULL], ids=["plain", "all effects"])
def test_a_step_leads_to_the_end_of_the_arc_that_readings_see(car, rule: str):
    car, state, inputs = car.system(rule), np.array([0.3, -0.2, 0.7, 1.5, 0.1, -0.8]), np.array([0.6, 0.3])
    for period in (0.2, 0.01, 0.0):
        given = [*map(ca.SX, (ca.DM(state), ca.DM(inputs), ca.DM(car.nominal))), ca.SX(period)]
        twist, further = car.motion(*given)
        expected = np.array(ca.evalf(after_arc(given[0], twist, further, period, rule))).ravel()
        assert np.abs(stepped(car, state, inputs, period) - expected).max() < 1e-14
        assert period or np.array(ca.evalf(twist)).ravel() == pytest.approx(state[3:], abs=1e-15)


@pytest.mark.slow
def test_a_drive_from_rest_is_scipys():
    table, period = swerving(80), 0.05
    states = [np.zeros(6)]
    for inputs in table:
        states.append(exact(states[-1], inputs, period))
    expected = np.array(states)
    assert np.abs(expected[:, 3] * expected[:, 5]).max() > 2
    found = driven(CAR, table, period)
    # Millimetres, and a tenth of a degree.
    assert np.abs(found[:, :2] - expected[:, :2]).max() < 1e-3
    assert np.abs(found[:, 2] - expected[:, 2]).max() < 2e-3
    finer = driven(oed.BicycleDynamic(**cars.CAR, substeps=8), table, period)
    assert np.abs(finer - expected).max() < np.abs(found - expected).max() / 30


@pytest.mark.slow
def test_no_time_changes_nothing_and_long_periods_settle():
    state = np.array([1.0, 2.0, 0.5, 1.2, -0.1, 0.7])
    np.testing.assert_array_equal(stepped(CAR, state, (0.4, 0.2), 0.0), state)
    rest = stepped(CAR, np.zeros(6), (0.0, 0.3), 5.0)
    np.testing.assert_array_equal(rest, np.zeros(6))
    steady = twist_of(CAR, (0.4, 0.1))
    slow = oed.BicycleDynamic(**cars.CAR, substeps=25)
    np.testing.assert_allclose(stepped(slow, np.zeros(6), (0.4, 0.1), 40.0)[3:], steady, rtol=1e-9)


@pytest.mark.parametrize("car", [cars.CAR, {**cars.CAR, "stiffness_front": 35.0}], ids=["under", "over"])
@pytest.mark.parametrize("throttle", [0.2, 0.5, 0.9])
def test_steady_cornering_has_the_yaw_gain_of_the_closed_form(car, throttle: float):
    # At the softened speed that tyres see, which is the speed itself where that is not low.
    model, angle = oed.BicycleDynamic(**car, low_speed=1e-3), 1e-4
    ahead, _, yaw_rate = twist_of(model, (throttle, angle))
    front, rear = car["front_axle"], car["rear_axle"]
    wheelbase = front + rear
    gradient = (rear / car["stiffness_front"] - front / car["stiffness_rear"]) / wheelbase
    assert (gradient > 0) == (car["stiffness_front"] < 30)
    assert ahead == pytest.approx(car["drive_gain"] * throttle / car["viscous_drag"], rel=1e-6)
    assert yaw_rate / angle == pytest.approx(ahead / (wheelbase + gradient * ahead**2), rel=1e-6)


def test_a_slow_car_rolls_as_its_steering_says():
    ahead, across, yaw_rate = twist_of(CAR, (0.001, 0.4))
    assert yaw_rate == pytest.approx(ahead * np.tan(0.4) / CAR.wheelbase, rel=1e-3)
    assert across == pytest.approx(CAR.rear_axle * yaw_rate, rel=1e-2)


@pytest.mark.parametrize("inputs", [(0.0, 0.3), (0.03, 0.2), (0.7, 0.35), (-0.4, -0.3), (1.0, 0.0)])
def test_in_steady_driving_nothing_accelerates(inputs):
    steady = twist_of(FULL, inputs)
    np.testing.assert_allclose(cars.accelerations(steady, inputs, cars.EFFECTS), 0, atol=1e-12)


def test_what_is_steered_the_other_way_is_mirrored():
    state = np.array([0.0, 0.0, 0.0, 1.3, 0.1, 0.6])
    mirror = np.array([1, -1, -1, 1, -1, -1])
    one = stepped(CAR, state, (0.5, 0.2), 0.1)
    np.testing.assert_allclose(stepped(CAR, mirror * state, (0.5, -0.2), 0.1), mirror * one, atol=1e-14)


@pytest.mark.parametrize("speeds", [(0, 0, 0), (1.5, 0.1, -0.8), (-1.0, 0.05, 0.4)])
def test_derivatives_by_state_inputs_and_parameters_are_the_finite_differences(speeds):
    # Also at rest, from which every drive begins.
    point = np.concatenate([[0.1, 0.2, 0.3, *speeds, 0.4, 0.2], FULL.nominal])
    symbol = ca.SX.sym("point", len(point))
    following = stepper(FULL)(symbol[:6], symbol[6:8], symbol[8:], 0.1)
    found = np.array(ca.Function("j", [symbol], [ca.jacobian(following, symbol)])(point))

    def step(at: np.ndarray) -> np.ndarray:
        return np.array(stepper(FULL)(at[:6], at[6:8], at[8:], 0.1)).ravel()

    np.testing.assert_allclose(found, oracle.central_difference(step, point), rtol=1e-6, atol=1e-8)


def study(**parts):
    """A problem of the car, with small numbers."""
    given = {
        "model": oed.BicycleDynamic(**cars.CAR, substeps=1),
        "measurement": oed.Poses(noise={"position": 0.01, "heading": 0.02}, initial_pose="resting"),
        "limits": (
            *INPUTS,
            oed.BodySpeed(bounds=2.0),
            oed.YawRateLimit(bounds=3.0),
            oed.LateralAcceleration(bounds=4.0),
            oed.Rectangle(x=(-2, 2), y=(-2, 2)),
        ),
        "criterion": oed.E(),
        "estimate": ("drive_gain", "stiffness_front", "stiffness_rear", "gyration_radius"),
        "duration": 4.0,
        "samples": 32,
        **parts,
    }
    return problem_of(**given)


@pytest.mark.slow
def test_all_its_parameters_are_identifiable_from_poses():
    names = tuple(one.name for one in FULL.parameters)
    problem = study(model=FULL, estimate=names, duration=6.0, samples=60)
    assert oed.ambiguities(problem) == ()


@pytest.mark.slow
def test_speeds_known_to_rest_make_a_drive_more_informative():
    table = np.vstack([swerving(32)])
    drive = oed.Trajectory.from_samples(table, 4.0, np.zeros(6), rest_to_rest=False)
    noise = {"position": 0.01, "heading": 0.02}
    problems = [
        study(limits=INPUTS, rest_to_rest=False, measurement=oed.Poses(noise=noise, initial_pose=name))
        for name in ("unknown", "resting", "known")
    ]
    found = [oed.evaluate(one, drive).objective for one in problems]
    assert found[0] < found[1] < found[2]


@pytest.mark.slow
def test_limits_hold_between_samples():
    problem = study(rest_to_rest=False, limits=(*INPUTS, oed.Rectangle(x=(-2, 2), y=(-2, 2))))
    drive = oed.Trajectory.from_samples(swerving(32), 4.0, np.zeros(6), rest_to_rest=False)
    margins = {one.name: one for one in score(problem, drive).margins}
    states = [np.zeros(6)]
    for inputs in drive.inputs:
        states.append(cars.rosenbrock(states[-1], inputs, drive.period, cars.CAR, 1))
    # Looked at closely before and after the samples that are farthest out, where the farthest place is.
    farthest = np.argsort(-np.abs(np.array(states)[:, :2]).max(axis=1))[:3]
    periods = {at for sample in farthest for at in (sample - 1, sample) if 0 <= at < drive.samples}
    fine = [
        cars.rosenbrock(states[at], drive.inputs[at], share * drive.period, cars.CAR, 1)
        for at in sorted(periods)
        for share in _SHARES
    ]
    room = 2.0 - np.abs(np.array(fine)[:, :2]).max()
    assert margins["workspace"].margin == pytest.approx(room, abs=2e-5)


_SHARES = np.linspace(0, 1, 51)[1:]


def test_everyday_paths_are_refused_in_words_and_random_inputs_are_not():
    problem = study()
    assert suited(problem) == ("random",)
    others = [name for name in NAMES if name != "random"]
    for name in others:
        text = f"bicycle_dynamic cannot drive a {name} (it is made of speeds, and throttle is none)"
        assert refusal(problem, name) == f"{text}; it can drive random"


@pytest.mark.parametrize(
    ("limit", "text"),
    [
        (oed.Throttle(bounds=100), "100 is more than the full throttle, 1; give shares of it"),
        (oed.Throttle(bounds=(0.1, 1)), "excludes 0"),
        (oed.WheelSpeed(bounds=3), "bicycle_dynamic has no wheel_speed"),
    ],
)
def test_limits_that_mean_nothing_are_refused_by_their_key(limit, text: str):
    bounds = [oed.SteeringAngle(bounds=0.4)]
    bounds += [] if limit.name == "throttle" else [oed.Throttle(bounds=1)]
    with pytest.raises(ProblemError, match=f"limits.{limit.name}: .*{text}"):
        study(limits=(*bounds, limit))


def test_a_throttle_without_bounds_is_refused_with_the_limit_to_add():
    with pytest.raises(ProblemError, match="add throttle"):
        study(limits=(oed.SteeringAngle(bounds=0.4),))


@pytest.mark.parametrize(
    "wrong",
    [
        {"drive_gain": 0},
        {"viscous_drag": 0},
        {"stiffness_rear": -1},
        {"stiffness_front": "25 m/s^2"},
        {"gyration_radius": 0},
        {"low_speed": 0},
        {"substeps": 0},
        {"mass": 3},
    ],
)
def test_wrong_values_are_refused_by_their_key(wrong):
    with pytest.raises(PartError, match=next(iter(wrong))):
        oed.BicycleDynamic(**{**cars.CAR, **wrong})
