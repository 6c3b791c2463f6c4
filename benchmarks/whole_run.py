"""How long a newcomer waits: for `oed run` of the founding paper's study, and for a report made again."""

from __future__ import annotations

import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.figure import Figure, seconds
from benchmarks.start_up import STUDY, run_as_installed

GALLERY = STUDY.parent.parent / "reports" / "gallery"
ROUNDS = 5
ALLOWED = {"`oed run` of choi_skid_steer": 12.0, "`oed report` of it": 4.0}
"""Each with the time [s] that it may take on two processors that do nothing else."""


def figures() -> list[Figure]:
    """Medians of runs in turn; ratios are to the time allowed."""
    oed = [sys.executable, "-m", "oed"]
    taken: dict[str, list[float]] = {name: [] for name in ALLOWED}
    with tempfile.TemporaryDirectory() as folder:
        run, saved = Path(folder, "run"), Path(folder, "saved")
        shutil.copytree(GALLERY / STUDY.stem, saved)
        commands = [[*oed, "run", str(STUDY), "--out", str(run), "--quiet"], [*oed, "report", str(saved)]]
        for _ in range(ROUNDS):
            for times, command in zip(taken.values(), commands, strict=True):
                began = time.perf_counter()
                run_as_installed(command, folder)
                times.append(time.perf_counter() - began)
    return [
        Figure(
            what=name,
            ours=seconds(statistics.median(taken[name])),
            against=f"{seconds(allowed)} allowed on two processors",
            ratio=statistics.median(taken[name]) / allowed,
            goal=1,
            at="most",
        )
        for name, allowed in ALLOWED.items()
    ]
