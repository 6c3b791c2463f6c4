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
