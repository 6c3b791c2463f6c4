"""`python -m benchmarks.auto_starts [STUDY ...]`: how often searches reach the best known.

Each study's first gradient search, with `starts: auto` and with a number of starts (the study's own, or the
default), in one process: how many seeds end within `CLOSE` of the best that any of them found (or of the one
in `KNOWN`, if that is more), Ipopt's iterations (of a number of starts without those of perturbations, which
are not listed), and processor time. A second stage, which gives objective away by design, is judged by what
it began with, and its time counts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import oed

PROBLEMS = Path(__file__).parent.parent / "problems"
KNOWN = {"laser_tracker": 880943.7017, "per_sample": 83.58012, "robot_40": 5751.56106}
"""Best objectives known, of all searches so far."""
SETTINGS = ("auto", "fixed")
FIXED_STARTS = 12
"""Starts that `starts: auto` is compared with."""
CLOSE = 1e-3
"""Share of the best known that a search may miss to count as having found it."""


@dataclass(frozen=True)
class Run:
    """One search from one seed: the objective reached, iterations that it tells, processor time [s]."""

    objective: float
    iterations: int
    seconds: float


def main() -> None:
    """Print a row per study and setting."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.auto_starts", description=__doc__)
    parser.add_argument("studies", nargs="*", metavar="STUDY", default=list(KNOWN), help="stems in problems/")
    parser.add_argument("--seeds", type=int, default=10, help="how many seeds")
    parser.add_argument("--first", type=int, default=0, help="the first of them")
    parser.add_argument("--only", choices=SETTINGS, help="one of the two settings")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    print("| study | starts | found | worst | median time | longest | median iterations |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for name in options.studies:
        for setting in (options.only,) if options.only else SETTINGS:
            runs = [_run(name, setting, seed) for seed in seeds]
            print(_row(name, setting, runs), flush=True)


def _run(name: str, setting: str, seed: int) -> Run:
    study = oed.load_study(PROBLEMS / f"{name}.yaml")
    own = next(one for one in study.solvers if isinstance(one, oed.Ipopt))
    auto = {"starts": "auto", "iterations": oed.Ipopt(starts="auto").budget}
    fixed = {"starts": FIXED_STARTS, "iterations": None} if own.starts == "auto" else {}
    solver = own.model_copy(update=auto if setting == "auto" else fixed)
    began = time.process_time()
    found = oed.solve(study.problem, solver, seed=seed, workers=1)
    explored = 0 if found.explored is None else found.explored.iterations
    iterations = sum(start.iterations for start in found.starts) + explored
    return Run(max(found.stages.values()), iterations, time.process_time() - began)


def _row(name: str, setting: str, runs: Sequence[Run]) -> str:
    best = max(KNOWN.get(name, float("-inf")), *(run.objective for run in runs))
    found = sum(run.objective >= best - CLOSE * abs(best) for run in runs)
    worst = min(run.objective for run in runs) / best - 1
    times, iterations = sorted(run.seconds for run in runs), sorted(run.iterations for run in runs)
    middle = len(runs) // 2
    return (
        f"| {name} | {setting} | {found} of {len(runs)} | {worst:+.2%} | {times[middle]:.3g} s | "
        f"{times[-1]:.3g} s | {iterations[middle]} |"
    )


if __name__ == "__main__":
    main()
