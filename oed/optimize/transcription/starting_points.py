"""Starts of local searches: screened random drives, and small random coefficients."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count

import numpy as np

from oed.foundation.arrays import Array
from oed.optimize.transcription.design import DesignExpressions

SCREENED = 2000
"""Number of random drives among which starts are chosen."""
POOL = 200
"""Number of the best screened drives among which varied starts are chosen."""
SMALL = 0.25
"""Amplitude of the small random starts, as a share of each input's range."""
DISCOUNT = 1.0
"""Standard scores of the criterion that exceeding limits by their own size costs in the screening."""
HUGE = 1e100
"""Size of a criterion above which it is scaled before its variance is taken, lest that overflow."""
USUAL = (-1.0, 1.0)
"""Default range of start states in units other than m and rad that no limit bounds, SI."""


def random_drives(
    design: DesignExpressions, amplitudes: Array, rng: np.random.Generator, centre: Array | None = None
) -> Array:
    """Return the unknowns (K, size) of random drives: every input is uniform within a share of its range.

    Args:
        design: expressions of the problem.
        amplitudes: shares of the inputs' ranges, (K,).
        rng: generator of the draws.
        centre: coefficients at amplitude 0; by default those closest to 0 within the ranges.
    """
    low, high = design.coefficient_bounds.T
    centre = np.clip(0.0, low, high) if centre is None else centre
    draws = rng.uniform(low, high, (len(amplitudes), len(centre)))
    coefficients = centre + amplitudes[:, None] * (draws - centre)
    coefficients = design.terms.embedding.within(coefficients, design.ranges)
    if design.terms.size == design.terms.coefficient_count:
        return np.asarray(coefficients)
    return np.hstack([coefficients, random_starts(design, len(amplitudes), rng)])


def start_bounds(design: DesignExpressions) -> Array:
    """Return the bounds (k * runs, 2) of the unknowns that are start states.

    They are those of the design space, or else those of the limits. Without either, all angles are allowed,
    and positions lie within a millimetre of the origin.
    """
    if design.problem.starts.bounded:
        return design.problem.starts.bounds
    robot, ranges = design.problem.system, dict[str, tuple[float, float]]()
    for limit in design.problem.limits:
        for state, (low, high) in limit.state_bounds().items():
            least, most = ranges.get(state, (-np.inf, np.inf))
            ranges[state] = (max(low, least), min(high, most))
    usual = {"m": (-1e-3, 1e-3), "rad": (-np.pi, np.pi)}
    units = zip(robot.states[: robot.chosen_states], robot.state_units, strict=False)
    pose = np.array([ranges.get(state, usual.get(unit, USUAL)) for state, unit in units])
    return np.tile(pose, (design.problem.design.runs, 1))


def random_starts(design: DesignExpressions, count: int, rng: np.random.Generator) -> Array:
    """Return random start states (count, k * runs) within `start_bounds`.

    Args:
        design: expressions of the problem.
        count: number of draws.
        rng: generator of the draws.
    """
    columns = [rng.uniform(low, high, count) for low, high in start_bounds(design)]
    return np.stack(columns, axis=1)


@dataclass(frozen=True)
class Screening:
    """Random drives, scored at the samples.

    Attributes:
        candidates: unknowns of the drives, (K, size).
        values: values of the criterion, (K,).
        violations: violation of each limit as a share of its size, (K, limits).
    """

    candidates: Array
    values: Array
    violations: Array

    def feasible(self, tolerance: float) -> list[Array]:
        """Return the unknowns of drives that satisfy all limits at the samples, the best drive first.

        A violation up to `tolerance`, as a share of the limit's size, counts as satisfied.
        """
        satisfied = self.violations.max(axis=1, initial=0.0) <= tolerance
        places = np.flatnonzero(np.isfinite(self.values) & satisfied)
        return list(self.candidates[places[np.argsort(-self.values[places], kind="stable")]])


def screen(design: DesignExpressions, rng: np.random.Generator) -> Screening:
    """Return random drives of all sizes, simulated and scored."""
    candidates = random_drives(design, rng.uniform(0.05, 1.0, SCREENED), rng)
    values, excess = design.score_many(candidates)
    return Screening(candidates, values, np.maximum(0.0, excess))


def starting_points(
    design: DesignExpressions, count: int, rng: np.random.Generator, screened: Screening | None = None
) -> list[Array]:
    """Return the unknowns of starts: half of them screened random drives, half small coefficients.

    Screening ranks random drives by the criterion, discounted by their excess over the limits.

    Args:
        design: expressions of the problem.
        count: number of starts.
        rng: generator of the draws.
        screened: screened random drives; by default they are drawn here.
    """
    screened = screen(design, rng) if screened is None else screened
    order = np.argsort(-_merit(screened.values, screened.violations), kind="stable")
    # Both kinds take turns, so that an interrupted search has tried both.
    starts = np.empty((count, design.terms.size))
    starts[0::2] = screened.candidates[order[: (count + 1) // 2]]
    starts[1::2] = random_drives(design, np.full(count // 2, SMALL), rng)
    return list(starts)


def varied_starts(
    design: DesignExpressions, screened: Screening, rng: np.random.Generator
) -> Iterator[Array]:
    """Yield the unknowns of ever more starts, of three kinds in turn.

    The kinds are the best screened drives, good screened drives that differ most from the starts before, and
    random drives about the middle of the inputs' ranges.

    Args:
        design: expressions of the problem.
        screened: screened random drives.
        rng: generator of the draws.
    """
    order = np.argsort(-_merit(screened.values, screened.violations), kind="stable")
    pool = screened.candidates[order[:POOL]]
    nearest, unused = np.full(len(pool), np.inf), np.ones(len(pool), dtype=bool)
    for turn in count():
        if turn % 4 == 3 or not unused.any():
            yield _about_middle(design, rng)
            continue
        # The best remaining drive every fourth time, else the drive farthest from all starts so far.
        place = int(np.argmax(unused) if turn % 4 == 0 else np.argmax(np.where(unused, nearest, -1.0)))
        unused[place] = False
        nearest = np.minimum(nearest, np.linalg.norm(pool - pool[place], axis=1))
        yield pool[place]


def _about_middle(design: DesignExpressions, rng: np.random.Generator) -> Array:
    # Inputs that cannot be negative have their zero at an end of their range, where little can be separated.
    low, high = design.coefficient_bounds.T
    return np.asarray(random_drives(design, rng.uniform(SMALL, 1.0, 1), rng, (low + high) / 2)[0])


def _merit(values: Array, violations: Array) -> Array:
    # Standard scores, so that criteria of any size and sign are discounted alike.
    finite = np.isfinite(values)
    if not finite.any():
        return np.asarray(-violations.sum(axis=1))
    largest = float(np.abs(values[finite]).max())
    if largest > HUGE:
        # The square of a criterion of a nearly unbounded system would overflow.
        values = values / largest
    spread = float(values[finite].std()) or 1.0
    scores = np.where(finite, (values - values[finite].mean()) / spread, -1e3)
    return np.asarray(scores - DISCOUNT * violations.sum(axis=1))
