"""What a local search is given, and what it hands back."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.results import Evaluation
from oed.kernel.solution import Start, Status


@dataclass(frozen=True)
class Local:
    """The result of one local search: where it ended, and its evaluation if that is a feasible design."""

    unknowns: Array
    evaluation: Evaluation | None
    status: Status
    iterations: int
    evaluations: int
    wall_seconds: float
    reason: str = ""
    """Why it has failed, where that is known."""
    gains: Mapping[str, float] = field(default_factory=dict)
    """As of a `Solution`."""

    @property
    def singular(self) -> bool:
        """Whether there is no design, or one that makes some combination of parameters not identifiable."""
        return self.evaluation is None or self.evaluation.singular

    @property
    def useless(self) -> bool:
        """Whether there is no design, or one that is not informative about what the criterion asks for."""
        return self.evaluation is None or not self.evaluation.identifiable

    @property
    def objective(self) -> float:
        """The objective reached, minus infinity without a feasible design."""
        return -np.inf if self.evaluation is None else self.evaluation.objective

    @property
    def start(self) -> Start:
        """What a solution says of it."""
        reached = self.objective if np.isfinite(self.objective) else None
        return Start(reached, self.status, self.wall_seconds, self.iterations)


@dataclass(frozen=True)
class Sketch:
    """Where one solve ended: z, the objective there as its grid sees it, and Ipopt's iterations.

    The value is minus infinity where limits are violated at the samples; it is never reported as a score.
    """

    unknowns: Array
    value: float
    iterations: int


@dataclass(frozen=True)
class Settings:
    """What a local search needs to know of the solver's options, and when the time of the whole search is up.

    Attributes:
        max_iterations, tolerance, time_limit, second_stage, search_samples: as of `Ipopt`.
        deadline: by `time.time`, the same for all processes; None where there is no limit.
    """

    max_iterations: int
    tolerance: float
    time_limit: float | None
    second_stage: str
    search_samples: int | None = None
    deadline: float | None = None

    @property
    def until(self) -> float:
        """The deadline by this process's `time.perf_counter`; infinity where there is none."""
        return np.inf if self.deadline is None else time.perf_counter() + self.deadline - time.time()

    @property
    def ipopt(self) -> dict[str, Any]:
        """The options in Ipopt's names."""
        options: dict[str, Any] = {"ipopt.max_iter": self.max_iterations, "ipopt.tol": self.tolerance}
        if self.time_limit is not None:
            options["ipopt.max_wall_time"] = self.time_limit
        return options
