"""Every listed robot against independent formulas; the shared step; the paper's slip equations."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import oracle
import pytest
from builders import SPEED, problem_of
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from sample_robots import (
    COEFFICIENT_ROBOTS,
    EXAMPLES,
    RADIUS,
    ROBOTS,
    TRACK,
    Example,
    draw_inputs,
    draw_state,
    sized,
    twist_of,
)

import oed
from oed.foundation.errors import PartError
from oed.kernel.criteria import E
from oed.kernel.dynamics.system import stepper
from oed.robots.models import (
    MODELS,
    DifferentialDrive,
    Mecanum,
    OffsetDrive,
    OmniThree,
    SkidSteer,
    SkidSteerIcr,
    chord,
    sinc,
)
from oed.robots.models.model import CoefficientRobot
from oed.robots.sensors import Displacements, Poses

robots = pytest.mark.parametrize("example", ROBOTS, ids=lambda example: example.name)
coefficient_robots = pytest.mark.parametrize("example", COEFFICIENT_ROBOTS, ids=lambda example: example.name)
rules = pytest.mark.parametrize("rule", ["arc", "midpoint"])


def next_pose(model, rule, pose, inputs, period, parameters=None) -> np.ndarray:
    values = model.nominal if parameters is None else parameters
    return np.array(stepper(model.system(rule))(pose, inputs, values, period)).ravel()


def step_jacobian(model, rule) -> ca.Function:
    advance = stepper(model.system(rule))
    pose, inputs = ca.SX.sym("pose", len(model.states)), ca.SX.sym("inputs", len(model.inputs))
    parameters, period = ca.SX.sym("p", len(model.parameters)), ca.SX.sym("period")
    point = ca.vertcat(pose, inputs, parameters, period)
    return ca.Function("jacobian", [point], [ca.jacobian(advance(pose, inputs, parameters, period), point)])


def split_step(model, rule, point) -> np.ndarray:
    states = len(model.states)
    inputs = states + len(model.inputs)
    return next_pose(model, rule, point[:states], point[states:inputs], point[-1], point[inputs:-1])


def test_every_listed_robot_has_an_example():
    assert {model.model_fields["kind"].default for model in MODELS} == set(EXAMPLES)
    for kind, examples in EXAMPLES.items():
        # What `python` names is a robot of another kind.
        assert kind == "python" or {example.model.kind for example in examples} == {kind}


def test_names_and_units():
    units = ["m", "rad", "s", "s^2", "m*s/rad", "rad/m", "m/rad", "1/s", "1/m", "m/s^2", "m/s^2/rad", ""]
    for model in (example.model for example in ROBOTS):
        names = [*model.input_names, *(parameter.name for parameter in model.parameters)]
        assert len(set(names)) == len(names), model
        assert {entry.unit for entry in model.inputs} <= {"rad/s", "rad", "m/s", ""}, model
        assert {parameter.unit for parameter in model.parameters} <= set(units), model
        assert len(model.state_units) == len(model.states), model
        assert len(model.nominal) == len(model.parameters), model
        assert model.states[:3] == ("x", "y", "heading"), model


def test_estimating_its_own_parameters_it_is_itself():
    for model in (example.model for example in ROBOTS):
        assert model.physical is model
        for names in ((), tuple(parameter.name for parameter in model.parameters)):
            assert model.estimating(names) is model


def test_estimating_coefficients_it_is_seen_through_them():
    for model in (example.model for example in COEFFICIENT_ROBOTS):
        coefficients = [name for row in model.coefficient_names for name in row]
        seen = model.estimating(coefficients)
        assert [parameter.name for parameter in seen.parameters] == coefficients, model
        assert seen.estimating(coefficients[:1]) is seen
        assert seen.by_coefficients is seen
        assert seen.physical is model
        assert seen.estimating([parameter.name for parameter in model.parameters]) is model


def test_without_coefficients_it_is_always_itself():
    car = oed.Ackermann(wheel_radius=0.05, wheelbase=0.3)
    assert car.coefficient_names == ()
    assert car.estimating(["c11"]) is car


@pytest.mark.parametrize(
    ("model", "zeros"),
    [
        (OmniThree(wheel_radius=0.04, centre_distance=0.18), ["c22"]),
        (OmniThree(wheel_radius=0.0401, centre_distance=3.1), ["c22"]),
        # A sensor above a wheel does not move ahead with the other one.
        (OffsetDrive(wheel_radius=RADIUS, track=0.3, sensor_offset=0.15), ["c21"]),
        (OffsetDrive(wheel_radius=0.03, track=0.07, sensor_offset=-0.035), ["c22"]),
        (Mecanum(wheel_radius=0.05, half_wheelbase_plus_half_track=0.3), []),
        (SkidSteerIcr(wheel_radius=0.1, y_icr_left=0.7, y_icr_right=-0.4, x_icr=1e-6), []),
        (SkidSteerIcr(wheel_radius=0.1, y_icr_left=0.7, y_icr_right=-0.4), ["c31", "c32"]),
    ],
)
def test_coefficients_that_are_0_by_geometry_are_exactly_0(model, zeros: list[str]):
    found = CoefficientRobot(base=model).parameters
    assert [one.name for one in found if one.nominal == 0] == zeros
    written = np.array(ca.evalf(model.coefficients(ca.DM(model.nominal)))).ravel()
    np.testing.assert_allclose([one.nominal for one in found], written, rtol=0, atol=1e-15)
    poses = Poses(noise={"position": 0.01, "heading": 0.02})
    regression = Displacements(segments=8, regressor="both", noise={"position": 0.01, "heading": 0.02})
    # Their precision is relative to the largest of their unit.
    largest = {unit: max(abs(one.nominal) for one in found if one.unit == unit) for unit in ("", "m")}
    assert [one.scale for one in found if one.name in zeros] == [
        largest[one.unit] for one in found if one.name in zeros
    ]
    for measurement in (poses, regression):
        parts = {"limits": (SPEED,), "estimate": tuple(one.name for one in found), "criterion": E()}
        problem_of(model=model, measurement=measurement, **parts)


@pytest.mark.parametrize("kind", [Mecanum, OmniThree])
def test_wheels_with_rollers_have_one_radius_or_each_its_own(kind):
    arm = {"half_wheelbase_plus_half_track": 0.3} if kind is Mecanum else {"centre_distance": 0.2}
    each = {f"wheel_radius_{place}": 0.05 for place in kind.places}
    assert [one.name for one in kind(wheel_radius=0.05, **arm).parameters] == ["wheel_radius", *arm]
    assert [one.name for one in kind(**each, **arm).parameters] == [*each, *arm]
    three = dict(list(each.items())[1:])
    for radii in ({}, three, {"wheel_radius": 0.05, **three}):
        with pytest.raises(PartError, match="either wheel_radius, or all of wheel_radius_front_left, "):
            kind(**radii, **arm)


def test_a_steering_gain_is_a_parameter_where_it_is_given():
    sizes = {"wheel_radius": 0.1, "wheelbase": 0.4}
    plain, geared = oed.Tricycle(**sizes), oed.Tricycle(**sizes, steering_gain=1)
    assert [one.name for one in plain.parameters] == ["wheel_radius", "wheelbase", "steering_offset"]
    assert [one.name for one in geared.parameters][3:] == ["steering_gain"]
    np.testing.assert_array_equal(twist_of(plain, [3.0, 0.4]), twist_of(geared, [3.0, 0.4]))
    assert oed.Ackermann(**sizes).parameters[3].nominal == 1.0
    with pytest.raises(PartError, match="steering_gain: expected more than 0"):
        oed.Tricycle(**sizes, steering_gain=0)


@robots
@rules
def test_step_is_the_oracles(example: Example, rule: str):
    rng = np.random.default_rng(1)
    for inputs in draw_inputs(rng, 20, example.model):
        pose = draw_state(rng, example.model)
        expected = oracle.advance(pose, example.moved(pose, inputs, 0.3), 0.3, rule)
        found = next_pose(example.model, rule, pose, inputs, 0.3)
        tolerance = 1e-13 if example.on_arcs else 1e-9
        np.testing.assert_allclose(found[:3], expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize(
    "example", [one for one in ROBOTS if one.has_further_states], ids=lambda one: one.name
)
def test_further_states_are_the_oracles(example: Example):
    rng = np.random.default_rng(11)
    straight, spin, rest = (sized([one, other], example.model) for one, other in ((5, 5), (4, -4), (0, 0)))
    for inputs in [*draw_inputs(rng, 20, example.model), straight, spin, rest]:
        state = draw_state(rng, example.model)
        expected = example.further(state, inputs, 0.4)
        found = next_pose(example.model, "arc", state, inputs, 0.4)
        np.testing.assert_allclose(found[3:], expected, rtol=0, atol=1e-9)


def test_every_robot_with_further_states_has_an_oracle_for_them():
    assert all(one.has_further_states == (len(one.model.states) > 3) for one in ROBOTS)


@robots
def test_effective_inputs_are_the_oracles(example: Example):
    for inputs in draw_inputs(np.random.default_rng(2), 20, example.model):
        found = ca.evalf(example.model.effective_inputs(ca.DM(inputs), ca.DM(example.model.nominal)))
        np.testing.assert_allclose(np.array(found).ravel(), example.effective(inputs), rtol=1e-14)


@coefficient_robots
def test_coefficients_give_the_twist(example: Example):
    model = example.model
    inputs = draw_inputs(np.random.default_rng(3), 1, model)[0]
    coefficients = np.array(ca.evalf(model.coefficients(ca.DM(model.nominal))))
    assert coefficients.shape == np.array(model.coefficient_names).shape
    yaw_rate, forward, *sideways = coefficients @ example.effective(inputs)
    lateral = sideways[0] if sideways else 0.0
    np.testing.assert_allclose(twist_of(model, inputs), [forward, lateral, yaw_rate], rtol=1e-14)


@robots
@rules
def test_step_jacobian_is_the_finite_difference(example: Example, rule: str):
    model, rng = example.model, np.random.default_rng(4)
    jacobian, straight = step_jacobian(model, rule), np.full(len(model.inputs), 0.5)
    for inputs in (draw_inputs(rng, 1, model)[0], straight):
        point = np.concatenate([rng.uniform(-1, 1, len(model.states)), inputs, model.nominal, [0.2]])
        expected = oracle.central_difference(lambda p: split_step(model, rule, p), point)
        np.testing.assert_allclose(np.array(jacobian(point)), expected, rtol=1e-6, atol=1e-8)


@robots
@pytest.mark.slow
def test_twist_jacobian_is_the_finite_difference(example: Example):
    model, rng = example.model, np.random.default_rng(5)
    count = len(model.inputs)
    symbol = ca.SX.sym("point", count + len(model.parameters))
    jacobian = ca.Function("j", [symbol], [ca.jacobian(model.twist(symbol[:count], symbol[count:]), symbol)])
    # Faster on either side, forwards and backwards.
    for inputs in draw_inputs(rng, 3, model):
        point = np.concatenate([inputs, model.nominal])
        expected = oracle.central_difference(lambda p: twist_of(model, p[:count], p[count:]), point)
        np.testing.assert_allclose(np.array(jacobian(point)), expected, rtol=1e-6, atol=1e-8)


@robots
def test_second_derivatives_are_finite_without_yaw(example: Example):
    model, symbol = example.model, ca.SX.sym("inputs", len(example.model.inputs))
    state = np.linspace(0.1, 0.4, len(model.states))
    following = stepper(model)(state, symbol, model.nominal, 0.1)
    for row in ca.vertsplit(following):
        hessian, gradient = ca.hessian(row, symbol)
        derivatives = ca.Function("d", [symbol], [hessian, gradient])
        for speed in (0.0, 0.5):
            values = derivatives(np.full(len(model.inputs), speed))
            assert all(np.isfinite(np.array(value)).all() for value in values), speed


@pytest.mark.parametrize("example", [one for one in ROBOTS if one.motion is None], ids=lambda one: one.name)
def test_arcs_compose(example: Example):
    model, rng = example.model, np.random.default_rng(6)
    for inputs in [*draw_inputs(rng, 10, model), np.full(len(model.inputs), 0.4)]:
        pose, whole = rng.uniform(-1, 1, len(model.states)), 0.7
        half = next_pose(model, "arc", pose, inputs, whole / 2)
        twice = next_pose(model, "arc", half, inputs, whole / 2)
        # Where the yaw rate changes in between, the way there is no arc.
        same = slice(None) if example.on_arcs else slice(2, None)
        once = next_pose(model, "arc", pose, inputs, whole)
        np.testing.assert_allclose(twice[same], once[same], rtol=0, atol=1e-12)


def test_midpoint_rule_converges_to_the_arc_with_order_two():
    model, inputs, start, duration = ROBOTS[0].model, [8.0, 3.0], np.array([0.1, -0.2, 0.3]), 2.0
    exact = next_pose(model, "arc", start, inputs, duration)
    counts = np.array([10, 20, 40, 80, 160])
    errors = []
    for count in counts:
        pose = start
        for _ in range(count):
            pose = next_pose(model, "midpoint", pose, inputs, duration / count)
        errors.append(np.linalg.norm(pose - exact))
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.02)


def sinc_derivatives(points: np.ndarray) -> np.ndarray:
    symbol = ca.SX.sym("a")
    value = sinc(symbol)
    first = ca.gradient(value, symbol)
    function = ca.Function("sinc", [symbol], [ca.vertcat(value, first, ca.gradient(first, symbol))])
    return np.array(function.map(len(points))(points[None, :]))


def taylor_sinc(points: np.ndarray, order: int) -> np.ndarray:
    # d^m/da^m of sum (-1)^k a^(2k) / (2k+1)!
    total = np.zeros_like(points)
    for k in range(12):
        if 2 * k >= order:
            factor = math.perm(2 * k, order) / math.factorial(2 * k + 1)
            total = total + (-1) ** k * factor * points ** (2 * k - order)
    return total


@pytest.mark.parametrize(("order", "tolerance"), [(0, 4e-16), (1, 1e-13), (2, 1e-11)])
def test_sinc_and_its_derivatives_across_the_branch_point(order: int, tolerance: float):
    edge = 0.02
    around = edge + np.concatenate([-np.geomspace(1e-3, 1e-12, 20), [0.0], np.geomspace(1e-12, 1e-3, 20)])
    points = np.concatenate([[0.0], around, -around, np.linspace(-1, 1, 21)])
    found = sinc_derivatives(points)[order]
    np.testing.assert_allclose(found, taylor_sinc(points, order), rtol=0, atol=tolerance)


@rules
def test_chord_of_a_straight_is_the_period(rule: str):
    gain, direction = chord(ca.DM(0), ca.DM(0.7), ca.DM(0.1), rule)
    assert float(gain) == 0.1
    assert float(direction) == 0.7


class TestSlip:
    """[Choi, eqs 1-6], with the sides' roles swapped by the turn's direction."""

    outer, inner = 0.15, 0.04
    robot = SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=outer, slip_inner=inner)

    def paper(self, fast: float, slow: float) -> tuple[float, float, float, float]:
        """R', Omega', V, K_s of a turn whose outer side turns at `fast` and inner at `slow`."""
        out, inn = RADIUS * fast * (1 - self.outer), RADIUS * slow * (1 - self.inner)
        radius = TRACK * (out + inn) / (2 * (out - inn))
        return radius, (out - inn) / TRACK, (out + inn) / 2, fast / slow

    @pytest.mark.parametrize("direction", [1.0, -1.0], ids=["forward", "reverse"])
    @pytest.mark.parametrize("left_turn", [True, False])
    def test_equations_one_to_four(self, left_turn: bool, direction: float):
        fast, slow = 9.0 * direction, 4.0 * direction
        speeds = [fast, slow] if left_turn else [slow, fast]
        radius, yaw_rate, forward, ratio = self.paper(fast, slow)
        side = 1 if left_turn else -1
        twist = twist_of(self.robot, speeds)
        assert twist == pytest.approx([forward, 0, side * yaw_rate], rel=1e-12)
        assert float(self.robot.turning_radius(ca.DM(speeds))) == pytest.approx(side * radius, rel=1e-12)
        assert float(self.robot.speed_ratio(ca.DM(speeds))) == pytest.approx(ratio, rel=1e-12)

    @given(right=st.floats(-10, 10), left=st.floats(-10, 10))
    def test_mirrored_speeds_give_the_mirrored_twist(self, right: float, left: float):
        forward, _, yaw_rate = twist_of(self.robot, [right, left])
        mirrored = twist_of(self.robot, [left, right])
        np.testing.assert_allclose(mirrored, [forward, 0, -yaw_rate], rtol=0, atol=1e-12)

    @given(right=st.floats(-10, 10), left=st.floats(-10, 10))
    def test_reversed_speeds_give_the_reversed_twist(self, right: float, left: float):
        twist = twist_of(self.robot, [right, left])
        np.testing.assert_allclose(twist_of(self.robot, [-right, -left]), -twist, rtol=0, atol=1e-12)

    @given(right=st.floats(-10, 10), left=st.floats(-10, 10))
    def test_no_slip_is_a_differential_drive(self, right: float, left: float):
        skid = SkidSteer(wheel_radius=RADIUS, track=TRACK)
        plain = DifferentialDrive(wheel_radius=RADIUS, track=TRACK)
        np.testing.assert_allclose(
            twist_of(skid, [right, left]), twist_of(plain, [right, left]), rtol=0, atol=1e-14
        )

    @pytest.mark.parametrize("speeds", [[5.0, 5.0], [-5.0, -5.0], [5.0, -5.0]])
    def test_straight_and_spin_have_the_mean_slip(self, speeds: list[float]):
        mean = 1 - (self.outer + self.inner) / 2
        expected = oracle.differential_twist(np.array(speeds) * mean, RADIUS, RADIUS, TRACK)
        np.testing.assert_allclose(twist_of(self.robot, speeds), expected, rtol=1e-13, atol=1e-15)

    @pytest.mark.parametrize("speed", [0.0, 5.0, -5.0])
    @pytest.mark.slow
    def test_derivative_is_smooth_across_a_straight(self, speed: float):
        symbol = ca.SX.sym("speeds", 2)
        twist = self.robot.twist(symbol, ca.DM(self.robot.nominal))
        jacobian = ca.Function("j", [symbol], [ca.jacobian(twist, symbol)])
        offsets = np.linspace(-0.5, 0.5, 2001)
        points = speed + np.array([offsets, -offsets])
        values = np.split(np.array(jacobian.map(len(offsets))(points)), len(offsets), axis=1)
        jumps = np.abs(np.diff(values, axis=0)).max()
        total = np.ptp(values, axis=0).max()
        assert jumps < 0.02 * total + 1e-12
        for offset in (-0.07, 0.0, 0.03):
            point = np.array([speed + offset, speed - offset])
            expected = oracle.central_difference(lambda p: twist_of(self.robot, p), point, 1e-6)
            np.testing.assert_allclose(np.array(jacobian(point)), expected, rtol=0, atol=1e-7)

    @pytest.mark.parametrize("slip", ["slip_outer", "slip_inner"])
    def test_full_slip_is_refused(self, slip: str):
        with pytest.raises(PartError, match=slip):
            SkidSteer(wheel_radius=RADIUS, track=TRACK, **{slip: 1.0})


@pytest.mark.parametrize("robot", [DifferentialDrive, SkidSteer])
class TestGeometry:
    def test_one_radius_serves_both_sides(self, robot):
        model = robot(wheel_radius="4.9 cm", track="18 cm")
        assert model.nominal[:3] == pytest.approx([0.049, 0.049, 0.18])

    def test_two_radii(self, robot):
        model = robot(wheel_radius_right="5 cm", wheel_radius_left="45 mm", track=0.18)
        assert model.nominal[:3] == pytest.approx([0.05, 0.045, 0.18])

    @pytest.mark.parametrize(
        "radii",
        [
            {},
            {"wheel_radius_right": 0.05},
            {"wheel_radius_left": 0.05},
            {"wheel_radius": 0.05, "wheel_radius_left": 0.05},
            {"wheel_radius": 0.05, "wheel_radius_right": 0.05, "wheel_radius_left": 0.05},
        ],
    )
    def test_any_other_way_to_give_radii_is_refused(self, robot, radii):
        with pytest.raises(PartError, match="either wheel_radius, or both"):
            robot(track=0.18, **radii)

    @pytest.mark.parametrize("wrong", [{"track": 0}, {"track": -0.18}, {"wheel_radius": 0}, {"width": 0.2}])
    def test_wrong_values_are_refused(self, robot, wrong):
        with pytest.raises(PartError, match=next(iter(wrong))):
            robot(**{"wheel_radius": 0.049, "track": 0.18, **wrong})

    def test_robots_are_immutable_and_hashable(self, robot):
        model = robot(wheel_radius=0.049, track=0.18)
        assert model == robot(wheel_radius=0.049, track=0.18)
        assert hash(model) == hash(robot(wheel_radius=0.049, track=0.18))
        with pytest.raises(ValidationError, match="frozen"):
            model.track = 0.2
