"""Criteria: their values, their laws, and the smooth form an optimiser maximises."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import Annotated

import casadi as ca
import numpy as np
import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from oed.foundation.component import OneOf
from oed.foundation.errors import PartError
from oed.kernel.criteria import CRITERIA, A, Criterion, D, E, G, I, Leg, ModifiedE, Subject
from oed.kernel.criteria.criterion import multipliers_of
from oed.kernel.criteria.prediction import Prediction
from oed.kernel.equivalence import root_of
from oed.robots.models import DifferentialDrive

ROBOT = DifferentialDrive(wheel_radius_right=0.051, wheel_radius_left=0.047, track=0.18)
LEGS = (
    Leg(inputs=(5, 4), duration=2),
    Leg(inputs=(-3, 6), duration=1.5),
    Leg(inputs=(2, 2), duration=4),
)

EXAMPLES: dict[type[Criterion], Criterion] = {
    E: E(),
    D: D(),
    A: A(),
    ModifiedE: ModifiedE(),
    G: G(test_drive=LEGS),
    I: I(test_drive=LEGS, quantity="heading"),
}
"""One instance of every listed criterion; a new one obeys the laws below by being added here."""

criteria = pytest.mark.parametrize("kind", CRITERIA, ids=lambda kind: kind.__name__)
monotone = pytest.mark.parametrize(
    "kind", [kind for kind in CRITERIA if kind is not ModifiedE], ids=lambda kind: kind.__name__
)
predictions = pytest.mark.parametrize("kind", [G, I])
seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 3)
block_counts = st.integers(1, 3)


@cache
def example(kind: type[Criterion], size: int, blocks: int = 1) -> Criterion:
    """The example, told that every block is about the first `size` parameters of the robot."""
    parameters = ROBOT.parameters[:size]
    subject = Subject(
        system=ROBOT,
        parameters=(tuple(each.name for each in parameters),) * blocks,
        scales=(np.array([each.nominal for each in parameters]),) * blocks,
    )
    return EXAMPLES[kind].about(subject)


def random_information(rng: np.random.Generator, size: int, rows: int | None = None) -> np.ndarray:
    design = rng.standard_normal((size + 2 if rows is None else rows, size)) * 10 ** rng.uniform(-2, 2)
    return design.T @ design


def random_rotation(rng: np.random.Generator, size: int) -> np.ndarray:
    return np.linalg.qr(rng.standard_normal((size, size)))[0]


def moderate_information(rng: np.random.Generator, size: int) -> np.ndarray:
    """A matrix with eigenvalues from 1 to 100, as an optimiser meets it after scaling."""
    rotation = random_rotation(rng, size)
    return rotation @ np.diag(10 ** rng.uniform(0, 2, size)) @ rotation.T


def moderate_blocks(seed: int, size: int, blocks: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [moderate_information(rng, size) for _ in range(blocks)]


def value(criterion: Criterion, matrices: Sequence[np.ndarray]) -> float:
    return float(criterion.value(matrices))


def transformed(criterion: Criterion, changes: Sequence[np.ndarray]) -> Criterion:
    """The criterion for parameters q with p = T q, one T for each block."""
    if not isinstance(criterion, Prediction):
        return criterion
    rows = [(np.array(block) @ T).tolist() for block, T in zip(criterion.rows, changes, strict=True)]
    return criterion.with_rows(rows)


def epigraph_values(criterion: Criterion, matrices: list[np.ndarray]) -> tuple[float, np.ndarray, float]:
    """Objective and equalities of the epigraph at its own initial point, and the size of their terms."""
    epigraph = criterion.epigraph([ca.SX(ca.DM(matrix)) for matrix in matrices])
    function = ca.Function("epigraph", [epigraph.variables], [epigraph.objective, epigraph.equalities])
    initial = epigraph.initial(matrices)
    objective, equalities = function(initial)
    # Equalities are quadratic in the factors, linear in the matrices.
    terms = 1 + max(np.abs(initial).max() ** 2, *map(np.trace, matrices))
    return float(objective), np.array(equalities).ravel(), terms


def test_every_listed_criterion_has_an_example():
    assert set(EXAMPLES) == set(CRITERIA)


class TestEveryCriterion:
    """Laws of values."""

    @criteria
    @given(seed=seeds, size=sizes, blocks=block_counts)
    def test_values_of_stacks_are_the_values_one_by_one(self, kind, seed: int, size: int, blocks: int):
        rng, criterion = np.random.default_rng(seed), example(kind, size, blocks)
        stacks = [np.array([random_information(rng, size) for _ in range(4)]) for _ in range(blocks)]
        stacks[0][2] = 0.0
        together = criterion.value(stacks)
        single = [value(criterion, [stack[index] for stack in stacks]) for index in range(4)]
        assert together.shape == (4,)
        np.testing.assert_allclose(together, single, rtol=1e-12, atol=1e-15)

    @criteria
    @given(seed=seeds, size=st.integers(2, 3), rows=st.integers(0, 1))
    def test_singular_information_has_a_value_or_minus_infinity(self, kind, seed: int, size: int, rows: int):
        rng, criterion = np.random.default_rng(seed), example(kind, size)
        singular = random_information(rng, size, rows=rows)
        found = value(criterion, [singular])
        assert found < math.inf  # neither infinity nor NaN
        assert found <= value(criterion, [singular + np.trace(singular) * np.eye(size)])

    @criteria
    @given(seed=seeds, size=sizes, blocks=block_counts)
    def test_rotating_the_parameters_changes_nothing(self, kind, seed: int, size: int, blocks: int):
        rng, criterion = np.random.default_rng(seed), example(kind, size, blocks)
        matrices = [moderate_information(rng, size) for _ in range(blocks)]
        turns = [random_rotation(rng, size) for _ in range(blocks)]
        turned = [Q.T @ F @ Q for Q, F in zip(turns, matrices, strict=True)]
        found = value(transformed(criterion, turns), turned)
        assert found == pytest.approx(value(criterion, matrices), rel=1e-10, abs=1e-10)

    @monotone
    @given(seed=seeds, size=sizes, blocks=block_counts, which=st.integers(0, 2))
    def test_more_information_is_never_worse(self, kind, seed: int, size: int, blocks: int, which: int):
        rng, criterion = np.random.default_rng(seed), example(kind, size, blocks)
        matrices = [moderate_information(rng, size) for _ in range(blocks)]
        before = value(criterion, matrices)
        matrices[which % blocks] = matrices[which % blocks] + random_information(rng, size, rows=1)
        assert value(criterion, matrices) >= before - 1e-10 * abs(before)

    @criteria
    @pytest.mark.parametrize("blocks", [1, 2])
    def test_efficiency_counts_repetitions(self, kind, blocks: int):
        for size, times in product([1, 2, 3], [2, 7]):
            criterion, matrices = example(kind, size, blocks), moderate_blocks(size, size, blocks)
            once = value(criterion, matrices)
            repeated = value(criterion, [times * matrix for matrix in matrices])
            found = criterion.efficiency(repeated, once, size * blocks)
            if found is None:
                assert repeated == pytest.approx(once, rel=1e-12), (size, times)
            else:
                assert found == pytest.approx(times, rel=1e-10), (size, times)
                assert criterion.efficiency(once, once, size * blocks) == pytest.approx(1), (size, times)

    @monotone
    def test_a_design_that_tells_nothing_has_no_efficiency(self, kind):
        criterion, (matrix,) = example(kind, 2), moderate_blocks(0, 2, 1)
        nothing = value(criterion, [np.zeros((2, 2))])
        assert criterion.efficiency(nothing, value(criterion, [matrix]), 2) == 0
        assert criterion.efficiency(nothing, nothing, 2) is None

    @criteria
    @given(before=st.floats(-1e6, 1e6), share=st.floats(0.5, 1))
    def test_conceding_lowers_the_value(self, kind, before: float, share: float):
        criterion = EXAMPLES[kind]
        assert criterion.concede(before, share) <= before
        assert criterion.concede(before, share) >= criterion.concede(before, 0.9 * share)
        assert criterion.concede(before, 1.0) == before

    @criteria
    def test_options_are_checked(self, kind):
        criterion = EXAMPLES[kind]
        given = criterion.model_dump()
        assert criterion.scaling == "relative"
        with pytest.raises(PartError, match="weight"):
            kind(**given, weight=1)
        with pytest.raises(PartError, match="scaling"):
            kind(**{**given, "scaling": "absolute"})

    @criteria
    def test_the_kind_in_a_study_is_the_class(self, kind):
        anyone = TypeAdapter(Annotated[Criterion, OneOf(CRITERIA)])
        assert anyone.validate_python(example(kind, 2).model_dump(mode="json")) == EXAMPLES[kind]

    @criteria
    def test_told_its_subject_it_can_still_be_a_key(self, kind):
        assert {example(kind, 2): 1}[example(kind, 2)] == 1


class TestEveryEpigraph:
    """The smooth form maximises the value."""

    @criteria
    @given(seed=seeds, size=sizes, blocks=block_counts)
    @pytest.mark.slow
    def test_it_begins_consistent(self, kind, seed: int, size: int, blocks: int):
        criterion, matrices = example(kind, size, blocks), moderate_blocks(seed, size, blocks)
        objective, equalities, terms = epigraph_values(criterion, matrices)
        assert np.abs(equalities).max() <= 1e-5 * terms
        reached = value(criterion, matrices)
        assert objective <= reached + 1e-6 * abs(reached)

    @criteria
    @given(seed=seeds, size=sizes, rows=st.integers(0, 2))
    def test_it_begins_at_singular_and_badly_scaled_matrices_too(self, kind, seed: int, size: int, rows: int):
        matrix = random_information(np.random.default_rng(seed), size, rows=rows)
        objective, equalities, terms = epigraph_values(example(kind, size), [matrix])
        assert np.isfinite(objective)
        if kind is ModifiedE:
            # It keeps away from drives that tell next to nothing: those it cannot begin at, only near them.
            assert np.all(np.isfinite(equalities))
        else:
            assert np.abs(equalities).max() <= 1e-5 * terms

    @criteria
    @pytest.mark.parametrize(("size", "blocks"), [(1, 1), (3, 1), (2, 2), (3, 2)])
    @pytest.mark.slow
    def test_its_maximum_is_the_criterion(self, kind, size: int, blocks: int):
        criterion, matrices = example(kind, size, blocks), moderate_blocks(size, size, blocks)
        epigraph = criterion.epigraph([ca.SX(ca.DM(matrix)) for matrix in matrices])
        program = {"x": epigraph.variables, "f": -epigraph.objective, "g": epigraph.equalities}
        options = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
        solver = ca.nlpsol("p", "ipopt", program, options)
        found = solver(x0=epigraph.initial(matrices), lbg=0, ubg=0)
        assert -float(found["f"]) == pytest.approx(value(criterion, matrices), rel=1e-6)

    @criteria
    @pytest.mark.parametrize("blocks", [1, 2])
    def test_its_derivatives_are_exact(self, kind, blocks: int):
        criterion, matrices = example(kind, 3, blocks), moderate_blocks(9, 3, blocks)
        symbols = [ca.SX.sym("F", 3, 3) for _ in matrices]
        epigraph = criterion.epigraph(symbols)
        unknowns = ca.vertcat(epigraph.variables, *map(ca.vec, symbols))
        outputs = ca.vertcat(epigraph.objective, epigraph.equalities)
        function = ca.Function("outputs", [unknowns], [outputs, ca.jacobian(outputs, unknowns)])
        point = np.concatenate([epigraph.initial(matrices), *(matrix.ravel() for matrix in matrices)])
        exact = np.array(function(point)[1])
        differences = oracle.central_difference(lambda x: np.array(function(x)[0]), point)
        np.testing.assert_allclose(exact, differences, rtol=1e-6, atol=1e-7 * np.abs(exact).max())


class TestE:
    """E-optimality is the smallest eigenvalue over all blocks."""

    criterion = E(scaling="none")

    @given(seed=seeds, size=st.integers(1, 5), blocks=block_counts)
    def test_value_is_the_smallest_eigenvalue(self, seed: int, size: int, blocks: int):
        rng = np.random.default_rng(seed)
        matrices = [random_information(rng, size) for _ in range(blocks)]
        expected = min(np.linalg.svd(matrix, compute_uv=False)[-1] for matrix in matrices)
        assert value(self.criterion, matrices) == pytest.approx(expected, rel=1e-9, abs=1e-11)

    @given(seed=seeds, size=st.integers(1, 5))
    def test_value_is_the_least_information_of_any_direction(self, seed: int, size: int):
        rng = np.random.default_rng(seed)
        matrix, direction = random_information(rng, size), rng.standard_normal(size)
        quotient = direction @ matrix @ direction / (direction @ direction)
        assert value(self.criterion, [matrix]) <= quotient + 1e-9 * np.trace(matrix)

    @given(seed=seeds, size=st.integers(1, 5))
    def test_another_block_is_never_better(self, seed: int, size: int):
        rng = np.random.default_rng(seed)
        first, second = random_information(rng, size), random_information(rng, size)
        assert value(self.criterion, [first, second]) == min(
            value(self.criterion, [first]), value(self.criterion, [second])
        )

    def test_conceding_a_share_takes_it_off(self):
        assert self.criterion.concede(270.0, 0.999) == pytest.approx(270 - 0.27)
        assert self.criterion.efficiency(270 - 0.27, 270.0, 2) == pytest.approx(0.999)

    def test_nothing_compares_with_a_best_that_tells_nothing(self):
        assert self.criterion.efficiency(1.0, 0.0, 2) is None


class TestModifiedE:
    """Modified E-optimality is the condition number."""

    criterion = ModifiedE(scaling="none")

    @given(seed=seeds, size=sizes, blocks=block_counts)
    def test_value_is_the_worst_condition_number(self, seed: int, size: int, blocks: int):
        matrices = moderate_blocks(seed, size, blocks)
        assert value(self.criterion, matrices) == pytest.approx(-max(map(np.linalg.cond, matrices)), rel=1e-9)

    @given(seed=seeds, size=sizes, factors=st.lists(st.floats(1e-6, 1e6), min_size=1, max_size=3))
    def test_the_amount_of_information_does_not_matter(self, seed: int, size: int, factors: list[float]):
        matrices = moderate_blocks(seed, size, len(factors))
        scaled = [factor * matrix for factor, matrix in zip(factors, matrices, strict=True)]
        assert value(self.criterion, scaled) == pytest.approx(value(self.criterion, matrices), rel=1e-9)

    def test_singular_information_is_the_worst(self):
        assert value(self.criterion, [np.diag([1.0, 0.0])]) == -math.inf

    def test_repeating_a_design_is_no_gain(self):
        assert self.criterion.efficiency(-5.0, -4.0, 2) is None


class TestD:
    """D-optimality is the log determinant, that is minus twice the log volume of the ellipsoid."""

    criterion = D(scaling="none")

    @given(seed=seeds, size=st.integers(1, 5), blocks=block_counts)
    def test_value_is_the_sum_of_log_eigenvalues(self, seed: int, size: int, blocks: int):
        matrices = moderate_blocks(seed, size, blocks)
        expected = sum(np.log(np.linalg.eigvalsh(matrix)).sum() for matrix in matrices)
        assert value(self.criterion, matrices) == pytest.approx(expected, rel=1e-9, abs=1e-9)

    @given(seed=seeds, size=st.integers(1, 5), blocks=block_counts)
    def test_other_parameters_only_add_a_constant(self, seed: int, size: int, blocks: int):
        rng = np.random.default_rng(seed)
        matrices = [moderate_information(rng, size) for _ in range(blocks)]
        changes = [rng.standard_normal((size, size)) + 3 * np.eye(size) for _ in range(blocks)]
        changed = [T.T @ F @ T for T, F in zip(changes, matrices, strict=True)]
        constant = sum(2 * math.log(abs(np.linalg.det(T))) for T in changes)
        gained = value(self.criterion, changed) - value(self.criterion, matrices)
        assert gained == pytest.approx(constant, abs=1e-8)

    def test_conceding_a_share_takes_it_off_the_determinant(self):
        assert self.criterion.concede(math.log(8.0), 0.5) == pytest.approx(math.log(4.0))
        assert self.criterion.concede(math.log(0.8), 0.5) == pytest.approx(math.log(0.4))

    def test_singular_information_is_the_worst(self):
        assert value(self.criterion, [np.diag([1.0, 0.0])]) == -math.inf


class TestA:
    """A-optimality is minus the sum of the variances."""

    criterion = A(scaling="none")

    @given(seed=seeds, size=st.integers(1, 5), blocks=block_counts)
    def test_value_is_minus_the_sum_of_the_variances(self, seed: int, size: int, blocks: int):
        matrices = moderate_blocks(seed, size, blocks)
        expected = -sum(np.trace(np.linalg.inv(matrix)) for matrix in matrices)
        assert value(self.criterion, matrices) == pytest.approx(expected, rel=1e-9)

    @given(seed=seeds, size=st.integers(1, 5))
    def test_value_lies_between_what_e_and_d_promise(self, seed: int, size: int):
        # p / lambda_min >= tr F^-1 >= p det(F)^(-1/p), the means of the variances.
        (matrix,) = moderate_blocks(seed, size, 1)
        variances = -value(self.criterion, [matrix])
        assert variances <= size / value(E(), [matrix]) * (1 + 1e-9)
        assert variances >= size * math.exp(-value(D(), [matrix]) / size) * (1 - 1e-9)

    def test_singular_information_is_the_worst(self):
        assert value(self.criterion, [np.diag([1.0, 0.0])]) == -math.inf


class TestGAndI:
    """Predictions' variances do not depend on how the parameters are written."""

    @predictions
    @given(seed=seeds, size=sizes, blocks=block_counts)
    def test_other_parameters_change_nothing(self, kind, seed: int, size: int, blocks: int):
        rng, criterion = np.random.default_rng(seed), example(kind, size, blocks)
        matrices = [moderate_information(rng, size) for _ in range(blocks)]
        changes = [rng.standard_normal((size, size)) + 3 * np.eye(size) for _ in range(blocks)]
        changed = [T.T @ F @ T for T, F in zip(changes, matrices, strict=True)]
        found = value(transformed(criterion, changes), changed)
        assert found == pytest.approx(value(criterion, matrices), rel=1e-8)

    @given(seed=seeds, size=sizes, blocks=block_counts)
    def test_the_mean_is_at_most_the_largest(self, seed: int, size: int, blocks: int):
        mean, largest = (example(kind, size, blocks) for kind in (I, G))
        mean = mean.with_rows(largest.rows)
        matrices = moderate_blocks(seed, size, blocks)
        assert value(mean, matrices) >= value(largest, matrices)

    @predictions
    def test_one_leg_is_the_mean_and_the_largest(self, kind):
        criterion, (matrix,) = example(kind, 3), moderate_blocks(4, 3, 1)
        alone = criterion.model_copy(update={"test_drive": LEGS[:1]})
        alone = alone.with_rows([block[:1] for block in criterion.rows])
        rows = np.array(criterion.rows[0][0])
        expected = -np.trace(rows @ np.linalg.inv(matrix) @ rows.T)
        assert value(alone, [matrix]) == pytest.approx(expected, rel=1e-9)

    @predictions
    def test_singular_information_is_the_worst(self, kind):
        assert value(example(kind, 2), [np.diag([1.0, 0.0])]) == -math.inf


@criteria
def test_every_criterion_says_what_its_number_means(kind: type[Criterion]):
    criterion = EXAMPLES[kind]
    assert criterion.meaning
    said = criterion.share.format(size=3)
    best = {"value": -2.0, "best": -1.0} if kind is not E else {"value": 1.0, "best": 2.0}
    assert bool(said) == (criterion.efficiency(**best, size=3) is not None)
    assert "{" not in said


@pytest.mark.parametrize(
    ("criterion", "told"),
    [
        (E(scaling="none"), "the smallest eigenvalue of the information, the parameters taken in SI units"),
        (A(scaling={"track": 0.1}), "minus the sum of the variances, the parameters taken in units of the"),
        (G(test_drive=LEGS), "minus the largest variance of the position predicted after 3 legs driven"),
    ],
    ids=["E", "A", "G"],
)
def test_meanings_in_words(criterion: Criterion, told: str):
    assert criterion.meaning.startswith(told)


@pytest.mark.parametrize(
    ("criterion", "value", "told"),
    [
        (E(), 4.0, ""),
        (D(), -6 * math.log(0.01), "the geometric mean of those along the ellipsoid's axes is 1.00 %"),
        (A(), -3e-4, "the root mean square of those of the parameters is 1.00 %"),
        (A(scaling="none"), -3e-4, ""),
        (G(test_drive=LEGS), -1e-4, "the largest standard deviation of a predicted position is 10 mm"),
        (
            I(test_drive=LEGS, quantity="heading"),
            -(math.radians(2) ** 2),
            "the root mean square of the standard deviation of a predicted heading is 2.0 deg",
        ),
    ],
    ids=["E", "D", "A", "A in SI", "G", "I"],
)
def test_deviations_in_words(criterion: Criterion, value: float, told: str):
    assert criterion.deviation(value, 3) == told


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
@pytest.mark.parametrize("kind", [E, D, A, G, I], ids="EDAGI")
def test_no_information_lies_above_the_plane_of_a_supergradient(kind: type[Criterion], seed: int, size: int):
    """phi(F') <= the homogeneous bound <= phi(F) + tr(G (F' - F))."""
    rng = np.random.default_rng(seed)
    criterion = EXAMPLES[kind]
    if isinstance(criterion, Prediction):
        criterion = criterion.with_rows([rng.normal(size=(len(LEGS), 2, size)).tolist()])
    touched, other = (moderate_information(rng, size) for _ in range(2))
    gradient = criterion.supergradient(touched)
    most = float(np.trace(gradient @ other))
    plane = value(criterion, [touched]) + most - float(np.trace(gradient @ touched))
    root = root_of(gradient)
    bound = criterion.homogeneous_bound(touched, root, most)
    assert value(criterion, [other]) <= bound + 1e-9 * abs(bound)
    assert bound <= plane + 1e-9 * abs(plane)
    same = criterion.homogeneous_bound(touched, root, float(np.trace(gradient @ touched)))
    assert same == pytest.approx(value(criterion, [touched]), rel=1e-9)


@pytest.mark.parametrize("units", [(1.0, 1.0, 1.0), (1.0, 1e-6, 1e-6), (1e6, 1.0, 1.0)])
@pytest.mark.parametrize("size", [1.0, 1e-6, 1e6])
def test_shares_of_a_searchs_multipliers_are_in_no_units(size: float, units: tuple[float, ...]):
    """Of predictions that differ in the first parameter, and hardly in others; of multipliers to 8 digits."""
    rows, given = np.array([[[1.0, 1.0, 1.0]], [[-1.0, 1.0, 1.001]]]) * size * units, np.array([0.3, 0.7])
    criterion = G(test_drive=LEGS[:2]).with_rows([rows.tolist()])
    inverse = np.diag(np.divide([0.5, 2.0, 3.0], np.square(units)))
    mixture = sum(share * leg.T @ leg for share, leg in zip(given, rows, strict=True))
    unsure = 1e-8 * np.random.default_rng(0).uniform(-1, 1, (3, 3))
    multipliers = inverse @ mixture @ inverse * (1 + unsure + unsure.T)
    found = criterion.shares(np.linalg.inv(inverse), multipliers)
    np.testing.assert_allclose(found, given, rtol=1e-7)


@pytest.mark.parametrize("kind", [G, I])
@pytest.mark.parametrize("unseen", [0.0, -1e-20])
def test_predictions_look_away_from_what_nothing_sees(kind: type[Prediction], unseen: float):
    """What is left of a parameter that no reading sees may be rounding below 0; none is expected either."""
    criterion = EXAMPLES[kind].with_rows([[[[3.0, 0.0]], [[1.0, 0.0]]]])
    matrix = np.diag([2.0, unseen])
    gradient = criterion.supergradient(matrix)
    root, most = root_of(gradient), float(np.trace(gradient @ matrix))
    expected = value(criterion, [np.diag([2.0, 0.0])])
    assert criterion.homogeneous_bound(matrix, root, most) == pytest.approx(expected, rel=1e-12)
    assert criterion.homogeneous_bound(matrix, root, 0.0) == -math.inf


def test_a_plane_that_leaves_something_out_bounds_no_volume():
    """Whatever the rest comes to: rounding of what nearly nothing says may leave no root at all."""
    for root, most in ((np.zeros((1, 1)), 0.0), (np.diag([1.0, 0.0]), 2.0)):
        assert D(scaling="none").homogeneous_bound(np.eye(len(root)), root, most) == math.inf


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_multipliers_are_never_below_0(sign: float):
    turn = random_rotation(np.random.default_rng(0), 3)
    found = multipliers_of(sign * turn @ np.diag([2.0, 1.0, -1e-6]) @ turn.T)
    np.testing.assert_allclose(found, turn @ np.diag([2.0, 1.0, 0.0]) @ turn.T, atol=1e-14)


@pytest.mark.parametrize("kind", [E, G, I], ids="EGI")
@pytest.mark.parametrize("size", [0.0, math.nan, math.inf])
def test_multipliers_that_say_nothing_are_as_none(kind: type[Criterion], size: float):
    matrix, criterion = moderate_information(np.random.default_rng(0), 3), example(kind, 3)
    found = criterion.supergradient(matrix, np.full((3, 3), size))
    np.testing.assert_array_equal(found, criterion.supergradient(matrix))


def test_what_is_not_concave_has_no_supergradient():
    assert ModifiedE().supergradient(np.eye(2)) is None
