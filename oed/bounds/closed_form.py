"""Closed-form upper bounds on the smallest eigenvalue, each with what it rests on.

All come from lambda_min(F) <= v'F v for one direction v of unit length, or <= tr F / p: the information on a
single combination of parameters that the room, the limits or geometry keep small.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from oed.bounds.certificate import Bound
from oed.bounds.reach import coefficient_rows, grip, input_reach, path_budget, room, top_speeds
from oed.foundation.arrays import Array
from oed.kernel.criteria import E
from oed.kernel.problem import Estimation, Problem, prior_of
from oed.robots.models.model import robot_of
from oed.robots.sensors.displacements import Displacements

SPEEDS = "wheel speeds and accelerations within their limits"
"""An assumption, in words."""
NO_ROOM = "the room is left out"
"""An assumption, in words."""


def regression_bounds(problem: Problem) -> Iterator[Bound]:
    """Bounds on E for the paper's regressions with independent increments."""
    measurement = problem.measurement
    if type(problem.criterion) is not E or not isinstance(measurement, Displacements):
        return
    if measurement.noise_model != "increments":
        return
    for one in problem.any_estimations:
        yield from _trace_bounds(problem, measurement, one)
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
