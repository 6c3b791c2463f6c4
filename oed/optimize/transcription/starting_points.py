"""Where local searches begin: random drives, screened, and small random coefficients."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count

import numpy as np

from oed.foundation.arrays import Array
from oed.optimize.transcription.design import DesignExpressions

SCREENED = 2000
"""Random drives simulated to choose starts from."""
POOL = 200
"""Screened drives, the best ones, among which varied starts are chosen."""
SMALL = 0.25
"""Amplitude of the small random starts, as a share of each input's range."""
DISCOUNT = 1.0
"""Standard scores of the criterion that exceeding limits by their own size costs in the screening."""
HUGE = 1e100
"""Size of a criterion from which on its variance is not taken as it is."""
USUAL = (-1.0, 1.0)
"""Where a start state of any other unit is tried, SI, if no limit bounds it."""
PERTURBATION = 0.15
"""Standard deviation of a perturbation, as a share of each input's largest value."""


def random_drives(design: DesignExpressions, amplitudes: Array, rng: np.random.Generator) -> Array:
    """Unknowns (K, size) of random drives: every input uniform within a share (K,) of its range.

    Args:
        design: the problem's expressions.
        amplitudes: shares of the inputs' ranges, (K,).
        rng: of the draws.
    """
    low, high = design.coefficient_bounds.T
    centre = np.clip(0.0, low, high)
    draws = rng.uniform(low, high, (len(amplitudes), len(centre)))
    coefficients = centre + amplitudes[:, None] * (draws - centre)
    coefficients = design.terms.embedding.within(coefficients, design.ranges)
    if design.terms.size == design.terms.coefficient_count:
        return np.asarray(coefficients)
    return np.hstack([coefficients, random_starts(design, len(amplitudes), rng)])


def start_bounds(design: DesignExpressions) -> Array:
    """Bounds (k * runs, 2) of the unknowns that are start states: the space's own, or what limits say of
    them, else all angles, and a place.
    """
    chosen = design.problem.chosen_starts
    if chosen is not None and chosen.bounded:
        return chosen.bounds
    robot, known = design.problem.system, dict[str, tuple[float, float]]()
    for limit in design.problem.limits:
        for state, (low, high) in limit.state_bounds().items():
            least, most = known.get(state, (-np.inf, np.inf))
            known[state] = (max(low, least), min(high, most))
    usual = {"m": (-1e-3, 1e-3), "rad": (-np.pi, np.pi)}
    units = zip(robot.states[: robot.chosen_states], robot.state_units, strict=False)
    pose = np.array([known.get(state, usual.get(unit, USUAL)) for state, unit in units])
    return np.tile(pose, (design.problem.design.runs, 1))


def random_starts(design: DesignExpressions, count: int, rng: np.random.Generator) -> Array:
    """Random start states (count, k * runs) within those bounds.

    Args:
        design: the problem's expressions.
        count: how many.
        rng: of the draws.
    """
    # Coordinate by coordinate, as they always were drawn.
    columns = [rng.uniform(low, high, count) for low, high in start_bounds(design)]
    return np.stack(columns, axis=1)


@dataclass(frozen=True)
class Screening:
    """Random drives, scored at the samples.

    Attributes:
        candidates: their unknowns, (K, size).
        values: of the criterion, (K,).
        violations: of each limit as a share of its size, (K, limits).
    """

    candidates: Array
    values: Array
    violations: Array

    def kept(self, tolerance: float) -> list[Array]:
        """Unknowns of those that keep every limit at the samples within that share, the best first."""
        kept = np.isfinite(self.values) & (self.violations.max(axis=1, initial=0.0) <= tolerance)
        places = np.flatnonzero(kept)
        return list(self.candidates[places[np.argsort(-self.values[places], kind="stable")]])


def screen(design: DesignExpressions, rng: np.random.Generator) -> Screening:
    """Simulate random drives of all sizes."""
    candidates = random_drives(design, rng.uniform(0.05, 1.0, SCREENED), rng)
    return Screening(candidates, *design.score_many(candidates))


def starting_points(
    design: DesignExpressions, count: int, rng: np.random.Generator, screened: Screening | None = None
) -> list[Array]:
    """Unknowns of `count` starts: half screened, half small.

    Screening ranks random drives by criterion, discounted by how far they exceed the limits.

    Args:
        design: the problem's expressions.
        count: how many.
        rng: of the draws.
        screened: the screened random drives.
    """
    found = screen(design, rng) if screened is None else screened
    order = np.argsort(-_merit(found.values, found.violations), kind="stable")
    # Taking turns, so that a search cut short has tried both sorts.
    starts = np.empty((count, design.terms.size))
    starts[0::2] = found.candidates[order[: (count + 1) // 2]]
    starts[1::2] = random_drives(design, np.full(count // 2, SMALL), rng)
    return list(starts)


def varied_starts(
    design: DesignExpressions, screened: Screening, rng: np.random.Generator
) -> Iterator[Array]:
    """Unknowns of ever more starts: the best screened drives, those among the better ones that are least like
    the starts before, and random ones about the middle of the inputs' ranges.

    Args:
        design: the problem's expressions.
        screened: random drives.
        rng: of the draws.
    """
    order = np.argsort(-_merit(screened.values, screened.violations), kind="stable")
    pool = screened.candidates[order[:POOL]]
    nearest, left = np.full(len(pool), np.inf), np.ones(len(pool), dtype=bool)
    for turn in count():
        if turn % 4 == 3 or not left.any():
            yield _about_middle(design, rng)
            continue
        # By merit the first time and every fourth; else the one that is farthest from all taken so far.
        place = int(np.argmax(left) if turn % 4 == 0 else np.argmax(np.where(left, nearest, -1.0)))
        left[place] = False
        nearest = np.minimum(nearest, np.linalg.norm(pool - pool[place], axis=1))
        yield pool[place]


def _about_middle(design: DesignExpressions, rng: np.random.Generator) -> Array:
    # Inputs that cannot be negative have their zero at an end of their range, where little can be separated.
    low, high = design.coefficient_bounds.T
    middle, share = (low + high) / 2, rng.uniform(SMALL, 1.0)
    drawn = middle + share * (rng.uniform(low, high) - middle)
    own = design.terms.embedding.within(drawn[None, :], design.ranges)[0]
    if design.terms.size == len(own):
        return np.asarray(own)
    return np.concatenate([own, random_starts(design, 1, rng)[0]])


def _merit(values: Array, violations: Array) -> Array:
    # Standard scores, so that criteria of any size and sign are discounted alike.
    finite = np.isfinite(values)
    if not finite.any():
        return np.asarray(-violations.sum(axis=1))
    largest = float(np.abs(values[finite]).max())
    if largest > HUGE:
        # Of a system that all but goes beyond all bounds: its square is no number.
        values = values / largest
    spread = float(values[finite].std()) or 1.0
    scores = np.where(finite, (values - values[finite].mean()) / spread, -1e3)
    return np.asarray(scores - DISCOUNT * violations.sum(axis=1))


def perturbed(design: DesignExpressions, unknowns: Array, rng: np.random.Generator) -> Array:
    """A neighbour of a design: every coefficient perturbed, within the inputs' bounds.

    Args:
        design: the problem's expressions.
        unknowns: of the design, (size,).
        rng: of the draws.
    """
    moved: Array = unknowns + PERTURBATION * rng.standard_normal(len(unknowns))
    head = moved[: design.terms.coefficient_count]
    np.clip(head, *design.coefficient_bounds.T, out=head)
    return np.clip(moved, *design.terms.own_bounds.T)
