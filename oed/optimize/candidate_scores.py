"""Scores of a generation of candidates at once, by several processes where that is faster."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.work.parallel import Workers, at_once, run_tasks
from oed.kernel.problem import Problem
from oed.optimize.transcription.design import DesignExpressions

Scores = tuple[Array, Array]
"""Criterion (K,), and by how much each limit is exceeded, in shares of its size, (K, limits)."""

WORTH = 0.5
"""Time [s] of scoring a generation here from which it is sent to workers.

Sending one costs 15 ms here and 0.1 s on a cluster, starting processes some seconds. 200 drives of 200
samples take 3 to 8 ms: they are scored here.
"""
WRITING = 2e-5
"""Time [s] for one operation of a drive that is written out, as processes do which have no compiled code."""
THREADS = 4
"""Threads that score a generation here, at most: the more there are, the less each adds."""
COMPILED = 0.5
"""Time [s] of all that is still to be scored from which generated C is thought of."""
SPARED = 0.6
"""Share of that time that it spares."""


class CandidateScorer:
    """Scores candidates of a problem in this process or in others, which give the same numbers.

    Attributes:
        tightening: shares of the limits' sizes by which they are tightened for candidates, (limits,).

    Args:
        design: the problem's expressions in this process.
        refine: points per sample at which positions are limited there.
        workers: who scores, where a generation takes long.
        expected: candidates that there will be at most.
        until: when the search ends, by `time.perf_counter`.
    """

    def __init__(
        self,
        design: DesignExpressions,
        refine: int,
        workers: Workers,
        expected: int = 0,
        until: float = np.inf,
    ) -> None:
        """Compile nothing yet."""
        self._expected, self._compiled, self._until = expected, False, until
        self._design, self._refine, self._workers = design, refine, workers
        self.tightening = np.zeros(len(design.terms.rows))
        self._seconds = 0.0
        self._binary: Path | None = None

    def score(self, candidates: Array) -> Scores:
        """Return the criterion (K,) of candidates (K, size), and by how much they exceed each limit as it was
        tightened, in shares of its size (K, limits).
        """
        values, excess = self._measured(candidates)
        return values, excess + self.tightening

    def _measured(self, candidates: Array) -> Scores:
        self._expected -= len(candidates)
        if self._workers != 1 and self._worth_sharing(len(candidates)):
            return self._shared(candidates)
        began = time.perf_counter()
        threads = min(self._workers, THREADS) if isinstance(self._workers, int) else 1
        scores = self._design.measure_many(candidates, threads)
        self._seconds = (time.perf_counter() - began) / len(candidates)
        if not self._compiled and self._left >= COMPILED:
            self._binary = self._design.terms.compile_scores(SPARED * self._left)
            self._compiled = True
            # To be found out again.
            self._seconds = 0.0
        return scores

    @property
    def _left(self) -> float:
        # Time [s] of scoring all other candidates here.
        return min(self._seconds * self._expected, self._until - time.perf_counter())

    def _worth_sharing(self, count: int) -> bool:
        seconds, share = self._seconds * count, 1 - 1 / at_once(self._workers)
        writing = 0.0 if self._binary is not None else WRITING * self._design.terms.written
        return seconds > WORTH and share * (self._left + seconds) > writing

    def _shared(self, candidates: Array) -> Scores:
        parts = np.array_split(candidates, at_once(self._workers))
        problem, refine = self._design.problem, self._refine
        tasks = [_Part(problem, refine, part, self._binary) for part in parts if len(part)]
        scores: dict[int, Scores] = {}
        run_tasks(_scored, tasks, self._workers, scores.__setitem__)
        values, excess = zip(*(scores[index] for index in range(len(tasks))), strict=True)
        return np.concatenate(values), np.concatenate(excess)


@dataclass(frozen=True, eq=False)
class _Part:
    problem: Problem
    refine: int
    candidates: Array
    binary: Path | None


def _scored(part: _Part) -> Scores:
    # The terms are written once in each process; what was compiled is taken from where it is.
    design = DesignExpressions(part.problem, part.refine)
    if part.binary is not None:
        design.terms.take_scores(part.binary)
    return design.measure_many(part.candidates)
