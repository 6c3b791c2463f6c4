"""Criteria of some parameters or of predictions: the derivatives behind G and I, and subsets (D_s)."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import oracle
import pytest
from builders import problem_of, random_drive
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_robots import PLANAR, ROBOTS, Example, cases, draw_inputs, motion_by_parameters

import oed
from oed.foundation.errors import PartError, ProblemError
from oed.kernel.criteria import A, D, E, G, I, Leg, Subject, TaskDrive
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.optimize.transcription.design import DesignExpressions
from oed.robots.models import Model
from oed.robots.sensors import AbsoluteNoise, Displacements, LeverArm, Poses

robots = pytest.mark.parametrize("example", cases(PLANAR))
quantities = pytest.mark.parametrize("quantity", ["position", "heading"])
predictions = pytest.mark.parametrize("kind", [G, I])
seeds = st.integers(0, 2**32 - 1)

POSES = Poses(noise=AbsoluteNoise(position=0.01, heading=0.02), every=10)
GEOMETRY = ("wheel_radius_right", "wheel_radius_left", "track")
LEGS = (Leg(inputs=(5, 4), duration=2), Leg(inputs=(-3, 6), duration=1.5))


def twist_of(model: Model, inputs: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """The twist at other parameters than the nominal ones; of most robots by the package."""
    alike = [one for one in ROBOTS if one.model.kind == model.kind]
    example = next((one for one in alike if one.model == model), alike[0])
    return motion_by_parameters(example)(inputs, parameters)


def predicted(model: Model, legs: tuple[Leg, ...], parameters: np.ndarray) -> np.ndarray:
    """Poses (legs, 3) at the legs' ends, from the origin."""
    pose, poses = np.zeros(3), []
    for leg in legs:
        pose = oracle.advance(pose, twist_of(model, np.array(leg.inputs), parameters), leg.duration, "arc")
        poses.append(pose)
    return np.array(poses)


def expected_rows(model: Model, legs: tuple[Leg, ...], quantity: str) -> np.ndarray:
    """Derivatives (legs, coordinates, parameters) by central differences."""
    columns = slice(0, 2) if quantity == "position" else slice(2, 3)
    flat = oracle.central_difference(
        lambda p: predicted(model, legs, p)[:, columns], np.array(model.nominal, dtype=float)
    )
    return flat.reshape(len(legs), -1, len(model.nominal))


def subject_of(model: Model, scales: np.ndarray, names: tuple[str, ...] | None = None) -> Subject:
    every = tuple(parameter.name for parameter in model.parameters)
    return Subject(system=model, parameters=(names or every,), scales=(scales,))


def random_legs(seed: int, count: int, model: Model | None = None) -> tuple[Leg, ...]:
    rng = np.random.default_rng(seed)
    inputs, durations = draw_inputs(rng, count, model), rng.uniform(0.1, 3.0, count)
    return tuple(
        Leg(inputs=tuple(row), duration=duration) for row, duration in zip(inputs, durations, strict=True)
    )


class TestRows:
    """The predictions' derivatives by the scaled parameters."""

    @robots
    @quantities
    @settings(max_examples=3)
    @given(seed=seeds, count=st.integers(1, 4))
    @pytest.mark.slow
    def test_rows_are_the_derivatives_of_the_poses(self, example: Example, quantity: str, seed: int, count):
        model = example.model
        legs = random_legs(seed, count, model)
        scales = np.random.default_rng(seed).uniform(0.1, 2, len(model.parameters))
        criterion = G(test_drive=legs, quantity=quantity).about(subject_of(model, scales))
        expected = expected_rows(model, legs, quantity) * scales
        np.testing.assert_allclose(criterion.rows[0], expected, rtol=1e-6, atol=1e-6)

    @quantities
    @pytest.mark.parametrize("inputs", [(5, 5), (5, -5), (0, 0)], ids=["straight", "spin", "rest"])
    def test_special_legs(self, quantity: str, inputs: tuple[float, float]):
        legs, model = (LEGS[0], Leg(inputs=inputs, duration=3), LEGS[1]), ROBOTS[0].model
        criterion = I(test_drive=legs, quantity=quantity).about(subject_of(model, np.ones(3)))
        expected = expected_rows(model, legs, quantity)
        np.testing.assert_allclose(criterion.rows[0], expected, rtol=1e-6, atol=1e-6)

    def test_a_block_has_the_columns_of_its_own_parameters(self):
        model, names = ROBOTS[1].model, ("track", "wheel_radius_right")
        subject = subject_of(model, np.array([2.0, 3.0]), names)
        found = np.array(G(test_drive=LEGS).about(subject).rows[0])
        every = np.array(G(test_drive=LEGS).about(subject_of(model, np.ones(3))).rows[0])
        np.testing.assert_allclose(found, every[:, :, [2, 0]] * [2, 3], rtol=1e-12)

    @quantities
    def test_coefficients_in_two_blocks(self, quantity: str):
        # c11, c12 turn the robot, c21, c22 move it; each block has its own share of the prediction.
        problem = problem_of(
            measurement=Displacements(segments=4, regressor="both"),
            criterion=I(scaling="none", test_drive=LEGS, quantity=quantity),
        )
        columns = slice(0, 2) if quantity == "position" else slice(2, 3)

        def poses(c: np.ndarray) -> np.ndarray:
            pose, found = np.zeros(3), []
            for leg in LEGS:
                twist = (c[2:] @ leg.inputs, 0.0, c[:2] @ leg.inputs)
                pose = oracle.advance(pose, twist, leg.duration, "arc")
                found.append(pose[columns])
            return np.array(found)

        c = np.array(problem.model.coefficients(problem.model.nominal)).ravel()
        expected = oracle.central_difference(poses, c).reshape(2, -1, 4)
        turning, moving = map(np.array, problem.objective.rows)
        found = np.concatenate([turning, moving], axis=-1)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


class TestPredictions:
    """G and I in a problem."""

    @quantities
    def test_values_are_the_propagated_covariance(self, quantity: str):
        problem = problem_of(measurement=POSES, criterion=G(test_drive=LEGS, quantity=quantity))
        drive = random_drive(problem, 1)
        evaluation = evaluate(problem, drive)
        rows = expected_rows(problem.model, LEGS, quantity)
        covariance = evaluation.covariances["joint"]
        variances = np.einsum("lci,ij,lcj->l", rows, covariance, rows)
        assert evaluation.objective == pytest.approx(-variances.max(), rel=1e-6)
        mean = problem_of(measurement=POSES, criterion=I(test_drive=LEGS, quantity=quantity))
        assert evaluate(mean, drive).objective == pytest.approx(-variances.mean(), rel=1e-6)

    @predictions
    def test_the_scaling_does_not_matter(self, kind):
        values = []
        for scaling in ("relative", "none", dict(zip(GEOMETRY, (1.0, 20.0, 0.3), strict=True))):
            problem = problem_of(measurement=POSES, criterion=kind(test_drive=LEGS, scaling=scaling))
            values.append(evaluate(problem, random_drive(problem, 2)).objective)
        np.testing.assert_allclose(values, values[0], rtol=1e-8)

    @predictions
    @pytest.mark.parametrize("inputs", [(1.0,), (1.0, 2.0, 3.0)])
    def test_a_wrong_number_of_inputs_is_an_issue(self, kind, inputs: tuple[float, ...]):
        legs = (LEGS[0], Leg(inputs=inputs, duration=1))
        with pytest.raises(ProblemError) as caught:
            problem_of(criterion=kind(scaling="none", test_drive=legs))
        (issue,) = caught.value.issues
        assert issue.key == ("criterion", "test_drive", 1, "inputs")
        names = "wheel_speed_right, wheel_speed_left"
        assert issue.message == f"expected 2 inputs ({names}), got {len(inputs)}"

    def test_what_is_not_finite_is_an_issue(self):
        """A state that grows without bounds: that was an error of linear algebra."""
        system = oed.Equations(
            states={"a": ""},
            derivatives={"a": "k * a^2 + u"},
            parameters={"k": "1 1/s"},
            inputs={"u": "1/s"},
            outputs={"a": "a"},
        )
        task = TaskDrive(inputs=((1.0,),) * 40, period=1.0, start=(1.0,))
        with pytest.raises(ProblemError, match="predicted a are not finite: predict less far") as caught:
            Problem(
                model=system,
                design=oed.SignalSpace(duration=1.0, samples=4, start=(0.1,)),
                measurement=oed.Outputs(noise={"a": 0.1}),
                limits=[oed.InputRange(input="u", range=("0 1/s", "0.1 1/s"))],
                criterion=I(task=(task,), quantity="a", scaling="none"),
            )
        assert [issue.key for issue in caught.value.issues] == [("criterion", "quantity")]

    TASK = (TaskDrive(inputs=((5, 4), (-3, 6)), period=0.5),)

    @pytest.mark.parametrize(
        "criterion",
        [
            G(test_drive=LEGS, quantity="heading", scaling="none"),
            I(task=TASK, quantity="heading", scaling="none"),
        ],
    )
    def test_what_nothing_estimated_changes_is_an_issue(self, criterion: G | I):
        # The paper's position regression estimates c21 and c22, of which no heading knows.
        with pytest.raises(ProblemError) as caught:
            problem_of(measurement=Displacements(segments=4), criterion=criterion)
        (issue,) = caught.value.issues
        assert issue.key == ("criterion", "quantity")
        assert issue.message == "the heading predicted depends on none of c21, c22: every design would do"

    def test_a_task_that_some_regressions_do_not_change_is_that_of_the_others(self):
        values = []
        for regressor in ("heading", "both"):
            measurement = Displacements(segments=4, regressor=regressor)
            criterion = I(task=self.TASK, quantity="heading", scaling="none")
            problem = problem_of(measurement=measurement, criterion=criterion)
            values.append(evaluate(problem, random_drive(problem, 2)).objective)
        assert values[0] == pytest.approx(values[1], rel=1e-9)
        assert values[0] < 0

    @predictions
    @pytest.mark.parametrize(
        "options",
        [
            {},
            {"test_drive": ()},
            {"test_drive": [{"inputs": [], "duration": 1}]},
            {"test_drive": [{"inputs": [1, 2], "duration": 0}]},
            {"test_drive": [{"inputs": [1, math.inf], "duration": 1}]},
        ],
        ids=["none", "no legs", "no inputs", "no time", "no number"],
    )
    def test_options_are_checked(self, kind, options):
        with pytest.raises(PartError):
            kind(**options)

    def test_a_legs_duration_may_have_a_unit(self):
        assert Leg(inputs=(1, 2), duration="500 ms").duration == 0.5


def schur(matrix: np.ndarray, kept: list[int]) -> np.ndarray:
    """Information on the parameters `kept` where the others are unknown as well."""
    others = [index for index in range(len(matrix)) if index not in kept]
    shared, rest = matrix[np.ix_(kept, others)], matrix[np.ix_(others, others)]
    return matrix[np.ix_(kept, kept)] - shared @ np.linalg.solve(rest, shared.T)


def whole_information(problem: Problem, seed: int) -> np.ndarray:
    """F of a random drive on all parameters and nuisances, SI, nothing eliminated."""
    design = DesignExpressions(problem)
    (estimation,) = problem.estimations(design.terms.drive)
    function = ca.Function(
        "F",
        [design.terms.unknowns],
        [
            estimation.block.information(
                range(len(estimation.block.parameters) + len(estimation.block.nuisances))
            )
        ],
    )
    return np.array(function(design.unknowns_of(random_drive(problem, seed))))


def judged_information(problem: Problem, seed: int) -> np.ndarray:
    (matrix,) = evaluate(problem, random_drive(problem, seed)).information.values()
    return matrix


subsets = pytest.mark.parametrize(
    "subset", [("track",), ("wheel_radius_left",), ("wheel_radius_right", "track"), GEOMETRY], ids="+".join
)
ARM = {"lever_arm": LeverArm(x=0.1, y=0.05, known=False)}
"""A nuisance beside the start."""

ISSUES = {
    "a stranger": ({}, ("track", "mass"), "expected some of the estimated .*track, got mass"),
    "none": ({}, (), "expected some of the estimated .*, got none"),
    "not estimated": ({"estimate": GEOMETRY[:2]}, ("track",), "wheel_radius_left, got track"),
    "of another regressor": (
        {"measurement": Displacements(segments=4)},
        ("c11",),
        "expected some of the estimated c21, c22, got c11",
    ),
}


class TestSubset:
    """Some parameters are judged, the others unknown all the same."""

    # Every subset, every scaling with every sort of nuisances.
    @pytest.mark.parametrize(
        ("subset", "scaling", "options"),
        [
            (("track",), "none", {"initial_pose": "known"}),
            (("track",), "own", {}),
            (("wheel_radius_left",), "relative", {"initial_pose": "known"}),
            (("wheel_radius_left",), "none", ARM),
            (("wheel_radius_right", "track"), "own", {"initial_pose": "known"}),
            (("wheel_radius_right", "track"), "relative", {}),
            (("wheel_radius_right", "track"), "own", ARM),
            (GEOMETRY, "none", {}),
            (GEOMETRY, "relative", ARM),
        ],
    )
    @pytest.mark.slow
    def test_its_information_is_the_schur_complement(self, subset, scaling, options):
        scales = np.array([3.0, 0.2, 5.0][: len(subset)])
        chosen = dict(zip(subset, scales, strict=True)) if scaling == "own" else scaling
        measurement = Poses(noise=AbsoluteNoise(position=0.01, heading=0.02), every=10, **options)
        problem = problem_of(measurement=measurement, criterion=D(subset=subset, scaling=chosen))
        kept = [GEOMETRY.index(name) for name in subset]
        nominal = np.array(problem.model.nominal)[kept]
        sizes = {"none": np.ones(len(subset)), "relative": nominal, "own": scales}[scaling]
        complement = schur(whole_information(problem, 3), kept)
        expected = complement * np.outer(sizes, sizes)
        found = judged_information(problem, 3)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())
        value = float(problem.objective.value([found]))
        assert value == pytest.approx(np.linalg.slogdet(expected)[1], abs=1e-6)

    @subsets
    def test_its_inverse_is_the_subsets_covariance(self, subset):
        problem = problem_of(measurement=POSES, criterion=A(subset=subset, scaling="none"))
        evaluation = evaluate(problem, random_drive(problem, 4))
        together = evaluate(problem_of(measurement=POSES, criterion=A()), random_drive(problem, 4))
        assert evaluation.parameters["joint"][: len(subset)] == subset
        kept = [GEOMETRY.index(name) for name in subset]
        covariance = together.covariances["joint"][np.ix_(kept, kept)]
        assert evaluation.objective == pytest.approx(-np.trace(covariance), rel=1e-6)
        order = [GEOMETRY.index(name) for name in evaluation.parameters["joint"]]
        np.testing.assert_allclose(
            evaluation.covariances["joint"], together.covariances["joint"][np.ix_(order, order)], rtol=1e-6
        )

    def test_determinants_factor(self):
        # det F = det F_s det F_others, with the others' information where the subset is known.
        every, some = (problem_of(measurement=POSES, criterion=D(subset=s)) for s in (None, ("track",)))
        rest = problem_of(measurement=POSES, criterion=D(), estimate=GEOMETRY[:2])
        values = [evaluate(problem, random_drive(every, 5)).objective for problem in (every, some, rest)]
        assert values[0] == pytest.approx(values[1] + values[2], abs=1e-6)

    @settings(max_examples=15)
    @given(seed=seeds)
    @pytest.mark.slow
    def test_what_is_not_known_is_never_worth_more(self, seed: int):
        unknown = problem_of(measurement=POSES, criterion=E(subset=("track",)))
        known = problem_of(measurement=POSES, criterion=E(), estimate=("track",))
        drive = random_drive(unknown, seed)
        values = [evaluate(problem, drive).objective for problem in (unknown, known)]
        assert values[0] <= values[1] * (1 + 1e-9)

    def test_its_names_come_in_the_estimations_order(self):
        problem = problem_of(measurement=POSES, criterion=E(subset=("track", "wheel_radius_left")))
        (estimation,) = problem.any_estimations
        assert estimation.judged == ("wheel_radius_left", "track")
        assert estimation.parameters == ("wheel_radius_left", "track", "wheel_radius_right")

    def test_blocks_without_it_are_left_out(self):
        both = Displacements(segments=4, regressor="both")
        problem = problem_of(measurement=both, criterion=D(scaling="none", subset=("c11",)))
        evaluation = evaluate(problem, random_drive(problem, 6))
        (name,) = evaluation.information
        assert name == "heading"
        W = evaluation.design_matrices["heading"]
        complement = schur(W.T @ W, [0])
        np.testing.assert_allclose(evaluation.information["heading"], complement, rtol=1e-9)
        assert evaluation.objective == pytest.approx(math.log(complement.item()), abs=1e-9)

    def test_predictions_may_be_judged_by_a_subset_too(self):
        problem = problem_of(measurement=POSES, criterion=G(test_drive=LEGS, subset=("track",)))
        evaluation = evaluate(problem, random_drive(problem, 7))
        column = expected_rows(problem.model, LEGS, "position")[:, :, 2]
        variance = evaluation.covariances["joint"][0, 0]
        assert evaluation.objective == pytest.approx(-variance * (column**2).sum(axis=1).max(), rel=1e-6)

    @pytest.mark.parametrize(("parts", "subset", "message"), ISSUES.values(), ids=ISSUES.keys())
    def test_unknown_names_are_issues(self, parts, subset, message):
        parts = {"measurement": POSES, **parts}
        with pytest.raises(ProblemError, match=message) as caught:
            problem_of(criterion=D(scaling="none", subset=subset), **parts)
        assert [issue.key for issue in caught.value.issues] == [("criterion", "subset")]

    def test_a_scale_of_every_judged_parameter_is_needed(self):
        criterion = D(subset=("track", "wheel_radius_left"), scaling={"track": 1.0})
        with pytest.raises(ProblemError, match="the scale of wheel_radius_left is missing"):
            problem_of(measurement=POSES, criterion=criterion)
