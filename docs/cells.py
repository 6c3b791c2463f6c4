"""What executed pages use and do not show."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import yaml

QUICK = "OED_DOCS_QUICK"
"""Environment variable: whether what is long is cut short, where only its working is tested."""
LEAST = {
    "solvers": [
        {"kind": "ipopt", "starts": 1, "perturbations": 0, "second_stage": "none", "max_iterations": 30}
    ],
    "baselines": ["square"],
}


def quick() -> bool:
    """Whether what is long is to be cut short."""
    return bool(os.environ.get(QUICK))


def command(line: str) -> None:
    """Run a shell command without a terminal, where nothing is asked, and show what it says.

    Raises:
        RuntimeError: it failed.
    """
    done = subprocess.run(line, shell=True, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    print(done.stdout, end="")
    if done.returncode:
        raise RuntimeError(f"{line} failed with {done.returncode}: {done.stderr}")


def cut_short(study: str) -> None:
    """Ask less of a study file, if all is to be quick."""
    if quick():
        file = Path(study)
        data = yaml.safe_load(file.read_text(encoding="utf-8")) | LEAST
        data["trajectory"]["samples"] = 40
        for key in ("robust", "uncertainty", "validation"):
            data.pop(key, None)
        file.write_text(yaml.safe_dump(data), encoding="utf-8")
