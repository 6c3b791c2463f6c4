"""Closed forms of robots that also move sideways, one measurement per sample.

With w the wheel speeds of a sample, R the rotation of its displacement, T its period, the position rows are
T R (I2 x w'), so that W'W = T^2 I2 x sum w w' whatever the heading: lambda_min(W'W) is T^2 times that of
sum w w', at most T^2 N wmax^2, reached by wheel speeds at their limits that are uncorrelated over time. With
exact arcs every sample counts sinc(T Omega / 2)^2 times.

Of wheel radius r and distance a (half wheelbase plus half track, or centre distance), relative to their
nominal values: r scales displacements and turns, a divides turns. With P = sum |d|^2 / sigma_p^2 and
H = sum dtheta^2 / sigma_h^2 the information is [[P + H, -H], [-H, H]], so that
lambda_min = P / 2 + H - sqrt(P^2 / 4 + H^2).
"""

from __future__ import annotations

from functools import partial

import numpy as np
import oracle
import pytest
from builders import ACCELERATION, SPEED, problem_of, random_drive
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_robots import EXAMPLES, Example
from scipy.linalg import hadamard

import oed
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.results import Evaluation
from oed.robots.sensors import Displacements

SAMPLES, PERIOD, TOP = 24, 0.1, 10.0
NOISE = {"position": 2e-3, "heading": 0.01}

ALIKE = [EXAMPLES["mecanum"][0], EXAMPLES["omni_three"][0]]
"""Whose wheels are all of one size."""
sideways = pytest.mark.parametrize(
    "example",
    [
        pytest.param(one, id=one.name, marks=() if one in ALIKE else pytest.mark.slow)
        for one in (*EXAMPLES["mecanum"], *EXAMPLES["omni_three"])
    ],
)
alike = pytest.mark.parametrize("example", ALIKE, ids=lambda example: example.name)
rules = pytest.mark.parametrize("rule", ["arc", "midpoint"])
seeds = st.integers(0, 2**32 - 1)


sideways_problem = partial(
    problem_of,
    period=PERIOD,
    samples=SAMPLES,
    integration="midpoint",
    rest_to_rest=False,
    start="free",
    limits=(SPEED,),
    measurement=Displacements(segments="samples", regressor="both", noise=NOISE),
)


def driven(problem: oed.Problem, speeds: np.ndarray) -> Evaluation:
    drive = Trajectory.from_samples(speeds, SAMPLES * PERIOD, (0.3, -0.2, 0.7), rest_to_rest=False)
    return evaluate(problem, drive)


def random_speeds(example: Example, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-TOP, TOP, (SAMPLES, len(example.model.inputs)))


def squares(example: Example, speeds: np.ndarray, rule: str) -> np.ndarray:
    """T^2 sum w w', with arcs each sample's share of it."""
    turns = PERIOD * np.array([example.twist(row)[2] for row in speeds])
    shares = np.sinc(turns / (2 * np.pi)) ** 2 if rule == "arc" else np.ones(SAMPLES)
    return PERIOD**2 * (speeds * shares[:, None]).T @ speeds


@sideways
@rules
@settings(max_examples=4)
@given(seed=seeds)
@pytest.mark.slow
def test_information_on_coefficients(example: Example, rule: str, seed: int):
    speeds = random_speeds(example, seed)
    found = driven(sideways_problem(model=example.model, integration=rule), speeds)
    expected = squares(example, speeds, rule)
    position, heading = (found.design_matrices[name] for name in ("position", "heading"))
    np.testing.assert_allclose(position.T @ position, np.kron(np.eye(2), expected), rtol=0, atol=1e-10)
    np.testing.assert_allclose(heading.T @ heading, squares(example, speeds, "midpoint"), rtol=0, atol=1e-10)
    smallest = np.linalg.eigvalsh(expected)[0]
    assert np.linalg.eigvalsh(position.T @ position)[0] == pytest.approx(smallest, rel=1e-9)


@sideways
def test_uncorrelated_wheels_at_full_speed_reach_the_cap(example: Example):
    columns = slice(1, 1 + len(example.model.inputs))
    speeds = TOP * np.tile(hadamard(8)[:, columns], (SAMPLES // 8, 1)).astype(float)
    problem = sideways_problem(model=example.model, measurement=Displacements(segments="samples"))
    cap = PERIOD**2 * SAMPLES * TOP**2
    assert driven(problem, speeds).objective == pytest.approx(cap, rel=1e-12)
    assert oed.bound(problem).upper_bound == pytest.approx(cap, rel=1e-6)


@alike
@rules
@settings(max_examples=8)
@given(seed=seeds)
@pytest.mark.slow
def test_no_drive_is_above_the_cap(example: Example, rule: str, seed: int):
    problem = sideways_problem(
        model=example.model, integration=rule, measurement=Displacements(segments="samples")
    )
    assert driven(problem, random_speeds(example, seed)).objective <= PERIOD**2 * SAMPLES * TOP**2


@alike
@settings(max_examples=8)
@given(seed=seeds)
@pytest.mark.slow
def test_information_on_radius_and_distance(example: Example, seed: int):
    speeds, model = random_speeds(example, seed), example.model
    found = driven(sideways_problem(model=example.model), speeds).design_matrices
    by_coefficients = {name: found[name].T @ found[name] / NOISE[name] ** 2 for name in found}

    def coefficients(values: np.ndarray) -> np.ndarray:
        return np.array(model.coefficients(values)).ravel()

    nominal = np.array(model.nominal)
    slopes = oracle.central_difference(coefficients, nominal) * nominal
    wheels = len(model.inputs)
    relative = (
        slopes[:wheels].T @ by_coefficients["heading"] @ slopes[:wheels]
        + slopes[wheels:].T @ by_coefficients["position"] @ slopes[wheels:]
    )
    twists = np.array([example.twist(row) for row in speeds])
    moved = PERIOD**2 * (twists[:, :2] ** 2).sum() / NOISE["position"] ** 2
    turned = PERIOD**2 * (twists[:, 2] ** 2).sum() / NOISE["heading"] ** 2
    expected = np.array([[moved + turned, -turned], [-turned, turned]])
    np.testing.assert_allclose(relative, expected, rtol=1e-7)
    closed = moved / 2 + turned - np.sqrt(moved**2 / 4 + turned**2)
    assert np.linalg.eigvalsh(relative)[0] == pytest.approx(closed, rel=1e-6)


@sideways
def test_the_wheels_that_do_not_move_it_tell_nothing_of_its_motion(example: Example):
    # Four mecanum wheels have one way to turn against each other: y = W c is the same, W'W is not.
    speeds = random_speeds(example, 1)
    matrix = np.array(example.model.coefficients(example.model.nominal))
    idle = np.linalg.svd(matrix)[2][np.linalg.matrix_rank(matrix) :]
    assert len(idle) == len(example.model.inputs) - 3
    for direction in idle:
        same, other = (
            driven(sideways_problem(model=example.model), speeds),
            driven(sideways_problem(model=example.model), speeds + 3 * direction),
        )
        np.testing.assert_allclose(same.states, other.states, atol=1e-12)
        assert not np.allclose(same.information["heading"], other.information["heading"])


@sideways
def test_random_drives_keep_their_closed_form_under_limits(example: Example):
    problem = sideways_problem(
        model=example.model, limits=(SPEED, ACCELERATION), measurement=Displacements(segments="samples")
    )
    drive = random_drive(problem, 4)
    expected = np.linalg.eigvalsh(PERIOD**2 * drive.inputs.T @ drive.inputs)[0]
    assert evaluate(problem, drive).objective == pytest.approx(expected, rel=1e-9)
