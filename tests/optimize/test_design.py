"""What a program maximises: the criterion of one robot, the mean of several, or the worst of them."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from builders import problem_of

from oed.kernel.criteria import D
from oed.optimize.transcription.design import smooth_objective
from oed.uncertainty.robust import Robust

MATRICES = [np.array([[2.0, 0.3], [0.3, 3.0]]), np.array([[5.0, -1.0], [-1.0, 4.0]])]


def maximised(matrices: list[np.ndarray], **parts: Any) -> tuple[float, np.ndarray, np.ndarray]:
    """What is maximised, of robots with these matrices, what is to stay above 0, and each criterion."""
    problem = problem_of(criterion=D(scaling="none"), **parts)
    symbols = [ca.SX.sym("information", *one.shape) for one in matrices]
    found = smooth_objective(problem, [[one] for one in symbols])
    begun = found.initial([[one] for one in matrices])
    assert len(begun) == found.variables.numel()
    function = ca.Function("objective", [*symbols, found.variables], [found.maximised, found.floors])
    value, floors = function(*matrices, begun)
    each = np.array([float(problem.criterion.value([one])) for one in matrices])
    return float(value), np.array(floors).ravel(), each


def test_of_one_robot_it_is_the_criterion():
    value, floors, each = maximised(MATRICES[:1])
    assert value == pytest.approx(each[0])
    assert len(floors) == 0


def robust(objective: str) -> dict[str, Any]:
    return {"robust": Robust(objective=objective), "within": {"track": 0.05}}


def test_of_several_it_may_be_the_mean():
    value, floors, each = maximised(MATRICES, **robust("mean"))
    assert value == pytest.approx(each.mean())
    assert len(floors) == 0


def test_of_several_it_may_be_the_worst():
    value, floors, each = maximised(MATRICES, **robust("worst"))
    assert value == pytest.approx(each.min())
    np.testing.assert_allclose(floors, each - value, atol=1e-9)
