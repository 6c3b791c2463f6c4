"""Scores of all candidates of a generation, by several processes where that is faster."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.work.parallel import Workers, at_once, run_tasks
from oed.kernel.problem import Problem
from oed.optimize.transcription.design import DesignExpressions

Scores = tuple[Array, Array]
"""Criterion (K,), and excess over each limit in shares of its size, (K, limits)."""

WORTH = 0.5
"""Time [s] to score a generation in this process above which it is sent to workers.

Sending one costs 15 ms here and 0.1 s on a cluster, starting processes some seconds. 200 drives of 200
samples take 3 to 8 ms: they are scored here.
"""
WRITING = 2e-5
"""Time [s] per operation of a drive to write its expressions, as processes without compiled code do."""
THREADS = 4
"""Largest number of threads that score a generation here: each further thread adds less."""


class CandidateScorer:
    """Scores candidates of a problem in this process or in others, which give the same numbers.

    Attributes:
        tightening: shares of the limits' sizes by which they are tightened for candidates, (limits,).

    Args:
        design: expressions of the problem in this process.
        refine: points per sample at which positions are limited.
        workers: processes that score where a generation takes long.
        expected: largest number of candidates to come.
        until: end of the search, by `time.perf_counter`.
    """

    def __init__(
        self,
        design: DesignExpressions,
        refine: int,
        workers: Workers,
        expected: int = 0,
        until: float = np.inf,
    ) -> None:
        """Begin without measured times."""
        self._expected, self._until = expected, until
        self._design, self._refine, self._workers = design, refine, workers
        self.tightening = np.zeros(len(design.terms.rows))
        self._seconds = 0.0

    def score(self, candidates: Array) -> Scores:
        """Return the criterion (K,) of candidates (K, size), and their excess (K, limits).

        The excess is over each tightened limit, in shares of its size.
        """
        values, excess = self._measure(candidates)
        return values, excess + self.tightening

    def _measure(self, candidates: Array) -> Scores:
        self._expected -= len(candidates)
        if self._workers != 1 and self._worth_sharing(len(candidates)):
            return self._share(candidates)
        began = time.perf_counter()
        threads = min(self._workers, THREADS) if isinstance(self._workers, int) else 1
        scores = self._design.score_many(candidates, threads)
        self._seconds = (time.perf_counter() - began) / len(candidates)
        return scores

    @property
    def _remaining(self) -> float:
        # Time [s] to score all further candidates in this process.
        return min(self._seconds * self._expected, self._until - time.perf_counter())

    def _worth_sharing(self, count: int) -> bool:
        seconds, share = self._seconds * count, 1 - 1 / at_once(self._workers)
        writing = WRITING * self._design.terms.written
        return seconds > WORTH and share * (self._remaining + seconds) > writing

    def _share(self, candidates: Array) -> Scores:
        parts = np.array_split(candidates, at_once(self._workers))
        problem, refine = self._design.problem, self._refine
        tasks = [_Batch(problem, refine, part) for part in parts if len(part)]
        scores: dict[int, Scores] = {}
        run_tasks(_score_batch, tasks, self._workers, scores.__setitem__)
        values, excess = zip(*(scores[index] for index in range(len(tasks))), strict=True)
        return np.concatenate(values), np.concatenate(excess)


@dataclass(frozen=True, eq=False)
class _Batch:
    problem: Problem
    refine: int
    candidates: Array


def _score_batch(part: _Batch) -> Scores:
    # Each process writes the terms once.
    return DesignExpressions(part.problem, part.refine).score_many(part.candidates)
