"""Small symmetric matrices: elimination and weighing against NumPy, for every type of CasADi's."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import schur

from oed.kernel.measurement.matrices import eliminate, harmonic, quotient

seeds = st.integers(0, 2**32 - 1)


def information(seed: int, size: int, rank: int | None = None, spread: float = 0.0) -> np.ndarray:
    """A random W'W of that rank, its rows' sizes `spread` powers of ten apart."""
    rng = np.random.default_rng(seed)
    design = rng.normal(size=(2 * size if rank is None else rank, size))
    design *= 10.0 ** rng.uniform(-spread / 2, spread / 2, size)
    return design.T @ design


def assert_alike(found, expected: np.ndarray, whole: np.ndarray, tolerance: float = 1e-10):
    sizes = np.sqrt(np.diag(whole))
    sizes = np.where(sizes > 0, sizes, 1.0)
    scale = np.outer(sizes, sizes)
    np.testing.assert_allclose(np.array(found) / scale, expected / scale, rtol=0, atol=tolerance)


class TestEliminate:
    """The Schur complement."""

    @settings(max_examples=30)
    @given(
        seed=seeds, kept=st.integers(1, 5), others=st.integers(1, 6), spread=st.sampled_from([0.0, 4.0, 10.0])
    )
    def test_it_is_numpys(self, seed: int, kept: int, others: int, spread: float):
        matrix = information(seed, kept + others, spread=spread)
        found = eliminate(ca.DM(matrix), kept)
        assert found.shape == (kept, kept)
        assert_alike(found, schur(matrix, kept), matrix[:kept, :kept], 1e-8)

    @settings(max_examples=10)
    @given(seed=seeds, kept=st.integers(1, 4), others=st.integers(1, 3))
    def test_its_inverse_is_that_part_of_the_covariance(self, seed: int, kept: int, others: int):
        matrix = information(seed, kept + others)
        covariance = np.linalg.inv(matrix)[:kept, :kept]
        np.testing.assert_allclose(
            np.array(eliminate(ca.DM(matrix), kept)) @ covariance, np.eye(kept), atol=1e-7
        )

    def test_with_nothing_to_eliminate_it_is_the_matrix_itself(self):
        matrix = ca.DM(information(0, 3))
        assert eliminate(matrix, 3) is matrix

    @pytest.mark.parametrize("kind", [ca.SX, ca.MX])
    def test_every_type_of_expression(self, kind: type):
        matrix = information(1, 5)
        symbol = kind.sym("F", 5, 5)
        function = ca.Function("f", [symbol], [eliminate(symbol, 2)])
        np.testing.assert_allclose(np.array(function(matrix)), schur(matrix, 2), rtol=1e-9)

    def test_its_derivatives_are_finite(self):
        symbol = ca.MX.sym("F", 4, 4)
        gradient = ca.Function("g", [symbol], [ca.gradient(ca.trace(eliminate(symbol, 2)), symbol)])
        matrix = information(2, 4)
        matrix[3, :] = matrix[:, 3] = 0.0
        assert np.isfinite(np.array(gradient(matrix))).all()

    @pytest.mark.parametrize("where", [[2], [4], [2, 3, 4]])
    def test_what_nothing_tells_takes_nothing_away(self, where: list[int]):
        matrix = information(3, 5)
        matrix[where, :] = matrix[:, where] = 0.0
        rest = [index for index in range(5) if index not in where]
        expected = schur(matrix[np.ix_(rest, rest)], 2)
        assert_alike(eliminate(ca.DM(matrix), 2), expected, matrix[:2, :2])

    @settings(max_examples=20)
    @given(
        seed=seeds, others=st.integers(2, 6), missing=st.integers(1, 3), spread=st.sampled_from([0.0, 6.0])
    )
    def test_combinations_that_nothing_tells(self, seed: int, others: int, missing: int, spread: float):
        # Readings depend on the nuisances only through fewer combinations of them.
        rng, kept = np.random.default_rng(seed), 3
        seen = max(others - missing, 1)
        combined = rng.normal(size=(20, seen)) @ rng.normal(size=(seen, others))
        combined *= 10.0 ** rng.uniform(-spread / 2, spread / 2, others)
        design = np.hstack([rng.normal(size=(20, kept)), combined])
        matrix = design.T @ design
        found = np.array(eliminate(ca.DM(matrix), kept))
        assert np.isfinite(found).all()
        assert_alike(found, schur(matrix, kept), matrix[:kept, :kept], 1e-5)

    def test_the_same_nuisance_twice_is_one(self):
        matrix = information(5, 4)
        order = [0, 1, 2, 3, 3]
        expected = schur(matrix, 2)
        assert_alike(eliminate(ca.DM(matrix[np.ix_(order, order)]), 2), expected, matrix[:2, :2], 1e-7)

    @settings(max_examples=20)
    @given(seed=seeds, precision=st.floats(0, 1e6))
    def test_knowing_nuisances_never_tells_less(self, seed: int, precision: float):
        matrix = information(seed, 5)
        known = matrix + np.diag([0, 0, precision, 0, precision])
        gap = np.array(eliminate(ca.DM(known), 2)) - np.array(eliminate(ca.DM(matrix), 2))
        assert np.linalg.eigvalsh(gap)[0] >= -1e-9 * np.trace(matrix)


def test_what_is_0_by_structure_costs_nothing():
    """Two kept, and blocks of two further unknowns that meet in these alone."""

    def steps(blocks: int) -> int:
        pattern = ca.DM(np.kron(np.eye(blocks), np.ones((2, 2))))
        border = ca.DM.ones(2 * blocks, 2)
        whole = ca.vertcat(ca.horzcat(ca.DM.ones(2, 2), border.T), ca.horzcat(border, ca.sparsify(pattern)))
        matrix = ca.SX.sym("F", whole.sparsity())
        left = eliminate(matrix, 2)
        rng = np.random.default_rng(0)
        rows = [
            np.hstack([rng.normal(size=(5, 2)), np.kron(np.eye(blocks)[k], rng.normal(size=(5, 2)))])
            for k in range(blocks)
        ]
        numbers = np.vstack(rows).T @ np.vstack(rows)
        found = ca.Function("left", [matrix], [left])(ca.project(ca.DM(numbers), whole.sparsity()))
        np.testing.assert_allclose(np.array(found), schur(numbers, 2), rtol=1e-10)
        return ca.Function("left", [matrix], [left]).n_instructions()

    assert steps(40) < 45 * steps(1)


class TestHarmonic:
    """The inverse of a sandwich."""

    @settings(max_examples=20)
    @given(seed=seeds, size=st.integers(1, 5))
    def test_it_is_numpys(self, seed: int, size: int):
        matrix, spread = information(seed, size), information(seed + 1, size)
        expected = matrix @ np.linalg.inv(spread) @ matrix
        found = np.array(harmonic(ca.DM(matrix), ca.DM(spread)))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.trace(expected))

    def test_of_itself_it_is_the_matrix(self):
        matrix = information(7, 3)
        np.testing.assert_allclose(np.array(harmonic(ca.DM(matrix), ca.DM(matrix))), matrix, rtol=1e-9)

    @pytest.mark.parametrize("kind", [ca.SX, ca.MX])
    def test_every_type_of_expression(self, kind: type):
        matrix, spread = information(8, 2), information(9, 2)
        first, second = kind.sym("S", 2, 2), kind.sym("M", 2, 2)
        function = ca.Function("f", [first, second], [harmonic(first, second)])
        expected = matrix @ np.linalg.inv(spread) @ matrix
        np.testing.assert_allclose(np.array(function(matrix, spread)), expected, rtol=1e-9)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_quotients(size: int):
    matrix, right = information(10, size), np.random.default_rng(0).normal(size=(size, 2))
    found = np.array(ca.evalf(quotient(ca.SX(ca.DM(matrix)), ca.SX(ca.DM(right)))))
    np.testing.assert_allclose(found, right.T @ np.linalg.solve(matrix, right), rtol=1e-9)
