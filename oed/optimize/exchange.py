"""Limits at all times by few rows: those of the instants at which a search would leave them.

A limit on every instant is infinitely many conditions. A search begins with few of them; where the drive that
it ends on exceeds a limit on a fine grid of times, the worst instants of every such stretch are added, and it
goes on from there, until nothing is left to add [Blankenship and Falk, "Infinitely constrained optimization
problems", Journal of Optimization Theory and Applications 19, 1976].
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics import spline
from oed.kernel.dynamics.embedding import OneSpline
from oed.kernel.dynamics.rollout import FINE
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.optimize.lower_level import Instants, LowerLevel, within
from oed.optimize.terms.base import Terms
from oed.optimize.terms.slots import Chosen
from oed.optimize.transcription.program import OUT_OF_TIME, SLOTS, Outcome, slots_for

PER_UNKNOWN = 2.0
"""Instants per unknown of an input that a search begins with in a run."""
LEAST, MOST = 10, 32
"""Instants of a run that it begins with at least, and at most, but for slots that would be empty: more cost
more than they save.
"""
TOGETHER = 128
"""Rows of all instants that it begins with at most, but for the least number of each: of many obstacles few
count, and which is found out soon.
"""
ENOUGH = 1e-4
"""Share of a limit's size by which a drive exceeds it where nothing is added any more."""
CLOSE = 2e-3
"""Share of a limit's size by which it is exceeded at most where the next solve is to the end."""
IDLE = 0.02
"""Share of a limit's size that a drive stays away from it at an instant that others may take the place of."""
EXCHANGES = 10
"""Times that a search goes on with more instants before it is judged as it is."""
TIMES = 2000
"""Times of a run at which limits are looked at, at least."""


class Exchange:
    """Choice of the instants that a search of one problem looks at.

    Args:
        problem: problem, all of whose samples count.
        terms: terms of the search, on all samples or on fewer.

    Attributes:
        lower_level: where given drives exceed the limits.
    """

    def __init__(self, problem: Problem, terms: Terms) -> None:
        """Look at no drive yet."""
        self._problem, self._terms = problem, terms
        self._rows, self._searched = terms.instants, terms.problem
        self.lower_level = LowerLevel(problem, terms)
        self.needed = self._rows.count > 0
        """True when any limit is on instants."""
        self.fine = max(FINE, -(-TIMES // problem.design.samples))
        """Times of a period at which limits are looked at."""

    def begun(self) -> Instants:
        """Return the instants to begin with, evenly spread over each run."""
        rows = self._rows.count * self._problem.design.runs
        if not rows:
            return self._spread(LEAST)
        most = int(np.clip(TOGETHER // rows, LEAST, MOST))
        count = int(np.clip(PER_UNKNOWN * max(self._terms.embedding.counts, default=0), LEAST, most))
        # Slots that are there anyway need not be empty.
        return self._spread(slots_for(count * rows) // rows)

    def at_samples(self) -> Instants:
        """Return the instants at the ends of the samples."""
        return self._spread(self._searched.design.samples)

    def _spread(self, count: int) -> Instants:
        # So many in each run, evenly, of every row.
        space, rows = self._problem.design, self._rows.count
        times = space.duration * np.arange(1, count + 1) / count
        row = np.repeat(np.arange(rows), space.runs * count)
        run = np.tile(np.repeat(np.arange(space.runs), count), rows)
        return Instants(row, run, np.tile(times, rows * space.runs))

    def chosen(self, instants: Instants, drive: Trajectory) -> Chosen:
        """Return instants as rows of the search's program, at a drive of the problem close to which it looks.

        On fewer samples than all a row has another value there; its bounds are moved by that.

        Args:
            instants: instants of the problem's drives.
            drive: drive on all samples.
        """
        lower, upper = self._rows.lower[instants.row], self._rows.upper[instants.row]
        space = self._searched.design
        if space.samples != self._problem.design.samples:
            coarse = replace(drive, samples=space.all_samples)
            shift = self.lower_level.at(coarse, instants) - self.lower_level.at(drive, instants)
            lower, upper = lower + shift, upper + shift
        sample, elapsed = within(instants, space.samples, space.period)
        basis, places = self._basis(instants)
        return Chosen(sample, elapsed, instants.row, basis, places, lower, upper, self._rows.count)

    def _basis(self, instants: Instants) -> tuple[Array, Places]:
        # Values of the basis functions that are not 0, and the first input's unknowns that they are of.
        embedding, space = self._terms.embedding, self._searched.design
        if not self._rows.asking:
            return np.zeros((0, len(instants))), np.zeros((0, len(instants)), dtype=int)
        assert isinstance(embedding, OneSpline)
        degree = space.own_spline.degree
        band = spline.basis(space.own_knots, degree, instants.time)
        first = instants.run * (space.all_coefficients // space.runs)
        every = first[:, None] + band.places
        # Of coefficients that rest fixes there is no unknown.
        place = np.full(space.all_coefficients, -1)
        place[embedding.free] = np.arange(len(embedding.free))
        unknown = place[every]
        return np.where(unknown < 0, 0.0, band.entries).T, np.maximum(unknown, 0).T

    def solved(
        self,
        solve: Callable[[Array, Outcome | None, Chosen | None, bool], Outcome],
        unknowns: Array,
        after: Outcome | None,
        instants: Instants,
        trajectory: Callable[[Array], Trajectory],
        until: float = np.inf,
    ) -> tuple[Outcome, Instants]:
        """Solve, and go on with more instants until none is exceeded.

        Args:
            solve: solve from unknowns, after a solve, with rows of instants, loosely or to the end.
            unknowns: unknowns to begin at.
            after: solve that it goes on from.
            instants: instants to begin with.
            trajectory: function that returns the drive of unknowns.
            until: end by `time.time`; what is not done by then is as if Ipopt had run out of time.
        """
        if not self.needed:
            return solve(unknowns, after, None, False), instants
        # What comes before all instants that count are known need not be exact.
        iterations, evaluations, loosely = 0, 0, after is None
        for remaining in reversed(range(EXCHANGES)):
            # What is handed on in the end is solved to the end.
            loosely = loosely and remaining > 0
            chosen = self.chosen(instants, trajectory(unknowns))
            outcome = solve(unknowns, after, chosen, loosely)
            iterations, evaluations = iterations + outcome.iterations, evaluations + outcome.evaluations
            unknowns, after = outcome.unknowns, outcome if outcome.succeeded else None
            drive = trajectory(unknowns)
            more = self.more(instants, drive)
            if not len(more) and not loosely:
                break
            if time.time() > until:
                outcome = replace(outcome, return_status=OUT_OF_TIME)
                break
            loosely = loosely and bool(np.any(self.lower_level.violations(more, drive) > CLOSE))
            instants = self.with_more(instants, more, drive)
        return replace(outcome, iterations=iterations, evaluations=evaluations), instants

    def with_more(self, instants: Instants, more: Instants, drive: Trajectory) -> Instants:
        """Return instants with further ones, which take the places of those that a drive is farthest from.

        Args:
            instants: instants that are looked at.
            more: instants to be added.
            drive: drive of the problem.
        """
        missing = len(more) - (-len(instants) % SLOTS)
        if missing <= 0:
            return instants.joined(more)
        excess = self.lower_level.violations(instants, drive)
        idle = np.argsort(excess, kind="stable")[:missing]
        idle = idle[excess[idle] < -IDLE]
        first = np.arange(len(more)) < len(idle)
        # Joining copies them.
        merged = instants.joined(instants.some(np.zeros(len(instants), dtype=bool)))
        for old, new in ((merged.row, more.row), (merged.run, more.run), (merged.time, more.time)):
            old[idle] = new[first]
        return merged.joined(more.some(~first))

    def more(self, instants: Instants, drive: Trajectory, finer: int = 1) -> Instants:
        """Return the worst instants of a drive that are not among others, to half a step of the fine grid.

        Args:
            instants: instants that are looked at.
            drive: drive of the problem.
            finer: factor on the times that are looked at.
        """
        if not np.isfinite(drive.coefficients).all():
            return instants.some(np.zeros(len(instants), dtype=bool))
        fine = finer * self.fine
        worst = self.lower_level.exceeded(drive, ENOUGH, fine)
        return worst.some(~worst.near(instants, drive.period / (2 * fine)))
