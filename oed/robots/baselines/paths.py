"""One baseline for a study, as large as it can be and of a given length; which ones a robot can drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache, partial

import numpy as np

from oed.foundation.errors import NotFinite, ProblemError
from oed.foundation.text import count, listing, quantity
from oed.kernel.dynamics.system import label_of
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.kernel.solution import Solution, Status, unscored
from oed.robots.baselines.baseline import Baseline
from oed.robots.baselines.fitting import MOST_LAPS, Shape, chosen, largest_by_coarse_steps, of_length
from oed.robots.baselines.kinematics import kinematics
from oed.robots.baselines.patterns import BENT, NAMES, ONE_WAY, PATTERNS, RANDOM, VARIANTS, Move, Pattern
from oed.robots.baselines.placing import Placement, approach, joined, placements, start_of
from oed.robots.baselines.rolling import smallest_size, steering, tightest
from oed.robots.baselines.schedule import least_samples, least_seconds, starts, stretched
from oed.robots.limits.workspace import workspace_of

STREAM = 17
"""Of random paths: their draws are independent of all others of a seed."""
FINER, ROUGHLY = 16, 4
"""Number of times that integration steps are finer than the study's by which baselines satisfy the limits, as
`evaluate` sees them; and by which their family, laps and size are looked for.
"""


def baselines(
    problem: Problem,
    asked: str | Baseline,
    *,
    length: float | None = None,
    seed: int = 0,
    one_way: bool = True,
) -> list[Solution]:
    """One baseline as a careful person would drive it, and where asked again with a given length, scored.

    Of the places in the room and the numbers of laps that the duration allows, each as large as the limits
    allow, it is the drive of the largest objective.

    Args:
        problem: whose limits, duration and start it is made for.
        asked: one of `NAMES`, or a baseline of the user's own.
        length: path length [m] of the second variant; None for none.
        seed: of the random path.
        one_way: whether one run may drive a square to the left alone, where that is better.

    Raises:
        ProblemError: an unknown name.
    """
    if not isinstance(asked, Baseline) and asked not in NAMES:
        raise ProblemError.about(("baselines",), f"expected one of {', '.join(NAMES)}, got {asked!r}")
    name, reason = label(asked), refusal(problem, asked)
    if reason:
        return [unscored(name, "baseline", f"{reason}.", Status.IMPOSSIBLE)]
    exact, rough = problem.refined(FINER), problem.refined(ROUGHLY)
    if asked == RANDOM:
        shape, laps, below = chosen(rough, [_random_shape(problem, seed)], 1)
    else:
        shape, laps, below = _chosen(rough, _ways(problem, asked, one_way))
    size = largest_by_coarse_steps(exact, rough, shape, laps, below=below)
    scored = [_scored(problem, name, shape, (size, laps), seed)]
    if length is not None:
        most = scored[0].evaluation.path_length if scored[0].evaluation else 0.0
        fitted = of_length(exact, shape, length, most / laps)
        scored.append(_scored(problem, f"{name}_same_length", shape, fitted, seed))
    return scored


def _chosen(problem: Problem, ways: Sequence[Pattern]) -> tuple[Shape, int, float]:
    most = largest_size(problem)
    lying = [placements(problem, way, most) for way in ways]
    turns = (True,) if problem.design.runs == 1 or problem.fixed_starts is None else (True, False)
    shapes = [placed(problem, one, in_turns=turn) for way in lying for one in way for turn in turns]
    found = chosen(problem, shapes, MOST_LAPS)
    if math.isfinite(found[2]) or steering(problem) is None:
        return found
    # What cannot be steered while the robot rolls may be driven with a stop before every arc.
    stopping = [placed(problem, one, rolls=False) for way in lying for one in way]
    stopped = chosen(problem, stopping, MOST_LAPS)
    return stopped if math.isfinite(stopped[2]) else found


def label(asked: str | Baseline) -> str:
    """The name of a baseline's result."""
    return asked if isinstance(asked, str) else asked.label


def _ways(problem: Problem, asked: str | Baseline, one_way: bool = True) -> tuple[Pattern, ...]:
    # Of a pattern and its variants; runs that take turns drive both directions themselves.
    if not isinstance(asked, str):
        return (asked.lap,)
    several = asked in ONE_WAY and problem.design.runs > 1
    ways = () if several else (PATTERNS[asked], *VARIANTS.get(asked, ()))
    ways += (ONE_WAY[asked],) if asked in ONE_WAY and (one_way or several) else ()
    return tuple(_bent(problem, one) for one in ways)


def _bent(problem: Problem, way: Pattern) -> Pattern:
    bent = BENT.get(way)
    return way if bent is None else partial(bent, tightest=tightest(problem))


def _scored(problem: Problem, name: str, shape: Shape, driven: tuple[float, int], seed: int) -> Solution:
    trajectory = shape.drive(*driven)
    try:
        evaluation = evaluate(problem, trajectory)
    except NotFinite as error:
        return unscored(name, "baseline", f"{error}.")
    return Solution(
        name=name,
        kind="baseline",
        trajectory=trajectory,
        evaluation=evaluation,
        status=Status.SCORED,
        seed=seed,
        detail=f"{shape.words(*driven)} {_limits_exceeded(evaluation, driven[0] <= shape.smallest)}".strip(),
        problem=problem,
    )


def _limits_exceeded(evaluation: Evaluation, smallest: bool) -> str:
    if evaluation.feasible:
        return ""
    size = ", though the robot turns as tightly as it can" if smallest else ""
    return f"It cannot be driven here: it exceeds {', '.join(evaluation.violations)}{size}."


def placed(problem: Problem, placement: Placement, *, in_turns: bool = True, rolls: bool = True) -> Shape:
    """The drives of a pattern that lies so in the room, of any size and number of laps.

    Args:
        problem: with the start and the number of runs.
        placement: of the pattern.
        in_turns: whether every other run drives the opposite way.
        rolls: whether a car steers while it rolls, where it can.
    """
    two = in_turns and problem.design.runs > 1 and placement.opposite != placement
    placed = (placement, placement.opposite) if two else (placement,)

    def way(one: Placement, size: float) -> list[Move]:
        # From the study's start to where the pattern begins.
        pose = one.pose(size)
        return [] if pose is None or problem.fixed_starts is None else approach(start_of(problem), pose)

    def moves(size: float, laps: int) -> list[list[Move]]:
        return [joined([*way(one, size), *one.laps(size, laps)]) for one in placed]

    def drive(size: float, laps: int) -> Trajectory:
        poses = [one.pose(size) for one in placed]
        return stretched(problem, moves(size, laps), poses, rolls=rolls)

    def fits(laps: int) -> bool:
        driven = moves(placement.largest, laps)
        return max(least_samples(problem, one, rolls=rolls) for one in driven) <= problem.design.samples

    def seconds(size: float, laps: int) -> float:
        return max(least_seconds(problem, one, rolls=rolls) for one in moves(size, laps))

    def words(size: float, laps: int) -> str:
        one_way = getattr(placement.pattern, "func", placement.pattern) in ONE_WAY.values()
        opposite = ", every other run the other way" if two else ", one way round" if one_way else ""
        backwards = ", driven backwards" if placement.reversed else ""
        steps = [_step(one) for one in way(placement, size)]
        after = f", after {listing(steps)}" if steps else ""
        return f"{count(laps, 'lap')} of {quantity(size, 'm')}{opposite}{backwards}{after}."

    smallest = smallest_size(problem, placement.pattern)
    return Shape(drive, placement.largest, smallest, fits, seconds, words)


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
    fixed = np.delete(np.arange(count), space.free_rows)
    draws[fixed] = 0.0

    start = starts(problem, [None] * space.runs)
    pushed = any(entry.pushes for entry in problem.model.inputs)
    drawn = "inputs, the largest" if pushed else "speeds, the fastest"

    def drive(size: float, laps: int) -> Trajectory:
        return space.trajectory(rest + size * (draws - rest), start)

    def words(size: float, laps: int) -> str:
        return f"Random {drawn} at {quantity(100 * size / most, '%')} of its limit."

    # Splines stay inside what they are drawn of: all may grow until one reaches its limit.
    peaks = drive(1.0, 1).extremes(0) - rest
    allowed = np.where(peaks > 0, bounds[:, 1], bounds[:, 0]) - rest
    grows = peaks * allowed > 0
    most = (1 - 1e-9) / float((peaks[grows] / allowed[grows]).max())
    return Shape(drive, most, 0.0, lambda laps: True, lambda size, laps: 0.0, words)


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


def refusal(problem: Problem, asked: str | Baseline) -> str:
    """Why the robot cannot drive a baseline, and which it can; "" where it can, if perhaps beyond its limits.

    Args:
        problem: with the robot and its inputs' limits.
        asked: a name, or a baseline of the user's own.

    Raises:
        OwnCodeError: what the user's own returned is no list of moves.
    """
    obstacle = _obstacle(problem, asked)
    if not obstacle:
        return ""
    kind = label_of(problem.model)
    return f"{kind} cannot drive a {label(asked)} ({obstacle}); it can drive {', '.join(suited(problem))}"


def try_baselines(problem: Problem, asked: Sequence[object]) -> None:
    """Ask those of the user's own for moves of the study's size; what it cannot drive is no mistake.

    Raises:
        OwnCodeError: what one returned is no list of moves.
    """
    for one in asked:
        if isinstance(one, Baseline):
            one.lap(largest_size(problem), 0)


def _obstacle(problem: Problem, asked: str | Baseline) -> str:
    if isinstance(asked, str) and asked not in PATTERNS:
        return ""
    pushing = [entry.name for entry in problem.model.inputs if entry.pushes]
    if pushing:
        return f"it is made of speeds, and {listing(pushing)} is none"
    moves = _ways(problem, asked)[0](largest_size(problem), 0)
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
