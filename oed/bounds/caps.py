"""Closed-form upper bounds on the smallest eigenvalue, each with what it rests on.

All come from lambda_min(F) <= v'F v for one direction v of unit length, or <= tr F / p: the information on a
single combination of parameters that the room, the limits or geometry keep small.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from oed.bounds.certificate import Cap
from oed.bounds.motion import coefficient_rows, grip, input_reach, room, top_speeds
from oed.measurements.displacements import Displacements
from oed.problem import Estimation, Problem, prior_of

Array = npt.NDArray[np.float64]

SPEEDS = "wheel speeds and accelerations within their limits"


def regression_caps(problem: Problem, measurement: Displacements) -> Iterator[Cap]:
    """Bounds for the paper's regressions with independent increments."""
    if measurement.noise_model != "increments":
        return
    for one in problem.any_estimations:
        weights = one.scales / (1.0 if raw(problem, one) else float(one.block.noise or 1.0))
        prior = prior_matrix(problem, one)
        yield from _trace_caps(problem, measurement, one, weights, prior)
        rows = coefficient_rows(problem)
        if one.block.name == "position" and rows is not None and len(one.judged) == len(rows[0]):
            yield from _direction_caps(problem, measurement, weights, prior, rows)


def raw(problem: Problem, one: Estimation) -> bool:
    """Whether the objective leaves the noise out."""
    return one.block.raw and problem.criterion.scaling == "none"


def prior_matrix(problem: Problem, one: Estimation) -> Array:
    """What is known beforehand of the judged parameters, scaled, were the others known: (p, p)."""
    size = len(one.judged)
    known = None if problem.prior is None else prior_of(problem.prior, one.block, one.parameters)
    if known is None:
        return np.zeros((size, size))
    return np.asarray(known[:size, :size] * np.outer(one.scales, one.scales))


def _edges(problem: Problem, measurement: Displacements) -> npt.NDArray[np.int64]:
    return measurement.segment_edges(problem.design.samples)


def _trace_caps(
    problem: Problem, measurement: Displacements, one: Estimation, weights: Array, prior: Array
) -> Iterator[Cap]:
    # Each segment's rows are sums of T w: no longer than the sum of the lengths.
    factor = grip(problem)
    if factor is None:
        return
    columns = [one.block.parameters.index(name) for name in one.judged]
    reach = factor * problem.design.period * input_reach(problem)[:, columns] * weights
    lengths = np.linalg.norm(reach, axis=1)
    edges = _edges(problem, measurement)
    sums = np.add.reduceat(lengths, edges[:-1])
    value = (float((sums**2).sum()) + float(np.trace(prior))) / len(columns)
    yield Cap(
        value,
        "largest wheel speeds in every period, the same information in all directions",
        (SPEEDS, "the room is left out"),
        np.eye(len(columns)) / len(columns),
    )


def _direction_caps(
    problem: Problem, measurement: Displacements, weights: Array, prior: Array, rows: tuple[Array, Array]
) -> Iterator[Cap]:
    edges = _edges(problem, measurement)
    count, arcs = len(edges) - 1, problem.design.integration == "arc"
    speeds, bounds = top_speeds(problem), room(problem)
    along = None if speeds is None else np.add.reduceat(problem.design.period * speeds, edges[:-1])
    if arcs:
        yield _direction(
            rows[0],
            4.0 * count,
            weights,
            prior,
            "a segment's turn is a chord of the unit circle, no longer than its diameter",
            ("exact arcs", "neither speeds nor the room matter"),
        )
    if along is not None:
        yield _direction(
            rows[1],
            float((along**2).sum()),
            weights,
            prior,
            "a segment is no longer than the top speed allows",
            (SPEEDS, "the room is left out"),
        )
    if arcs and bounds is not None:
        x_min, x_max, y_min, y_max = bounds
        diagonal = (x_max - x_min) ** 2 + (y_max - y_min) ** 2
        squares = np.full(count, diagonal) if along is None else np.minimum(along**2, diagonal)
        yield _direction(
            rows[1],
            float(squares.sum()),
            weights,
            prior,
            "a segment's displacement is no longer than the room's diagonal",
            ("exact arcs", "every position within the room", SPEEDS),
        )


def _direction(
    row: Array, value: float, weights: Array, prior: Array, method: str, assumptions: tuple[str, ...]
) -> Cap:
    # With u = row: u'M u <= value, so v = S^-1 u of unit length has v'S M S v <= value / |S^-1 u|^2.
    scaled = row / weights
    unit = scaled / np.linalg.norm(scaled)
    bound = value / float(scaled @ scaled) + float(unit @ prior @ unit)
    return Cap(bound, method, assumptions, np.outer(unit, unit))
