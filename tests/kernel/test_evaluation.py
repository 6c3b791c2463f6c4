"""The one scorer, against the NumPy oracle on a grid ten times finer than the samples."""

from __future__ import annotations

import numpy as np
import oracle
import pytest
from builders import ACCELERATION, BOX, RADIUS, SPEED, TRACK, problem_of, random_drive
from hypothesis import given
from hypothesis import strategies as st

from oed.kernel.criteria import E
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.robots.sensors import Displacements
from oed.robots.space import DesignSpace, StartPose

NOISE = {"position": 0.1, "heading": 0.2}
seeds = st.integers(0, 2**32 - 1)
PROBLEM = problem_of(measurement=Displacements(segments=4, regressor="both", noise=NOISE))


def margins(evaluation: Evaluation) -> dict[str, float]:
    return {margin.name: margin.margin for margin in evaluation.margins}


DENSE = 200
"""Times per period at which the oracle looks."""


def oracle_margins(problem: Problem, drive: Trajectory) -> dict[str, float]:
    """Distance to the speed limit, the acceleration limit and the box."""
    times = np.union1d(np.linspace(0, drive.duration, DENSE * drive.samples + 1), drive.knots)
    held = oracle.spline_values(drive, (np.arange(drive.samples) + 0.5) * drive.duration / drive.samples)
    twists = np.array([oracle.differential_twist(row, RADIUS, RADIUS, TRACK) for row in held])
    period = drive.duration / drive.samples
    path = oracle.fine_path(twists, drive.start, period, problem.design.integration, DENSE)
    return {
        "wheel_speed": 10 - np.abs(oracle.spline_values(drive, times)).max(),
        "wheel_acceleration": 20 - np.abs(oracle.spline_values(drive, times, order=1)).max(),
        "workspace": 1 - np.abs(path[:, :2]).max(),
    }


@pytest.mark.parametrize(
    ("rule", "degree"), [("arc", 1), ("midpoint", 2), ("arc", 3), ("midpoint", 3), ("arc", 5)]
)
@pytest.mark.parametrize("amplitude", [1.0, 30.0])
def test_margins_are_the_oracles(rule: str, degree: int, amplitude: float):
    spline = Spline(degree=degree, coefficients=9)
    problem = problem_of(samples=30, spline=spline, integration=rule)
    drive = random_drive(problem, degree, amplitude)
    found, expected = margins(evaluate(problem, drive)), oracle_margins(problem, drive)
    for name, value in expected.items():
        # Exact where limits are exceeded; inside, to a share of the distance.
        close = 1e-5 if value < 0 else 1e-5 + 1e-4 * value
        assert found[name] == pytest.approx(value, abs=close)


def test_margins_of_a_piecewise_constant_drive():
    problem = problem_of(spline=Spline(degree=0, coefficients=8))
    drive = random_drive(problem, 1)
    found = margins(evaluate(problem, drive))
    assert found["wheel_speed"] == pytest.approx(10 - np.abs(drive.coefficients).max())
    jumps = np.abs(np.diff(drive.coefficients, axis=0)).max() / 0.25
    # Rest is half a period away from the middle of the first and the last one.
    jumps = max(jumps, np.abs(drive.inputs[[0, -1]]).max() / 0.125)
    assert found["wheel_acceleration"] == pytest.approx(20 - jumps)


@given(seed=seeds, amplitude=st.floats(0.1, 40))
def test_feasible_means_that_no_violation_is_left(seed: int, amplitude: float):
    evaluation = evaluate(PROBLEM, random_drive(PROBLEM, seed, amplitude))
    exceeded = {m.name: -m.margin for m in evaluation.margins if -m.margin > 1e-3 * m.size}
    assert evaluation.violations == pytest.approx(exceeded)
    assert evaluation.feasible == (not exceeded)


@pytest.mark.parametrize(
    ("duration", "start", "rest", "violated"),
    [
        (10.0, (0, 0, 0), True, {}),
        (9.0, (0, 0, 0), True, {}),
        (12.0, (0, 0, 0), True, {"duration": 2.0}),
        (10.0, (0.1, 0, 0), True, {"start": 0.1}),
        (10.0, (0, 0, -0.2), True, {"start": 0.2}),
        (10.0, (0, 0, 0), False, {"rest_to_rest": 0.5}),
        (11.0, (0, -0.3, 0), False, {"duration": 1.0, "start": 0.3, "rest_to_rest": 0.5}),
    ],
)
def test_conditions_of_the_study_are_violations(duration, start, rest, violated):
    drive = Trajectory.from_samples(np.tile([0.5, 0.25], (40, 1)), duration, start, rest_to_rest=rest)
    assert evaluate(PROBLEM, drive).violations == pytest.approx(violated)


def test_conditions_that_a_study_does_not_set_are_not_judged():
    free = problem_of(design=DesignSpace(duration=10, samples=40, start="free", rest_to_rest=False))
    names = margins(evaluate(free, random_drive(free, 0)))
    assert set(names) == {"wheel_speed", "wheel_acceleration", "workspace", "duration"}
    assert set(margins(evaluate(PROBLEM, random_drive(PROBLEM, 0)))) == {*names, "start", "rest_to_rest"}


@given(seed=seeds)
def test_predicted_standard_deviations(seed: int):
    evaluation = evaluate(PROBLEM, random_drive(PROBLEM, seed))
    for block, names in {"heading": ("c11", "c12"), "position": ("c21", "c22")}.items():
        design = evaluation.design_matrices[block]
        expected = np.sqrt(np.diag(NOISE[block] ** 2 * np.linalg.inv(design.T @ design)))
        found = [evaluation.standard_deviations[name] for name in names]
        np.testing.assert_allclose(found, expected, rtol=1e-8)


@given(seed=seeds)
def test_numbers_follow_from_the_design_matrices(seed: int):
    evaluation = evaluate(PROBLEM, random_drive(PROBLEM, seed))
    designs = evaluation.design_matrices
    eigenvalues = np.concatenate([np.linalg.eigvalsh(design.T @ design) for design in designs.values()])
    singular = np.sort(np.sqrt(np.maximum(eigenvalues, 0)))[::-1]
    c11, c21 = RADIUS / TRACK, RADIUS / 2
    measured = np.concatenate([designs["heading"] @ [c11, -c11], designs["position"] @ [c21, c21]])
    assert evaluation.lambda_min == pytest.approx(eigenvalues.min(), rel=1e-9)
    assert evaluation.objective == evaluation.lambda_min
    assert evaluation.lambda_max == pytest.approx(eigenvalues.max(), rel=1e-12)
    np.testing.assert_allclose(evaluation.singular_values, singular, rtol=1e-6)
    assert evaluation.smallest_singular_value**2 == pytest.approx(evaluation.lambda_min, rel=1e-6)
    assert evaluation.condition_number == pytest.approx(singular[0] / singular[-1], rel=1e-6)
    assert evaluation.norm_y == pytest.approx(np.linalg.norm(measured), rel=1e-12)


def test_path_and_length():
    drive = random_drive(PROBLEM, 5)
    evaluation = evaluate(PROBLEM, drive)
    twists = np.array([oracle.differential_twist(row, RADIUS, RADIUS, TRACK) for row in drive.inputs])
    np.testing.assert_allclose(
        evaluation.path, oracle.fine_path(twists, drive.start, drive.period, "arc", 10), rtol=0, atol=1e-12
    )
    assert evaluation.states.shape == (41, 3)
    assert evaluation.path_length == pytest.approx(drive.period * np.abs(twists[:, 0]).sum(), abs=1e-7)


@pytest.mark.parametrize(
    "speeds", [(2.0, 2.0), (0.0, 0.0), (1.0, 0.0)], ids=["straight", "rest", "one wheel"]
)
@pytest.mark.parametrize("segments", [1, 4])
def test_a_design_that_cannot_tell_parameters_apart(speeds, segments: int):
    problem = problem_of(measurement=Displacements(segments=segments, noise={"position": 0.1}))
    evaluation = evaluate(problem, Trajectory.from_samples(np.tile(speeds, (40, 1)), 10.0, (0, 0, 0)))
    assert evaluation.lambda_min == pytest.approx(0, abs=1e-10)
    assert evaluation.condition_number > 1e12
    # c21 is still known where the right wheel alone turns.
    assert evaluation.standard_deviations["c22"] > 1e8
    assert (evaluation.standard_deviations["c21"] > 1e8) == (speeds != (1.0, 0.0))


def test_no_noise_no_standard_deviations():
    problem = problem_of()
    assert evaluate(problem, random_drive(problem, 0)).standard_deviations == {}


def test_relative_scaling_leaves_the_singular_values_raw():
    measurement = Displacements(segments=4, noise=NOISE)
    raw = problem_of(measurement=measurement)
    relative = problem_of(measurement=measurement, criterion=E(scaling="relative"))
    drive = random_drive(raw, 3)
    first, second = evaluate(raw, drive), evaluate(relative, drive)
    np.testing.assert_allclose(second.singular_values, first.singular_values, rtol=1e-14)
    factor = (RADIUS / 2 / NOISE["position"]) ** 2
    assert second.objective == pytest.approx(first.objective * factor, rel=1e-12)


@pytest.mark.parametrize("samples", [20, 80])
def test_a_drive_keeps_its_own_duration_and_samples(samples: int):
    drive = Trajectory.from_samples(np.full((samples, 2), 1.0), 5.0, (0, 0, 0), rest_to_rest=False)
    evaluation = evaluate(PROBLEM, drive)
    assert evaluation.states.shape == (samples + 1, 3)
    assert evaluation.states[-1, 0] == pytest.approx(5 * RADIUS)


@pytest.mark.parametrize("inputs", [1, 3])
def test_inputs_of_another_robot_are_refused(inputs: int):
    drive = Trajectory.from_samples(np.zeros((5, inputs)), 5.0, (0, 0, 0))
    with pytest.raises(ValueError, match=rf"expected 2 inputs \(wheel_speed_right, .*got {inputs}"):
        evaluate(PROBLEM, drive)


def test_a_start_in_the_box_matters_to_the_margin_only():
    centre = problem_of(limits=(SPEED, ACCELERATION, BOX))
    corner = problem_of(design=DesignSpace(duration=10, samples=40, start=StartPose(x=0.9, y=0.9)))
    drive = random_drive(centre, 2, 1.0)
    moved = Trajectory(drive.knots, drive.degree, drive.coefficients, (0.9, 0.9, 0.0), drive.samples)
    first, second = evaluate(centre, drive), evaluate(corner, moved)
    assert first.objective == pytest.approx(second.objective, rel=1e-9)
    assert margins(first)["workspace"] > margins(second)["workspace"]
