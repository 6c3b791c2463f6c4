"""How long a newcomer waits for the first report on a robot: `oed init` and `oed run`, for every robot."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.figure import Figure, seconds
from benchmarks.start_up import run_as_installed
from oed.study.starter import robots

ALLOWED = 60.0
"""Time [s] on two processors that do nothing else."""


def figures() -> list[Figure]:
    """Once each, for a newcomer runs it once; ratios are to the time allowed."""
    with tempfile.TemporaryDirectory() as folder:
        # The first time compiles to bytecode, once for an installation.
        run_as_installed([sys.executable, "-m", "oed", "--help"], folder)
        return [_figure(robot, Path(folder)) for robot in robots()]


def _figure(robot: str, folder: Path) -> Figure:
    oed, study = [sys.executable, "-m", "oed"], str(folder / f"{robot}.yaml")
    began, computed = time.perf_counter(), _computed()
    run_as_installed([*oed, "init", study, "--robot", robot], str(folder))
    run_as_installed([*oed, "run", study, "--out", str(folder / robot), "--quiet"], str(folder))
    taken, computed = time.perf_counter() - began, _computed() - computed
    return Figure(
        what=f"`oed init` and `oed run`: {robot}",
        ours=f"{seconds(taken)}, {seconds(computed)} of computing",
        against=f"{seconds(ALLOWED)} allowed on two processors",
        ratio=taken / ALLOWED,
        goal=1,
        at="most",
    )


def _computed() -> float:
    # By processes that have ended.
    spent = os.times()
    return spent.children_user + spent.children_system
