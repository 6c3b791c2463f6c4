"""Roots of equations, whatever the units, with the derivatives of the root."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from oed.kernel.dynamics.roots import DAMPING, RootFinder


def roots(scales: tuple[float, float], damping: tuple[float, ...]) -> ca.Function:
    """X and y with x^3 = a and y = b x, of equations in other units; and their derivatives by a and b."""
    unknowns, given = ca.SX.sym("unknowns", 2), ca.SX.sym("given", 2)
    (x, y), (a, b) = ca.vertsplit(unknowns), ca.vertsplit(given)
    residual = ca.Function("residual", [unknowns, given], [ca.vertcat(x**3 - a, y - b * x) * ca.DM(scales)])
    hint = ca.SX.sym("hint", 0)
    start = ca.Function("start", [given, hint], [ca.SX([1.0, 0.0])])
    finder = RootFinder(residual, start, iterations=30, damping=damping)
    found = finder.root(given, ca.SX(0, 1))
    return ca.Function("roots", [given], [found, ca.jacobian(found, given)])


@pytest.mark.parametrize("damping", [(1.0,), DAMPING])
@pytest.mark.parametrize("scales", [(1.0, 1.0), (1e-9, 1e9)])
@pytest.mark.parametrize("slope", [0.5, 0.0])
def test_a_root_and_its_derivatives(slope: float, scales, damping):
    # With a slope of 0 an unknown is 0, and so are all terms of its equation.
    found, slopes = (np.array(one) for one in roots(scales, damping)([8.0, slope]))
    np.testing.assert_allclose(found.ravel(), [2.0, 2 * slope], atol=1e-12)
    np.testing.assert_allclose(slopes, [[1 / 12, 0.0], [slope / 12, 2.0]], atol=1e-9)


def test_what_has_no_root_has_no_derivatives_either():
    # Derivatives of the branch that says so were 0, as if nothing changed the root.
    unknown, given = ca.SX.sym("x"), ca.SX.sym("a")
    residual = ca.Function("residual", [unknown, given], [unknown**2 + given**2])
    start = ca.Function("start", [given, ca.SX.sym("hint", 0)], [ca.SX(1.0)])
    found = RootFinder(residual, start, iterations=5).root(given, ca.SX(0, 1))
    both = ca.Function("both", [given], [found, ca.jacobian(found, given)])(2.0)
    assert np.isnan(np.array(both, dtype=float)).all()


def test_equations_of_which_two_ask_the_same_of_one_unknown_have_no_root():
    # No block of them can be solved by itself.
    unknowns, given = ca.SX.sym("unknowns", 3), ca.SX.sym("given", 3)
    asked = ca.vertcat(unknowns[0], ca.sum1(unknowns), 2 * unknowns[0]) - given
    residual = ca.Function("residual", [unknowns, given], [asked])
    start = ca.Function("start", [given, ca.SX.sym("hint", 0)], [ca.SX.ones(3)])
    found = RootFinder(residual, start, iterations=5).root(given, ca.SX(0, 1))
    both = ca.Function("both", [given], [found, ca.jacobian(found, given)])([1.0, 2.0, 3.0])
    assert all(np.isnan(np.array(one)).all() for one in both)


def test_what_does_not_depend_on_something_depends_by_exactly_0():
    # Rounding in its place, as a column of its own, would be an unknown that can be told from others.
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(6, 6)) * np.kron(np.tril(np.ones((3, 3))), np.ones((2, 2)))
    unknowns, given = ca.SX.sym("unknowns", 6), ca.SX.sym("given", 6)
    start = ca.Function("start", [given, ca.SX.sym("hint", 0)], [ca.SX.zeros(6)])
    mixed = rng.permutation(6)
    linear = ca.mtimes(ca.sparsify(ca.DM(matrix[mixed])), unknowns) - given[mixed.tolist()]
    residual = ca.Function("residual", [unknowns, given], [linear])
    finder = RootFinder(residual, start, iterations=3)
    wanted = rng.normal(size=6)
    np.testing.assert_allclose(finder.step(rng.normal(size=6), matrix @ wanted), wanted[:, None], atol=1e-9)
    found = finder.root(given, ca.SX(0, 1))
    slopes = np.array(ca.Function("slopes", [given], [ca.jacobian(found, given)])(rng.normal(size=6)))
    np.testing.assert_allclose(slopes, np.linalg.inv(matrix), atol=1e-9)
    assert np.all(slopes[np.kron(np.triu(np.ones((3, 3)), 1), np.ones((2, 2))) > 0] == 0)
