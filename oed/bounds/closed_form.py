"""Closed-form upper bounds on the smallest eigenvalue, each with what it rests on.

All come from lambda_min(F) <= v'F v for one direction v of unit length, or <= tr F / p: the information on a
single combination of parameters that the room, the limits or geometry keep small.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from oed.bounds.certificate import Bound
from oed.bounds.reach import (
    coefficient_rows,
    grip,
    input_reach,
    largest_rates,
    path_budget,
    room,
    top_speeds,
    unslipped,
)
from oed.foundation.arrays import Array, Places
from oed.kernel.criteria import E
from oed.kernel.problem import Problem
from oed.kernel.statement import Estimation, prior_of
from oed.robots.models.model import robot_of
from oed.robots.sensors.displacements import Displacements

SPEEDS = "wheel speeds and accelerations within their limits"
"""An assumption, in words."""
NO_ROOM = "the room is left out"
"""An assumption, in words."""
TURNED = "largest angles of both inputs in every segment, of which one has to turn round"
"""How a bound on what headings say is found."""


def regression_bounds(problem: Problem) -> Iterator[Bound]:
    """Bounds on E for the paper's regressions with independent increments."""
    measurement = problem.measurement
    if type(problem.criterion) is not E or not isinstance(measurement, Displacements):
        return
    if measurement.noise_model != "increments":
        return
    for one in problem.any_estimations:
        yield from _trace_bounds(problem, measurement, one)
        yield from _turned_round(problem, measurement, one)
        rows = coefficient_rows(problem)
        if one.block.name == "position" and rows is not None and len(one.judged) == len(rows[0]):
            # In the order in which the parameters are estimated.
            order = _columns(one)
            yield from _direction_bounds(problem, measurement, one, (rows[0][order], rows[1][order]))


def noise_of(problem: Problem, one: Estimation) -> float:
    """What the objective divides W by: the noise, or 1 where it takes that as it is."""
    raw = one.block.raw and problem.criterion.scaling == "none"
    return 1.0 if raw or one.block.noise is None else one.block.noise


def _columns(one: Estimation) -> list[int]:
    return [one.block.parameters.index(name) for name in one.judged]


def prior_matrix(problem: Problem, one: Estimation) -> Array:
    """The prior information on the judged parameters, scaled, were the others known: (p, p)."""
    size = len(one.judged)
    known = None if problem.prior is None else prior_of(problem.prior, one.block, one.parameters)
    if known is None:
        return np.zeros((size, size))
    return np.asarray(known[:size, :size] * np.outer(one.scales, one.scales))


def _trace_bounds(problem: Problem, measurement: Displacements, one: Estimation) -> Iterator[Bound]:
    # Each segment's rows are sums of T w: no longer than the sum of the lengths.
    factor = grip(problem)
    if factor is None:
        return
    columns, weights = _columns(one), one.scales / noise_of(problem, one)
    # A robot that also moves sideways has every input in two columns of W.
    inputs = [column % len(problem.model.inputs) for column in columns]
    reach = factor * problem.design.period * input_reach(problem)[:, inputs] * weights
    lengths = np.linalg.norm(reach, axis=1)
    edges = measurement.segment_edges(problem.design.samples)
    sums = np.add.reduceat(lengths, edges[:-1])
    value = (float((sums**2).sum()) + float(np.trace(prior_matrix(problem, one)))) / len(columns)
    yield Bound(
        value,
        "largest wheel speeds in every period, the same information in all directions",
        (SPEEDS, NO_ROOM),
        np.eye(len(columns)) / len(columns),
        one.block.name,
    )


def _turned_round(problem: Problem, measurement: Displacements, one: Estimation) -> Iterator[Bound]:
    # The heading turns by c11 and c12 times the angles a of two inputs, and the smallest eigenvalue is at
    # most half the trace less |F12|: segments in which the product of both angles has one sign, and those in
    # which it has the other, have to be about as many. So an input turns round between two of them.
    columns, known = _columns(one), prior_matrix(problem, one)
    if one.block.name != "heading" or len(columns) != 2 or not unslipped(problem):
        return
    if len(problem.model.inputs) != 2:
        return
    period, edges = problem.design.period, measurement.segment_edges(problem.design.samples)
    weights = one.scales / noise_of(problem, one)
    reach = period * input_reach(problem)[:, columns] * weights
    steps = period**2 * largest_rates(problem)[columns] * weights
    value = most_turning(reach, steps, edges) + float(np.trace(known)) / 2 + abs(float(known[0, 1]))
    yield Bound(value, TURNED, (SPEEDS, NO_ROOM), None, one.block.name)


def most_turning(reach: Array, steps: Array, edges: Places) -> float:
    """At least the smallest eigenvalue of sum a a' of the angles a (2,) of both inputs, segment by segment.

    Args:
        reach: largest angle of each input in every period, (N, 2).
        steps: largest change of each from a period to the next, (2,).
        edges: periods at which segments begin, and N, (P + 1,).
    """
    angles = np.add.reduceat(reach, edges[:-1])
    one_sign, other = angles.max(axis=1) ** 2 / 2, angles.sum(axis=1) ** 2 / 2
    # What one segment more of the sign that fewer have is worth.
    gains = np.cumsum(np.sort(other - one_sign)[::-1])
    squares, found = (angles**2).sum(axis=0), []
    for aside in range((len(angles) - 1) // 2):
        # With more segments of either sign than those at both ends, one of the others is where it changes.
        few = float(one_sign.sum() + (gains[2 * aside - 1] if aside else 0.0))
        first, last = int(edges[aside]), int(edges[-1 - aside])
        passing = [
            _passing_zero(reach[:, place], float(steps[place]), edges, first, last) for place in (0, 1)
        ]
        found.append(max(few, float(np.max(squares.sum() - squares + passing)) / 2))
    return min([float(squares.sum()) / 2, *found])


def _passing_zero(reach: Array, step: float, edges: Places, first: int, last: int) -> float:
    # The largest sum of squared angles per segment of an input that changes its sign from one period to the
    # next, or is 0 there, of those from `first` until `last`.
    periods, best = np.arange(len(reach)), 0.0
    for before in range(first, last - 1):
        away = np.where(periods <= before, before - periods + 1, periods - before)
        near = np.minimum(reach, away * step) if np.isfinite(step) else reach
        best = max(best, float((np.add.reduceat(near, edges[:-1]) ** 2).sum()))
    return best


def _direction_bounds(
    problem: Problem, measurement: Displacements, one: Estimation, rows: tuple[Array, Array]
) -> Iterator[Bound]:
    edges = measurement.segment_edges(problem.design.samples)
    count, arcs = len(edges) - 1, robot_of(problem.system).integration == "arc"
    speeds, bounds = top_speeds(problem), room(problem)
    lengths = None if speeds is None else np.add.reduceat(problem.design.period * speeds, edges[:-1])
    variance = noise_of(problem, one) ** 2
    if arcs:
        method = "a segment's turn is a chord of the unit circle, no longer than its diameter"
        assumptions: tuple[str, ...] = ("exact arcs", "neither speeds nor the room matter")
        yield along(problem, one, rows[0], 4.0 * count / variance, method, assumptions)
    if lengths is not None:
        method, assumptions = "a segment is no longer than the top speed allows", (SPEEDS, NO_ROOM)
        yield along(problem, one, rows[1], float((lengths**2).sum()) / variance, method, assumptions)
    budget = path_budget(problem)
    if lengths is not None and budget is not None:
        method = "no more path than allowed, in segments as long as the top speed allows"
        assumptions = ("path length within its limit", SPEEDS, NO_ROOM)
        yield along(problem, one, rows[1], largest_squares(lengths, budget) / variance, method, assumptions)
    if arcs and bounds is not None:
        x_min, x_max, y_min, y_max = bounds
        diagonal = (x_max - x_min) ** 2 + (y_max - y_min) ** 2
        squares = np.full(count, diagonal) if lengths is None else np.minimum(lengths**2, diagonal)
        method = "a segment's displacement is no longer than the room's diagonal"
        assumptions = ("exact arcs", "every position within the room", SPEEDS)
        yield along(problem, one, rows[1], float(squares.sum()) / variance, method, assumptions)


def largest_squares(lengths: Array, budget: float) -> float:
    """The largest sum of squares of numbers up to `lengths` that add up to at most `budget`.

    The longest first: no other numbers have larger sums of their largest ones, nor of their squares.
    """
    longest = np.sort(lengths)[::-1]
    before = np.concatenate([[0.0], np.cumsum(longest)[:-1]])
    taken = np.clip(budget - before, 0.0, longest)
    return float((taken**2).sum())


def along(
    problem: Problem, one: Estimation, change: Array, value: float, method: str, assumptions: tuple[str, ...]
) -> Bound:
    """The bound from one direction: `change` of the judged parameters, SI, has at most information `value`.

    In scaled parameters it is v times its length, so v'F v is at most value over that length squared.

    Args:
        problem: to be bounded.
        one: the estimation.
        change: of the judged parameters, SI, (p,).
        value: information on that change at most.
        method: how the bound was found, in words.
        assumptions: what it rests on, in words.
    """
    scaled = change / one.scales
    unit = scaled / np.linalg.norm(scaled)
    bound = value / float(scaled @ scaled) + float(unit @ prior_matrix(problem, one) @ unit)
    return Bound(bound, method, assumptions, np.outer(unit, unit), one.block.name)
