"""How long a user waits: for `oed run` of the founding paper's study and of a larger one, and for a report
made again.
"""

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
LARGER = STUDY.with_name("laser_tracker.yaml")
ALLOWED = {
    "`oed run` of choi_skid_steer": 12.0,
    "`oed report` of it": 4.0,
    "`oed run` of laser_tracker": 30.0,
}
"""Each with the time [s] that it may take on two processors that do nothing else."""


def figures() -> list[Figure]:
    """Medians of runs in turn; ratios are to the time allowed."""
    oed = [sys.executable, "-m", "oed"]
    taken: dict[str, list[float]] = {name: [] for name in ALLOWED}
    with tempfile.TemporaryDirectory() as folder:
        saved = Path(folder, "saved")
        shutil.copytree(GALLERY / STUDY.stem, saved)
        first, larger = (
            [*oed, "run", str(study), "--out", str(Path(folder, study.stem)), "--quiet"]
            for study in (STUDY, LARGER)
        )
        commands = [first, [*oed, "report", str(saved)], larger]
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
