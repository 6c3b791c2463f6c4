"""The paper's regression: W against oracles, laws of W'W, and the three identities of the paper's table."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import oracle
import pytest
from builders import ACCELERATION, BOX, RADIUS, SPEED, TRACK, problem_of, random_drive, upper_bound
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_robots import ROBOTS, TWO_SIDED, Example, cases, draw_inputs

from oed.foundation.errors import PartError
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.optimize import Ipopt, solve
from oed.robots.models import DifferentialDrive
from oed.robots.sensors import Displacements
from oed.robots.space import DesignSpace

SAMPLES, DURATION = 23, 5.0
PERIOD, START = DURATION / SAMPLES, (0.2, -0.1, 0.4)

robots = pytest.mark.parametrize("example", cases(TWO_SIDED))
rules = pytest.mark.parametrize("rule", ["arc", "midpoint"])
seeds = st.integers(0, 2**32 - 1)


@cache
def problem_for(model, rule: str, segments, regressor: str = "both") -> Problem:
    return problem_of(
        model=model,
        design=DesignSpace(
            duration=DURATION, samples=SAMPLES, integration=rule, rest_to_rest=False, start="free"
        ),
        measurement=Displacements(segments=segments, regressor=regressor),
        limits=(SPEED,),
    )


def designs(problem: Problem, speeds: np.ndarray, start=START) -> dict[str, np.ndarray]:
    drive = Trajectory.from_samples(speeds, DURATION, start, rest_to_rest=False)
    return dict(evaluate(problem, drive).design_matrices)


def position_information(problem: Problem, speeds: np.ndarray, start=START) -> np.ndarray:
    design = designs(problem, speeds, start)["position"]
    return design.T @ design


def random_speeds(seed: int, amplitude: float = 10.0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-amplitude, amplitude, (SAMPLES, 2))


def plus_minus(matrix: np.ndarray) -> tuple[float, float, float]:
    """F++, F--, F+- of a 2 x 2 matrix."""
    plus, minus = np.array([1, 1]) / math.sqrt(2), np.array([1, -1]) / math.sqrt(2)
    return plus @ matrix @ plus, minus @ matrix @ minus, plus @ matrix @ minus


# Every robot, and of one of them every number of segments by both rules.
@pytest.mark.parametrize(
    ("example", "rule", "segments"),
    [
        *((example, "arc", 10) for example in TWO_SIDED[1:]),
        *(
            (TWO_SIDED[0], rule, count)
            for rule in ("arc", "midpoint")
            for count in (2, 10, SAMPLES, "samples")
        ),
    ],
    ids=lambda one: getattr(one, "name", str(one)),
)
def test_regressors_are_the_oracles(example: Example, rule: str, segments):
    problem = problem_for(example.model, rule, segments)
    inputs = draw_inputs(np.random.default_rng(3), SAMPLES)
    twists = np.array([example.twist(row) for row in inputs])
    effective = np.array([example.effective(row) for row in inputs])
    headings = oracle.roll_out(twists, START, PERIOD, rule)[:-1, 2]
    edges = problem.measurement.segment_edges(SAMPLES)
    turns, moves = oracle.segment_regressors(effective, headings, twists[:, 2], PERIOD, edges, rule)
    found = designs(problem, inputs)
    np.testing.assert_allclose(found["heading"], turns, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found["position"], moves, rtol=0, atol=1e-11)


@robots
@rules
def test_rows_times_coefficients_are_the_displacements(example: Example, rule: str):
    problem, inputs = problem_for(example.model, rule, 5), draw_inputs(np.random.default_rng(4), SAMPLES)
    evaluation = evaluate(problem, Trajectory.from_samples(inputs, DURATION, START, rest_to_rest=False))
    ends = evaluation.states[problem.measurement.segment_edges(SAMPLES)]
    moved = np.diff(ends, axis=0)
    turn_row, move_row = np.array(example.model.coefficients(example.model.nominal))
    found = evaluation.design_matrices
    np.testing.assert_allclose(found["heading"] @ turn_row, moved[:, 2], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["position"] @ move_row, moved[:, :2].ravel(), rtol=0, atol=1e-12)


@pytest.mark.parametrize("regressor", ["position", "heading", "both"])
def test_regressor_chooses_the_blocks(regressor: str):
    problem = problem_for(ROBOTS[0].model, "arc", 4, regressor)
    shapes = {name: design.shape for name, design in designs(problem, random_speeds(0)).items()}
    every = {"heading": (4, 2), "position": (8, 2)}
    assert shapes == (every if regressor == "both" else {regressor: every[regressor]})


@rules
def test_design_matrix_is_the_derivative_of_what_is_measured(rule: str):
    problem, speeds = problem_for(ROBOTS[0].model, rule, 5), random_speeds(5)
    edges = problem.measurement.segment_edges(SAMPLES)
    c11, c21 = RADIUS / TRACK, RADIUS / 2
    yaw_rates = c11 * (speeds[:, 0] - speeds[:, 1])
    headings = START[2] + np.concatenate([[0], np.cumsum(PERIOD * yaw_rates)])

    def positions(c: np.ndarray) -> np.ndarray:
        # Headings held at their nominal course, speeds from the coefficients.
        place, places = np.zeros(2), [np.zeros(2)]
        for k in range(SAMPLES):
            ahead, _ = oracle.DISPLACEMENTS[rule](headings[k], yaw_rates[k], PERIOD)
            place = place + (c[0] * speeds[k, 0] + c[1] * speeds[k, 1]) * ahead
            places.append(place)
        return np.diff(np.array(places)[edges], axis=0).ravel()

    def turns(c: np.ndarray) -> np.ndarray:
        course = np.concatenate([[0], np.cumsum(PERIOD * (speeds @ c))])
        return np.diff(course[edges])

    found = designs(problem, speeds)
    by_position = oracle.central_difference(positions, np.array([c21, c21]), 1e-3)
    by_heading = oracle.central_difference(turns, np.array([c11, -c11]), 1e-3)
    np.testing.assert_allclose(found["position"], by_position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["heading"], by_heading, rtol=0, atol=1e-9)


@given(seed=seeds)
def test_per_sample_midpoint_information_is_the_sum_of_speeds(seed: int):
    speeds = random_speeds(seed)
    found = position_information(problem_for(ROBOTS[0].model, "midpoint", "samples"), speeds)
    np.testing.assert_allclose(found, PERIOD**2 * speeds.T @ speeds, rtol=1e-12)


@given(seed=seeds, segments=st.sampled_from([1, 3, 10, SAMPLES]))
@pytest.mark.slow
def test_segment_information_depends_on_the_segments_ends_only(seed: int, segments: int):
    problem, speeds = problem_for(ROBOTS[0].model, "arc", segments, "position"), random_speeds(seed)
    twists = np.array([oracle.differential_twist(row, RADIUS, RADIUS, TRACK) for row in speeds])
    poses = oracle.roll_out(twists, START, PERIOD, "arc")
    edges = problem.measurement.segment_edges(SAMPLES)
    expected = oracle.segment_information(poses, edges, RADIUS, TRACK)
    found = plus_minus(position_information(problem, speeds))
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)


@given(seed=seeds, segments=st.sampled_from([1, 2, 3, 10, SAMPLES]), amplitude=st.floats(0.1, 30))
def test_no_drive_exceeds_the_cap(seed: int, segments: int, amplitude: float):
    problem = problem_for(ROBOTS[0].model, "arc", segments, "position")
    smallest = np.linalg.eigvalsh(position_information(problem, random_speeds(seed, amplitude)))[0]
    assert smallest <= upper_bound(segments) * (1 + 1e-12)


@pytest.mark.slow
@settings(max_examples=6)
@given(seed=seeds, radii=st.tuples(st.floats(0.02, 0.1), st.floats(0.02, 0.1)))
def test_no_drive_with_unequal_radii_exceeds_the_cap(seed: int, radii: tuple[float, float]):
    right, left = radii
    problem = problem_of(
        model=DifferentialDrive(wheel_radius_right=right, wheel_radius_left=left, track=TRACK),
        limits=(SPEED,),
        design=DesignSpace(duration=DURATION, samples=SAMPLES, rest_to_rest=False, start="free"),
    )
    smallest = np.linalg.eigvalsh(position_information(problem, random_speeds(seed)))[0]
    assert smallest <= 4 * 4 * TRACK**2 / (right**2 + left**2) * (1 + 1e-12)


@pytest.mark.slow
@rules
@given(seed=seeds, x=st.floats(-50, 50), y=st.floats(-50, 50), heading=st.floats(-10, 10))
def test_information_does_not_depend_on_the_start(rule: str, seed: int, x: float, y: float, heading: float):
    problem, speeds = problem_for(ROBOTS[0].model, rule, 5), random_speeds(seed)
    reference = position_information(problem, speeds)
    moved = position_information(problem, speeds, (x, y, heading))
    np.testing.assert_allclose(moved, reference, rtol=0, atol=1e-11 * np.trace(reference))


@pytest.mark.parametrize("samples", [10, 23, 40, 200])
@pytest.mark.parametrize("segments", [1, 2, 3, 7, 10])
def test_segments_are_as_equal_as_whole_samples_allow(samples: int, segments: int):
    edges = Displacements(segments=segments).segment_edges(samples)
    lengths = np.diff(edges)
    assert (edges[0], edges[-1], len(lengths)) == (0, samples, segments)
    assert lengths.max() - lengths.min() <= 1


def test_per_sample_segments():
    assert Displacements(segments="samples").segment_edges(7).tolist() == list(range(8))


@pytest.mark.parametrize("wrong", [{"segments": 0}, {"segments": "all"}, {"regressor": "speed"}, {"rows": 3}])
def test_wrong_values_are_refused(wrong):
    with pytest.raises(PartError, match=next(iter(wrong))):
        Displacements(**wrong)


@pytest.mark.parametrize("wrong", [{"position": 0}, {"position": "-1 cm"}, {"heading": "3 cm"}, {"yaw": 1}])
def test_wrong_noise_is_refused(wrong):
    with pytest.raises(PartError, match=f"noise.{next(iter(wrong))}"):
        Displacements(noise=wrong)


@pytest.mark.slow
class TestPaperTable:
    """The three identities that any consistent reading of the table must reproduce."""

    norm_c = math.hypot(2.45, 2.45)

    @staticmethod
    def rounding(value: float, digits: int) -> np.ndarray:
        """The lowest and highest number that rounds to `value`."""
        return value + np.array([-0.5, 0.5]) * 10.0**-digits

    @pytest.mark.parametrize(
        ("condition", "smallest", "norm_y"), [(3.35, 8.70, 100.83), (3.36, 8.64, 100.68)]
    )
    def test_genetic_paths(self, condition: float, smallest: float, norm_y: float):
        low, high = self.rounding(condition, 2) * self.rounding(smallest, 2) * self.norm_c
        assert low <= norm_y <= high

    def test_control_path(self):
        assert pytest.approx(87.6656 / self.norm_c, rel=0.01) == 1.33e16 * 1.92e-15

    def test_true_coefficients(self):
        model = DifferentialDrive(wheel_radius="4.9 cm", track="18 cm")
        coefficients = np.array(model.coefficients(model.nominal))
        np.testing.assert_allclose(coefficients[0], [0.2722, -0.2722], atol=5e-5)
        np.testing.assert_allclose(coefficients[1] * 100, [2.45, 2.45], rtol=1e-12)
        assert self.norm_c == pytest.approx(3.4648, abs=5e-5)

    @given(seed=seeds)
    def test_norm_y_is_at_most_the_largest_singular_value_times_norm_c(self, seed: int):
        problem = problem_of(limits=(SPEED, ACCELERATION, BOX), measurement=Displacements(segments=3))
        evaluation = evaluate(problem, random_drive(problem, seed))
        bounds = evaluation.singular_values * self.norm_c / 100
        assert bounds[-1] * (1 - 1e-12) <= evaluation.norm_y <= bounds[0] * (1 + 1e-12)

    def test_an_optimal_design_with_three_segments_is_alike(self, three_segments: Problem):
        options = Ipopt(starts=1, perturbations=0, second_stage="none")
        evaluation = solve(three_segments, options, seed=0, workers=1).evaluation
        largest = evaluation.singular_values[0]
        assert evaluation.norm_y == pytest.approx(largest * self.norm_c / 100, rel=0.01)


def test_splines_and_samples_of_the_same_drive_give_the_same_rows():
    problem = problem_of(duration=DURATION, samples=SAMPLES, coefficients=7)
    drive = random_drive(problem, 3)
    held = Trajectory.from_samples(drive.inputs, DURATION, drive.start)
    first, second = (evaluate(problem, each).design_matrices["position"] for each in (drive, held))
    np.testing.assert_allclose(first, second, rtol=0, atol=1e-11)
