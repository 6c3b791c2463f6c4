"""Roots of equations, whatever the units, with the derivatives of the root."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from oed.kernel.dynamics.roots import RootSolver


def solver(residual: ca.SX, unknowns: ca.SX, arguments: ca.SX, iterations: int = 30) -> RootSolver:
    return RootSolver(ca.Function("residual", [unknowns, arguments], [residual]), iterations)


@pytest.mark.parametrize("scales", [(1.0, 1.0), (1e-9, 1e9)])
@pytest.mark.parametrize("slope", [0.5, 0.0])
def test_a_root_and_its_derivatives(slope: float, scales: tuple[float, float]):
    # With a slope of 0 an unknown is 0, and so are all terms of its equation.
    unknowns, arguments = ca.SX.sym("unknowns", 2), ca.SX.sym("arguments", 2)
    (x, y), (a, b) = ca.vertsplit(unknowns), ca.vertsplit(arguments)
    rows = ca.vertcat(x**3 - a, y - b * x) * ca.DM(scales)
    root = solver(rows, unknowns, arguments).root(ca.SX([1.0, 0.0]), arguments)
    function = ca.Function("root", [arguments], [root, ca.jacobian(root, arguments)])
    values, slopes = (np.array(result) for result in function([8.0, slope]))
    np.testing.assert_allclose(values.ravel(), [2.0, 2 * slope], atol=1e-12)
    np.testing.assert_allclose(slopes, [[1 / 12, 0.0], [slope / 12, 2.0]], atol=1e-9)


def test_unsolvable_equations_have_no_root_and_no_derivatives():
    # Derivatives of the branch that says so were 0, as if nothing changed the root.
    unknown, argument = ca.SX.sym("x"), ca.SX.sym("a")
    root = solver(unknown**2 + argument**2, unknown, argument).root(ca.SX(1.0), argument)
    both = ca.Function("both", [argument], [root, ca.jacobian(root, argument)])(2.0)
    assert np.isnan(np.array(both, dtype=float)).all()


def test_structural_independence_is_a_derivative_of_exactly_0():
    # Rounding in its place would be an unknown that can be told from others.
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(6, 6)) * np.kron(np.tril(np.ones((3, 3))), np.ones((2, 2)))
    unknowns, arguments = ca.SX.sym("unknowns", 6), ca.SX.sym("arguments", 6)
    mixed = rng.permutation(6)
    linear = ca.mtimes(ca.sparsify(ca.DM(matrix[mixed])), unknowns) - arguments[mixed.tolist()]
    root = solver(linear, unknowns, arguments, iterations=3).root(ca.SX.zeros(6), arguments)
    function = ca.Function("root", [arguments], [root, ca.jacobian(root, arguments)])
    wanted = rng.normal(size=6)
    values, slopes = (np.array(result) for result in function(matrix @ wanted))
    np.testing.assert_allclose(values, wanted[:, None], atol=1e-9)
    np.testing.assert_allclose(slopes, np.linalg.inv(matrix), atol=1e-9)
    assert np.all(slopes[np.kron(np.triu(np.ones((3, 3)), 1), np.ones((2, 2))) > 0] == 0)
