"""Result of a solver: its best trajectory, how it was scored, and a status that says what to do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from oed.foundation import views
from oed.foundation.arrays import Array
from oed.foundation.equality import ByValue
from oed.foundation.presenting import Presented
from oed.foundation.text import chance_text
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.kernel.tightening import Tightening


class Status(Enum):
    """End of a search; `sentence` says what it means and what to do next."""

    sentence: str

    def __new__(cls, value: str, sentence: str) -> Status:
        """A status by its value in files, with what it says."""
        status = object.__new__(cls)
        status._value_, status.sentence = value, sentence
        return status

    CONVERGED = "converged", "Converged to a local optimum that satisfies every limit."
    ACCEPTABLE = (
        "acceptable",
        "Stopped close to a local optimum; more iterations or another seed may gain a little.",
    )
    ITERATION_LIMIT = (
        "iteration_limit",
        "Stopped at the iteration limit with the best design so far; raise max_iterations to go on.",
    )
    TIME_LIMIT = "time_limit", "Stopped at the time limit; raise time_limit to go on."
    INTERRUPTED = "interrupted", "Interrupted before the search was done."
    SEARCHED = (
        "searched",
        "Searched as long as asked; the best design found satisfies every limit, but nothing says that "
        "it is an optimum.",
    )
    UNIMPROVED = (
        "unimproved",
        "No search ended with a better drive than the best feasible one met on the way, which is "
        "returned; nothing says that it is an optimum: try more starts or another seed.",
    )
    SCORED = "scored", "Scored as given; nothing was optimised."
    UNSCORED = "unscored", "This drive has no score, for its numbers are not finite."
    IMPOSSIBLE = "impossible", "The robot cannot make this drive."
    INFEASIBLE = (
        "infeasible",
        "No drive that satisfies every limit was found; loosen one of the limits named.",
    )
    SINGULAR = (
        "singular",
        "No drive found makes all parameters identifiable that the criterion asks about; "
        "measure more, more often or something else, or allow more.",
    )
    FAILED = "failed", "The solver gave up without a usable design; try more starts or another seed."

    @property
    def usable(self) -> bool:
        """True if there is a design to use."""
        return self not in (
            Status.INFEASIBLE,
            Status.SINGULAR,
            Status.FAILED,
            Status.UNSCORED,
            Status.IMPOSSIBLE,
        )


NOMINAL = "nominal"
"""Name of a robust study's search without any back-off."""
BEST_YET = "This is the best design found until then."
NOTHING_YET = "No design had been found by then."
TAIL = 0.025
"""Probability with which a violation probability is above its interval at most, and below it at most."""


@dataclass(frozen=True)
class HistoryPoint:
    """A search's best objective so far, after so many evaluations of the drive and seconds."""

    evaluations: int
    seconds: float
    objective: float


@dataclass(frozen=True)
class Start:
    """One local search: the objective it reached (None without a feasible design) and its effort."""

    objective: float | None
    status: Status
    wall_seconds: float
    iterations: int


@dataclass(frozen=True)
class Explored:
    """Effort of a search with a budget (`starts: auto`) before its best optima were solved in the end.

    Attributes:
        solves: made.
        iterations: iterations of Ipopt that these took.
        samples: per run of the grid that they were made on.
        budget: iterations on 200 samples that it had.
        spent: iterations of the budget that were spent.
    """

    solves: int
    iterations: int
    samples: int
    budget: int
    spent: float

    def __add__(self, other: Explored) -> Explored:
        """Return the effort of two searches together."""
        return Explored(
            self.solves + other.solves,
            self.iterations + other.iterations,
            max(self.samples, other.samples),
            self.budget + other.budget,
            self.spent + other.spent,
        )


@dataclass(frozen=True)
class RefinementLevel:
    """A spline of a search that refines it: its coefficients, the objective reached and Ipopt's iterations
    for that, and the design, which any finer one can begin with.
    """

    coefficients: int
    objective: float
    iterations: int
    trajectory: Trajectory = field(compare=False, repr=False)


@dataclass(frozen=True)
class Violation:
    """Probability that robots violate the limits that the nominal robot satisfies, by more than scoring
    tolerates.

    Attributes:
        probability: share of the draws that exceed a limit on the path at any time.
        interval: exact 95 % interval of that probability [Clopper and Pearson, 1934]: with 97.5 % confidence
            it is no more than the upper end. Of a robust search it is for all drives together that were
            verified by the same draws [Bonferroni].
        draws, seed: number of draws and seed of the simulation.
        by_limit: share of the draws that exceed each limit.
        farthest: excess of the worst draws, as a share of the limit's size; 0 for none, infinite
            where a drive is not a number somewhere.
        worst: the uncertain quantities of the draws that exceed a limit most, SI, (<= 4, q).
        checked_at_points: limits that draws were checked against at some points only: more may exceed them.
    """

    probability: float
    interval: tuple[float, float]
    draws: int
    seed: int
    by_limit: dict[str, float]
    farthest: float
    worst: Array
    checked_at_points: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The probability in words."""
        share = f"{chance_text(self.probability)} of {self.draws} simulated robots violate the limits."
        points = ", ".join(self.checked_at_points)
        return f"{share} Checked at points only: {points}; between them more may." if points else share

    def surely_below(self, probability: float) -> bool:
        """Return whether the whole interval lies below a probability."""
        return self.interval[1] <= probability


@dataclass(frozen=True, repr=False, eq=False)
class Solution(ByValue, Presented):
    """A solver's best design.

    Attributes:
        name, kind: name and kind of the solver.
        trajectory: the best design, None where there is none.
        evaluation: score of the design by `evaluate`.
        status: end of the search.
        starts: every local search.
        wall_seconds: time of the whole search [s].
        seed: seed of every random draw.
        detail: details that the status' sentence cannot know, e.g. which limits conflict.
        stages: objective reached after each stage of the search, by name.
        history: the best objective so far, re-scored, each time it rose, and at the end.
        criterion: kind of the criterion searched for, where that is not the problem's; `starts`, `stages`,
            `history` and `levels` are in its numbers then.
        violation: violations of the limits on this drive by robots of the problem's uncertainty.
        robust: tightening of the limits in the end; None where the problem is not robust.
        problem: problem that scored it; figures show its surroundings.
        levels: splines searched, the coarsest first, where `coefficients: auto` refines them; `starts` are of
            the first.
        gains: share by which the best drive would be better, to first order, were a limit wider: per SI unit,
            by the limits' names; {} where the search does not know. Lagrange multipliers: they hold for small
            changes, and for drives like this one.
        explored: effort of a search with a budget; None of others.
    """

    name: str
    kind: str
    trajectory: Trajectory | None
    evaluation: Evaluation | None
    status: Status
    starts: tuple[Start, ...] = ()
    wall_seconds: float = 0.0
    seed: int = 0
    detail: str = ""
    stages: Mapping[str, float] = field(default_factory=dict)
    history: tuple[HistoryPoint, ...] = ()
    criterion: str | None = None
    violation: Violation | None = None
    robust: Tightening | None = None
    problem: Problem | None = field(default=None, compare=False)
    gains: Mapping[str, float] = field(default_factory=dict)
    explored: Explored | None = None
    levels: tuple[RefinementLevel, ...] = ()

    @property
    def designs(self) -> tuple[Trajectory, ...]:
        """The design, and after it those on coarser splines, the finest first."""
        best = () if self.trajectory is None else (self.trajectory,)
        return (*best, *(level.trajectory for level in reversed(self.levels)))

    @property
    def message(self) -> str:
        """The status in words, with what is special to this search or drive; of one that was only scored, the
        latter alone.
        """
        violation = "" if self.violation is None else self.violation.sentence
        only_scored = self.status is Status.SCORED and self.detail
        return " ".join(filter(None, ["" if only_scored else self.status.sentence, self.detail, violation]))

    def plot(self, what: str = "path") -> Any:
        """The figure (matplotlib's) of the design: its "path" in the room, or its "inputs" over time.

        Raises:
            UserMistake: there is no design, or no such figure.
        """
        return views.make("figure", self, what)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row per estimated parameter: nominal value and standard error, SI.

        Raises:
            UserMistake: there is no design, or pandas is not installed.
        """
        return views.make("table", self)


def scored(problem: Problem, trajectory: Trajectory, name: str) -> Solution:
    """Any trajectory as a solution that nobody searched for, scored by a problem.

    Args:
        problem: problem that scores it.
        trajectory: the drive.
        name: name of the solution.
    """
    return Solution(
        name=name,
        kind="path",
        trajectory=trajectory,
        evaluation=evaluate(problem, trajectory),
        status=Status.SCORED,
        problem=problem,
    )


def unscored(name: str, kind: str, reason: str, status: Status = Status.UNSCORED) -> Solution:
    """A drive among others that cannot be scored, and why.

    Args:
        name: name of the drive.
        kind: kind of the method that made it.
        reason: why it has no score.
        status: status of the drive.
    """
    return Solution(name, kind, None, None, status, detail=reason)
