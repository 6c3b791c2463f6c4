"""The candidates of one generation, scored by several processes where that is faster."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.work.parallel import Workers, at_once, run_tasks
from oed.kernel.problem import Problem
from oed.optimize.transcription.design import DesignExpressions

Scores = tuple[Array, Array]

WORTH = 0.5
"""Time [s] of scoring a generation here from which it is sent to workers.

Sending one costs 15 ms here and 0.1 s on a cluster, starting processes some seconds. 200 drives of 200
samples take 0.02 s: they are scored here.
"""
COMPILED = 30.0
"""Time [s] of all that is to be scored from which compiling first is faster."""


class Population:
    """Scores candidates of a problem; who scores them changes none of the numbers.

    Args:
        design: the problem's expressions in this process.
        refine: points per sample at which positions are limited there.
        workers: who scores, where a generation takes long.
        expected: candidates that there will be at most.
    """

    def __init__(self, design: DesignExpressions, refine: int, workers: Workers, expected: int = 0) -> None:
        """Compile nothing yet."""
        self._expected, self._compiled = expected, False
        self._design, self._refine, self._workers = design, refine, workers
        self._seconds = 0.0

    def score(self, candidates: Array) -> Scores:
        """Criterion (K,) and relative violation of each limit (K, limits) of candidates (K, size)."""
        if self._workers != 1 and self._seconds * len(candidates) > WORTH:
            return self._shared(candidates)
        # Compiling, on the first call, is not to be taken for scoring.
        self._design.terms.scores  # noqa: B018
        began = time.perf_counter()
        scores = self._design.score_many(candidates)
        self._seconds = (time.perf_counter() - began) / len(candidates)
        if not self._compiled and self._seconds * self._expected >= COMPILED:
            self._design.compile_scores()
            self._compiled = True
        return scores

    def _shared(self, candidates: Array) -> Scores:
        parts = np.array_split(candidates, at_once(self._workers))
        tasks = [_Part(self._design.problem, self._refine, part) for part in parts if len(part)]
        found: dict[int, Scores] = {}
        run_tasks(_scored, tasks, self._workers, found.__setitem__)
        values, violations = zip(*(found[index] for index in range(len(tasks))), strict=True)
        return np.concatenate(values), np.concatenate(violations)


@dataclass(frozen=True, eq=False)
class _Part:
    problem: Problem
    refine: int
    candidates: Array


def _scored(part: _Part) -> Scores:
    # The terms are written once in each process.
    return DesignExpressions(part.problem, part.refine, differentiated=False).score_many(part.candidates)
