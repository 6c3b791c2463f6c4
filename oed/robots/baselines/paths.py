"""One baseline for a study, as large as it can be and of a given length; which ones a robot can drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from oed.foundation.errors import Flaw, NotFinite, ProblemError
from oed.foundation.text import count, listing, quantity
from oed.kernel.dynamics.system import label_of
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import Evaluation, evaluate
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution, Status, unscored
from oed.robots.baselines.baseline import Baseline
from oed.robots.baselines.fitting import MOST_LAPS, Shape, chosen, largest, of_length
from oed.robots.baselines.kinematics import kinematics
from oed.robots.baselines.patterns import NAMES, PATTERNS, RANDOM, VARIANTS, Move, Pattern
from oed.robots.baselines.placing import Placement, approach, joined, placements, start_of
from oed.robots.baselines.schedule import least_samples, least_seconds, starts, stretched
from oed.robots.limits.workspace import workspace_of

STREAM = 17
"""Of random paths: their draws are independent of all others of a seed."""


def baselines(
    problem: Problem, asked: str | Baseline, *, length: float | None = None, seed: int = 0
) -> list[Solution]:
    """One baseline as a careful person would drive it, and where asked again with a given length, scored.

    Of the places in the room and the numbers of laps that the duration allows, each as large as the limits
    allow, it is the drive of the largest objective.

    Args:
        problem: whose limits, duration and start it is made for.
        asked: one of `NAMES`, or a baseline of the user's own.
        length: path length [m] of the second variant; None for none.
        seed: of the random path.

    Raises:
        ProblemError: an unknown name, or a path that the robot cannot drive.
    """
    known = isinstance(asked, Baseline) or asked in NAMES
    text = "" if known else f"expected one of {', '.join(NAMES)}, got {asked!r}"
    text = text or refusal(problem, asked)
    if text:
        raise ProblemError.about(("baselines",), text)
    name = label(asked)
    if asked == RANDOM:
        shapes = [_random_shape(problem, seed)]
    else:
        most = largest_size(problem)
        ways = (_pattern(asked), *(VARIANTS.get(asked, ()) if isinstance(asked, str) else ()))
        shapes = [placed(problem, one) for way in ways for one in placements(problem, way, most)]
    shape, laps, below = chosen(problem, shapes, 1 if asked == RANDOM else MOST_LAPS)
    scored = [_scored(problem, name, shape, (largest(problem, shape, laps, below=below), laps), seed)]
    if length is not None:
        most = scored[0].evaluation.path_length if scored[0].evaluation else 0.0
        fitted = of_length(problem, shape, length, most / laps)
        scored.append(_scored(problem, f"{name}_same_length", shape, fitted, seed))
    return scored


def label(asked: str | Baseline) -> str:
    """The name of a baseline's result."""
    return asked if isinstance(asked, str) else asked.label


def _pattern(asked: str | Baseline) -> Pattern:
    return PATTERNS[asked] if isinstance(asked, str) else asked.lap


def _scored(problem: Problem, name: str, shape: Shape, driven: tuple[float, int], seed: int) -> Solution:
    trajectory = shape.drive(*driven)
    try:
        evaluation = evaluate(problem, trajectory)
    except NotFinite as error:
        return unscored(name, "baseline", error)
    return Solution(
        name=name,
        kind="baseline",
        trajectory=trajectory,
        evaluation=evaluation,
        status=Status.SCORED,
        seed=seed,
        detail=f"{shape.words(*driven)} {_limits_exceeded(evaluation)}".strip(),
        problem=problem,
    )


def _limits_exceeded(evaluation: Evaluation) -> str:
    if evaluation.feasible:
        return ""
    return f"It cannot be driven here: it exceeds {', '.join(evaluation.violations)}."


def placed(problem: Problem, placement: Placement) -> Shape:
    """The drives of a pattern that lies so in the room, of any size and number of laps."""

    def way(size: float) -> list[Move]:
        # From the study's start to where the pattern begins.
        pose = placement.pose(size)
        return [] if pose is None or problem.fixed_starts is None else approach(start_of(problem), pose)

    def moves(size: float, laps: int) -> list[Move]:
        return joined([*way(size), *placement.laps(size, laps)])

    def drive(size: float, laps: int) -> Trajectory:
        return stretched(problem, moves(size, laps), placement.pose(size))

    def fits(laps: int) -> bool:
        return least_samples(problem, moves(placement.largest, laps)) <= problem.design.samples

    def seconds(size: float, laps: int) -> float:
        return least_seconds(problem, moves(size, laps))

    def words(size: float, laps: int) -> str:
        backwards = ", driven backwards" if placement.reversed else ""
        steps = [_step(one) for one in way(size)]
        after = f", after {listing(steps)}" if steps else ""
        return f"{count(laps, 'lap')} of {quantity(size, 'm')}{backwards}{after}."

    return Shape(drive, placement.largest, fits, seconds, words)


def _step(move: Move) -> str:
    # Of the way to where a pattern begins.
    if move.in_place:
        return f"turning by {math.degrees(abs(move.turn)):.0f} deg in place"
    return f"driving {quantity(move.forward, 'm')}"


def _random_shape(problem: Problem, seed: int) -> Shape:
    space = problem.design
    bounds, count = problem.input_bounds, space.all_coefficients
    rest = np.clip(0.0, bounds[:, 0], bounds[:, 1])
    draws = np.random.default_rng([seed, STREAM]).uniform(bounds[:, 0], bounds[:, 1], (count, len(bounds)))
    held = np.zeros(count, dtype=bool)
    held[space.free_rows] = True

    def drive(size: float, laps: int) -> Trajectory:
        table = rest + size * (draws - rest)
        return space.trajectory(np.where(held[:, None], table, 0.0), starts(problem))

    def words(size: float, laps: int) -> str:
        return f"Random speeds, at {quantity(100 * size, '%')} of their limits."

    return Shape(drive, 1.0, lambda laps: True, lambda size, laps: 0.0, words)


def largest_size(problem: Problem) -> float:
    """A size [m] beyond which no pattern fits the room or the duration."""
    speeds = problem.input_bounds[kinematics(problem.model).drives]
    reach = float(np.abs(speeds).max()) * problem.design.duration
    room = workspace_of(problem.limits)
    if room is None:
        return reach
    x_min, x_max, y_min, y_max = room.extent
    return min(math.hypot(x_max - x_min, y_max - y_min), reach)


@lru_cache(maxsize=16)
def suited(problem: Problem) -> tuple[str, ...]:
    """Names of the baselines that the robot can drive at all; whether they fit the limits is open."""
    return tuple(name for name in NAMES if not _obstacle(problem, name))


def baseline_flaws(problem: Problem, names: Sequence[object]) -> list[Flaw]:
    """The baselines of a study that the robot cannot drive; paths of the user's own pass."""
    return [
        Flaw(("baselines", index), reason)
        for index, name in enumerate(names)
        if isinstance(name, str | Baseline) and (reason := refusal(problem, name))
    ]


def refusal(problem: Problem, asked: str | Baseline) -> str:
    """Why the robot cannot drive a baseline, and which it can; "" where it can."""
    obstacle = _obstacle(problem, asked)
    if not obstacle:
        return ""
    kind = label_of(problem.model)
    return f"{kind} cannot drive a {label(asked)} ({obstacle}); it can drive {', '.join(suited(problem))}"


def _obstacle(problem: Problem, asked: str | Baseline) -> str:
    if isinstance(asked, str) and asked not in PATTERNS:
        return ""
    moves = _pattern(asked)(largest_size(problem), 0)
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
