"""Where searches begin."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest
from builders import ACCELERATION, problem_of

from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Spline
from oed.kernel.limit import Limit, Rows
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.perturbations import perturbed_design
from oed.optimize.transcription.starting_points import random_drives, start_bounds, starting_points
from oed.robots.limits import Rectangle, WheelSpeed
from oed.robots.space import DesignSpace

TIGHT = Rectangle(x=(-0.2, 0.2), y=(-0.2, 0.2))
SPACE = {"duration": 6, "samples": 24, "spline": Spline(coefficients=7)}


@pytest.fixture(scope="module", params=[(-10, 10), (0, 8), (2, 8)], ids=str)
def design(request) -> DesignExpressions:
    box = Rectangle(x=(3, 4), y=(-2, 0))
    space = DesignSpace(**SPACE, start="free", rest_to_rest=False)
    limits = (WheelSpeed(bounds=request.param), ACCELERATION, box)
    return DesignExpressions(problem_of(design=space, limits=limits))


def assert_within_bounds(design: DesignExpressions, unknowns: np.ndarray) -> None:
    drive, (low, high) = design.trajectory(unknowns), design.problem.input_bounds[0]
    assert np.all(drive.coefficients >= low - 1e-12)
    assert np.all(drive.coefficients <= high + 1e-12)


def test_random_drives_are_within_the_input_bounds_and_start_in_the_box(design):
    drives = random_drives(design, np.linspace(0.1, 1, 50), np.random.default_rng(0))
    for unknowns in drives:
        assert_within_bounds(design, unknowns)
        x, y, _ = design.trajectory(unknowns).start
        assert 3 <= x <= 4
        assert -2 <= y <= 0


class Facing(Limit):
    """A user's own limit: where the robot is, and where it looks."""

    name: ClassVar[str] = "facing"
    looks_at: ClassVar = "state"

    def state_bounds(self) -> dict[str, tuple[float, float]]:
        return {"y": (-1.0, 5.0), "heading": (0.0, 1.0)}

    def rows(self, drive: Drive) -> Rows:
        count = drive.path.shape[0]
        return Rows(drive.path[:, 2], np.zeros(count), np.ones(count), 1.0, "rad")


def test_free_starts_are_where_all_limits_let_states_be():
    space = DesignSpace(**SPACE, start="free", runs=2)
    limits = (WheelSpeed(bounds=10), Facing(), Rectangle(x=(3, 4), y=(-2, 0)))
    bounds = start_bounds(DesignExpressions(problem_of(design=space, limits=limits)))
    np.testing.assert_array_equal(bounds, [[3, 4], [-1, 0], [0, 1]] * 2)
    alone = problem_of(design=space, limits=limits[:1])
    expected = [[-1e-3, 1e-3], [-1e-3, 1e-3], [-np.pi, np.pi]] * 2
    np.testing.assert_array_equal(start_bounds(DesignExpressions(alone)), expected)


def test_amplitude_is_a_share_of_the_range_about_rest(design):
    bounds = design.problem.input_bounds[0]
    rest = np.clip(0, *bounds)
    drives = random_drives(design, np.full(200, 0.25), np.random.default_rng(0))
    coefficients = np.array([design.trajectory(unknowns).coefficients for unknowns in drives])
    assert coefficients.max() == pytest.approx(rest + 0.25 * (bounds[1] - rest), rel=0.02)
    assert coefficients.min() == pytest.approx(rest + 0.25 * (bounds[0] - rest), rel=0.02, abs=0.02)


def test_perturbed_drives_stay_within_the_bounds(design):
    rng = np.random.default_rng(1)
    base = random_drives(design, np.array([1.0]), rng)[0]
    kicked = perturbed_design(design, base, rng)
    assert_within_bounds(design, kicked)
    assert 0.01 < np.abs(kicked - base).max() < 1


@pytest.mark.parametrize("count", [1, 2, 5, 12])
@pytest.mark.slow
def test_starts_are_reproducible(count: int):
    design = DesignExpressions(problem_of())
    first, second = (starting_points(design, count, np.random.default_rng(7)) for _ in range(2))
    assert len(first) == count
    np.testing.assert_array_equal(first, second)
    assert len({start.tobytes() for start in first}) == count


@pytest.mark.slow
def test_screened_starts_are_better_than_random_ones():
    design = DesignExpressions(problem_of(limits=(WheelSpeed(bounds=10), TIGHT)))
    rng = np.random.default_rng(0)
    screened = np.array(starting_points(design, 12, rng)[0::2])
    any_size, full_size = (random_drives(design, rng.uniform(low, 1, 200), rng) for low in (0.05, 1))
    informative, excess = design.score_many(screened)
    assert np.median(informative) > np.quantile(design.score_many(any_size)[0], 0.9)
    violations, usual = (np.maximum(0.0, part) for part in (excess, design.score_many(full_size)[1]))
    assert violations.sum(axis=1).mean() < np.median(usual.sum(axis=1))
