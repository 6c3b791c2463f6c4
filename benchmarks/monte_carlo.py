"""Simulated experiments with measured headings, against drawing their noise with NumPy alone."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.figure import Figure, peak_memory, seconds
from oed import Problem, Trajectory, load_study, validate
from oed.simulation.monte_carlo import BATCH, STREAM

REPLICATES = 100_000
STUDY = Path(__file__).parent.parent / "problems" / "choi_skid_steer.yaml"
SAMPLES, SEGMENTS = 200, 10
ROUNDS = 5


def figures() -> list[Figure]:
    """The time over that of the same normal numbers, and the memory added."""
    problem = load_study(STUDY).problem
    drive = _drive(problem)
    _simulate(problem, drive, BATCH)
    before = peak_memory()
    ours, drawing = [], []
    for _ in range(ROUNDS):
        drawing.append(_seconds(_draw))
        ours.append(_seconds(lambda: _simulate(problem, drive, REPLICATES)))
    added = 1e3 * (peak_memory() - before)
    what = f"{REPLICATES} simulated experiments, N = {SAMPLES}, measured headings"
    return [
        Figure(
            what=what,
            ours=seconds(min(ours)),
            against=f"{seconds(min(drawing))} to draw the same normal numbers with NumPy",
            ratio=min(ours) / min(drawing),
            goal=5,
            at="most",
        ),
        Figure(
            what="memory they add",
            ours=f"{added:.3g} MB",
            against=f"{_drawn() * 8 / 1e6:.3g} MB of normal numbers",
            ratio=added / (_drawn() * 8 / 1e6),
        ),
    ]


def _seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def _simulate(problem: Problem, drive: Trajectory, replicates: int) -> None:
    validate(problem, drive, replicates=replicates, heading="measured", workers=1)


def _draw() -> None:
    # The same streams in the same order: displacements, then headings.
    for index in range(REPLICATES // BATCH):
        rng = np.random.default_rng([0, STREAM, index])
        rng.standard_normal((BATCH, 2 * SEGMENTS))
        rng.standard_normal((BATCH, SAMPLES))


def _drawn() -> int:
    return REPLICATES * (2 * SEGMENTS + SAMPLES)


def _drive(problem: Problem) -> Trajectory:
    # Any: every drive takes the same work.
    space = problem.design
    coefficients = np.zeros((space.all_coefficients, len(problem.model.inputs)))
    free = space.free_rows
    coefficients[free] = np.random.default_rng(0).uniform(-8, 8, (len(free), coefficients.shape[1]))
    return space.trajectory(coefficients, problem.fixed_starts)
