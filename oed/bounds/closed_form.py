"""Closed-form upper bounds on the smallest eigenvalue, with their assumptions.

All come from lambda_min(F) <= v'F v for one direction v of unit length, or <= tr F / p: the information on a
single combination of parameters that the room, the limits or geometry keep small.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from oed.bounds.certificate import Bound
from oed.bounds.reach import (
    coefficient_rows,
    has_exact_inputs,
    input_reach,
    largest_input_gain,
    largest_rates,
    path_budget,
    top_speeds,
    workspace_bounds,
)
from oed.foundation.arrays import Array, Places
from oed.kernel.measurement.information import Estimation
from oed.kernel.problem import Problem
from oed.robots.models.model import robot_of
from oed.robots.sensors.displacements import Displacements

SPEEDS = "wheel speeds and accelerations within their limits"
"""An assumption, in words."""
NO_ROOM = "the room is left out"
"""An assumption, in words."""
TURNED = "largest angles of both inputs in every segment, of which one has to turn round"
"""Method of the bound on the information of headings."""


def regression_bounds(problem: Problem) -> Iterator[Bound]:
    """Yield bounds for the paper's regressions with independent increments."""
    measurement = problem.measurement
    if not isinstance(measurement, Displacements) or measurement.noise_model != "increments":
        return
    for estimation in problem.any_estimations:
        yield from _trace_bounds(problem, measurement, estimation)
        yield from _turning_bounds(problem, measurement, estimation)
        rows = coefficient_rows(problem)
        if (
            estimation.block.name == "position"
            and rows is not None
            and len(estimation.judged) == len(rows[0])
        ):
            # Columns in the order of the estimated parameters.
            order = _columns(estimation)
            yield from _direction_bounds(problem, measurement, estimation, (rows[0][order], rows[1][order]))


def noise_of(problem: Problem, estimation: Estimation) -> float:
    """Return the divisor of W in the objective: the noise, or 1 if the objective uses W as it is."""
    raw = estimation.block.raw and problem.criterion.scaling == "none"
    return 1.0 if raw or estimation.block.noise is None else estimation.block.noise


def _columns(estimation: Estimation) -> list[int]:
    return [estimation.block.parameters.index(name) for name in estimation.judged]


def prior_matrix(estimation: Estimation) -> Array:
    """Return the scaled prior information on the judged parameters, (p, p), with all others as known."""
    size = len(estimation.judged)
    if estimation.prior is None:
        return np.zeros((size, size))
    return np.asarray(estimation.prior[:size, :size] * np.outer(estimation.scales, estimation.scales))


def _trace_bounds(problem: Problem, measurement: Displacements, estimation: Estimation) -> Iterator[Bound]:
    # The rows of a segment are sums of T w, so their norm is at most the sum of the norms.
    factor = largest_input_gain(problem)
    if factor is None:
        return
    columns, weights = _columns(estimation), estimation.scales / noise_of(problem, estimation)
    # A robot that also moves sideways has every input in two columns of W.
    inputs = [column % len(problem.model.inputs) for column in columns]
    reach = factor * problem.design.period * input_reach(problem)[:, inputs] * weights
    lengths = np.linalg.norm(reach, axis=1)
    edges = measurement.segment_edges(problem.design.samples)
    sums = np.add.reduceat(lengths, edges[:-1])
    value = (float((sums**2).sum()) + float(np.trace(prior_matrix(estimation)))) / len(columns)
    yield Bound(
        value,
        "largest wheel speeds in every period, the same information in all directions",
        (SPEEDS, NO_ROOM),
        np.eye(len(columns)) / len(columns),
        estimation.block.name,
    )


def _turning_bounds(problem: Problem, measurement: Displacements, estimation: Estimation) -> Iterator[Bound]:
    # The heading turns by c11 and c12 times the angles a of two inputs, and the smallest eigenvalue is at
    # most half the trace less |F12|. So segments with a positive and with a negative product of both angles
    # have to be about equally many, and an input changes its sign between two of them.
    columns, prior = _columns(estimation), prior_matrix(estimation)
    if estimation.block.name != "heading" or len(columns) != 2 or not has_exact_inputs(problem):
        return
    if len(problem.model.inputs) != 2:
        return
    period, edges = problem.design.period, measurement.segment_edges(problem.design.samples)
    weights = estimation.scales / noise_of(problem, estimation)
    reach = period * input_reach(problem)[:, columns] * weights
    steps = period**2 * largest_rates(problem)[columns] * weights
    value = (
        turning_eigenvalue_bound(reach, steps, edges) + float(np.trace(prior)) / 2 + abs(float(prior[0, 1]))
    )
    yield Bound(value, TURNED, (SPEEDS, NO_ROOM), None, estimation.block.name)


def turning_eigenvalue_bound(reach: Array, steps: Array, edges: Places) -> float:
    """Return an upper bound on the smallest eigenvalue of sum a a' for the angles a (2,) of all segments.

    Args:
        reach: largest angle of each input in every period, (N, 2).
        steps: largest change of each angle from a period to the next, (2,).
        edges: periods at which segments begin, and N, (P + 1,).
    """
    angles = np.add.reduceat(reach, edges[:-1])
    one_sign, both_signs = angles.max(axis=1) ** 2 / 2, angles.sum(axis=1) ** 2 / 2
    # Gain of another segment with the rarer sign.
    gains = np.cumsum(np.sort(both_signs - one_sign)[::-1])
    squares, largest = (angles**2).sum(axis=0), []
    for aside in range((len(angles) - 1) // 2):
        # With more segments of either sign than those at both ends, the sign changes between the ends.
        few = float(one_sign.sum() + (gains[2 * aside - 1] if aside else 0.0))
        first, last = int(edges[aside]), int(edges[-1 - aside])
        passing = [
            _largest_with_sign_change(reach[:, place], float(steps[place]), edges, first, last)
            for place in (0, 1)
        ]
        largest.append(max(few, float(np.max(squares.sum() - squares + passing)) / 2))
    return min([float(squares.sum()) / 2, *largest])


def _largest_with_sign_change(reach: Array, step: float, edges: Places, first: int, last: int) -> float:
    # The largest sum of squared angles per segment of an input that changes its sign, or is 0, between two
    # successive periods from `first` until `last`.
    periods, best = np.arange(len(reach)), 0.0
    for before in range(first, last - 1):
        away = np.where(periods <= before, before - periods + 1, periods - before)
        near = np.minimum(reach, away * step) if np.isfinite(step) else reach
        best = max(best, float((np.add.reduceat(near, edges[:-1]) ** 2).sum()))
    return best


def _direction_bounds(
    problem: Problem, measurement: Displacements, estimation: Estimation, rows: tuple[Array, Array]
) -> Iterator[Bound]:
    edges = measurement.segment_edges(problem.design.samples)
    count, arcs = len(edges) - 1, robot_of(problem.system).integration == "arc"
    speeds, bounds, budget = top_speeds(problem), workspace_bounds(problem), path_budget(problem)
    lengths = None if speeds is None else np.add.reduceat(problem.design.period * speeds, edges[:-1])
    variance = noise_of(problem, estimation) ** 2

    def bound(row: int, squares: Array, method: str, *assumptions: str) -> Bound:
        return direction_bound(
            problem, estimation, rows[row], float(np.sum(squares)) / variance, method, assumptions
        )

    if arcs:
        method = "a segment's turn is a chord of the unit circle, no longer than its diameter"
        yield bound(0, np.full(count, 4.0), method, "exact arcs", "neither speeds nor the room matter")
    if lengths is not None:
        yield bound(1, lengths**2, "a segment is no longer than the top speed allows", SPEEDS, NO_ROOM)
    if lengths is not None and budget is not None:
        method = "no more path than allowed, in segments as long as the top speed allows"
        squares = np.array(largest_squares(lengths, budget))
        yield bound(1, squares, method, "path length within its limit", SPEEDS, NO_ROOM)
    if arcs and bounds is not None:
        x_min, x_max, y_min, y_max = bounds
        diagonal = (x_max - x_min) ** 2 + (y_max - y_min) ** 2
        squares = np.full(count, diagonal) if lengths is None else np.minimum(lengths**2, diagonal)
        method = "a segment's displacement is no longer than the room's diagonal"
        yield bound(1, squares, method, "exact arcs", "every position within the room", SPEEDS)


def largest_squares(lengths: Array, budget: float) -> float:
    """Return the largest sum of squares of numbers up to `lengths` that add up to at most `budget`.

    The budget is spent on the longest first: these numbers majorise all others.
    """
    longest = np.sort(lengths)[::-1]
    before = np.concatenate([[0.0], np.cumsum(longest)[:-1]])
    spent = np.clip(budget - before, 0.0, longest)
    return float((spent**2).sum())


def direction_bound(
    problem: Problem,
    estimation: Estimation,
    change: Array,
    value: float,
    method: str,
    assumptions: tuple[str, ...],
) -> Bound:
    """Return the bound from an upper bound `value` on the information about one direction `change`.

    In scaled parameters the change is v times its length, so v'F v is at most value over that length squared.

    Args:
        problem: problem to be bounded.
        estimation: estimation of its parameters.
        change: change of the judged parameters, SI, (p,).
        value: upper bound on the information about the change.
        method: derivation of the bound, in words.
        assumptions: assumptions of the bound, in words.
    """
    scaled = change / estimation.scales
    unit = scaled / np.linalg.norm(scaled)
    bound = value / float(scaled @ scaled) + float(unit @ prior_matrix(estimation) @ unit)
    return Bound(bound, method, assumptions, np.outer(unit, unit), estimation.block.name)
