"""Which readings to take: published weights, certificates that hold, whole readings, and wrong input."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from places import PROBLEMS

import oed
from oed.equations.limits import InputRange
from oed.equations.outputs import Rates, Responses
from oed.equations.system import Equations
from oed.foundation.errors import ProblemError, UserMistake
from oed.kernel.criteria import A, Criterion, D, E, G, I, ModifiedE
from oed.kernel.equivalence import directional_derivatives, weight_bound
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.parts import Parts, Reading, budgets_of
from oed.kernel.reading_parts import parts_of
from oed.optimize.exact import exact_weights
from oed.optimize.selection import select
from oed.optimize.weights import Weights, best_weights, whole_weights

CRITERIA: tuple[Criterion, ...] = (E(scaling="none"), D(scaling="none"), A(scaling="none"))
POINTS = np.linspace(-1, 1, 41)


@cache
def quadratic(
    output: str = "constant + slope * x + curvature * x^2",
    judged: tuple[str, ...] | None = None,
    noise: float = 1.0,
    count: int = len(POINTS),
    **others: str,
) -> Parts:
    """A parabola that may be read at so many points, with other parameters than its three if wanted."""
    parameters = {**dict.fromkeys(("constant", "slope", "curvature"), "1"), **others}
    system = Equations(parameters=parameters, inputs={"x": ""}, outputs={"y": output})
    points = np.linspace(-1, 1, count)
    spline = oed.Spline(degree=0, coefficients=count)
    space = oed.SignalSpace(duration=count, samples=count, spline=spline, rest_to_rest=False)
    problem = oed.Problem(
        model=system,
        design=space,
        measurement=Responses(noise={"y": noise}),
        limits=[InputRange(input="x", range=(-1, 1))],
        criterion=D(subset=judged),
    )
    return parts_of(problem, space.trajectory(points[:, None], np.zeros((1, 0))))


def powers(points: np.ndarray) -> np.ndarray:
    """1, x, x^2 at points, (n, 3)."""
    return np.vander(points, 3, increasing=True)


def predicting(kind: type[G | I], points: np.ndarray) -> Criterion:
    """G or I of what a parabola predicts at points."""
    legs = [{"inputs": [0.0], "duration": 1.0}] * len(points)
    return kind(scaling="none", test_drive=legs).with_rows([powers(points)[:, None].tolist()])


def driven(study: str) -> tuple[oed.Problem, oed.Trajectory]:
    """A shipped study, and a random drive of it."""
    problem = oed.load_study(PROBLEMS / f"{study}.yaml").problem
    # A quarter of the readings: the same in a fraction of the time.
    space = problem.design.model_copy(update={"samples": problem.design.samples // 4})
    # Readings have worths of their own where nothing drifts.
    problem = replace(problem, design=space, measurement=problem.measurement.steady())
    rng = np.random.default_rng(0)
    table = np.zeros((space.all_coefficients, len(problem.model.inputs)))
    table[space.free_rows] = rng.uniform(-3, 3, (len(space.free_rows), table.shape[1]))
    start = problem.fixed_starts
    if start is None:
        start = problem.start_states(np.zeros((space.runs, problem.system.chosen_states)))
    return problem, space.trajectory(table, start)


@cache
def tracked(study: str) -> Parts:
    """That drive, reading by reading."""
    return parts_of(*driven(study))


@cache
def twenty(study: str, criterion: Criterion) -> Weights:
    """The best of twenty readings of that drive."""
    return best_weights(criterion, tracked(study), budgets_of(tracked(study), 20.0))


KINDS = [
    E(),
    D(),
    A(),
    *(kind(quantity="a", test_drive=[{"inputs": [2.0], "duration": 1.0}]) for kind in (G, I)),
]


class TestCriterionOfProblem:
    """Functions of weights take `problem.objective`, which alone knows what G and I predict."""

    @staticmethod
    def fed(criterion: Criterion) -> tuple[oed.Problem, Parts]:
        """A state that decays while it is fed."""
        system = Equations(
            states={"a": ""},
            derivatives={"a": "u - k * a"},
            parameters={"k": "0.5 1/s", "gain": "1"},
            inputs={"u": "1/s"},
            outputs={"a": "gain * a"},
        )
        space = oed.SignalSpace(
            duration=2, samples=4, start=(0.2,), signals=(oed.PiecewiseConstant(pieces=4),)
        )
        problem = oed.Problem(
            model=system,
            design=space,
            measurement=oed.Outputs(noise={"a": 0.1}),
            limits=[InputRange(input="u", range=("0 1/s", "2 1/s"))],
            criterion=criterion,
        )
        drive = space.trajectory(np.array([[2.0], [0.0], [1.0], [2.0]]), np.array([[0.2]]))
        return problem, parts_of(problem, drive)

    @pytest.mark.slow
    @pytest.mark.parametrize("criterion", KINDS)
    def test_every_function_answers_for_the_objective_of_a_problem(self, criterion: Criterion):
        problem, parts = self.fed(criterion)
        objective, budgets = problem.objective, budgets_of(parts, 2.0)
        relaxed = best_weights(objective, parts, budgets)
        near = whole_weights(objective, parts, relaxed.values, budgets)
        exact = exact_weights(objective, parts, near, budgets)
        bound = weight_bound(objective, parts, relaxed.values, relaxed.gradient, budgets)
        assert near.value <= exact.weights.value <= exact.bound <= bound + 1e-6 * abs(bound)
        assert relaxed.value <= bound <= relaxed.value + 1e-6 * abs(relaxed.value)

    @pytest.mark.slow
    @pytest.mark.parametrize("criterion", KINDS[3:])
    def test_predictions_of_no_problem_are_refused_by_the_name_of_what_to_give(self, criterion: Criterion):
        _, parts = self.fed(criterion)
        budgets, some = budgets_of(parts, 2.0), np.array([0.0, 0.5, 0.5, 0.5, 0.5])
        with pytest.raises(UserMistake, match=r"problem\.objective"):
            best_weights(criterion, parts, budgets)
        with pytest.raises(UserMistake, match=r"problem\.objective"):
            whole_weights(criterion, parts, some, budgets)
        with pytest.raises(UserMistake, match=r"problem\.objective"):
            exact_weights(criterion, parts, Weights(some, 0.0, np.eye(2)), budgets)


class TestParts:
    @pytest.mark.parametrize("study", ["laser_tracker", "gyro_and_position", "three_runs"])
    def test_all_of_them_are_what_evaluate_says(self, study: str):
        problem, drive = driven(study)
        parts = parts_of(problem, drive)
        whole = parts.information(np.ones(len(parts.readings)))
        assert float(problem.criterion.value([whole])) == pytest.approx(
            oed.evaluate(problem, drive).objective, rel=1e-7
        )

    def test_trials_have_nothing_to_do_with_each_others_starts(self):
        """Matrices of many trials are mostly 0, and stay so: dense ones took minutes, and gigabytes."""
        system = Equations(
            states={"x": ""}, derivatives={"x": "-k * x"}, parameters={"k": "1 1/s"}, outputs={"y": "x"}
        )
        spline = oed.Spline(degree=0, coefficients=4)
        space = oed.SignalSpace(duration=1, samples=4, runs=3, spline=spline, start=(1.0,))
        problem = oed.Problem(
            model=system,
            design=space,
            measurement=oed.Outputs(noise={"y": 0.1}, start="unknown"),
            limits=[],
            criterion=D(),
        )
        drive = space.trajectory(np.zeros((12, 0)), np.ones((3, 1)))
        whole = parts_of(problem, drive).whole(np.arange(15.0))
        assert np.all(whole[1:, 1:][~np.eye(3, dtype=bool)] == 0)
        assert np.all(whole[0, 1:] != 0)

    def test_what_is_taken_surely_is_known_beside_the_rest(self):
        parts, rng = tracked("laser_tracker"), np.random.default_rng(0)
        free = np.sort(rng.permutation(len(parts.readings))[:30])
        surely, further = rng.uniform(0, 2, len(parts.readings)), rng.uniform(0, 2, len(free))
        both = surely.copy()
        both[free] += further
        left = parts.taken(surely, free)
        np.testing.assert_allclose(left.whole(further), parts.whole(both), rtol=1e-10, atol=1e-10)
        assert left.readings == tuple(parts.readings[place] for place in free)

    def test_readings_that_tell_apart_by_rounding_alone_tell_nothing(self):
        """Two where a parabola is as high are no more than one, beside a constant that is nearly it."""
        output = "(curvature * (1 + x^2 * 1e-6) + constant) * (2 + x) + 0 * slope"
        # Of so many some are told by little more than rounding, and rounding tells nearly as much of others.
        parts = quadratic(output, ("curvature",), count=201)
        for place in range(100):
            for other, told in ((200 - place, False), (100, True)):
                weights = np.bincount([place, other], minlength=201).astype(float)
                assert parts.root(weights).complete == told

    def test_what_is_rounding_of_one_parameter_is_not_of_another(self):
        parts = quadratic("constant + slope * (1 + x) * 1e18 + curvature * x^2", ("slope", "curvature"))
        assert parts.root(np.ones(len(POINTS))).complete

    @pytest.mark.parametrize("noise", [1e-9, 1e9])
    def test_what_is_rounding_is_not_a_matter_of_the_noise(self, noise: float):
        known, parts = (quadratic(judged=("curvature",), noise=one) for one in (1.0, noise))
        every = np.ones(len(POINTS))
        assert parts.root(every).complete
        expected = known.root(every).matrix / noise**2
        np.testing.assert_allclose(parts.root(every).matrix, expected, rtol=1e-9)

    def test_every_reading_has_its_time(self):
        parts = tracked("laser_tracker")
        assert [one.time for one in parts.readings] == pytest.approx(np.linspace(0, 20, len(parts.readings)))
        assert {one.sensor for one in parts.readings} == {"poses"}

    def test_those_of_regressions_do_not_add_up(self):
        problem = oed.load_study(PROBLEMS / "choi_skid_steer.yaml").problem
        drive = problem.design.trajectory(np.zeros((16, 2)), problem.fixed_starts)
        with pytest.raises(ProblemError, match=r"measurement\.kind: .*do not add up"):
            parts_of(problem, drive)


class TestPublished:
    @pytest.mark.parametrize(
        ("criterion", "weights", "value"),
        [
            # [Pukelsheim, Optimal Design of Experiments, 1993, sections 9.5 and 9.8].
            (CRITERIA[0], [1 / 5, 3 / 5, 1 / 5], 1 / 5),
            (CRITERIA[1], [1 / 3, 1 / 3, 1 / 3], np.log(4 / 27)),
            (CRITERIA[2], [1 / 4, 1 / 2, 1 / 4], -8.0),
        ],
        ids="EDA",
    )
    def test_quadratic_regression(self, criterion: Criterion, weights: list[float], value: float):
        parts, one = quadratic(), budgets_of(quadratic(), 1.0)
        found = best_weights(criterion, parts, one)
        assert POINTS[found.values > 1e-4] == pytest.approx([-1, 0, 1])
        assert found.values[found.values > 1e-4] == pytest.approx(weights, abs=1e-6)
        assert found.value == pytest.approx(value, rel=1e-6)
        bound = weight_bound(criterion, parts, found.values, found.gradient, one)
        assert 0 <= bound - found.value < 1e-7

    def test_the_curvature_alone_beside_what_is_nearly_the_same(self):
        """A quarter at both ends, half in the middle [Kiefer and Wolfowitz, Annals of Mathematical Statistics
        30, 1959], where information, squared, cannot tell the constant from the slope.
        """
        parts = quadratic("constant + slope * (1 + x * 1e-7) + curvature * x^2", ("curvature",))
        found = best_weights(D(scaling="none"), parts, budgets_of(parts, 1.0))
        assert parts.root(found.values).complete
        assert POINTS[found.values > 1e-4] == pytest.approx([-1, 0, 1])
        assert found.values[found.values > 1e-4] == pytest.approx([1 / 4, 1 / 2, 1 / 4], abs=1e-6)
        assert found.value == pytest.approx(np.log(1 / 4), rel=1e-6)

    @pytest.mark.slow
    def test_the_volume_of_what_is_nearly_the_same(self):
        """A third at the ends and in the middle, as of the parabola, from which it differs by a factor."""
        apart = 1e-5
        parts = quadratic(f"constant + slope * (1 + x * {apart}) + curvature * x^2")
        found = best_weights(D(scaling="none"), parts, budgets_of(parts, 1.0))
        assert found.values[[0, 20, 40]] == pytest.approx(np.full(3, 1 / 3), abs=1e-4)
        assert found.value == pytest.approx(np.log(4 / 27 * apart**2), rel=1e-7)

    @pytest.mark.slow
    def test_rounding_leaves_no_bound_below_what_is_reached(self):
        """By information, squared, it was .0008 below the logarithm of a third at each of three."""
        parts = quadratic("constant + slope * (1 + x * 1e-7) + curvature * x^2")
        one = budgets_of(parts, 1.0)
        found = best_weights(D(scaling="none"), parts, one)
        bound = weight_bound(D(scaling="none"), parts, found.values, found.gradient, one)
        # How near above depends on the linear algebra of the machine.
        assert np.log(4 / 27 * 1e-14) <= bound < np.log(4 / 27 * 1e-14) + 0.1

    def test_beside_others_that_every_reading_sees_alike(self):
        """A quarter at both ends, half in the middle, as above; what makes two of the others differ is never
        known, and of no matter. With it in the matrices the search stops far from the optimum.
        """
        parts = quadratic(
            "curvature * x^2 + (constant + again) * (1 + x * 1e-6) + slope", ("curvature",), again="1"
        )
        criterion, one = D(scaling="none"), budgets_of(parts, 1.0)
        found = best_weights(criterion, parts, one)
        bound = weight_bound(criterion, parts, found.values, found.gradient, one)
        assert found.value == pytest.approx(np.log(1 / 4), rel=1e-6)
        assert 0 <= bound - found.value < 1e-7

    @pytest.mark.slow
    def test_the_least_information_beside_far_more(self):
        """What readings say of one parameter, a million times as much, is all that helps with another."""
        known = np.array([[3.1, -7.6], [-7.6, 136.0]])
        rows = np.column_stack([np.zeros(len(POINTS)), np.sqrt(7e5) * POINTS])
        parts = replace(quadratic(), rows=rows, known_rows=np.linalg.cholesky(known).T, judged=2, rounding=())
        found = best_weights(E(scaling="none"), parts, budgets_of(parts, 20.0))
        largest = rows[np.argsort(np.abs(POINTS))[-20:]]
        best = known + largest.T @ largest
        assert found.value == pytest.approx(np.linalg.eigvalsh(best)[0], rel=1e-8)

    @pytest.mark.slow
    def test_information_of_any_size(self):
        """Readings that differ little, beside a prior far below and far above."""
        rng = np.random.default_rng(3)
        rows = np.array([1.0, 0.3, 1e-5, 3e-3]) * (1 + 0.01 * rng.normal(size=(17, 4)))
        parts = replace(
            quadratic(),
            readings=quadratic().readings[:17],
            sizes=np.ones(17),
            members=tuple((one,) for one in range(17)),
            rows=rows,
            places=np.arange(17),
            known_rows=np.diag(np.sqrt([0.0, 6.7, 7.7e-4, 24.8])),
            judged=4,
            rounding=(),
        )
        for criterion in CRITERIA:
            budgets = budgets_of(parts, 7.0, most=3.0)
            found = best_weights(criterion, parts, budgets)
            bound = weight_bound(criterion, parts, found.values, found.gradient, budgets)
            assert found.value == pytest.approx(bound, rel=1e-7)

    @pytest.mark.slow
    def test_predictions_at_all_points_are_best_where_the_volume_is(self):
        """The equivalence theorem: the largest variance of what is predicted is the number of parameters
        [Kiefer and Wolfowitz, The equivalence of two extremum problems, 1960].
        """
        criterion = predicting(G, POINTS[::2])
        parts, one = quadratic(), budgets_of(quadratic(), 1.0)
        found = best_weights(criterion, parts, one)
        assert found.values[[0, 20, 40]] == pytest.approx(np.full(3, 1 / 3), abs=1e-6)
        assert found.value == pytest.approx(-3.0, rel=1e-8)
        bound = weight_bound(criterion, parts, found.values, found.gradient, one)
        assert 0 <= bound - found.value < 1e-6

    def test_the_mean_variance_of_predictions(self):
        """The optimum is A's for the predictions' combinations: no weights near it do better."""
        criterion = predicting(I, POINTS[::2])
        parts, one = quadratic(), budgets_of(quadratic(), 1.0)
        found = best_weights(criterion, parts, one)
        bound = weight_bound(criterion, parts, found.values, found.gradient, one)
        assert 0 <= bound - found.value < 1e-7
        table = powers(POINTS[::2])
        expected = -np.mean(np.einsum("na,ab,nb->n", table, np.linalg.inv(parts.whole(found.values)), table))
        assert found.value == pytest.approx(expected, rel=1e-9)

    @pytest.mark.slow
    @pytest.mark.parametrize("kind", [G, I])
    @pytest.mark.parametrize("units", [(1e-6, 1.0, 1e6), (1e3, 1e-4, 1.0)])
    def test_predictions_are_in_no_units_of_parameters(self, kind: type[G | I], units: tuple[float, ...]):
        """Bounds were exceeded by 12 %, and choices worse than even weights."""
        parts, one = quadratic(), budgets_of(quadratic(), 20.0)
        known = best_weights(predicting(kind, POINTS[[4, 18, 40]]), parts, one)
        scaled = replace(parts, rows=parts.rows * units, known_rows=parts.known_rows * units, rounding=())
        criterion = predicting(kind, POINTS[[4, 18, 40]])
        criterion = criterion.with_rows([(np.array(criterion.rows[0]) * units).tolist()])
        found = best_weights(criterion, scaled, one)
        assert found.value == pytest.approx(known.value, rel=1e-7)
        bound = weight_bound(criterion, scaled, found.values, found.gradient, one)
        assert -1e-9 * abs(found.value) <= bound - found.value < 1e-6 * abs(found.value)

    @pytest.mark.slow
    @pytest.mark.parametrize("kind", [G, I])
    def test_predictions_of_any_size(self, kind: type[G | I]):
        """Variances of 1e-10 were below a solver's tolerance."""
        parts, one = quadratic(), budgets_of(quadratic(), 20.0)
        criterion = predicting(kind, POINTS[[4, 18, 40]])
        known = best_weights(criterion, parts, one).value
        small = criterion.with_rows([(1e-6 * np.array(criterion.rows[0])).tolist()])
        found = best_weights(small, parts, one)
        assert found.value == pytest.approx(1e-12 * known, rel=1e-7, abs=0)

    @pytest.mark.slow
    @pytest.mark.parametrize("kind", [G, I])
    @pytest.mark.parametrize("size", [1.0, 1e-3])
    def test_what_readings_of_predictions_are_worth_is_in_their_units(self, kind: type[G | I], size: float):
        """With twice the information half the variance is left; it was 4e6 times as much."""
        parts, one = quadratic(), budgets_of(quadratic(), 20.0)
        criterion = predicting(kind, POINTS[[4, 18, 40]])
        criterion = criterion.with_rows([(size * np.array(criterion.rows[0])).tolist()])
        found = best_weights(criterion, parts, one)
        slopes = directional_derivatives(parts, found.values, found.gradient)
        assert slopes @ found.values == pytest.approx(-found.value, rel=1e-6)

    @pytest.mark.slow
    def test_one_prediction_needs_one_combination(self):
        """The middle of a parabola is best predicted by reading it there alone, at which F is singular."""
        for kind in (G, I):
            criterion = predicting(kind, np.zeros(1))
            parts, one = quadratic(), budgets_of(quadratic(), 1.0)
            found = best_weights(criterion, parts, one)
            assert found.value == pytest.approx(-1.0, rel=1e-6)
            bound = weight_bound(criterion, parts, found.values, found.gradient, one)
            assert -1e-9 <= bound - found.value < 1e-5

    def test_a_decay_that_is_measured_for_two_fifths_of_the_time(self):
        """X' = p x, in ten intervals [1D test of DynamicOED.jl]: from .3 to .7."""
        parts = followed({"x": "p * x"}, {"p": "-2 1/s"}, {"x": 1.0}, seconds=1.0, samples=1000).divided(10)
        criterion = E(scaling="none")
        budgets = budgets_of(parts, 0.4)
        found = best_weights(criterion, parts, budgets)
        middles = [one.time for one, weight in zip(parts.readings, found.values, strict=True) if weight > 0.5]
        assert middles == pytest.approx([0.35, 0.45, 0.55, 0.65])
        assert found.value == pytest.approx(0.0128135, rel=1e-4)
        assert weight_bound(criterion, parts, found.values, found.gradient, budgets) == pytest.approx(
            found.value, rel=1e-8
        )

    @pytest.mark.slow
    def test_prey_and_predators_that_are_counted_for_a_third_of_the_time_each(self):
        """Lotka and Volterra without fishing, p2 and p4 unknown [Sager, Sampling decisions in optimum
        experimental design in the light of Pontryagin's maximum principle, 2013].
        """
        parts = followed(
            {"prey": "p1 * prey - p2 * prey * hunters", "hunters": "p4 * prey * hunters - p3 * hunters"},
            dict.fromkeys(("p1", "p2", "p3", "p4"), "1 1/s"),
            {"prey": 0.5, "hunters": 0.7},
            seconds=12.0,
            samples=2400,
            estimate=("p2", "p4"),
        )
        criterion = A(scaling="none")
        budgets = budgets_of(parts, {"rates": 4.0, "rates_2": 4.0})
        found = best_weights(criterion, parts, budgets)
        assert -found.value == pytest.approx(0.063957, rel=1e-4)
        bound = weight_bound(criterion, parts, found.values, found.gradient, budgets)
        assert found.value <= bound + 1e-12
        assert found.value / bound - 1 < 1e-6
        # Each is measured all the time or not at all, but where it begins and ends.
        assert np.count_nonzero((found.values > 0.01) & (found.values < 0.99)) < 10


def followed(
    derivatives: dict[str, str],
    parameters: dict[str, str],
    start: dict[str, float],
    seconds: float,
    samples: int,
    **parts: object,
) -> Parts:
    """A system that nobody drives, each of its states read by itself with a noise of 1."""
    system = Equations(
        states=dict.fromkeys(derivatives, ""),
        derivatives=derivatives,
        parameters=parameters,
        inputs={"idle": ""},
        outputs={name: name for name in derivatives},
        substeps=1,
    )
    space = oed.SignalSpace(
        duration=seconds, samples=samples, spline=oed.Spline(degree=0, coefficients=1), rest_to_rest=False
    ).model_copy(update={"start": tuple(start.values())})
    problem = oed.Problem(
        model=system,
        design=space,
        measurement=[Rates(noise={name: 1.0}) for name in derivatives],
        limits=[InputRange(input="idle", range=(0, 1))],
        criterion=D(scaling="none"),
        **parts,
    )
    return parts_of(problem, space.trajectory(np.zeros((1, 1)), [list(start.values())]))


@pytest.mark.slow
class TestCertificates:
    @pytest.mark.parametrize("criterion", CRITERIA, ids="EDA")
    @pytest.mark.parametrize("study", ["laser_tracker", "gyro_and_position"])
    def test_of_k_of_n_readings_are_tight(self, study: str, criterion: Criterion):
        parts, found = tracked(study), twenty(study, criterion)
        bound = weight_bound(criterion, parts, found.values, found.gradient, budgets_of(parts, 20.0))
        assert abs(criterion.efficiency(found.value, bound, parts.judged) - 1) < 1e-6
        # Readings above the threshold count in full, those below it not at all.
        switching = directional_derivatives(parts, found.values, found.gradient)
        full, none = switching[found.values > 0.999], switching[found.values < 0.001]
        assert full.min() > none.max() * (1 - 1e-4)

    @pytest.mark.parametrize("criterion", CRITERIA, ids="EDA")
    def test_no_weights_are_better_wherever_the_plane_touches(self, criterion: Criterion):
        parts, rng = tracked("laser_tracker"), np.random.default_rng(0)
        best = twenty("laser_tracker", criterion).value
        for _ in range(20):
            touched, other = (_random_weights(rng, len(parts.readings), 20.0) for _ in range(2))
            gradient = criterion.supergradient(parts.information(touched))
            bound = weight_bound(criterion, parts, touched, gradient, budgets_of(parts, 20.0))
            value = float(criterion.value([parts.information(other)]))
            assert max(value, best) <= bound + 1e-9 * abs(bound)

    @pytest.mark.parametrize("criterion", CRITERIA, ids="EDA")
    def test_whole_readings_are_nearly_as_good(self, criterion: Criterion):
        parts, found = tracked("laser_tracker"), twenty("laser_tracker", criterion)
        chosen = whole_weights(criterion, parts, found.values, budgets_of(parts, 20.0))
        assert sorted(set(chosen.values)) == [0, 1]
        assert chosen.values.sum() == 20
        bound = weight_bound(criterion, parts, found.values, found.gradient, budgets_of(parts, 20.0))
        assert 0.99 < criterion.efficiency(chosen.value, bound, parts.judged) <= 1 + 1e-9
        # Twenty readings spread evenly say less.
        even = np.zeros(len(parts.readings))
        even[np.linspace(0, len(even) - 1, 20).astype(int)] = 1
        assert criterion.value([parts.information(even)]) < chosen.value


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "taken"),
    [(5, [1, 3, 1]), (10, [2, 6, 2]), (4, None)],
    ids=["as the weights", "twice as the weights", "nearly as the weights"],
)
def test_trials_may_be_repeated(count: int, taken: list[int] | None):
    """So many readings of a parabola: whole multiples of 1/5, 3/5, 1/5 are optimal."""
    criterion, parts = E(scaling="none"), quadratic()
    budgets = budgets_of(parts, float(count), most=float(count))
    found = best_weights(criterion, parts, budgets)
    chosen = whole_weights(criterion, parts, found.values, budgets)
    bound = weight_bound(criterion, parts, found.values, found.gradient, budgets)
    assert chosen.values.sum() == count
    if taken is None:
        assert 0.9 < chosen.value / bound < 1
    else:
        assert chosen.values[chosen.values > 0].tolist() == taken
        assert chosen.value == pytest.approx(bound, rel=1e-7)


def test_half_a_reading_is_none():
    with pytest.raises(UserMistake, match=r"expected whole numbers of readings, got 2\.5"):
        whole_weights(CRITERIA[1], quadratic(), np.zeros(41), budgets_of(quadratic(), 2.5))


def test_every_sensor_has_a_total():
    with pytest.raises(UserMistake, match="totals: expected one of each of responses, got outputs"):
        budgets_of(quadratic(), {"outputs": 1.0})


def _random_weights(rng: np.random.Generator, count: int, total: float) -> np.ndarray:
    weights = np.zeros(count)
    weights[rng.permutation(count)[: int(total)]] = 1.0
    return 0.5 * weights + 0.5 * total / count


@pytest.mark.parametrize("total", [0.0, -1.0, 42.0])
def test_totals_that_no_weights_have(total: float):
    with pytest.raises(UserMistake, match="expected a total above 0 and at most 41"):
        budgets_of(quadratic(), total)


def test_criteria_that_are_not_concave():
    with pytest.raises(UserMistake, match="modified_E is not concave"):
        best_weights(ModifiedE(), quadratic(), budgets_of(quadratic(), 1.0))


TRIALS = """
format: 1
name: Where every trial begins nobody knows
system:
  kind: equations
  states: {x: {unknown: 2 kmol/m^3}, y: {unknown: 0.003 mmol/m^3}}
  inputs: {u: mol/m^3/s}
  parameters: {k: 0.7 1/s, b: 0.5, r: 1e-9 1/s}
  derivatives: {x: b * u - k * x, y: r * x - k * y}
  outputs: {x: x, y: y}
experiment:
  duration: 3 s
  samples: 6
  candidates: {grid: {u: {least: 0 mol/m^3/s, largest: 3 kmol/m^3/s, count: 7}}}
measurement: {kind: outputs, noise: {x: 10 mol/m^3, y: 0.05 umol/m^3}}
criterion: D
weights: {total: 3, of: trials}
"""


@pytest.mark.slow
def test_units_of_what_is_eliminated_are_of_no_matter():
    problem = oed.parse_study(TRIALS, "trials.yaml").problem
    found = select(problem, problem.design.only)
    assert (len(found.parts.readings), found.parts.rows.shape[1]) == (7, 17)
    assert found.chosen.value == pytest.approx(found.bound, rel=1e-7)
    weights = found.parts.of_every_reading(found.chosen.values)
    scored = oed.evaluate(problem, replace(problem.design.only, weights=weights)).objective
    assert found.chosen.value == pytest.approx(scored, rel=1e-7)


@pytest.mark.slow
def test_whole_readings_that_say_nothing_are_exchanged_for_others():
    """Two points do not tell a parabola's three parameters."""
    parts, budgets = quadratic(), budgets_of(quadratic(), 3.0, most=2.0)
    for criterion in CRITERIA[1:]:
        near = np.zeros(len(POINTS))
        near[0], near[20] = 2.0, 1.0
        found = whole_weights(criterion, parts, near, budgets)
        assert np.flatnonzero(found.values).tolist() == [0, 20, 40]
        assert np.isfinite(found.value)


APART = """
format: 1
name: Starts that are nearly the offset
system:
  kind: equations
  states: {{x: {{unknown: 1}}, q: {{unknown: 0}}}}
  inputs: {{u: 1/s}}
  parameters: {{slow: {slow} 1/s, offset: 1, k: 1}}
  derivatives: {{x: -slow * x, q: u}}
  outputs: {{y: x + offset + k * q}}
experiment:
  duration: 8 s
  samples: 8
  trials: {trials}
  inputs: {{u: [-5 1/s, 5 1/s]}}
measurement: {{kind: outputs, noise: {{y: 0.1}}}}
estimate: [offset, k]
criterion: {{kind: {kind}, subset: [k], scaling: none}}
weights: {{total: {total}}}
"""


@pytest.mark.parametrize("kind", "EDA")
@pytest.mark.parametrize("trials", [1, 2])
@pytest.mark.parametrize("slow", [1e-2, 1e-5, 1e-7])
def test_nuisances_of_trials_that_nearly_depend_on_common_ones(slow: float, trials: int, kind: str):
    """Starts of different trials share no reading, and each is nearly the offset: searches ended with up to
    59 % less information, or with more than all readings have.
    """
    text = APART.format(slow=slow, trials=trials, kind=kind, total=4.0 * trials)
    problem = oed.parse_study(text, "apart.yaml").problem
    held = np.random.default_rng(0).normal(size=(8 * trials, 1))
    space = problem.design
    drive = space.trajectory(held[: space.all_coefficients], np.tile([1.0, 0.0], (trials, 1)))
    found = select(problem, drive)
    assert found.chosen.value == pytest.approx(found.bound, rel=1e-7)
    weights = found.parts.of_every_reading(found.chosen.values)
    scored = oed.evaluate(problem, replace(drive, weights=weights)).objective
    assert found.chosen.value == pytest.approx(scored, rel=1e-7)


@pytest.mark.parametrize("criterion", CRITERIA, ids=lambda criterion: criterion.kind)
@pytest.mark.parametrize("unknowns", [2, 3, 4])
def test_readings_that_are_alike_are_as_good_in_any_shares(criterion: Criterion, unknowns: int):
    rows = np.random.default_rng(unknowns).normal(size=(6, unknowns))
    alike = Parts(
        readings=tuple(Reading("y", run, 0.0) for run in range(2)),
        rows=np.vstack([rows, rows]),
        places=np.repeat([0, 1], len(rows)),
        known_rows=np.zeros((0, unknowns)),
        judged=unknowns,
        sizes=np.ones(2),
        members=((0,), (1,)),
    )
    budgets = budgets_of(alike, 1.2)
    best = best_weights(criterion, alike, budgets)
    assert best.values.sum() == pytest.approx(1.2)
    bound = weight_bound(criterion, alike, best.values, best.gradient, budgets)
    assert best.value == pytest.approx(criterion.judge([SquareRoot.of_rows(np.sqrt(1.2) * rows)]), rel=1e-9)
    assert bound == pytest.approx(best.value, rel=1e-9)


@pytest.mark.slow
def test_a_nuisance_that_nothing_sees_changes_nothing():
    output = "curvature * x^2 + constant + slope * (1 + x * 1e-6)"
    parts = quadratic(output, ("curvature",), unseen="1")
    assert parts.rows.shape == quadratic(output, ("curvature",)).rows.shape
    found = best_weights(D(scaling="none"), parts, budgets_of(parts, 1.0))
    assert found.value == pytest.approx(np.log(1 / 4), rel=1e-6)


@pytest.mark.slow
def test_no_plane_bounds_weights_that_leave_something_undetermined():
    """It was a bound of 0, and proved what was wrong."""
    parts, one = quadratic(), budgets_of(quadratic(), 1.0)
    lonely = np.zeros(len(POINTS))
    lonely[0] = 1.0
    for criterion in CRITERIA:
        for gradient in (np.zeros((3, 3)), np.full((3, 3), np.nan), np.diag([1.0, 1.0, np.nan])):
            assert weight_bound(criterion, parts, lonely, gradient, one) == np.inf
        np.testing.assert_array_equal(whole_weights(criterion, parts, lonely, one).gradient, np.zeros((3, 3)))


@pytest.mark.parametrize("criterion", CRITERIA, ids="EDA")
def test_where_all_readings_are_taken_there_is_no_gap(criterion: Criterion):
    """Multipliers of a search that had nothing to choose left one of 5 %, and weights above the largest."""
    rows = np.random.default_rng(3).normal(size=(25, 4)) @ np.diag([1.0, 1e-2, 1e2, 1.0])
    parts = replace(
        quadratic(),
        readings=quadratic().readings[:25],
        sizes=np.ones(25),
        members=tuple((one,) for one in range(25)),
        rows=rows,
        places=np.arange(25),
        known_rows=np.zeros((0, 4)),
        judged=4,
        rounding=(),
    )
    budgets = budgets_of(parts, 25.0)
    found = best_weights(criterion, parts, budgets)
    assert found.values == pytest.approx(np.ones(25), abs=1e-12)
    assert found.values.max() <= 1
    bound = weight_bound(criterion, parts, found.values, found.gradient, budgets)
    assert found.value == pytest.approx(bound, rel=1e-9)


def regression(rows: np.ndarray) -> Parts:
    """Readings of a linear model."""
    count, size = rows.shape
    return replace(
        quadratic(),
        readings=(quadratic().readings[0],) * count,
        sizes=np.ones(count),
        members=tuple((place,) for place in range(count)),
        rows=rows,
        places=np.arange(count),
        known_rows=np.zeros((0, size)),
        judged=size,
        rounding=(),
    )


@pytest.mark.parametrize("criterion", CRITERIA, ids="EDA")
def test_weights_of_many_candidates_that_differ_little_are_best(criterion: Criterion):
    """Times at which a decay may be read: the search by E ended with less than half of what is possible."""
    times = np.linspace(0.0, 60.0, 600)
    rows = np.stack([times * np.exp(-0.06 * times), times * np.exp(-4.3 * times), np.exp(-0.06 * times)], 1)
    parts = regression(rows * [20.0, 80.0, 20.0])
    budgets = budgets_of(parts, 3.0, most=3.0)
    best = best_weights(criterion, parts, budgets)
    bound = weight_bound(criterion, parts, best.values, best.gradient, budgets)
    assert 0 <= criterion.change(bound, best.value, 3) < 1e-8


def test_few_of_many_candidates_that_say_the_same_are_taken():
    """All 32 corners of a cube are best together; so are few of them, which somebody can carry out."""
    corners = np.array(list(product([-1.0, 0.0, 1.0], repeat=5)))
    rows = np.hstack([np.ones((len(corners), 1)), corners])
    size, parts = rows.shape[1], regression(rows)
    found = best_weights(CRITERIA[1], parts, budgets_of(parts, 1.0))
    assert found.value == pytest.approx(0.0, abs=1e-9)
    assert np.count_nonzero(found.values > 1e-6) <= size * (size + 1) // 2 + 1
