"""Functions of one sample along runs, in calls of several samples."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from oed.optimize.terms import recurrence
from oed.optimize.terms.recurrence import Recurrence


def step() -> ca.Function:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return ca.Function("step", [x, u], [ca.vertcat(x[1], ca.sin(x[0]) + u), x[0] * u])


@pytest.mark.parametrize("together", [1, 3, 4, 7, 100])
@pytest.mark.parametrize("threads", [1, 2])
def test_what_is_handed_on_does_not_depend_on_how_many_samples_are_called_together(
    together: int, threads: int, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(recurrence, "TOGETHER", together)
    rng = np.random.default_rng(0)
    begins, given = rng.normal(size=(3, 2)), rng.normal(size=(3, 7, 1))
    following, added = Recurrence(step(), 3, 7, threads)(begins, given)
    assert following.shape == (3, 7, 2)
    assert added.shape == (3, 7, 1)
    for run in range(3):
        x = begins[run]
        for sample in range(7):
            u = given[run, sample, 0]
            np.testing.assert_allclose(added[run, sample], [x[0] * u], rtol=1e-14)
            x = np.array([x[1], np.sin(x[0]) + u])
            np.testing.assert_allclose(following[run, sample], x, rtol=1e-14)
