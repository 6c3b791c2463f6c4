"""`starts: auto`: many cheap solves within a budget of iterations, from varied starts and perturbed designs.

Every round is drawn and judged in the same order whichever process solves it, and the budget is counted in
iterations, so that the result is the same for any number of workers.
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
"""Samples of one iteration of a budget: an iteration on n samples, of all runs and robots, counts n/200."""
LEAST_SAMPLES = 20
"""Smallest number of samples that an iteration counts as, for the work of Ipopt itself."""
PER_COEFFICIENT = 3
"""Samples per spline coefficient on the grid of the exploration, whose best designs are solved further."""
WORTHWHILE = 0.6
"""Share of the search's samples up to which the exploration's grid is worth building."""
ROUND = 4
"""Number of solves that are drawn together."""
LEAST, SHARE = 850, 0.18
"""Iterations of Ipopt, and share of the budget, before repeated finds of the best design end the exploration.

After fewer iterations chance decides which optimum is found again; where solves are cheap, more are made.
"""
ELITE = 4
"""Number of different optima that are perturbed, the best one most often."""
HOPELESS = 24
"""Number of solves without any feasible drive after which the exploration ends."""
BARRIERS = (0.1, 1e-3)
"""First barrier parameters of the solves: a large one leaves the start, a small one stays near it.

They lead to different optima; which of them finds better ones depends on the problem.
"""
SUPPOSED = ((1, 60), (1, 40))
"""Prior number of solves from each barrier parameter, and of the iterations that they took."""
FINISHED = 3
"""Largest number of optima that are solved on the search's own grid in the end."""
CLOSE = 0.02
"""Share of the objective by which such an optimum may be worse than the best on the exploration's grid."""


DIFFERENT = 1e-4
"""Smallest difference between two optima as a share of the objective; of closer optima the better stays."""
AGAIN = 7
"""Number of repeated finds of the best design that ends the exploration.

At least half as many solves must have followed its first find as preceded it: where optima are few, the
search ends soon; where they are many, never.
"""


def explorer_of(shared: SharedSearch) -> SharedSearch:
    """Return a search on few samples where these can rank splines, else the search itself."""
    space = shared.problem.design
    few, samples = PER_COEFFICIENT * space.spline.count, shared.local.design.problem.design.samples
    if not space.spline.degree or coarse_samples(shared.problem, few) > samples * WORTHWHILE:
        return shared
    options = shared.options.model_copy(update={"search_samples": few})
    return replace(shared, token=f"{shared.token} explored", options=options)


@dataclass(frozen=True)
class Attempt:
    """Sketch to be made from a start.

    Attributes:
        unknowns: unknowns z of the start, (size,).
        barrier: first barrier parameter.
        perturbed: True where the start is a perturbed design.
    """

    unknowns: Array
    barrier: float = BARRIERS[-1]
    perturbed: bool = False

    def __call__(self, search: LocalSearch) -> LocalResult:
        """Return the sketch that a local search makes."""
        return search.sketch(self.unknowns, self.barrier)


@dataclass
class Exploration:
    """State of an exploration within a budget.

    Attributes:
        design: expressions on the exploration's grid.
        fresh: iterator over new starts.
        rng: generator of perturbations.
        budget: largest number of iterations of Ipopt, each over `UNIT` samples.
        elite: best different optima so far, in descending order.
        iterations: number of iterations so far, of any size.
        solves: number of solves so far.
        rounds: number of rounds so far.
    """

    design: DesignExpressions
    fresh: Iterator[Array]
    rng: np.random.Generator
    budget: int
    elite: list[LocalResult] = field(default_factory=list)
    iterations: int = 0
    solves: int = 0
    rounds: int = 0
    _solves_to_best: int = 0
    _repeats: int = 0
    _tallies: dict[float, tuple[int, int]] = field(
        default_factory=lambda: dict(zip(BARRIERS, SUPPOSED, strict=True))
    )

    @property
    def spent(self) -> float:
        """Iterations spent, each over `UNIT` samples."""
        problem = self.design.problem
        samples = problem.design.samples * problem.design.runs * len(problem.judged_systems)
        return max(samples, LEAST_SAMPLES) / UNIT * self.iterations

    @property
    def percent(self) -> int:
        """Share of the budget that is spent, in whole per cent."""
        return int(min(100 * self.spent / self.budget, 100))

    @property
    def solves_left(self) -> float:
        """Estimated number of solves within the remaining budget, from the mean iterations of a solve."""
        return self.solves * max(self.budget / self.spent - 1, 0.0) if self.spent else 1.0

    @property
    def done(self) -> bool:
        """True where the budget is spent, or the best design was found often enough."""
        hopeless = not self.elite and self.solves >= HOPELESS
        enough = self.iterations >= LEAST and self.spent >= SHARE * self.budget
        often = enough and self._repeats >= AGAIN and self.solves >= 1.5 * self._solves_to_best
        return self.spent >= self.budget or often or hopeless

    def next_round(self) -> list[Attempt]:
        """Return the attempts of the next round: perturbed designs and one new start, or new starts alone."""
        opening = not self.rounds or not self.elite
        self.rounds += 1
        perturbed = [] if opening else [self._perturbed(place) for place in range(ROUND - 1)]
        return [*perturbed, *(Attempt(next(self.fresh)) for _ in range(ROUND - len(perturbed)))]

    def _perturbed(self, place: int) -> Attempt:
        # Two of three perturb the best design, the third perturbs any of the elite.
        base = self.elite[0 if place < ROUND - 2 else int(self.rng.integers(len(self.elite)))]
        moved = varied_design(self.design, base.unknowns, self.rng)
        # A barrier parameter that takes fewer iterations is drawn more often. No fixed share suits all
        # problems: with a quarter from the larger parameter a race car's A ends at 8.4 instead of 6.8, with a
        # half obstacle courses and skid steering lose 1.5 %.
        weights = np.array([(solves / iterations) ** 3 for solves, iterations in self._tallies.values()])
        barrier = float(self.rng.choice(BARRIERS, p=weights / weights.sum()))
        return Attempt(moved, barrier, perturbed=True)

    def take(self, attempt: Attempt, sketch: LocalResult) -> None:
        """Count a solve, and add its end to the elite if it is among the best."""
        self.iterations += sketch.iterations
        self.solves += 1
        if attempt.perturbed:
            solves, iterations = self._tallies[attempt.barrier]
            self._tallies[attempt.barrier] = solves + 1, iterations + sketch.iterations
        if np.isfinite(sketch.objective):
            self._add_to_elite(sketch)

    def _add_to_elite(self, sketch: LocalResult) -> None:
        value, size = sketch.objective, DIFFERENT * abs(sketch.objective)
        best = self.elite[0].objective if self.elite else -np.inf
        self._repeats += abs(value - best) <= size
        similar = [optimum for optimum in self.elite if abs(optimum.objective - value) <= size]
        if any(optimum.objective >= value for optimum in similar):
            return
        different = [optimum for optimum in self.elite if optimum not in similar]
        self.elite = sorted([*different, sketch], key=lambda optimum: -optimum.objective)[:ELITE]
        if value > best + size:
            self._solves_to_best, self._repeats = self.solves, 0

    @property
    def worth_finishing(self) -> list[LocalResult]:
        """Optima close to the best, in descending order."""
        best = self.elite[0].objective if self.elite else 0.0
        return [optimum for optimum in self.elite[:FINISHED] if optimum.objective >= best - CLOSE * abs(best)]

    @property
    def explored(self) -> Explored:
        """Number of solves and iterations that the exploration spent."""
        samples = self.design.problem.design.samples
        return Explored(self.solves, self.iterations, samples, self.budget, self.spent)
