"""Functions of one sample, called sample after sample along runs."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.direct_call import DirectCall

TOGETHER = 2000
"""Samples of a run in one call: what CasADi keeps of a call is many times as large as its result."""


class Recurrence:
    """A function from what is handed on to a sample, and what the sample is given, to what it hands on and
    what else it returns; called along runs.

    Args:
        step: the function of one sample.
        runs: number of runs, R.
        samples: samples of each, N.
        threads: number of threads that the runs are shared by, which changes no digit.
    """

    def __init__(self, step: ca.Function, runs: int, samples: int, threads: int = 1) -> None:
        """Write the calls."""
        self._runs, self._sizes = runs, [step.numel_out(place) for place in range(step.n_out())]
        # Of few lengths, for each has a function of its own.
        calls = -(-samples // TOGETHER)
        self._edges = [samples * place // calls for place in range(calls + 1)]
        in_parallel = ("thread", threads) if threads > 1 else ()
        self._calls = {
            length: DirectCall(step.mapaccum(step.name(), length).map(runs, *in_parallel))
            for length in {last - first for first, last in pairwise(self._edges)}
        }

    def __call__(self, begins: Array, *given: Array) -> list[Array]:
        """Return what all samples hand on, and what else they return, (R, N, size) each.

        Args:
            begins: what is handed on to the runs' first samples, (R, ...).
            given: what the samples are given, (R, N, ...) each.
        """
        parts = list[list[Array]]()
        for first, last in pairwise(self._edges):
            results = self._calls[last - first](begins, *(table[:, first:last] for table in given))
            shaped = zip(results, self._sizes, strict=True)
            parts.append([flat.reshape(self._runs, last - first, size) for flat, size in shaped])
            begins = parts[-1][0][:, -1]
        tables = zip(*parts, strict=True)
        return parts[0] if len(parts) == 1 else [np.concatenate(table, axis=1) for table in tables]
