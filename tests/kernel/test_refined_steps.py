"""Finer steps of a numerical integration: the same system, closer to the solution."""

from __future__ import annotations

import cars
import casadi as ca
import numpy as np
import pytest
from builders import problem_of
from scipy.integrate import solve_ivp

import oed
from oed.kernel.cards import steps_text
from oed.kernel.dynamics.system import carrier, stepper
from oed.kernel.evaluation import AGREEMENT, FINEST, evaluate, resolved
from oed.kernel.scorer import score

LAGGING = oed.Unicycle(lag_v=0.15, lag_omega=0.25, body_radius=0.2)
CAR = oed.BicycleDynamic(**cars.CAR, substeps=1)
RATE = oed.Equations(
    states={"x": "mol"},
    derivatives={"x": "-k * x^2 + u"},
    inputs={"u": "mol/s"},
    parameters={"k": "0.7 1/s/mol"},
    outputs={"y": "x"},
    substeps=1,
)
SYSTEMS = {
    "lagging": (LAGGING, [0.1, -0.2, 0.3, 0.4, 0.5], [0.6, 1.2]),
    "car": (CAR, [0.1, -0.2, 0.3, 0.9, 0.1, 0.4], [0.5, 0.2]),
    "equations": (RATE, [0.8], [0.3]),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_period_is_as_many_shorter_ones(name: str):
    system, state, inputs = SYSTEMS[name]
    state = state[: len(system.states)]
    expected = state
    for _ in range(6):
        expected = stepper(system)(expected, inputs, system.nominal, 0.4 / 6)
    finer = system.refined(2).refined(3)
    assert finer.refinement == (system, 6)
    np.testing.assert_allclose(stepper(finer)(state, inputs, system.nominal, 0.4), expected, rtol=1e-13)
    # As searches write it, step after step.
    written = ca.DM(finer.step(ca.SX(state), ca.SX(inputs), ca.SX(finer.nominal), ca.SX(0.4)))
    np.testing.assert_allclose(written, expected, rtol=1e-12)


@pytest.mark.parametrize("name", SYSTEMS)
def test_sensitivities_are_derivatives_of_the_finer_steps(name: str):
    system, state, inputs = SYSTEMS[name]
    finer, state = system.refined(5), np.array(state[: len(system.states)])
    nominal, states = np.array(system.nominal), len(system.states)
    before = np.hstack([np.zeros((states, len(nominal))), np.eye(states)])
    carried = np.array(carrier(finer)(before, state, inputs, nominal, 0.4))
    values, every = np.concatenate([nominal, state]), []
    for place in range(len(values)):
        ends = []
        for side in (-1e-6, 1e-6):
            moved = values + side * (np.arange(len(values)) == place)
            ends.append(
                np.array(stepper(finer)(moved[len(nominal) :], inputs, moved[: len(nominal)], 0.4)).ravel()
            )
        every.append((ends[1] - ends[0]) / 2e-6)
    np.testing.assert_allclose(carried, np.array(every).T, rtol=1e-5, atol=1e-7)


def test_functions_of_finer_steps_are_no_larger():
    small, large = (stepper(CAR.refined(times)).n_instructions() for times in (4, 64))
    assert large == small


def commands(count: int, duration: float) -> np.ndarray:
    times = (np.arange(count) + 0.5) * duration / count
    return np.column_stack([0.4 * np.cos(2.3 * times), 1.5 * np.cos(1.7 * times)])


def lagging_path(drive: oed.Trajectory) -> np.ndarray:
    """Positions (n, 2) of a lagging robot by SciPy: places, heading, speed and yaw rate follow commands."""
    state, seen = np.zeros(5), [np.zeros(2)]
    for speed, turn in drive.inputs:

        def slope(_: float, now: np.ndarray, asked: tuple[float, float] = (speed, turn)) -> list[float]:
            return [
                now[3] * np.cos(now[2]),
                now[3] * np.sin(now[2]),
                now[4],
                (asked[0] - now[3]) / 0.15,
                (asked[1] - now[4]) / 0.25,
            ]

        times = np.linspace(0, drive.period, 41)
        found = solve_ivp(slope, (0, drive.period), state, t_eval=times, rtol=1e-10, atol=1e-12)
        state = found.y[:, -1]
        seen += list(found.y[:2, 1:].T)
    return np.array(seen)


def lagging_study(half: float) -> oed.Problem:
    return problem_of(
        model=LAGGING,
        measurement=oed.Poses(noise={"position": 0.005, "heading": 0.01}, initial_pose="known"),
        limits=(
            oed.CommandedSpeed(bounds=0.5),
            oed.CommandedYawRate(bounds=2.0),
            oed.Rectangle(x=(-half, half), y=(-half, half)),
        ),
        criterion=oed.D(),
        duration=8.0,
        samples=12,
        rest_to_rest=False,
    )


def margin_of(evaluation: oed.Evaluation) -> float:
    return next(one.margin for one in evaluation.margins if one.name == "workspace")


@pytest.mark.slow
def test_limits_of_a_lagging_robot_are_those_of_its_exact_path():
    drive = oed.Trajectory.from_samples(commands(12, 8.0), 8.0, np.zeros(5), rest_to_rest=False)
    farthest = np.abs(lagging_path(drive)).max()
    problem = lagging_study(1.0)
    room = 1.0 - 0.2 - farthest
    assert abs(margin_of(score(problem, drive)) - room) > 0.002
    assert margin_of(evaluate(problem, drive)) == pytest.approx(room, abs=3e-4)


@pytest.mark.slow
def test_a_wall_that_coarse_steps_miss_is_exceeded():
    """A room in which the drive ends by the study's steps, and that it leaves by exact ones."""
    drive = oed.Trajectory.from_samples(commands(12, 8.0), 8.0, np.zeros(5), rest_to_rest=False)
    farthest = np.abs(lagging_path(drive)).max()
    coarse = 1.0 - 0.2 - margin_of(score(lagging_study(1.0), drive))
    assert coarse < farthest
    problem = lagging_study(0.2 + (coarse + farthest) / 2)
    assert score(problem, drive).feasible
    assert not evaluate(problem, drive).feasible


@pytest.mark.slow
def test_standard_errors_and_limits_of_a_car_are_those_of_an_exact_integration():
    problem = problem_of(
        model=CAR,
        measurement=oed.Poses(noise={"position": 0.01, "heading": 0.02}, initial_pose="known"),
        limits=(
            oed.Throttle(bounds=1.0),
            oed.SteeringAngle(bounds="25 deg"),
            oed.Rectangle(x=(-3, 3), y=(-3, 3)),
        ),
        criterion=oed.D(),
        estimate=("drive_gain", "viscous_drag"),
        duration=6.0,
        samples=12,
        rest_to_rest=False,
    )
    times = (np.arange(12) + 0.5) * 0.5
    held = np.column_stack([0.5 * np.sin(0.9 * times) + 0.2, 0.35 * np.sin(2.5 * times)])
    drive = oed.Trajectory.from_samples(held, 6.0, np.zeros(6), rest_to_rest=False)

    def poses(**changed: float) -> np.ndarray:
        state, seen = np.zeros(6), []
        for inputs in drive.inputs:
            state = cars.rosenbrock(state, inputs, drive.period, {**cars.CAR, **changed}, 250)
            seen.append(state[:3])
        return np.array(seen)

    whitened = []
    for name in ("drive_gain", "viscous_drag"):
        step = 1e-4 * cars.CAR[name]
        ends = [poses(**{name: cars.CAR[name] + side * step}) for side in (-1, 1)]
        whitened.append(((ends[1] - ends[0]) / (2 * step) / [0.01, 0.01, 0.02]).ravel())
    expected = np.sqrt(np.diag(np.linalg.inv(np.array(whitened) @ np.array(whitened).T)))
    coarse, found = score(problem, drive), evaluate(problem, drive)
    assert abs(coarse.standard_deviations["viscous_drag"] / expected[1] - 1) > AGREEMENT
    np.testing.assert_allclose(list(found.standard_deviations.values()), expected, rtol=2e-3)
    np.testing.assert_allclose(found.states[1:, :3], poses(), atol=2e-4)
    assert found.steps.settled
    assert found.steps.enough > 1
    assert "coarse" in steps_text(found.steps)
    assert score(resolved(problem, drive), drive).objective == found.objective


def test_steps_that_are_fine_enough_are_not_spoken_of():
    drive = oed.Trajectory.from_samples(commands(12, 1.0), 1.0, np.zeros(5), rest_to_rest=False)
    found = evaluate(lagging_study(1.0), drive)
    assert found.steps.settled
    assert found.steps.enough == 1
    assert steps_text(found.steps) == ""


def test_a_robot_that_follows_at_once_has_no_steps():
    problem = problem_of()
    assert problem.refined(8) is problem
    assert not problem.system.integrates


def test_a_system_that_no_steps_resolve_is_said_to_be_unsettled():
    swinging = oed.parse_study(
        """format: 1
name: Swing
system:
  kind: equations
  states: {place: 1 m, speed: 0 m/s}
  parameters: {stiff: 2.25e4 1/s^2}
  derivatives: {place: speed, speed: -stiff * place}
  outputs: {seen: place}
  substeps: 1
experiment: {duration: 4 s, samples: 4}
measurement: {kind: outputs, noise: {seen: 1 mm}}
"""
    ).problem
    steps = evaluate(swinging, swinging.design.only).steps
    assert not steps.settled
    assert steps.times == FINEST
    assert "still change" in steps_text(steps)
