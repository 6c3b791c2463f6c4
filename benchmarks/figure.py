"""What a benchmark says: figures, each a ratio of two things measured in the same run."""

from __future__ import annotations

import importlib
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from oed.kernel.dynamics import compiled, direct_call


@dataclass(frozen=True)
class Figure:
    """One line of the table.

    Attributes:
        what: was measured.
        ours: what the package needs, or does, with its unit.
        against: what that is compared with, measured in the same run.
        ratio: of the two, as the goal means it; NaN where there is nothing to compare.
        goal: the ratio asked for, or None.
        at: whether the goal is the least ("least") or the most ("most") that the ratio may be.
    """

    what: str
    ours: str
    against: str
    ratio: float
    goal: float | None = None
    at: Literal["least", "most"] = "least"

    @property
    def reached(self) -> bool | None:
        """Whether the goal is reached; None without one."""
        if self.goal is None:
            return None
        return self.ratio >= self.goal if self.at == "least" else self.ratio <= self.goal


def figures_of(name: str) -> list[Figure]:
    """What the benchmark of this name says."""
    found: list[Figure] = importlib.import_module(f"benchmarks.{name}").figures()
    return found


def best_seconds(work: Callable[[], object], *, repeat: int = 5, at_least: float = 0.2) -> float:
    """The shortest time [s] of one call: of `repeat` rounds of as many calls as take `at_least` seconds."""
    began = time.perf_counter()
    work()
    once = time.perf_counter() - began
    calls = max(1, round(at_least / max(once, 1e-9)))
    shortest = once
    for _ in range(repeat):
        began = time.perf_counter()
        for _ in range(calls):
            work()
        shortest = min(shortest, (time.perf_counter() - began) / calls)
    return shortest


def seconds(duration: float) -> str:
    """A duration [s] for the table."""
    if duration >= 1:
        return f"{duration:.3g} s"
    return f"{1e3 * duration:.3g} ms" if duration >= 1e-3 else f"{1e6 * duration:.3g} µs"


def peak_memory() -> float:
    """The most memory that this process has held [GB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def compile_calls(call: Callable[[], object]) -> None:
    """Let a compiler make machine code of the functions that a call calls, and wait until they use it."""
    before, direct_call.PAYS = direct_call.PAYS, 0.0
    try:
        call()
        while compiled.at_work():
            time.sleep(0.1)
        call()
    finally:
        direct_call.PAYS = before
