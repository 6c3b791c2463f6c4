"""`starts: auto`: many cheap solves within a budget of iterations, from varied starts and perturbed designs.

Every round is drawn and judged in the same order whoever solves it, and the budget is counted between rounds,
so that the result is the same for any number of workers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.work.parallel import Workers, run_tasks
from oed.kernel.coarser import coarse_samples
from oed.kernel.problem import Problem
from oed.kernel.solution import Explored
from oed.optimize.local import LocalSearch, local_search
from oed.optimize.local_results import Settings, Sketch
from oed.optimize.sketches import Sketches
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.perturbations import varied_design

BUDGET = 1200
"""Iterations, as budgets count, that the searches of a study share unless they are given."""
UNIT = 200
"""Samples of one iteration as budgets count: one on n samples, of all runs and robots, counts n/200."""
LEAST_SAMPLES = 20
"""Samples that an iteration counts as at least, for what Ipopt does itself."""
PER_COEFFICIENT = 3
"""Samples per spline coefficient of the grid explored on; the best are then solved on the search's own."""
WORTHWHILE = 0.6
"""Share of the search's samples up to which such a grid is worth building."""
ROUND = 4
"""Solves at a time."""
LEAST, SHARE = 850, 0.18
"""Ipopt's iterations, and the share of the budget, that are spent before the best, found again, ends it:
after fewer chance decides which optimum that is. Where solves are cheap, more of them are made.
"""
ELITE = 4
"""Different optima that are perturbed: the best one most often."""
HOPELESS = 24
"""Solves without a single drive that keeps the limits which end it."""
BARRIERS = (0.1, 1e-3)
"""Barrier parameters that solves begin with: a large one forgets the start, a small one keeps to it, and they
end in different optima. Which of them finds more depends on the problem.
"""
SUPPOSED = ((1, 60), (1, 40))
"""Perturbed designs solved from each, and the iterations these took, as supposed before there are any."""
FINISHED = 3
"""Optima that are solved on the search's own grid in the end, at most."""
CLOSE = 0.02
"""Share of the objective that one of them may be worse than the best, as the grid explored on sees it."""


@dataclass(frozen=True)
class Pace:
    """How thoroughly a grid is explored.

    Attributes:
        opening: rounds from starts alone, before designs are perturbed.
        different: share of the objective by which two optima differ at least.
        refined: whether of those that differ by less the better one stays; else the first.
        tolerance: of Ipopt, at least.
        again: times that the best is found again which end it, if by then half as many solves as up to its
            first time are made. Where optima are few this comes soon, where they are many never.
    """

    opening: int
    different: float
    refined: bool
    tolerance: float
    again: int


QUICK = Pace(opening=1, different=1e-4, refined=True, tolerance=1e-5, again=7)
"""Of the search's own grid, where the best ends are solved on."""
EXACT = Pace(opening=2, different=1e-5, refined=False, tolerance=0.0, again=5)
"""Of a coarser one, whose optima are ranked as they are."""


@dataclass(frozen=True)
class Attempt:
    """A solve to make: from where, and with which first barrier parameter."""

    unknowns: Array
    barrier: float
    perturbed: bool = False


@dataclass(frozen=True)
class Explorer:
    """Who makes the solves, in any process: the search of this token."""

    token: str
    problem: Problem
    settings: Settings
    pace: Pace = QUICK
    binary: tuple[int, Path] | None = None

    def __call__(self, attempt: Attempt) -> Sketch:
        """Make one."""
        if self.binary is not None:
            self.search.design.terms.take(*self.binary)
        return Sketches(self.search)(attempt.unknowns, attempt.barrier, self.pace.tolerance)

    def made(
        self, attempts: Sequence[Attempt], workers: Workers, hear: Callable[[Sketch], None]
    ) -> Iterator[tuple[Attempt, Sketch]]:
        """Make several, and hand them over in their order: cut short, those that have ended all the same.

        Args:
            attempts: to make.
            workers: that share them.
            hear: called with each as it ends.
        """
        ended = dict[int, Sketch]()

        def take(index: int, sketch: Sketch) -> None:
            ended[index] = sketch
            hear(sketch)

        try:
            run_tasks(self, attempts, workers, take)
        finally:
            yield from [(attempts[index], ended[index]) for index in sorted(ended)]

    def compiled(self, spared: float) -> Explorer:
        """With what a compiler makes of it, where that takes less time [s] than it spares."""
        slots, binary = Sketches(self.search).compile(spared) if spared else (0, None)
        return self if binary is None else replace(self, binary=(slots, binary))

    @property
    def search(self) -> LocalSearch:
        """The search, built once in each process."""
        return local_search(self.token, self.problem, self.settings)


def explorer_of(token: str, problem: Problem, settings: Settings, samples: int) -> Explorer:
    """On few samples where these tell good splines from bad ones, else on those of the search.

    Args:
        token: of the search.
        problem: to be solved.
        settings: of the search.
        samples: per run that the search itself looks at.
    """
    few = PER_COEFFICIENT * problem.design.spline.count
    own = Explorer(token, problem, settings)
    if not problem.design.spline.degree or coarse_samples(problem, few) > samples * WORTHWHILE:
        return own
    coarse = replace(settings, search_samples=few)
    return Explorer(f"{token} explored", problem, coarse, EXACT)


@dataclass
class Exploration:
    """The state of a search within a budget.

    Attributes:
        design: expressions of the grid explored on.
        fresh: ever more starts.
        rng: of perturbations.
        budget: Ipopt's iterations, each over `UNIT` samples.
        pace: how thorough it is.
        elite: the best different optima so far, the best first.
        iterations: spent, of any size.
        solves: made.
    """

    design: DesignExpressions
    fresh: Iterator[Array]
    rng: np.random.Generator
    budget: int
    pace: Pace = QUICK
    elite: list[Sketch] = field(default_factory=list)
    iterations: int = 0
    solves: int = 0
    _risen: int = 0
    _again: int = 0
    _tallies: dict[float, tuple[int, int]] = field(
        default_factory=lambda: dict(zip(BARRIERS, SUPPOSED, strict=True))
    )

    @property
    def share(self) -> float:
        """What one iteration on this grid costs of one over `UNIT` samples."""
        problem = self.design.problem
        samples = problem.design.samples * problem.design.runs * len(problem.judged_systems)
        return max(samples, LEAST_SAMPLES) / UNIT

    @property
    def spent(self) -> float:
        """Iterations spent, as budgets count."""
        return self.share * self.iterations

    @property
    def done(self) -> bool:
        """Whether the budget is spent, or the best was found often enough."""
        lost = not self.elite and self.solves >= HOPELESS
        enough = self.iterations >= LEAST and self.spent >= SHARE * self.budget
        often = enough and self._again >= self.pace.again and self.solves - self._risen >= self._risen / 2
        return self.spent >= self.budget or often or lost

    def run(self, solve: Callable[[Sequence[Attempt]], Iterable[tuple[Attempt, Sketch]]]) -> None:
        """Explore until done, `solve` making the solves of a round, in their order."""
        turn = 0
        while not self.done:
            for attempt, sketch in solve(self._round(turn)):
                self.take(attempt, sketch)
            turn += 1

    def _round(self, turn: int) -> list[Attempt]:
        places = range(ROUND * turn, ROUND * (turn + 1))
        if turn < self.pace.opening or not self.elite:
            return [self._start() for _ in places]
        *others, _ = places
        return [*(self._perturbed(place) for place in others), self._start()]

    def _start(self) -> Attempt:
        return Attempt(next(self.fresh), BARRIERS[-1])

    def _perturbed(self, place: int) -> Attempt:
        # Two of three from the best, the others from any of the elite.
        base = self.elite[0 if place % ROUND < ROUND - 2 else int(self.rng.integers(len(self.elite)))]
        moved = varied_design(self.design, base.unknowns, self.rng)
        return Attempt(moved, float(self.rng.choice(BARRIERS, p=self._shares)), perturbed=True)

    @property
    def _shares(self) -> Array:
        # How often perturbed designs are solved from each barrier: more often where it takes less.
        weights = np.array([(made / taken) ** 3 for made, taken in (self._tallies[one] for one in BARRIERS)])
        return np.asarray(weights / weights.sum())

    def take(self, attempt: Attempt, sketch: Sketch) -> None:
        """Count a solve, and keep where it ended if that is among the best."""
        self.iterations += sketch.iterations
        if attempt.perturbed:
            made, taken = self._tallies[attempt.barrier]
            self._tallies[attempt.barrier] = made + 1, taken + sketch.iterations
        self.solves += 1
        if np.isfinite(sketch.value):
            self._join(sketch)

    def _join(self, sketch: Sketch) -> None:
        size = self.pace.different * abs(sketch.value)
        before = self.elite[0].value if self.elite else -np.inf
        self._again += abs(sketch.value - before) <= size
        others = [one for one in self.elite if abs(one.value - sketch.value) > size]
        alike = [one.value for one in self.elite if abs(one.value - sketch.value) <= size]
        if alike and not (self.pace.refined and sketch.value > max(alike)):
            return
        self.elite = sorted([*others, sketch], key=lambda one: -one.value)[:ELITE]
        if sketch.value > before + size:
            self._risen, self._again = self.solves, 0

    @property
    def worth_finishing(self) -> list[Sketch]:
        """The best optima, the best first."""
        least = self.elite[0].value - CLOSE * abs(self.elite[0].value) if self.elite else 0.0
        return [one for one in self.elite[:FINISHED] if one.value >= least]

    @property
    def explored(self) -> Explored:
        """What was spent."""
        samples = self.design.problem.design.samples
        return Explored(self.solves, self.iterations, samples, self.budget, self.spent)
