"""Limits at all times by few rows, those of the instants at which a search would exceed them.

A limit at every instant is infinitely many conditions. A search begins with few of them. Where its drive
exceeds a limit on a fine grid of times, the worst instant of every such interval is added and the search goes
on, until no instant is exceeded [Blankenship and Falk, "Infinitely constrained optimization problems",
Journal of Optimization Theory and Applications 19, 1976].
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.rollout import FINE
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.optimize.lower_level import Instants, LowerLevel, within
from oed.optimize.terms.chosen import ChosenRows
from oed.optimize.terms.terms import Terms
from oed.optimize.transcription.program import OUT_OF_TIME, SLOTS, IpoptOutcome, slots_for

PER_UNKNOWN = 2.0
"""Number of first instants of a run per unknown of an input."""
LEAST, MOST = 10, 32
"""Smallest and largest number of first instants of a run, without those that fill slots: more cost more than
they save.
"""
TOGETHER = 128
"""Largest number of rows of all first instants, unless `LEAST` is more: few of many obstacles matter, and the
search soon finds out which.
"""
ENOUGH = 1e-4
"""Excess, as a share of the limit's size, up to which no instants are added."""
CLOSE = 2e-3
"""Largest excess, as a share of the limit's size, before the next solve is to full tolerance."""
IDLE = 0.02
"""Distance of a drive from a limit, as a share of its size, at an instant that may be replaced."""
EXCHANGES = 10
"""Largest number of solves with added instants."""
TIMES = 2000
"""Smallest number of times of a run at which limits are checked."""


class Exchange:
    """Choice of the instants at which the search of a problem imposes limits.

    Args:
        problem: problem with all samples.
        terms: terms of the search, on all samples or on fewer.

    Attributes:
        lower_level: search for the instants at which drives exceed the limits.
        needed: True where any limit is on instants.
        fine: number of times of a period at which limits are checked.
    """

    def __init__(self, problem: Problem, terms: Terms) -> None:
        """Store the rows of the terms."""
        self._problem, self._terms = problem, terms
        self._rows, self._searched = terms.instants, terms.problem
        self.lower_level = LowerLevel(problem, terms)
        self.needed = self._rows.count > 0
        self.fine = max(FINE, -(-TIMES // problem.design.samples))

    def first_instants(self) -> Instants:
        """Return the first instants of a search, evenly spread over each run."""
        rows = int(self._rows.systems.sum()) * self._problem.design.runs
        if not rows:
            return self._spread(LEAST)
        most = int(np.clip(TOGETHER // rows, LEAST, MOST))
        count = int(np.clip(PER_UNKNOWN * max(self._terms.embedding.counts, default=0), LEAST, most))
        # Slots that a program has anyway are filled.
        return self._spread(slots_for(count * rows) // rows)

    def at_samples(self) -> Instants:
        """Return the instants at the ends of the samples."""
        return self._spread(self._searched.design.samples)

    def _spread(self, count: int) -> Instants:
        # Evenly spread instants of every row, `count` in each run.
        space = self._problem.design
        times = space.duration * np.arange(1, count + 1) / count
        row, run = np.nonzero(np.repeat(self._rows.systems, space.runs, axis=1))
        return Instants(np.repeat(row, count), np.repeat(run, count), np.tile(times, len(row)))

    def chosen_rows(self, instants: Instants, drive: Trajectory) -> ChosenRows:
        """Return instants as rows of the search's program.

        On a grid of fewer samples a row has a different value than on all samples; its bounds are shifted by
        the difference at a drive near the solution.

        Args:
            instants: instants of drives of the problem.
            drive: drive near the solution, on all samples.
        """
        lower, upper = self._rows.lower[instants.row], self._rows.upper[instants.row]
        space = self._searched.design
        if space.samples != self._problem.design.samples:
            coarse = replace(drive, samples=space.all_samples)
            shift = self.lower_level.at(coarse, instants) - self.lower_level.at(drive, instants)
            lower, upper = lower + shift, upper + shift
        place, elapsed = within(instants, space.samples, space.period)
        constants = self._rows.constants(instants.run // space.runs, elapsed)
        return ChosenRows(
            run=instants.run,
            sample=place % space.samples,
            row=instants.row,
            share=np.ones(len(instants)),
            constants=constants,
            asked=self._asked(instants),
            lower=lower,
            upper=upper,
        )

    def _asked(self, instants: Instants) -> Array:
        # Derivatives by z of the inputs that splines ask for, in units of their scale.
        terms, count = self._terms, len(instants)
        if not self._rows.asking:
            return np.zeros((count, 0, terms.size))
        runs = instants.run % terms.problem.design.runs
        basis, places = terms.embedding.basis(runs, instants.time)
        asked, stride = np.zeros((terms.embedding.inputs, count, terms.size)), terms.embedding.sizes[0]
        for place in range(terms.embedding.inputs):
            np.add.at(asked[place], (np.arange(count), places + place * stride), basis)
        return asked.transpose(1, 0, 2)

    def solve(
        self,
        call: Callable[[Array, IpoptOutcome | None, ChosenRows | None, bool], IpoptOutcome],
        unknowns: Array,
        after: IpoptOutcome | None,
        instants: Instants,
        trajectory: Callable[[Array], Trajectory],
        until: float = np.inf,
        *,
        persistent: bool = True,
    ) -> tuple[IpoptOutcome, Instants]:
        """Solve with ever more instants until no limit is exceeded; return the outcome and these instants.

        Args:
            call: function that solves from unknowns, continues an earlier solve, with rows of instants, to a
                loose or to the full tolerance.
            unknowns: first values of z, (n,).
            after: earlier solve that the first one continues.
            instants: first instants.
            trajectory: function that returns the drive of z.
            until: deadline by `time.time`, after which the outcome has the status of Ipopt's time limit.
            persistent: whether a solve that finds no feasible drive is followed by one with more instants.
        """
        if not self.needed:
            return call(unknowns, after, None, False), instants
        # Solves need not be exact before all relevant instants are known.
        iterations, evaluations, loosely = 0, 0, after is None
        for remaining in reversed(range(EXCHANGES)):
            # The last solve is to full tolerance.
            loosely = loosely and remaining > 0
            chosen = self.chosen_rows(instants, trajectory(unknowns))
            outcome = call(unknowns, after, chosen, loosely)
            iterations, evaluations = iterations + outcome.iterations, evaluations + outcome.evaluations
            unknowns, after = outcome.unknowns, outcome if outcome.succeeded else None
            drive = trajectory(unknowns)
            more = self.more(instants, drive)
            if not len(more) and not loosely:
                break
            if outcome.infeasible and not persistent:
                break
            if time.time() > until:
                outcome = replace(outcome, return_status=OUT_OF_TIME)
                break
            loosely = loosely and bool(np.any(self.lower_level.violations(more, drive) > CLOSE))
            instants = self.with_more(instants, more, drive)
        return replace(outcome, iterations=iterations, evaluations=evaluations), instants

    def with_more(self, instants: Instants, more: Instants, drive: Trajectory) -> Instants:
        """Return instants with further ones, which replace those where a drive is farthest from the limits.

        Args:
            instants: instants of the last solve.
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
        # Joining makes a copy, which is changed in place.
        merged = instants.joined(instants.some(np.zeros(len(instants), dtype=bool)))
        for old, new in ((merged.row, more.row), (merged.run, more.run), (merged.time, more.time)):
            old[idle] = new[first]
        return merged.joined(more.some(~first))

    def more(self, instants: Instants, drive: Trajectory, finer: int = 1) -> Instants:
        """Return the worst instants of a drive that are not near the instants of the last solve.

        Args:
            instants: instants of the last solve.
            drive: drive of the problem.
            finer: factor on the number of times that are checked; half a step between these counts as near.
        """
        if not np.isfinite(drive.coefficients).all():
            return instants.some(np.zeros(len(instants), dtype=bool))
        fine = finer * self.fine
        worst = self.lower_level.peaks(drive, ENOUGH, fine)
        return worst.some(~worst.near(instants, drive.period / (2 * fine)))
