"""What executed pages use and do not show."""

from __future__ import annotations

import contextlib
import io
import os
import shlex
import subprocess
from pathlib import Path
from typing import Any
from unittest import mock

import yaml

from oed.cli import main

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
    name, *words = shlex.split(line)
    if quick() and name == "oed":
        # Here, where the package is loaded already; what it says to its user aside is not shown either way.
        # Nobody sees the pages that a command writes beside these, so their figures are not drawn.
        with contextlib.redirect_stderr(io.StringIO()), mock.patch("oed.report.page._drawings", _empty):
            code = main(words)
        if code:
            raise RuntimeError(f"{line} failed with {code}")
        return
    done = subprocess.run(line, shell=True, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    print(done.stdout, end="")
    if done.returncode:
        raise RuntimeError(f"{line} failed with {done.returncode}: {done.stderr}")


def thinned(log: str) -> None:
    """Keep every fourth row of a CSV log, if all is to be quick."""
    if quick():
        header, *rows = Path(log).read_text(encoding="utf-8").splitlines(keepends=True)
        Path(log).write_text("".join([header, *rows[::4]]), encoding="utf-8")


def _empty(sections: list[Any]) -> dict[str, str]:
    return {picture.name: "<svg/>" for section in sections for picture in section.pictures}


def cut_short(study: str) -> None:
    """Ask less of a study file, if all is to be quick."""
    if quick():
        file = Path(study)
        data = yaml.safe_load(file.read_text(encoding="utf-8")) | LEAST
        data["trajectory"]["samples"] = 40
        for key in ("robust", "uncertainty", "validation"):
            data.pop(key, None)
        file.write_text(yaml.safe_dump(data), encoding="utf-8")
