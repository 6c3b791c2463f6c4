"""`python -m benchmarks.objectives [STUDY ...] [--write]`: the shipped studies' designs against frozen ones.

Every study is solved with its own gradient searches and seed, in one process on one core. An objective that
is lower than the frozen one by more than `ALLOWED` fails; times are told, for they are another machine's.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.figure import seconds

PROBLEMS = Path(__file__).parent.parent / "problems"
FROZEN = Path(__file__).with_name("objectives.json")
ALLOWED = 1e-6
"""Share by which an objective may be lower than the frozen one."""


def main() -> int:
    """Print the table; with --write freeze what it says."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.objectives", description=__doc__)
    parser.add_argument("studies", nargs="*", metavar="STUDY", help="file stems in problems/; all by default")
    parser.add_argument("--write", action="store_true", help="freeze these objectives and times")
    options = parser.parse_args()
    names = options.studies or sorted(file.stem for file in PROBLEMS.glob("*.yaml"))
    frozen = json.loads(FROZEN.read_text()) if FROZEN.exists() else {}
    found = {}
    print("| study | objective | frozen | share | time | frozen |\n|---|---|---|---|---|---|")
    for one in _all(names):
        found |= one
        for key, (objective, duration) in one.items():
            print(_row(key, objective, duration, frozen.get(key)), flush=True)
    if options.write:
        FROZEN.write_text(json.dumps(frozen | found, indent=1) + "\n")
        return 0
    lower = [key for key, (value, _) in found.items() if key in frozen and _lower(value, frozen[key][0])]
    print(f"lower than frozen: {', '.join(lower) or 'none'}", file=sys.stderr)
    return 1 if lower else 0


def _all(names: Sequence[str]) -> Iterator[dict[str, list[float]]]:
    # A process for each: what one study has compiled must not help the next. One thread, for times.
    os.environ["OMP_NUM_THREADS"] = "1"
    for name in names:
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
            yield pool.submit(designed, name).result()


def designed(name: str) -> dict[str, list[float]]:
    """Objective and time [s] of each gradient search of a study, by study and search."""
    import oed

    study, found = oed.load_study(PROBLEMS / f"{name}.yaml"), {}
    for solver in study.solvers:
        # What begins where a genetic search ended is as good as that was.
        if not isinstance(solver, oed.Ipopt) or solver.start_from:
            continue
        began = time.perf_counter()
        solution = oed.solve(study.problem, solver, seed=study.seed, workers=1)
        duration = time.perf_counter() - began
        value = float("-inf") if solution.evaluation is None else solution.evaluation.objective
        found[f"{name}: {solver.label}"] = [value, round(duration, 2)]
    return found


def _lower(value: float, frozen: float) -> bool:
    return value < frozen - ALLOWED * abs(frozen)


def _row(key: str, objective: float, duration: float, frozen: Sequence[float] | None) -> str:
    if frozen is None:
        return f"| {key} | {objective:.10g} | | | {seconds(duration)} | |"
    share = (objective - frozen[0]) / abs(frozen[0]) if frozen[0] else 0.0
    before = f"{frozen[0]:.10g} | {share:+.1e}"
    return f"| {key} | {objective:.10g} | {before} | {seconds(duration)} | {seconds(frozen[1])} |"


if __name__ == "__main__":
    sys.exit(main())
