"""Which baselines a robot can drive, and why not the others."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from oed.foundation.errors import Flaw
from oed.kernel.dynamics.system import label_of
from oed.kernel.problem import Problem
from oed.robots.baselines.kinematics import kinematics
from oed.robots.baselines.patterns import NAMES, PATTERNS, RANDOM, Move
from oed.robots.baselines.schedule import least_samples
from oed.robots.limits.workspace import workspace_of


def largest_size(problem: Problem) -> float:
    """A size [m] beyond which no pattern fits the room or the duration."""
    speeds = problem.input_bounds[kinematics(problem.model).drives]
    reach = float(np.abs(speeds).max()) * problem.design.duration
    room = workspace_of(problem.limits)
    if room is None:
        return reach
    x_min, x_max, y_min, y_max = room.extent
    return min(max(x_max - x_min, y_max - y_min), reach)


@lru_cache(maxsize=16)
def suited(problem: Problem) -> tuple[str, ...]:
    """Names of the baselines that the robot can drive at all; whether they fit the limits is open."""
    return tuple(name for name in NAMES if not _obstacle(problem, name))


def baseline_flaws(problem: Problem, names: Sequence[object]) -> list[Flaw]:
    """The baselines of a study that the robot cannot drive; entries that are no names pass."""
    return [
        Flaw(("baselines", index), reason)
        for index, name in enumerate(names)
        if isinstance(name, str) and (reason := refusal(problem, name))
    ]


def refusal(problem: Problem, name: str) -> str:
    """Why the robot cannot drive a baseline, and which it can; "" where it can."""
    obstacle = _obstacle(problem, name)
    if not obstacle:
        return ""
    kind = label_of(problem.model)
    return f"{kind} cannot drive a {name} ({obstacle}); it can drive {', '.join(suited(problem))}"


def _obstacle(problem: Problem, name: str) -> str:
    if name not in PATTERNS or name == RANDOM:
        return ""
    moves = PATTERNS[name](largest_size(problem), 0)
    _, made = kinematics(problem.model).directions(moves, problem.input_bounds)
    for move, possible in zip(moves, made, strict=True):
        if not possible:
            return f"it cannot {_in_words(move)}"
    needed, samples = least_samples(problem, moves), problem.design.samples
    if needed > samples:
        return f"it stops to steer, for which it needs {needed} samples, not {samples}"
    return ""


def _in_words(move: Move) -> str:
    if move.sideways:
        return "move sideways"
    if move.in_place:
        return "turn in place"
    return "drive along an arc" if move.turn else "drive straight on"
