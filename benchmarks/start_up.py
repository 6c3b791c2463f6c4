"""How long the command line takes to begin: `oed --help`, and a study's check."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.figure import Figure, seconds

STUDY = Path(__file__).parent.parent / "problems" / "choi_skid_steer.yaml"
ROUNDS = 5
BARE = [sys.executable, "-c", "import casadi, numpy"]
COMMANDS = {
    "`oed --help`": ([sys.executable, "-m", "oed", "--help"], 0.3),
    "`oed check` of a study": ([sys.executable, "-m", "oed", "check", str(STUDY)], 0.5),
}
"""Each with the time [s] that it may take."""


def figures() -> list[Figure]:
    """The best times; ratios are to the time allowed, for a user waits in seconds."""
    with tempfile.TemporaryDirectory() as folder:
        every = {"bare": BARE, **{name: command for name, (command, _) in COMMANDS.items()}}
        shortest = dict.fromkeys(every, float("inf"))
        for round_ in range(ROUNDS + 1):
            for name, command in every.items():
                taken = _seconds(command, folder)
                # The first time compiles to bytecode, once for an installation.
                shortest[name] = min(shortest[name], taken) if round_ else shortest[name]
    bare = seconds(shortest["bare"])
    return [
        Figure(
            what=name,
            ours=seconds(shortest[name]),
            against=f"{seconds(allowed)} allowed; `python -c 'import casadi, numpy'` takes {bare}",
            ratio=shortest[name] / allowed,
            goal=1,
            at="most",
        )
        for name, (_, allowed) in COMMANDS.items()
    ]


def run_as_installed(command: list[str], folder: str) -> None:
    """Run a command with bytecode kept in a folder, as every installation has it, whatever this process was
    told.
    """
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": folder}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    subprocess.run(command, env=environment, capture_output=True, check=True)


def _seconds(command: list[str], folder: str) -> float:
    began = time.perf_counter()
    run_as_installed(command, folder)
    return time.perf_counter() - began
