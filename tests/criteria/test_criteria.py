"""Criteria: their values, their laws, and the smooth form an optimiser maximises."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from oed.criteria import E

criteria = pytest.mark.parametrize("kind", [E], ids=lambda kind: kind.__name__)
seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 5)


def random_information(rng: np.random.Generator, size: int, rows: int | None = None) -> np.ndarray:
    design = rng.standard_normal((rows or size + 2, size)) * 10 ** rng.uniform(-2, 2)
    return design.T @ design


def epigraph_values(criterion, matrices: list[np.ndarray]) -> tuple[float, np.ndarray]:
    """Objective and equalities of the epigraph at its own initial point."""
    epigraph = criterion.epigraph([ca.SX(ca.DM(matrix)) for matrix in matrices])
    function = ca.Function("epigraph", [epigraph.variables], [epigraph.objective, epigraph.equalities])
    objective, equalities = function(epigraph.initial(matrices))
    return float(objective), np.array(equalities).ravel()


@criteria
@given(seed=seeds, size=sizes, blocks=st.integers(1, 3))
def test_values_of_stacks_are_the_values_one_by_one(kind, seed: int, size: int, blocks: int):
    rng, criterion = np.random.default_rng(seed), kind()
    stacks = [np.array([random_information(rng, size) for _ in range(4)]) for _ in range(blocks)]
    together = criterion.value(stacks)
    single = [float(criterion.value([stack[index] for stack in stacks])) for index in range(4)]
    assert together.shape == (4,)
    np.testing.assert_allclose(together, single, rtol=1e-12, atol=1e-15)


@criteria
@given(seed=seeds, size=sizes, blocks=st.integers(1, 3))
def test_epigraph_begins_consistent(kind, seed: int, size: int, blocks: int):
    rng, criterion = np.random.default_rng(seed), kind()
    matrices = [random_information(rng, size) for _ in range(blocks)]
    objective, equalities = epigraph_values(criterion, matrices)
    largest = max(1 + np.trace(matrix) / size for matrix in matrices)
    assert np.abs(equalities).max() <= 2e-6 * largest
    assert objective <= float(criterion.value(matrices)) + 1e-6 * largest


@criteria
@given(seed=seeds, size=st.integers(2, 4))
def test_epigraph_begins_at_singular_matrices_too(kind, seed: int, size: int):
    matrix = random_information(np.random.default_rng(seed), size, rows=1)
    objective, equalities = epigraph_values(kind(), [matrix])
    assert np.isfinite(objective)
    assert np.abs(equalities).max() <= 2e-6 * (1 + np.trace(matrix) / size)


@criteria
@pytest.mark.parametrize("size", [1, 2, 3])
def test_epigraphs_maximum_is_the_criterion(kind, size: int):
    rng, criterion = np.random.default_rng(size), kind()
    matrices = [random_information(rng, size) for _ in range(2)]
    matrices = [matrix / np.trace(matrix) for matrix in matrices]
    epigraph = criterion.epigraph([ca.SX(ca.DM(matrix)) for matrix in matrices])
    program = {"x": epigraph.variables, "f": -epigraph.objective, "g": epigraph.equalities}
    solver = ca.nlpsol(
        "p", "ipopt", program, {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    )
    found = solver(x0=epigraph.initial(matrices), lbg=0, ubg=0)
    assert -float(found["f"]) == pytest.approx(float(criterion.value(matrices)), abs=1e-6)


@criteria
def test_every_criterion_is_chosen_by_its_own_kind(kind):
    assert kind().kind == kind.__name__
    assert kind().scaling == "relative"
    with pytest.raises(ValidationError, match="weight"):
        kind(weight=1)
    with pytest.raises(ValidationError, match="scaling"):
        kind(scaling="absolute")


@criteria
@pytest.mark.parametrize("value", [270.0, -270.0])
def test_conceding_a_share_lowers_the_value(kind, value: float):
    assert kind().concede(value, 0.999) == pytest.approx(value - 0.27)
    assert kind().concede(value, 1.0) == value


class TestE:
    """E-optimality is the smallest eigenvalue over all blocks."""

    criterion = E(scaling="none")

    @given(seed=seeds, size=sizes, blocks=st.integers(1, 3))
    def test_value_is_the_smallest_eigenvalue(self, seed: int, size: int, blocks: int):
        rng = np.random.default_rng(seed)
        matrices = [random_information(rng, size) for _ in range(blocks)]
        expected = min(np.linalg.svd(matrix, compute_uv=False)[-1] for matrix in matrices)
        assert float(self.criterion.value(matrices)) == pytest.approx(expected, rel=1e-9, abs=1e-11)

    @given(seed=seeds, size=sizes)
    def test_value_is_the_least_information_of_any_direction(self, seed: int, size: int):
        rng = np.random.default_rng(seed)
        matrix, direction = random_information(rng, size), rng.standard_normal(size)
        quotient = direction @ matrix @ direction / (direction @ direction)
        assert float(self.criterion.value([matrix])) <= quotient + 1e-9 * np.trace(matrix)

    @given(seed=seeds, size=sizes)
    def test_rotating_the_parameters_changes_nothing(self, seed: int, size: int):
        rng = np.random.default_rng(seed)
        matrix = random_information(rng, size)
        rotation, _ = np.linalg.qr(rng.standard_normal((size, size)))
        turned = self.criterion.value([rotation @ matrix @ rotation.T])
        assert turned == pytest.approx(self.criterion.value([matrix]), abs=1e-12 * np.trace(matrix))

    @given(seed=seeds, size=sizes)
    def test_more_information_is_never_worse(self, seed: int, size: int):
        rng = np.random.default_rng(seed)
        matrix, more = random_information(rng, size), random_information(rng, size, rows=1)
        gained = self.criterion.value([matrix + more]) - self.criterion.value([matrix])
        assert gained >= -1e-12 * np.trace(matrix + more)

    @given(seed=seeds, size=sizes, factor=st.floats(1e-3, 1e3))
    def test_value_grows_with_the_information(self, seed: int, size: int, factor: float):
        matrix = random_information(np.random.default_rng(seed), size)
        scaled = self.criterion.value([factor * matrix])
        assert scaled == pytest.approx(
            factor * self.criterion.value([matrix]), abs=1e-12 * factor * np.trace(matrix)
        )

    @given(seed=seeds, size=sizes)
    def test_another_block_is_never_better(self, seed: int, size: int):
        rng = np.random.default_rng(seed)
        first, second = random_information(rng, size), random_information(rng, size)
        assert self.criterion.value([first, second]) == min(
            self.criterion.value([first]), self.criterion.value([second])
        )
