"""`oed estimate` of a log of two million rows: how long, and in how much memory."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.figure import Figure, seconds

ROWS, RATE = 2_000_000, 500.0
"""Rows of the log, and how many a second: somewhat more than an hour."""
ALLOWED_SECONDS, ALLOWED = 60.0, 2.0
"""Time [s] and memory [GB] that it may take."""
STUDY = """
format: 1
name: A long log
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}
trajectory: {duration: 20 s, samples: 200}
measurement: {kind: poses, noise: {position: 1 cm, heading: 0.01 rad}}
limits: {wheel_speed: 10 rad/s}
"""
RIGHT, LEFT, TRACK = 0.0505, 0.0495, 0.182
"""Of the robot that drove [m]."""


def figures() -> list[Figure]:
    """The whole command, from reading to the page, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        log, study = Path(folder) / "log.csv", Path(folder) / "study.yaml"
        study.write_text(STUDY)
        _write(log)
        size = log.stat().st_size / 1e6
        command = [sys.executable, "-m", "oed", "estimate", str(study), str(log), "--quiet", "--out", folder]
        began = time.perf_counter()
        subprocess.run(command, capture_output=True, check=True)
        taken = time.perf_counter() - began
    # Of all children there was but this one.
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    name = f"`oed estimate` of a log of {ROWS:,} rows ({size:.0f} MB)"
    slow = Figure(name, seconds(taken), f"{ALLOWED_SECONDS:g} s allowed", taken / ALLOWED_SECONDS, 1, "most")
    wide = Figure("its memory", f"{memory:.2g} GB", f"{ALLOWED:g} GB allowed", memory / ALLOWED, 1, "most")
    return [slow, wide]


def _write(file: Path) -> None:
    # A drive at random with motion capture to 1 cm and 0.01 rad, as a robot would log it.
    rng, times = np.random.default_rng(0), np.arange(ROWS) / RATE
    knots = np.arange(0.0, times[-1] + 2.0, 2.0)
    right, left = (np.interp(times, knots, rng.uniform(-2, 8, len(knots))) for _ in range(2))
    speed, turning = (RIGHT * right + LEFT * left) / 2, (RIGHT * right - LEFT * left) / TRACK
    heading = np.concatenate([[0.0], np.cumsum(turning[:-1])]) / RATE
    steps = speed / RATE * np.exp(1j * (heading + turning / RATE / 2))
    places = np.concatenate([[0.0], np.cumsum(steps[:-1])])
    noise = 0.01 * rng.standard_normal((ROWS, 3))
    poses = np.column_stack([places.real, places.imag, heading]) + noise
    header = "t,wheel_speed_right,wheel_speed_left,x,y,heading"
    table = np.column_stack([times, right, left, poses])
    np.savetxt(file, table, fmt=["%.4f", *["%.6f"] * 5], delimiter=",", header=header, comments="")
