"""The assembled nonlinear program, before and apart from any search."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import oracle
import pytest
from builders import ACCELERATION, BOX, RADIUS, SPEED, TRACK, problem_of, random_drive

from oed.kernel.dynamics.space import Spline
from oed.kernel.evaluation import evaluate
from oed.optimize.exchange import Exchange
from oed.optimize.ipopt import Ipopt
from oed.optimize.local import LocalSearch
from oed.optimize.terms.instants import LINEAR_WEIGHT
from oed.optimize.transcription import program
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.program import IpoptOutcome, Program
from oed.robots.limits import PathLength, Rectangle, WheelSpeed, YawRate
from oed.robots.models import SkidSteer
from oed.robots.sensors import Displacements
from oed.robots.space import DesignSpace

SPACE = {"duration": 6, "samples": 24, "spline": Spline(coefficients=7)}

VARIANTS = {
    "fixed start": {},
    "free start": {"design": DesignSpace(**SPACE, start="free")},
    "free start, no rest": {"design": DesignSpace(**SPACE, start="free", rest_to_rest=False)},
    "midpoint": {"design": DesignSpace(**SPACE, integration="midpoint")},
    "both regressors": {"measurement": Displacements(segments=4, regressor="both")},
    "per sample": {"measurement": Displacements(segments="samples")},
    "slip": {"model": SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=0.1, slip_inner=-0.05)},
    "uneven limits": {"limits": (WheelSpeed(bounds=(-2, 8)), ACCELERATION, BOX)},
}
variants = pytest.mark.parametrize("overrides", VARIANTS.values(), ids=VARIANTS.keys())


def make_design(overrides: dict) -> DesignExpressions:
    return DesignExpressions(problem_of(**{"design": DesignSpace(**SPACE), **overrides}))


def random_unknowns(design: DesignExpressions, seed: int = 0, share: float = 0.5) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-share, share, design.terms.size)


def stacked(design: DesignExpressions) -> tuple[ca.Function, ca.Function]:
    """All matrices and limit rows of z, and their Jacobian."""
    drive = design.terms.drive
    matrices = [ca.vec(one.matrix) for one in design.problem.estimations(drive)]
    everything = ca.vertcat(*matrices, *(rows.expression for rows in design.problem.limit_rows(drive)))
    values = ca.Function("values", [design.terms.unknowns], [everything])
    return values, ca.Function(
        "jacobian", [design.terms.unknowns], [ca.jacobian(everything, design.terms.unknowns)]
    )


@variants
@pytest.mark.slow
def test_jacobian_is_the_finite_difference(overrides):
    design = make_design(overrides)
    values, jacobian = stacked(design)
    point = random_unknowns(design)
    expected = oracle.central_difference(lambda z: np.array(values(z)), point, 1e-5)
    np.testing.assert_allclose(np.array(jacobian(point)), expected, rtol=1e-5, atol=1e-6)


@variants
def test_gradient_of_the_scored_criterion_is_the_finite_difference(overrides):
    design = make_design(overrides)
    weight = np.array([[1.0, 0.3], [0.3, 2.0]])
    matrices = [one.matrix for one in design.problem.estimations(design.terms.drive)]
    merit = sum(ca.trace(ca.DM(weight) @ matrix) for matrix in matrices)
    function = ca.Function("merit", [design.terms.unknowns], [merit])
    gradient = ca.Function("gradient", [design.terms.unknowns], [ca.gradient(merit, design.terms.unknowns)])
    point = random_unknowns(design, 1)
    expected = oracle.central_difference(lambda z: np.array(function(z)), point, 1e-5).ravel()
    np.testing.assert_allclose(np.array(gradient(point)).ravel(), expected, rtol=1e-6, atol=1e-6)


@variants
@pytest.mark.parametrize("share", [0.3, 2.0])
def test_the_program_says_what_evaluate_says(overrides, share: float):
    design = make_design(overrides)
    point = random_unknowns(design, 2, share)
    evaluation = evaluate(design.problem, design.trajectory(point))
    _, excess = design.score_many(point[None, :])
    violations = np.maximum(0.0, excess)
    for matrix, name in zip(design.matrices_of(point)[0], evaluation.information, strict=True):
        np.testing.assert_allclose(matrix, evaluation.information[name], rtol=1e-10, atol=1e-10)
    # Coefficients bound the curve, so speeds count for more here; positions are seen at the samples only.
    named = {margin.name: margin.violation / margin.size for margin in evaluation.margins}
    for limit, violation in zip(design.problem.limits, violations[0], strict=True):
        if limit.name == "workspace":
            assert violation <= named[limit.name] + 1e-12
        else:
            assert violation >= named[limit.name] - 1e-12


@variants
def test_a_drive_and_its_unknowns_are_one_to_one(overrides):
    design = make_design(overrides)
    point = random_unknowns(design, 3)
    drive = design.trajectory(point)
    np.testing.assert_allclose(design.unknowns_of(drive), point, rtol=0, atol=1e-14)
    assert evaluate(design.problem, drive).violations.keys().isdisjoint({"duration", "start", "rest_to_rest"})
    again = design.trajectory(design.unknowns_of(drive))
    np.testing.assert_array_equal(again.coefficients, drive.coefficients)


def test_unknowns_of_another_spline_are_refused():
    design = make_design({})
    other = problem_of(duration=6, samples=24, spline=Spline(degree=2, coefficients=7))
    with pytest.raises(ValueError, match="not those of the design space"):
        design.unknowns_of(random_drive(other, 0))


@variants
def test_many_candidates_score_as_each_does(overrides):
    design = make_design(overrides)
    candidates = np.array([random_unknowns(design, seed) for seed in range(5)])
    values, excess = design.score_many(candidates)
    for candidate, value, beyond in zip(candidates, values, excess, strict=True):
        _, single = design.terms.scored(candidate[None])
        expected = design.problem.criterion.value(design.matrices_of(candidate)[0])
        assert value == pytest.approx(float(expected), rel=1e-12)
        np.testing.assert_allclose(beyond, np.array(single).ravel(), rtol=1e-12)
    assert 0 < design.scale < np.inf


def test_speeds_and_accelerations_are_linear_and_positions_are_not():
    design = make_design({})
    assert design.terms.linear[:2] == [True, True]
    np.testing.assert_array_equal(design.terms.instants.weight, 1.0)
    turning = make_design({"limits": (SPEED, YawRate(bounds=1))})
    np.testing.assert_array_equal(turning.terms.instants.weight, LINEAR_WEIGHT)


def test_rows_that_rest_fixes_are_left_out():
    moved = make_design({"design": DesignSpace(**SPACE, rest_to_rest=False)})
    rest = make_design({})
    assert len(moved.terms.rows[0].lower) == 14
    assert len(rest.terms.rows[0].lower) == 10


class TestProgram:
    """A program whose optimum is known: drive as far along x as is allowed."""

    limits = (SPEED, PathLength(bounds=1))

    def program(self, sign: int = 1, floors: bool = False, limits=limits) -> tuple[Program, ca.Function]:
        design = make_design({"limits": limits})
        reached = design.terms.drive.poses[-1, 0]
        nothing = ca.SX(0, 1)
        program = Program(
            design,
            objective=sign * reached - 1e-9 * ca.sumsqr(design.terms.unknowns),
            auxiliary=nothing,
            equalities=nothing,
            floors=reached if floors else nothing,
        )
        return program, ca.Function("reached", [design.terms.unknowns], [reached])

    @pytest.mark.parametrize("backoff", [0.0, 0.1])
    @pytest.mark.slow
    def test_backoff_tightens_a_limit_by_its_share(self, backoff: float):
        program, reached = self.program()
        start = np.full(program.design.terms.size, 0.1)
        outcome = program.solve(start, np.zeros(0), backoff=np.array([0.0, backoff]))
        assert outcome.return_status == "Solve_Succeeded"
        assert float(reached(outcome.unknowns)) == pytest.approx(1 - backoff, abs=1e-3)

    @pytest.mark.slow
    def test_floors_are_kept(self):
        program, reached = self.program(sign=-1, floors=True)
        outcome = program.solve(np.full(program.design.terms.size, 0.1), np.zeros(0), floors=np.array([0.4]))
        assert outcome.return_status == "Solve_Succeeded"
        assert float(reached(outcome.unknowns)) == pytest.approx(0.4, abs=1e-5)

    @pytest.mark.slow
    def test_no_limit_is_exceeded_at_the_instants_chosen(self):
        program, reached = self.program(limits=(SPEED, BOX))
        terms, start = program.design.terms, np.full(program.design.terms.size, 0.1)
        exchange = Exchange(program.design.problem, terms)
        begun = exchange.first_instants()
        chosen = exchange.chosen_rows(begun, program.design.trajectory(start))
        none = np.full(len(chosen), np.inf)
        free = program.solve(start, np.zeros(0), chosen=replace(chosen, lower=-none, upper=none))
        outcome = program.solve(start, np.zeros(0), chosen=chosen)
        far, near = (program.design.trajectory(one.unknowns) for one in (free, outcome))
        assert exchange.lower_level.violations(begun, far).max() > 0.1
        assert exchange.lower_level.violations(begun, near).max() <= 1e-7
        assert float(reached(outcome.unknowns)) == pytest.approx(1, abs=1e-5)


class TestGoingOn:
    """Solves that go on from the multipliers of the one before."""

    @pytest.fixture
    def search(self) -> LocalSearch:
        room = Rectangle(x=(-0.3, 0.3), y=(-0.3, 0.3))
        problem = problem_of(design=DesignSpace(**SPACE), limits=(SPEED, ACCELERATION, room))
        return LocalSearch(problem, Ipopt(max_iterations=300))

    @pytest.mark.slow
    def test_multipliers_that_mislead_are_forgotten(self, search: LocalSearch, monkeypatch):
        monkeypatch.setattr(program, "WARM_ITERATIONS", 1)
        again, alone = self._solved(search)
        assert again.succeeded
        np.testing.assert_array_equal(again.unknowns, alone.unknowns)
        assert again.iterations == alone.iterations + 1

    @pytest.mark.slow
    def test_good_ones_save_some_of_the_way(self, search: LocalSearch):
        both = [self._solved(search, seed) for seed in (4, 6)]
        assert all(again.succeeded for again, _ in both)
        assert sum(again.iterations for again, _ in both) < sum(alone.iterations for _, alone in both)

    def _solved(self, search: LocalSearch, seed: int = 4) -> list[IpoptOutcome]:
        """Solves with more instants from the end of one with few: with its multipliers, and without."""
        begin, nothing = random_unknowns(search.design, seed, 0.1), search.grid.no_correction
        few, exchange = search.exchange.first_instants(), search.exchange
        few = few.some(few.time == search.problem.design.duration)
        chosen = exchange.chosen_rows(few, search.grid.trajectory(begin))
        first = search.solve(search.program, begin, nothing, chosen=chosen)
        drive = search.grid.trajectory(first.unknowns)
        more = few.joined(exchange.more(few, drive))
        assert len(more) > len(few)
        chosen = exchange.chosen_rows(more, drive)
        return [
            search.solve(search.program, first.unknowns, nothing, after=way, chosen=chosen)
            for way in (first, None)
        ]
