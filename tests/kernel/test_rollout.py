"""The drive as expressions, against the NumPy roll-out."""

from __future__ import annotations

from dataclasses import fields
from functools import cache

import casadi as ca
import numpy as np
import oracle
import pytest
from sample_robots import PLANAR, ROBOTS, Example, cases, draw_inputs

from oed.kernel.dynamics.rollout import FINE, Drive, drive_shape, roll_out
from oed.kernel.dynamics.system import mover, stepper
from oed.robots.models import Unicycle
from oed.robots.models.model import CoefficientRobot

SAMPLES, PERIOD, START = 13, 0.17, np.array([0.3, -0.4, 0.5])
FIELDS = ("effective_inputs", "twist", "gain", "direction", "poses", "path")

robots = pytest.mark.parametrize("example", cases(PLANAR))
rules = pytest.mark.parametrize("rule", ["arc", "midpoint"])


def held_inputs(example: Example) -> np.ndarray:
    inputs = draw_inputs(np.random.default_rng(7), SAMPLES, example.model)
    inputs[4] = 0.0
    return inputs


def symbolic_drive(example: Example, rule: str, kind: type, refine: int) -> tuple[Drive, ca.Function]:
    inputs = kind.sym("inputs", SAMPLES, len(example.model.inputs))
    start, period = kind.sym("start", 3), kind.sym("period")
    drive = roll_out(
        example.model.system(rule),
        inputs=inputs,
        start=start,
        parameters=kind(ca.DM(example.model.nominal)),
        period=period,
        input_values=inputs,
        input_rates=inputs,
        refine=refine,
    )
    outputs = [getattr(drive, name) for name in FIELDS] + [drive.path_length()]
    return drive, ca.Function("drive", [inputs, start, period], outputs)


@cache
def numeric_drive(example: Example, rule: str, kind: type = ca.MX, refine: int = FINE) -> dict:
    _, function = symbolic_drive(example, rule, kind, refine)
    results = [np.array(value) for value in function(held_inputs(example), START, PERIOD)]
    return dict(zip((*FIELDS, "path_length"), results, strict=True))


@robots
@rules
def test_poses_path_and_chords_are_the_oracles(example: Example, rule: str):
    found = numeric_drive(example, rule)
    twists = np.array([example.twist(row) for row in held_inputs(example)])
    poses = oracle.roll_out(twists, START, PERIOD, rule)
    path = oracle.fine_path(twists, START, PERIOD, rule, FINE)
    np.testing.assert_allclose(found["poses"], poses, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["path"], path, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["twist"], twists, rtol=0, atol=1e-13)
    # Chords are the displacements.
    for pose, twist, gain, direction in zip(
        found["poses"], found["twist"], found["gain"].ravel(), found["direction"].ravel(), strict=False
    ):
        ahead, _ = oracle.DISPLACEMENTS[rule](pose[2], twist[2], PERIOD)
        chord = gain * np.array([np.cos(direction), np.sin(direction)])
        np.testing.assert_allclose(chord, ahead, rtol=0, atol=1e-13)


@robots
def test_effective_inputs_and_the_sum_of_speeds(example: Example):
    found = numeric_drive(example, "arc")
    expected = [example.effective(row) for row in held_inputs(example)]
    np.testing.assert_allclose(found["effective_inputs"], expected, rtol=1e-13)
    twists = np.array([example.twist(row) for row in held_inputs(example)])
    length = PERIOD * np.hypot(twists[:, 0], twists[:, 1]).sum()
    assert found["path_length"].item() == pytest.approx(length, abs=1e-7)


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("example", [one for one in ROBOTS if one.mean is not None], ids=lambda one: one.name)
def test_limits_on_motion_see_what_a_robot_that_lags_does(example: Example, given: bool):
    inputs = held_inputs(example)
    drive = roll_out(
        example.model,
        inputs=ca.DM(inputs),
        start=ca.DM([*START, *np.zeros(len(example.model.states) - len(START))]),
        parameters=ca.DM(example.model.nominal),
        period=ca.DM(PERIOD),
        motion_inputs=ca.DM(inputs) if given else None,
    )
    asked = np.array([example.twist(row) for row in inputs])
    states, parameters = np.array(drive.poses), np.array(example.model.nominal)
    actual = [
        example.mean(state, twist, 0.0, parameters)
        for side in (states[:-1], states[1:])
        for state, twist in zip(side, asked, strict=True)
    ]
    np.testing.assert_allclose(np.array(drive.motion), actual, rtol=0, atol=1e-12)
    made = [example.moved(state, row, PERIOD) for state, row in zip(states, inputs, strict=False)]
    np.testing.assert_allclose(np.array(drive.twist), made, rtol=0, atol=1e-9)
    turns = PERIOD * np.array(drive.twist)[:, 2]
    np.testing.assert_allclose(np.diff(states[:, 2]), turns, rtol=0, atol=1e-13)
    # It never turns faster than it is asked to.
    yaw_rates = states[:, example.model.states.index("yaw_rate")]
    assert np.abs(yaw_rates).max() <= np.abs(asked[:, 2]).max()


@pytest.mark.parametrize("refine", [1, 3])
def test_motion_that_lags_is_taken_at_all_points_of_every_run(refine: int):
    """At the begins of all periods, at their ends, then at the points between."""
    system, runs, count = Unicycle(lag_v=0.15, lag_omega=0.25), 2, 4
    rng = np.random.default_rng(0)
    inputs = rng.uniform(-0.5, 0.5, (runs * count, 2))
    starts = rng.uniform(-0.3, 0.3, (runs, len(system.states)))
    parameters, step, move = ca.DM(system.nominal), stepper(system), mover(system)
    expected: dict[int, list[np.ndarray]] = {point: [] for point in (0, refine, *range(1, refine))}
    for start, held in zip(starts, np.split(inputs, runs), strict=True):
        state = ca.DM(start)
        for asked in held:
            for point, rows in expected.items():
                reached = step(state, asked, parameters, PERIOD * point / refine) if point else state
                rows.append(np.array(move(reached, asked, parameters)).ravel())
            state = step(state, asked, parameters, PERIOD)
    drive = roll_out(
        system,
        inputs=ca.DM(inputs),
        start=ca.DM(starts),
        parameters=parameters,
        period=ca.DM(PERIOD),
        refine=refine,
        runs=runs,
    )
    np.testing.assert_allclose(np.array(drive.motion), np.concatenate(list(expected.values())), atol=1e-12)


@robots
def test_unrefined_path_is_the_poses(example: Example):
    found = numeric_drive(example, "arc", refine=1)
    np.testing.assert_array_equal(found["path"], found["poses"])


@robots
def test_unrolled_and_compact_expressions_agree(example: Example):
    # Of the other rule their sensitivities do, below.
    unrolled, compact = numeric_drive(example, "arc", ca.SX), numeric_drive(example, "arc")
    for name in unrolled:
        np.testing.assert_allclose(unrolled[name], compact[name], rtol=0, atol=1e-13)


@pytest.mark.parametrize("softening", [1e-9, 1e-3, 0.1])
def test_softened_length_is_a_lower_bound_within_the_softening(softening: float):
    example = ROBOTS[0]
    drive, _ = symbolic_drive(example, "arc", ca.SX, 1)
    length = ca.Function(
        "length", [drive.inputs], [ca.substitute(drive.path_length(softening), drive.period, PERIOD)]
    )
    inputs = held_inputs(example)
    exact = PERIOD * sum(abs(example.twist(row)[0]) for row in inputs)
    found = float(length(inputs))
    assert exact - softening * PERIOD * SAMPLES - 1e-12 <= found <= exact + 1e-12
    assert float(length(np.zeros_like(inputs))) == 0


def sensitivities(model, rule: str, inputs: np.ndarray, kind: type = ca.MX) -> tuple[ca.Function, np.ndarray]:
    """The poses (states, N + 1) as a function of (parameters, start), and their derivatives by the package,
    (N + 1, states, p + states).
    """
    parameters, start = kind.sym("p", len(model.parameters)), kind.sym("start", len(model.states))
    held = kind(ca.DM(inputs))
    drive = roll_out(
        model.system(rule),
        inputs=held,
        start=start,
        parameters=parameters,
        period=kind(PERIOD),
        input_values=held,
        input_rates=held,
    )
    function = ca.Function("poses", [parameters, start], [drive.poses, drive.sensitivities])
    found = np.array(function(model.nominal, START)[1])
    width = len(model.parameters) + len(model.states)
    return function, found.reshape(len(model.states), len(inputs) + 1, width).swapaxes(0, 1)


@cache
def held_sensitivities(example: Example, rule: str, kind: type, seen: str) -> tuple[ca.Function, np.ndarray]:
    """The same of a robot's usual drive, by its constants or its coefficients."""
    model = example.model if seen == "constants" else CoefficientRobot(base=example.model)
    return sensitivities(model, rule, held_inputs(example), kind)


@robots
@rules
@pytest.mark.parametrize("seen", ["constants", "coefficients"])
def test_sensitivities_are_the_derivatives_of_the_poses(example: Example, rule: str, seen: str):
    if seen == "coefficients" and not example.model.coefficient_names:
        pytest.skip("a robot without coefficients")
    function, found = held_sensitivities(example, rule, ca.MX, seen)
    model = example.model if seen == "constants" else CoefficientRobot(base=example.model)
    size = len(model.parameters)

    def poses(point: np.ndarray) -> np.ndarray:
        return np.array(function(point[:size], point[size:])[0])

    expected = oracle.central_difference(poses, np.array([*model.nominal, *START]))
    expected = expected.reshape(found.shape)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7)


@robots
@rules
def test_the_start_shifts_and_turns_all_poses(example: Example, rule: str):
    # d(x, y)/d(th0) = (-(y - y0), x - x0).
    function, found = held_sensitivities(example, rule, ca.MX, "constants")
    poses = np.array(function(example.model.nominal, START)[0])
    by_start = found[:, :, len(example.model.parameters) :]
    expected = np.tile(np.eye(3), (SAMPLES + 1, 1, 1))
    expected[:, 0, 2], expected[:, 1, 2] = -(poses[:, 1] - START[1]), poses[:, 0] - START[0]
    np.testing.assert_allclose(by_start, expected, rtol=0, atol=1e-12)


@robots
@rules
def test_unrolled_and_compact_sensitivities_agree(example: Example, rule: str):
    unrolled, compact = (held_sensitivities(example, rule, kind, "constants")[1] for kind in (ca.SX, ca.MX))
    np.testing.assert_allclose(unrolled, compact, rtol=0, atol=1e-11)


@rules
def test_sensitivities_at_rest_are_finite(rule: str):
    example = ROBOTS[0]
    _, found = sensitivities(example.model, rule, np.zeros((SAMPLES, 2)))
    assert not found[:, :, : len(example.model.parameters)].any()


@pytest.mark.parametrize("example", cases(ROBOTS))
def test_the_shape_of_a_drive_is_that_of_any_drive(example: Example):
    # Of one run or of two, by turns: a robot knows nothing of runs.
    model, runs = example.model, 1 + ROBOTS.index(example) % 2
    count = 6 * runs
    shape = drive_shape(model, samples=6, runs=runs, period=PERIOD)
    drive = roll_out(
        model,
        inputs=ca.MX.sym("inputs", count, len(model.inputs)),
        start=ca.MX.sym("start", runs, len(model.states)),
        parameters=ca.MX(ca.DM(model.nominal)),
        period=ca.MX(PERIOD),
        runs=runs,
    )
    names = [entry.name for entry in fields(drive) if isinstance(getattr(drive, entry.name), ca.MX)]
    assert len(names) == 9
    assert {name: one.shape for name, one in shape.signals.items()} == {
        name: one.shape for name, one in drive.signals.items()
    }
    for name in (*names, "sensitivities"):
        assert getattr(shape, name).shape == getattr(drive, name).shape, name


def test_asked_for_what_it_has_not_a_drive_names_what_it_has():
    shape = drive_shape(ROBOTS[0].model, samples=2, runs=1, period=PERIOD)
    known = ", ".join([*shape.signals, *shape.system.renamed])
    assert "twist" in known
    with pytest.raises(AttributeError, match=f"no attribute 'poise'; its signals are {known}$"):
        shape.poise  # noqa: B018
