"""`starts: auto`: many cheap solves within a budget of iterations, from varied starts and perturbed designs.

Every round is drawn and judged in the same order whoever solves it, and the budget is counted in iterations,
so that the result is the same for any number of workers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.coarser import coarse_samples
from oed.kernel.solution import Explored
from oed.optimize.local import LocalSearch
from oed.optimize.results import LocalResult
from oed.optimize.shared_search import SharedSearch
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.perturbations import varied_design

UNIT = 200
"""Samples of one iteration as budgets count: one on n samples, of all runs and robots, counts n/200."""
LEAST_SAMPLES = 20
"""Samples that an iteration counts as at least, for what Ipopt does itself."""
PER_COEFFICIENT = 3
"""Samples per spline coefficient of the grid explored on; the best are then solved on the search's own."""
WORTHWHILE = 0.6
"""Share of the search's samples up to which such a grid is worth building."""
ROUND = 4
"""Number of solves that are drawn together."""
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


DIFFERENT = 1e-4
"""Share of the objective by which two optima differ at least; of closer ones the better stays."""
AGAIN = 7
"""Times that the best is found again which end a search, if by then half as many solves as up to its first
time are made. Where optima are few this comes soon, where they are many never.
"""


def explorer_of(shared: SharedSearch) -> SharedSearch:
    """Return a search on few samples, where these tell good splines from bad ones; else the search itself."""
    space = shared.problem.design
    few, samples = PER_COEFFICIENT * space.spline.count, shared.local.design.problem.design.samples
    if not space.spline.degree or coarse_samples(shared.problem, few) > samples * WORTHWHILE:
        return shared
    options = shared.options.model_copy(update={"search_samples": few})
    return replace(shared, token=f"{shared.token} explored", options=options)


@dataclass(frozen=True)
class Attempt:
    """A sketch to make: where it begins, and its first barrier parameter."""

    unknowns: Array
    barrier: float = BARRIERS[-1]
    perturbed: bool = False

    def __call__(self, search: LocalSearch) -> LocalResult:
        """Return the sketch that a local search makes."""
        return search.sketch(self.unknowns, self.barrier)


@dataclass
class Exploration:
    """The state of a search within a budget.

    Attributes:
        design: expressions of the grid explored on.
        fresh: ever more starts.
        rng: generator of perturbations.
        budget: Ipopt's iterations, each over `UNIT` samples.
        elite: the best different optima so far, the best first.
        iterations: iterations spent, of any size.
        solves: solves made.
        rounds: rounds begun.
    """

    design: DesignExpressions
    fresh: Iterator[Array]
    rng: np.random.Generator
    budget: int
    elite: list[LocalResult] = field(default_factory=list)
    iterations: int = 0
    solves: int = 0
    rounds: int = 0
    _risen: int = 0
    _again: int = 0
    _tallies: dict[float, tuple[int, int]] = field(
        default_factory=lambda: dict(zip(BARRIERS, SUPPOSED, strict=True))
    )

    @property
    def spent(self) -> float:
        """Iterations spent, as budgets count."""
        problem = self.design.problem
        samples = problem.design.samples * problem.design.runs * len(problem.judged_systems)
        return max(samples, LEAST_SAMPLES) / UNIT * self.iterations

    @property
    def percent(self) -> int:
        """Share of the budget that is spent, in whole per cent."""
        return int(min(100 * self.spent / self.budget, 100))

    @property
    def solves_left(self) -> float:
        """Number of solves that the budget allows yet, at the iterations that solves have taken."""
        return self.solves * max(self.budget / self.spent - 1, 0.0) if self.spent else 1.0

    @property
    def done(self) -> bool:
        """True when the budget is spent, or the best was found often enough."""
        lost = not self.elite and self.solves >= HOPELESS
        enough = self.iterations >= LEAST and self.spent >= SHARE * self.budget
        often = enough and self._again >= AGAIN and self.solves - self._risen >= self._risen / 2
        return self.spent >= self.budget or often or lost

    def next_round(self) -> list[Attempt]:
        """Return the attempts of a further round: perturbed designs and one fresh start, or starts alone."""
        opening = not self.rounds or not self.elite
        self.rounds += 1
        perturbed = [] if opening else [self._perturbed(place) for place in range(ROUND - 1)]
        return [*perturbed, *(Attempt(next(self.fresh)) for _ in range(ROUND - len(perturbed)))]

    def _perturbed(self, place: int) -> Attempt:
        # Two of three from the best, the others from any of the elite.
        base = self.elite[0 if place < ROUND - 2 else int(self.rng.integers(len(self.elite)))]
        moved = varied_design(self.design, base.unknowns, self.rng)
        # A barrier that takes fewer iterations begins more of them. No fixed share serves all problems:
        # with a quarter from the larger one a race car's A ends at 8.4 instead of 6.8, with a half obstacle
        # courses and skid steering lose 1.5 %.
        weights = np.array([(solves / iterations) ** 3 for solves, iterations in self._tallies.values()])
        barrier = float(self.rng.choice(BARRIERS, p=weights / weights.sum()))
        return Attempt(moved, barrier, perturbed=True)

    def take(self, attempt: Attempt, sketch: LocalResult) -> None:
        """Count a solve, and keep where it ended if that is among the best."""
        self.iterations += sketch.iterations
        self.solves += 1
        if attempt.perturbed:
            solves, iterations = self._tallies[attempt.barrier]
            self._tallies[attempt.barrier] = solves + 1, iterations + sketch.iterations
        if np.isfinite(sketch.objective):
            self._join(sketch)

    def _join(self, sketch: LocalResult) -> None:
        value, size = sketch.objective, DIFFERENT * abs(sketch.objective)
        best = self.elite[0].objective if self.elite else -np.inf
        self._again += abs(value - best) <= size
        similar = [optimum for optimum in self.elite if abs(optimum.objective - value) <= size]
        if any(optimum.objective >= value for optimum in similar):
            return
        different = [optimum for optimum in self.elite if optimum not in similar]
        self.elite = sorted([*different, sketch], key=lambda optimum: -optimum.objective)[:ELITE]
        if value > best + size:
            self._risen, self._again = self.solves, 0

    @property
    def worth_finishing(self) -> list[LocalResult]:
        """The best optima, the best first."""
        best = self.elite[0].objective if self.elite else 0.0
        return [optimum for optimum in self.elite[:FINISHED] if optimum.objective >= best - CLOSE * abs(best)]

    @property
    def explored(self) -> Explored:
        """Account of what was spent."""
        samples = self.design.problem.design.samples
        return Explored(self.solves, self.iterations, samples, self.budget, self.spent)
