"""The bound on what headings say, by a search over the shares of ways and turns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from oed.bounds.certificate import Bound
from oed.bounds.closed_form import SPEEDS, noise_of, prior_matrix, regression_bounds
from oed.bounds.effort import STAGE, Effort
from oed.bounds.reach import coefficient_rows, input_reach, largest_rates, room, turning_length, unslipped
from oed.bounds.turns import Classes, Course
from oed.foundation.arrays import Array
from oed.kernel.criteria import E
from oed.kernel.problem import Estimation, Problem
from oed.robots.models.model import robot_of
from oed.robots.sensors.displacements import Displacements

METHOD = "ways and turns of the segments within the room, by dynamic programming"
"""How the bound is found."""
ASSUMPTIONS = (SPEEDS, "every position within the room", "exact arcs")
"""What it rests on."""
FIRST = (0.5, 0.6, 0.4)
"""Shares that are tried at first."""
ROUGH = np.linspace(0.2, 0.8, 25)
"""Shares by which drives of a number of ways are bounded at once."""
GIVEN_UP = 0.96
"""Share of the largest of these bounds below which such drives are not looked at again."""
PASSES = 8
"""Shares tried, for ten segments of which five are ways; fewer of longer searches."""
USUAL_WORK = 50
"""Segments times ways of these."""
SMALLEST_STEP = 0.005
"""Between shares."""


def heading_bounds(problem: Problem, effort: Effort) -> Iterator[Bound]:
    """The bound on E from the turns of few segments by two inputs, where the room limits the ways between."""
    measurement = problem.measurement
    if type(problem.criterion) is not E or not isinstance(measurement, Displacements):
        return
    if measurement.noise_model != "increments":
        return
    for one in problem.any_estimations:
        course = _course(problem, measurement, one) if one.block.name == "heading" else None
        if course is None:
            continue
        search = _Search(course, prior_matrix(problem, one), effort)
        known = min((other.value for other in regression_bounds(problem)), default=np.inf)
        if np.isfinite(value := search.bound(known)):
            yield Bound(value, METHOD, ASSUMPTIONS, None, one.block.name)


def _course(problem: Problem, measurement: Displacements, one: Estimation) -> Course | None:
    rows, bounds, space = coefficient_rows(problem), room(problem), problem.design
    known = rows is not None and bounds is not None and len(problem.model.inputs) == len(one.judged) == 2
    if not known or not unslipped(problem) or robot_of(problem.system).integration != "arc":
        return None
    assert rows is not None
    assert bounds is not None
    columns = [one.block.parameters.index(name) for name in one.judged]
    turn, forward = rows[0][columns], rows[1][columns]
    arm, reach = turning_length(problem), input_reach(problem)[:, columns]
    if not (forward[0] * forward[1] > 0 > turn[0] * turn[1]) or not arm or not np.isfinite(reach).all():
        return None
    low, high = np.array(bounds[::2]), np.array(bounds[1::2])
    half = float(np.linalg.norm(high - low)) / 2
    # No input changes by more than from one bound to the other.
    steps = np.minimum(space.period * largest_rates(problem)[columns], 2 * reach.max(axis=0))
    edges = [int(edge) for edge in measurement.segment_edges(space.samples)]
    weights = one.scales / noise_of(problem, one)
    start = min(_away(problem, (low + high) / 2), half)
    return Course(reach, steps, edges, forward, turn, weights, arm, half, start, space.period)


def _away(problem: Problem, middle: Array) -> float:
    # How far from the middle of the room a drive begins at most.
    starts = problem.fixed_starts
    if starts is None:
        return np.inf
    return float(np.linalg.norm(starts[0, :2] - middle) + np.sqrt(2) * problem.start_spare)


@dataclass
class _Search:
    course: Course
    known: Array
    effort: Effort

    def bound(self, known: float) -> float:
        """Of the smallest eigenvalue; infinite where the search would take too long, or end above `known`."""
        rough = np.min([self.course.roughly([share]) + self._prior(share) for share in ROUGH], axis=0)
        worth_it = np.flatnonzero(rough > GIVEN_UP * rough.max())
        floor = max((float(value) for value in rough if value <= GIVEN_UP * rough.max()), default=0.0)
        work = self.course.count * int(np.sum(worth_it))
        passes = int(PASSES * USUAL_WORK / max(work, 1))
        if passes < len(FIRST) or floor >= known:
            return np.inf
        found = floor
        for ways in worth_it[np.argsort(-rough[worth_it])]:
            value = self._of(int(ways), floor, self.effort.most(min(passes, PASSES)), float(rough[ways]))
            found = max(found, value)
        return found

    def _prior(self, share: float) -> float:
        # tr(Z P) of the prior, whichever of both Z is that of ways.
        return float(np.trace(self.known)) / 2 + (2 * share - 1) * float(self.known[0, 1])

    def _of(self, ways: int, floor: float, passes: int, rough: float) -> float:
        # Every share bounds all classes; the least of them counts for each.
        key = (float(self.course.count), float(ways))
        shares = list(FIRST) if (known := self.effort.known_centres(key)) is None else list(known)
        tables: dict[float, Array] = {}
        self.effort.progress.begin(STAGE, passes if known is None else len(known))
        while len(tables) < passes and not self.effort.spent:
            share = shares.pop(0) if shares else None if known is not None else _next(tables)
            if share is None:
                break
            found = Classes(self.course, ways, share, floor - self._prior(share)).largest()
            tables[share] = found + self._prior(share)
            self.effort.progress.advance()
        if not tables:
            return rough
        table = np.array(list(tables.values()))
        self.effort.remember(key, np.array(list(tables))[np.unique(table.argmin(axis=0))])
        return min(rough, float(table.min(axis=0).max()))


def _next(tables: dict[float, Array]) -> float | None:
    # What each class is worth is a convex function of the share: the class that is worth most is least
    # between the neighbours of the best share so far.
    shares = np.array(sorted(tables))
    table = np.array([tables[share] for share in shares])
    values = table[:, int(table.min(axis=0).argmax())]
    best = int(values.argmin())
    ends = [float(share) for share in (*shares[max(best - 1, 0) : best], *shares[best + 1 : best + 2])]
    if best in (0, len(shares) - 1):
        ends.append(float(shares[best]) + (-0.1 if best == 0 else 0.1))
    middles = [(end + float(shares[best])) / 2 for end in ends]
    open_ = [one for one in middles if abs(one - shares[best]) >= SMALLEST_STEP and 0 < one < 1]
    if not open_:
        return None

    def slope(middle: float) -> float:
        side = best + (1 if middle > shares[best] else -1)
        return float(values[side]) if 0 <= side < len(shares) else -np.inf

    return min(open_, key=slope)
