"""Limits that stand against each other are named, with amounts that are enough."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from builders import ACCELERATION, BOX, SPEED, problem_of

from oed.kernel.problem import Problem
from oed.optimize.conflict import describe_conflict
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.starting_points import random_drives
from oed.robots.limits import Rectangle, WheelSpeed
from oed.robots.sensors import Displacements


def make_cornered(lowest: float = 3.0, half_side: float = 0.1) -> Problem:
    """Wheels that must turn forward all the time, in a box too small to turn in."""
    return problem_of(
        duration=5,
        rest_to_rest=False,
        limits=(
            WheelSpeed(bounds=(lowest, 10)),
            Rectangle(x=(-half_side, half_side), y=(-half_side, half_side)),
        ),
        measurement=Displacements(segments=4),
    )


def describe(problem: Problem) -> str:
    design = DesignExpressions(problem)
    starts = random_drives(design, np.array([0.25, 0.5, 1.0]), np.random.default_rng(0))
    return describe_conflict(design, list(starts))


@pytest.fixture(scope="module")
def description() -> str:
    return describe(make_cornered())


def amount(description: str, name: str) -> float:
    found = re.search(rf"{name} \(by at most ([0-9.e+-]+) ", description)
    assert found, description
    return float(found.group(1))


@pytest.mark.slow
def test_conflicting_limits_are_named_with_units(description: str):
    assert description.startswith("These limits conflict")
    assert re.search(r"wheel_speed \(by at most \S+ rad/s\)", description)
    assert re.search(r"workspace \(by at most \S+ m\)", description)


@pytest.mark.slow
def test_amounts_are_no_more_than_what_is_certainly_enough(description: str):
    # Wheels that may rest need no room at all, and no drive reaches farther than its own length.
    assert 0 < amount(description, "wheel_speed") <= 3.0 + 1e-3
    assert 0 < amount(description, "workspace") <= 5 * 10 * 0.049


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wheel_speed", "workspace"])
def test_loosening_one_limit_by_its_amount_is_enough(description: str, name: str):
    loosened = 1.02 * amount(description, name) + 1e-3
    changes = {"wheel_speed": {"lowest": 3.0 - loosened}, "workspace": {"half_side": 0.1 + loosened}}
    assert describe(make_cornered(**changes[name])) == ""


@pytest.mark.slow
def test_a_limit_that_is_not_in_the_way_is_not_named():
    cornered = make_cornered()
    description = describe(replace(cornered, limits=(*cornered.limits, ACCELERATION)))
    assert "workspace" in description
    assert "wheel_acceleration" not in description


@pytest.mark.slow
def test_limits_that_agree_do_not_conflict():
    assert describe(problem_of(limits=(SPEED, ACCELERATION, BOX))) == ""
