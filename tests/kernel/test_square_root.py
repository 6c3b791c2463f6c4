"""Information by its square root: against exact rational numbers, and what is identifiable."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from functools import cache

import casadi as ca
import numpy as np
import pytest
from builders import RADIUS, TRACK, driven_once, input_limits, problem_of
from hypothesis import given
from hypothesis import strategies as st
from places import PROBLEMS

from oed.kernel.criteria import A, Criterion, D, E, G, I, Leg, ModifiedE
from oed.kernel.dynamics.rollout import roll_out
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.identifiability import ambiguities, require_identifiable
from oed.kernel.measurement.matrices import eliminate
from oed.kernel.measurement.prior import Prior
from oed.kernel.measurement.square_root import SquareRoot, project_out, rounding_of
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.kernel.solution import Status
from oed.optimize import Genetic, Ipopt, solve
from oed.robots.models import Tricycle
from oed.robots.sensors import Displacements, Poses, YawRate
from oed.workflow.studies import load_study

seeds = st.integers(0, 2**32 - 1)
NOISE = {"position": 0.001, "heading": 0.01}
POSES = Poses(noise={"position": 0.01, "heading": 0.02}, every=10)
LEVER = {"x": 0.1, "y": 0.02, "known": False}

Exact = list[list[Fraction]]


def exact_information(rows: np.ndarray, kept: int) -> Exact:
    """J'J with all but the first columns eliminated one by one, without rounding."""
    table = [[Fraction(float(entry)) for entry in row] for row in rows]
    size = rows.shape[1]
    matrix = [[sum(row[i] * row[j] for row in table) for j in range(size)] for i in range(size)]
    for last in range(size - 1, kept - 1, -1):
        pivot = matrix[last][last]
        if pivot:
            for i in range(last):
                share = matrix[i][last] / pivot
                matrix[i] = [matrix[i][j] - share * matrix[last][j] for j in range(last)]
        matrix = [row[:last] for row in matrix[:last]]
    return matrix


def exact_inverse(matrix: Exact) -> Exact:
    """By Gauss and Jordan."""
    size = len(matrix)
    wide = [[*row, *(Fraction(int(i == j)) for j in range(size))] for i, row in enumerate(matrix)]
    for k in range(size):
        wide[k] = [entry / wide[k][k] for entry in wide[k]]
        for i in range(size):
            if i != k:
                wide[i] = [entry - wide[i][k] * own for entry, own in zip(wide[i], wide[k], strict=True)]
    return [row[size:] for row in wide]


def numbers(matrix: Exact) -> np.ndarray:
    return np.array([[float(entry) for entry in row] for row in matrix])


def jacobian_of(problem: Problem, drive: Trajectory) -> np.ndarray:
    """Derivatives of the whitened readings by parameters and nuisances."""
    inputs = ca.MX.sym("inputs", *drive.inputs.shape)
    start = ca.MX.sym("start", *drive.starts.shape)
    model = problem.system
    rolled = roll_out(
        model,
        inputs=inputs,
        start=start,
        parameters=ca.MX(ca.DM(model.nominal)),
        period=ca.MX(drive.period),
    )
    (one,) = problem.estimations(rolled)
    return np.array(ca.Function("J", [inputs, start], [one.block.jacobian])(drive.inputs, drive.starts))


def tricycle(**overrides) -> Problem:
    model = Tricycle(wheel_radius=0.1, wheelbase=0.4, steering_offset=0.03)
    return problem_of(
        **{
            "model": model,
            "measurement": Poses(noise=NOISE, lever_arm=LEVER),
            "criterion": E(),
            "limits": input_limits(model),
            **overrides,
        }
    )


def short_drive(length: float, steering: float) -> Trajectory:
    """A metre or less with the steering swinging once from side to side."""
    times = np.linspace(0, 1, 16)
    inputs = np.stack([np.full(16, length / 0.1), steering * np.sin(2 * np.pi * times)], axis=1)
    return Trajectory.from_samples(inputs, 1.0, (0.0, 0.0, 0.2), rest_to_rest=False)


class TestExactly:
    """Against rational numbers: nothing is squared, and no ridge added, on the way."""

    @pytest.mark.slow
    @pytest.mark.parametrize(("length", "steering"), [(0.2, 0.3), (0.02, 2e-4)])
    def test_a_short_drive_with_its_lever_arm_and_start_unknown(self, length: float, steering: float):
        problem, drive = tricycle(), short_drive(length, steering)
        information = exact_information(jacobian_of(problem, drive), 3)
        covariance = numbers(exact_inverse(information))
        found = evaluate(problem, drive)
        deviations = list(found.standard_deviations.values())
        np.testing.assert_allclose(deviations, np.sqrt(np.diag(covariance)), rtol=1e-8)
        np.testing.assert_allclose(found.full_information["joint"], numbers(information), rtol=1e-8)
        scales = np.array([0.1, 0.4, 0.03])
        relative = np.linalg.eigvalsh(numbers(information) * np.outer(scales, scales))
        assert found.lambda_max == pytest.approx(relative[-1], rel=1e-8)
        worst = np.linalg.eigvalsh(covariance / np.outer(scales, scales))[-1]
        assert found.objective == pytest.approx(1 / worst, rel=1e-8)

    @pytest.mark.parametrize(
        ("length", "steering", "tolerance"), [(0.02, 0.3, 1e-7), (0.02, 0.05, 1e-5), (0.02, 0.001, 0.05)]
    )
    def test_a_search_sees_it_as_well_as_squares_can(self, length: float, steering: float, tolerance: float):
        jacobian = jacobian_of(tricycle(), short_drive(length, steering))
        exact = numbers(exact_information(jacobian, 3))
        found = np.array(eliminate(ca.DM(jacobian.T @ jacobian), 3))
        np.testing.assert_allclose(found, exact, rtol=tolerance)

    @given(seed=seeds, kept=st.integers(1, 3), others=st.integers(1, 4), spread=st.sampled_from([0.0, 8.0]))
    def test_any_jacobian(self, seed: int, kept: int, others: int, spread: float):
        rng = np.random.default_rng(seed)
        rows = rng.normal(size=(8, kept + others)) * 10.0 ** rng.uniform(
            -spread / 2, spread / 2, kept + others
        )
        # Two nuisances a hundred thousandth apart.
        if others > 1:
            rows[:, -1] = rows[:, kept] * (1 + 1e-5 * rng.normal(size=8))
        left, rounding = project_out(rows, kept, rounding_of(rows))
        root = SquareRoot.of_rows(left, np.linalg.norm(rows[:, :kept], axis=0), rounding)
        information = exact_information(rows, kept)
        covariance = numbers(exact_inverse(information))
        sizes = np.sqrt(np.diag(numbers(information)))
        np.testing.assert_allclose(
            root.matrix / np.outer(sizes, sizes), numbers(information) / np.outer(sizes, sizes), atol=1e-8
        )
        np.testing.assert_allclose(np.diag(root.covariance), np.diag(covariance), rtol=1e-8)
        assert root.log_determinant == pytest.approx(-np.linalg.slogdet(covariance)[1], abs=1e-7)

    @pytest.mark.parametrize("estimate", [None, ("c21",)], ids=["both", "one known"])
    @pytest.mark.parametrize("estimator", ["gls", "ols"])
    def test_regressions_on_poses_that_segments_share(self, estimator: str, estimate):
        measurement = Displacements(
            segments=5, noise={"position": 0.02}, noise_model="absolute", estimator=estimator
        )
        problem = problem_of(measurement=measurement, criterion=E(), estimate=estimate)
        rng = np.random.default_rng(3)
        drive = Trajectory.from_samples(rng.uniform(-5, 5, (40, 2)), 10.0, (0, 0, 0), rest_to_rest=False)
        found = evaluate(problem, drive)
        W = found.design_matrices["position"][:, : len(estimate or "..")]
        # Increments of six poses, x and y by turns: v = D e.
        steps = np.eye(5, 6, 1) - np.eye(5, 6)
        noise = 0.02**2 * np.kron(steps @ steps.T, np.eye(2))
        if estimator == "gls":
            expected = np.linalg.inv(W.T @ np.linalg.solve(noise, W))
        else:
            inverse = np.linalg.inv(W.T @ W)
            expected = inverse @ W.T @ noise @ W @ inverse
        np.testing.assert_allclose(found.covariances["position"], expected, rtol=1e-9)


class TestTold:
    """What is identifiable does not depend on units, priors or what is asked of the rest."""

    @given(seed=seeds, size=st.integers(2, 5), rank=st.integers(1, 4))
    def test_ranks_in_any_units(self, seed: int, size: int, rank: int):
        rng = np.random.default_rng(seed)
        rows = rng.normal(size=(20, rank)) @ rng.normal(size=(rank, size)) * 10.0 ** rng.uniform(-9, 9, size)
        root = SquareRoot.of_rows(rows)
        assert np.count_nonzero(root.identifiable) == min(rank, size)
        assert root.scaled(10.0 ** rng.uniform(-9, 9, size)).complete == (rank >= size)

    def test_the_same_nuisance_twice_is_one_and_none_is_none(self):
        rng = np.random.default_rng(0)
        rows = rng.normal(size=(9, 4))
        once, _ = project_out(rows, 2, rounding_of(rows))
        more = np.hstack([rows, 1e6 * rows[:, 2:3], np.zeros((9, 1)), rows[:, 2:] @ [[1.0], [3.0]]])
        twice, _ = project_out(more, 2, rounding_of(more))
        np.testing.assert_allclose(twice, once, atol=1e-13)

    def test_variances_of_what_is_identifiable(self):
        root = SquareRoot.of_rows(np.array([[1.0, 2.0, 0.0], [2.0, 4.0, 0.0]]))
        combinations = np.array([[1.0, 2.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        assert root.variances(combinations) == pytest.approx([1 / 5, math.inf, math.inf])
        assert np.diag(root.covariance).tolist() == [math.inf] * 3
        assert (root.smallest, root.log_determinant) == (0.0, -math.inf)
        assert root.singular_values[1:].tolist() == [0.0, 0.0]

    def test_small_beside_large(self):
        # An eigenvalue 1e-20 times the largest one, exactly.
        rows = np.array([[1e10, 0.0], [1e10, 1.0]])
        root = SquareRoot.of_rows(rows)
        assert root.complete
        assert root.smallest == pytest.approx(0.5, rel=1e-9)


SPIN = Trajectory.from_samples(np.tile([4.0, -4.0], (40, 1)), 10.0, (0.0, 0.0, 0.0), rest_to_rest=False)
TURN, AHEAD = (Leg(inputs=(5, -5), duration=2),), (Leg(inputs=(5, 4), duration=2),)


def spun(criterion: Criterion, **parts) -> Evaluation:
    return evaluate(problem_of(**{"measurement": POSES, "criterion": criterion, **parts}), SPIN)


class TestASpin:
    """It tells how fast the robot turns, of three parameters one combination."""

    @pytest.mark.parametrize(
        "measurement", [POSES, Poses(noise=NOISE, lever_arm=LEVER)], ids=["", "lever arm"]
    )
    @pytest.mark.parametrize(
        "criterion",
        [
            E(),
            D(),
            A(),
            ModifiedE(),
            G(test_drive=AHEAD),
            I(test_drive=AHEAD),
            *(D(subset=(name,)) for name in ("track", "wheel_radius_right")),
        ],
        ids=lambda value: value.kind,
    )
    def test_every_criterion(self, criterion: Criterion, measurement: Poses):
        found = spun(criterion, measurement=measurement)
        assert found.objective == (0.0 if criterion.kind == "E" else -math.inf)
        assert (found.singular, found.identifiable) == (True, False)
        assert (found.lambda_min, found.condition_number) == (0.0, math.inf)
        assert found.log_determinant == -math.inf
        assert set(found.standard_deviations.values()) == {math.inf}

    @pytest.mark.parametrize("kind", [G, I])
    def test_predictions_that_need_no_more(self, kind):
        found = spun(kind(test_drive=TURN, quantity="heading"))
        # It turns as often as the radii's mean is of the track.
        assert (found.singular, found.identifiable) == (True, True)
        yaw = found.full_square_roots["joint"].variances(np.array([[0.5 / RADIUS, 0.5 / RADIUS, -1 / TRACK]]))
        turned = 2 * RADIUS * 5 * 2 / TRACK
        assert found.objective == pytest.approx(-(turned**2) * yaw[0], rel=1e-9)

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("kind", "search"),
        [(I, Ipopt(starts=1, perturbations=0)), (G, Genetic(population=20, generations=3))],
        ids=["gradients", "population"],
    )
    def test_a_search_for_them_keeps_it(self, kind, search):
        problem = problem_of(
            measurement=YawRate(noise=0.01, every=4),
            criterion=kind(test_drive=TURN, quantity="heading"),
            samples=20,
        )
        # On yaw rates alone no drive tells how large the robot is, which no prediction of headings needs.
        assert ambiguities(problem) == ()
        require_identifiable(problem)
        solution = solve(problem, search, seed=0, workers=1)
        assert solution.status.usable
        assert solution.evaluation.identifiable
        assert solution.evaluation.singular
        assert (
            solution.evaluation.objective
            > spun(problem.criterion, measurement=problem.measurement).objective * 10
        )

    def test_what_predictions_of_positions_need_is_still_asked_for(self):
        problem = problem_of(measurement=YawRate(noise=0.01), criterion=G(test_drive=AHEAD))
        assert [set(one.changes) for one in ambiguities(problem)] == [
            {"wheel_radius_right", "wheel_radius_left", "track"}
        ]


@pytest.mark.parametrize("criterion", [E(), D()], ids=["E", "D"])
@pytest.mark.parametrize("share", ["1e-6 %", "1e-3 %"])
def test_a_prior_however_good_makes_nothing_singular(criterion: Criterion, share: str):
    prior = Prior(standard_deviations={"track": share})
    problem = problem_of(measurement=POSES, criterion=criterion, prior=prior)
    rng = np.random.default_rng(1)
    drive = Trajectory.from_samples(rng.uniform(-5, 5, (40, 2)), 10.0, (0, 0, 0), rest_to_rest=False)
    found = evaluate(problem, drive)
    assert not found.singular
    expected = float(share.removesuffix(" %")) / 100 * TRACK
    assert found.standard_deviations["track"] == pytest.approx(expected, rel=1e-4)
    # As good as known: the radii are told as they are where it is.
    known = problem_of(
        measurement=POSES, criterion=criterion, estimate=("wheel_radius_right", "wheel_radius_left")
    )
    for name, deviation in evaluate(known, drive).standard_deviations.items():
        assert found.standard_deviations[name] == pytest.approx(deviation, rel=1e-4)
    if criterion.kind == "E":
        assert found.objective == pytest.approx(evaluate(known, drive).objective, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    "criterion", [E(scaling="none"), D(scaling="none"), A(scaling="none")], ids=lambda one: one.kind
)
def test_what_no_drive_tells_is_said_by_every_criterion(criterion: Criterion):
    # One coefficient: both segments turn alike.
    problem = problem_of(
        duration=4,
        samples=20,
        spline=Spline(degree=0, coefficients=1),
        rest_to_rest=False,
        measurement=Displacements(segments=2, regressor="heading"),
        criterion=criterion,
        limits=input_limits(problem_of().model),
    )
    solution = solve(problem, Ipopt(starts=2, perturbations=0), seed=0, workers=1)
    assert solution.status is Status.SINGULAR
    assert (solution.trajectory, solution.evaluation) == (None, None)
    assert solution.message.startswith(
        "No drive found makes all parameters identifiable that the criterion asks about"
    )


@cache
def shipped(name: str) -> Problem:
    return load_study(PROBLEMS / f"{name}.yaml").problem


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["omni_three", "mecanum"])
@pytest.mark.parametrize("path", ["straight", "sideways_straight", "sideways_square"])
def test_motions_that_cancel_to_rounding_tell_nothing(kind: str, path: str):
    """Robots that go sideways turn by some 1e-17 rad/s, for their wheels' speeds cancel to rounding."""
    problem = shipped(kind)
    score = evaluate(problem, driven_once(problem, path).trajectory)
    radius, other = score.standard_deviations.values()
    assert (score.objective, score.identifiable, other) == (0.0, False, np.inf)
    assert 0 < radius < 0.01


def test_a_wheel_that_stands_but_for_rounding_tells_nothing_although_the_others_are_known():
    problem = problem_of(
        measurement=Displacements(segments=4, noise={"position": 1e-3, "heading": 1e-2}),
        criterion=E(scaling="relative"),
        estimate=("c21",),
        rest_to_rest=False,
    )
    turning = problem.design.trajectory(np.tile([3.0, 1.0], (8, 1)), np.zeros(3))
    standing = replace(turning, coefficients=turning.coefficients * [1e-17, 1.0])
    assert evaluate(problem, turning).identifiable
    assert not evaluate(problem, standing).identifiable
    assert evaluate(problem, standing).standard_deviations["c21"] == np.inf


@pytest.mark.parametrize("noise_model", ["increments", "absolute"])
def test_displacements_that_cancel_to_rounding_tell_nothing(noise_model: str):
    """Twice once round the block: the displacements of both segments are sums that cancel."""
    measurement = Displacements(
        segments=2, regressor="position", noise={"position": 0.01, "heading": 0.01}, noise_model=noise_model
    )
    problem = problem_of(measurement=measurement, criterion=E(scaling="relative"))
    wheels = np.tile([[4.0, 4.0], [3.0, -3.0]] * 4, (10, 1))
    turn = np.pi / 2 * TRACK / (2 * RADIUS * 3.0)
    drives = [
        Trajectory.from_samples(wheels, 80 * turn, np.zeros(3), rest_to_rest=False),
        Trajectory.from_samples(wheels * [1.0, 1.001], 80 * turn, np.zeros(3), rest_to_rest=False),
    ]
    closed, open_ = (evaluate(problem, drive) for drive in drives)
    assert (closed.objective, closed.identifiable, closed.lambda_max) == (0.0, False, 0.0)
    assert open_.identifiable
    assert open_.objective > 0


@pytest.mark.slow
def test_a_faint_motion_is_none_that_cancels():
    problem = shipped("mecanum")
    sideways = driven_once(problem, "sideways_square")
    drive = sideways.trajectory
    # One wheel is faster by a billionth: the arm turns what the radius moves, less precisely by as much.
    faint = replace(drive, coefficients=drive.coefficients * (1 + 1e-9 * np.eye(4)[0]))
    score = evaluate(problem, faint)
    assert score.identifiable
    assert 0 < score.objective < 1e-10
