"""Limits that stand against each other are named, with amounts that are enough."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from builders import ACCELERATION, BOX, SPEED, problem_of
from listeners import Listener, interrupt

from oed.kernel.problem import Problem
from oed.optimize import Ipopt, solve
from oed.optimize.conflict import describe_conflict
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.starting_points import random_drives
from oed.robots.limits import EndHeading, EndPosition, Rectangle, WheelSpeed, YawRateLimit
from oed.robots.sensors import Displacements


def make_cornered(lowest: float = 3.0, half_side: float = 0.1) -> Problem:
    """Wheels that must turn forward all the time, in a box too small to turn in."""
    return problem_of(
        duration=4,
        samples=8,
        coefficients=6,
        rest_to_rest=False,
        limits=(
            WheelSpeed(bounds=(lowest, 10)),
            Rectangle(x=(-half_side, half_side), y=(-half_side, half_side)),
        ),
        measurement=Displacements(segments=4),
    )


def describe(problem: Problem) -> str:
    design = DesignExpressions(problem)
    starts = random_drives(design, np.array([0.25, 0.5]), np.random.default_rng(0))
    return describe_conflict(design, list(starts))


@pytest.fixture(scope="module")
def description() -> str:
    return describe(make_cornered())


def amount(description: str, name: str) -> float:
    found = re.search(rf"{name} \(by at most ([0-9.e+-]+) (\S+)\)", description)
    assert found, description
    return float(found.group(1)) * (1e-3 if found.group(2) == "mm" else 1.0)


@pytest.mark.slow
def test_conflicting_limits_are_named_with_units(description: str):
    assert description.startswith("These limits conflict")
    assert re.search(r"wheel speed \(by at most \S+ rad/s\)", description)
    assert re.search(r"workspace \(by at most \S+ mm\)", description)


@pytest.mark.slow
def test_amounts_are_no_more_than_what_is_certainly_enough(description: str):
    # Wheels that may rest need no room at all, and no drive reaches farther than its own length.
    assert 0 < amount(description, "wheel speed") <= 3.0 + 1e-3
    assert 0 < amount(description, "workspace") <= 4 * 10 * 0.049


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wheel speed", "workspace"])
def test_loosening_one_limit_by_its_amount_is_enough(description: str, name: str):
    loosened = 1.02 * amount(description, name) + 1e-3
    changes = {"wheel speed": {"lowest": 3.0 - loosened}, "workspace": {"half_side": 0.1 + loosened}}
    assert describe(make_cornered(**changes[name])) == ""


@pytest.mark.slow
def test_a_limit_that_is_not_in_the_way_is_not_named():
    cornered = make_cornered()
    description = describe(replace(cornered, limits=(*cornered.limits, ACCELERATION)))
    assert "workspace" in description
    assert "wheel acceleration" not in description


@pytest.mark.slow
def test_limits_that_agree_do_not_conflict():
    assert describe(problem_of(samples=8, coefficients=6, limits=(SPEED, ACCELERATION, BOX))) == ""


@pytest.mark.slow
def test_an_end_out_of_reach_is_missed_by_metres_not_by_the_square_that_a_solver_sees():
    # 5 s at 10 rad/s of wheels of 49 mm reach 2.45 m at most: an end 4 m away is missed by 1.55 m and more.
    far = problem_of(
        duration=5,
        samples=12,
        coefficients=6,
        limits=(SPEED, EndPosition(at={"x": 4, "y": 0})),
        start={"x": 0, "y": 0, "heading": 0},
    )
    assert 1.5 < amount(describe(far), "end position") < 4.0


@pytest.mark.slow
def test_an_angle_is_in_degrees():
    # Wheels that turn alike but for 0.1 rad/s turn a robot by a few degrees only.
    straight = problem_of(
        duration=5,
        samples=8,
        coefficients=6,
        limits=(SPEED, YawRateLimit(bounds=0.01), EndHeading(at=1.5)),
        start={"x": 0, "y": 0, "heading": 0},
    )
    assert re.search(r"end heading \(by at most \S+ deg\)", describe(straight))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "said"),
    [(make_cornered(), r"^$"), (problem_of(samples=8, coefficients=6), r"^best by E: \d+")],
)
def test_progress_says_nothing_of_a_best_until_there_is_one(problem: Problem, said: str):
    notes = []

    class Noting(Listener):
        def advance(self, note: str = "") -> None:
            notes.append(note)
            # What the search makes of it in the end is of no interest.
            interrupt()

    options = Ipopt(starts=1, perturbations=0, max_iterations=15)
    solve(problem, options, seed=0, workers=1, progress=Noting())
    assert re.search(said, notes[0])
