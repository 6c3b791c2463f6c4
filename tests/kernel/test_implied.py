"""Bounds of inputs that follow from limits on combinations of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from builders import problem_of

from oed.kernel.dynamics.rollout import Drive
from oed.kernel.limit import Limit, LinearBound, Rows, implied_bounds
from oed.robots.limits import Rectangle, WheelSpeed

OPEN = np.tile([-np.inf, np.inf], (2, 1))
TOTAL = LinearBound(np.array([1.0, 1.0]), 0.5, -3.0, 4.0)
DIFFERENCE = LinearBound(np.array([1.0, -1.0]), 0.0, -1.0, 1.0)


class Power(Limit):
    """A limit of the user's own on the sum of both speeds, and on their difference."""

    name: ClassVar[str] = "power"

    def rows(self, drive: Drive) -> Rows:
        return Rows(
            drive.inputs[:, 0],
            np.full(drive.inputs.shape[0], -9.0),
            np.full(drive.inputs.shape[0], 9.0),
            9.0,
            "rad/s",
        )

    def linear_bounds(self, model: Any) -> Sequence[LinearBound]:
        return [TOTAL, DIFFERENCE]


def test_together_they_bound_what_none_does_alone():
    assert np.isinf(implied_bounds(OPEN, [TOTAL])).all()
    # -3.5 <= u + v <= 3.5 and -1 <= u - v <= 1.
    np.testing.assert_allclose(implied_bounds(OPEN, [TOTAL, DIFFERENCE]), [[-2.25, 2.25]] * 2, rtol=1e-8)


def test_what_is_known_stays_and_helps():
    known = np.array([[-1.0, 1.0], [-np.inf, np.inf]])
    found = implied_bounds(known, [TOTAL])
    np.testing.assert_allclose(found, [[-1, 1], [-4.5, 4.5]], rtol=1e-8)


def test_widened_by_a_share_of_the_larger_bound():
    wider = TOTAL.widened(0.1)
    assert (wider.low, wider.high, wider.offset) == (-3.4, 4.4, 0.5)


def test_a_limit_of_the_users_own_bounds_inputs_so():
    problem = problem_of(limits=(Power(), Rectangle(x=(-1, 1), y=(-1, 1))))
    np.testing.assert_allclose(problem.input_bounds, [[-2.25, 2.25]] * 2, rtol=1e-8)
    wider = problem.widened(0.1).input_bounds
    np.testing.assert_allclose(wider, [[-(3.9 + 1.1) / 2, (3.9 + 1.1) / 2]] * 2, rtol=1e-8)
    kept = problem_of(limits=(Power(), WheelSpeed(bounds=2))).input_bounds
    np.testing.assert_array_equal(kept, [[-2, 2]] * 2)
