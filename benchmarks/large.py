"""Whole searches of a drive of 20,000 samples: how long, and in how much memory."""

from __future__ import annotations

import time

from benchmarks.figure import Figure, peak_memory, seconds
from benchmarks.forms import FORMS, problem_of
from oed import Ipopt, solve

SAMPLES = 20_000
ALLOWED = 1.0
"""Memory [GB] that it may take."""


def figures() -> list[Figure]:
    """Two starts of each form; memory is the most that the process has held."""
    found = []
    options = Ipopt(starts=2, perturbations=0, second_stage="none")
    for form in FORMS:
        began = time.perf_counter()
        reached = solve(problem_of(form, SAMPLES), options, workers=1).evaluation
        taken = time.perf_counter() - began
        assert reached is not None
        assert reached.feasible
        name = f"{form} form, N = {SAMPLES}: a search of 2 starts"
        memory = peak_memory()
        told = f"{ALLOWED:g} GB allowed; lambda_min {reached.lambda_min:.6g}"
        found.append(Figure(name, f"{seconds(taken)}, {memory:.2g} GB", told, memory / ALLOWED, 1, "most"))
    return found
