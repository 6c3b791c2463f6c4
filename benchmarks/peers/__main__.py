"""`python -m benchmarks.peers [--limit SECONDS]`: the table of oed, mopeds and Pyomo.DoE on robot-40."""

from __future__ import annotations

import argparse
import compileall
import json
import math
import os
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import oed
from benchmarks.peers import scorer, task

ALLOWED = 1e-6
"""Share of the largest wheel speed by which bounds may be exceeded: what interior-point solvers relax."""


@dataclass(frozen=True)
class Rival:
    """A program that designs the drive.

    Attributes:
        name: in the table.
        module: of this folder.
        option: the program's own variant.
    """

    name: str
    module: str
    option: str = ""


RIVALS = (
    Rival("mopeds (idas, its default)", "with_mopeds", "idas"),
    Rival("mopeds (idas, objective scaled)", "with_mopeds", "idas, scaled"),
    Rival("mopeds (collocation)", "with_mopeds", "collocation"),
    Rival("mopeds (collocation, objective scaled)", "with_mopeds", "collocation, scaled"),
    Rival("Pyomo.DoE", "with_pyomo"),
)


@dataclass(frozen=True)
class Result:
    """What one program found.

    Attributes:
        designs: answers, each with the wheel speeds and what the program said of them.
        seconds: from start to the last answer, or to the time limit.
        remark: why there is none, or not all.
    """

    designs: tuple[dict[str, Any], ...]
    seconds: float
    remark: str

    def best(self, criterion: str) -> tuple[float, dict[str, Any]] | None:
        """The best design that keeps the bounds by the independent scorer, and its value."""
        legal = [one for one in self.designs if scorer.excess(one["inputs"]) <= ALLOWED * task.FASTEST]
        scored = [(scorer.value(criterion, one["inputs"]), one) for one in legal]
        scored = [pair for pair in scored if math.isfinite(pair[0])]
        return max(scored, key=lambda pair: scorer.share(criterion, pair[0]), default=None)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.add_argument("--limit", type=float, default=600.0, help="seconds for one program and criterion")
    parser.add_argument("--criteria", default="DAE", help="some of D, A, E")
    options = parser.parse_args()
    # As pip does with what it installs: an editable install is compiled by whoever runs it first.
    compileall.compile_dir(Path(oed.__file__).parent, quiet=1)
    print("| criterion | program | value | of the best known | time | times as long as oed | |")
    print("|---|---|---|---|---|---|---|")
    for criterion in options.criteria:
        for row in _compared(criterion, options.limit):
            print(row, flush=True)
    return 0


def _compared(criterion: str, limit: float) -> Iterator[str]:
    # One run of oed before each peer and one after: what else the machine does slows down both.
    own = Rival("oed", "with_oed")
    runs, rows = [_run(own, criterion, limit)], list[str]()
    for rival in RIVALS:
        result = _run(rival, criterion, limit)
        runs.append(_run(own, criterion, limit))
        beside = statistics.mean(run.seconds if run.designs else math.nan for run in runs[-2:])
        rows.append(_row(criterion, rival.name, result, result.seconds, beside))
    ours = statistics.median(run.seconds if run.designs else math.nan for run in runs)
    yield _row(criterion, own.name, runs[0], ours, ours)
    yield from rows


def _run(rival: Rival, criterion: str, limit: float) -> Result:
    # A process of its own, from the interpreter's start to the answer.
    print(f"{criterion}: {rival.name} ...", file=sys.stderr, flush=True)
    command = [sys.executable, "-m", f"benchmarks.peers.{rival.module}", criterion]
    command += ["--option", rival.option] if rival.option else []
    began = time.time()
    # A group of its own, so that the solver a peer has called ends with it.
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    timer = threading.Timer(limit, os.killpg, (process.pid, signal.SIGKILL))
    timer.start()
    output, errors = process.communicate()
    late = not timer.is_alive()
    timer.cancel()
    lines = [json.loads(line) for line in output.splitlines() if line.startswith("{")]
    designs = [line for line in lines if "inputs" in line]
    remark = "; ".join(line["skipped"] for line in lines if "skipped" in line)
    if late:
        remark = f"stopped after {limit:g} s with {len(designs)} designs"
    elif process.returncode:
        remark = f"failed: {errors.strip().splitlines()[-1]}"
    ended = began + limit if late or not designs else designs[-1]["at"]
    waste = designs[-1]["waste"] if designs else 0.0
    return Result(tuple(designs), ended - began - waste, remark)


def _row(criterion: str, name: str, result: Result, seconds: float, ours: float) -> str:
    best = result.best(criterion)
    if best is None:
        return f"| {criterion} | {name} | | | | | {result.remark or 'no design'} |"
    value, _ = best
    said = ", ".join(sorted({one["said"] for one in result.designs}))
    times = "" if math.isnan(ours) else f"{seconds / ours:.1f}"
    found = f"{value:.9g} | {scorer.share(criterion, value):.6f} | {seconds:.2f} s | {times}"
    return f"| {criterion} | {name} | {found} | {result.remark or said} |"


if __name__ == "__main__":
    sys.exit(main())
