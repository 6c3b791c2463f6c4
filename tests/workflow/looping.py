"""A simulated robot that drives what a loop designs, and logs it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
from driven_robot import QUICKLY, ROOM_STUDY, write_log

from oed.records.record import load_record
from oed.study.study import Study

SEARCH = "solvers: [{kind: genetic, population: 20, generations: 3}]\n"
STUDY = f"{ROOM_STUDY}{SEARCH}{QUICKLY}"
TRUTH = {"wheel_radius_right": 0.0325, "wheel_radius_left": 0.0334, "track": 0.1635}
TARGETS = {"wheel_radius": "0.5 %", "track": "0.9 %"}
SOON = {"poll": 0.01, "settle": 0.03, "workers": 1}

Drive = Callable[[Path, Path], object]


class Heard:
    """A listener that keeps what is said."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def begin(self, description: str, total: int) -> None:
        self.said.append(description)

    def advance(self, note: str = "") -> None:
        """Not of interest."""

    def say(self, sentence: str) -> None:
        self.said.append(sentence)


def robot(study: Study, seed: int = 0, truth: dict[str, float] = TRUTH) -> Drive:
    """What drives the design beside a file, and logs it; other errors each time, the same for a seed."""

    def drive(file: Path, logs: Path) -> None:
        number = len(list(logs.iterdir())) + 1
        trajectory = load_record(file.parent).best.drive.trajectory
        rng = np.random.default_rng([seed, number])
        write_log(logs / f"drive{number}.csv", study.problem, trajectory, truth, rng)

    return drive


def stopping_at(number: int, drive: Drive) -> Drive:
    """The same, that is interrupted instead of driving for the n-th time."""
    turns = itertools.count(1)

    def drive_or_stop(file: Path, logs: Path) -> None:
        if next(turns) == number:
            raise KeyboardInterrupt
        drive(file, logs)

    return drive_or_stop
