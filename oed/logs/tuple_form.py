"""Wheel speeds and scan matches that are tuples already: the study's key `log` of kind tuples."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Literal

import numpy as np

from oed.foundation.errors import FileIssue, Issue, LogError
from oed.foundation.files import text_of
from oed.kernel.dynamics.system import System
from oed.logs.drive import CUT_OFF, RecordedDrive, to_logs
from oed.logs.form import LogForm
from oed.logs.log import Finding, Log
from oed.logs.motions import QUANTITIES
from oed.logs.series import Series, shortened
from oed.logs.tables.table import MOST_LOG_BYTES

INPUTS = {"wheel_speed_right": "phi_r", "wheel_speed_left": "phi_l"}
"""Fields of a tuple that are the robot's inputs [rad/s]."""
KEYS = ("T", *INPUTS.values())


class TupleForm(LogForm):
    """A tuple in each line, as JSON: the duration T [s], the wheels' mean speeds phi_l and phi_r [rad/s], and
    `sm`, how the sensor moved meanwhile: x, y [m] and heading [rad].

    That is the format of [Censi, Franchi, Marchionni, Oriolo, Simultaneous calibration of odometry and sensor
    parameters for mobile robots, 2013]. Tuples have no times: they are taken to follow each other.
    """

    kind: Literal["tuples"] = "tuples"

    def issues(self, model: System) -> list[Issue]:
        """A robot with other inputs than two wheels."""
        if set(model.input_names) == set(INPUTS):
            return []
        text = (
            f"tuples are of a robot with {' and '.join(INPUTS)}; this one has {', '.join(model.input_names)}"
        )
        return [Issue(("log", "kind"), text)]

    def read(self, file: Path, model: System) -> list[Log]:
        """The drive in a file.

        Raises:
            LogError: every mistake in the file, each with its line.
        """
        rows, lines, issues = list[list[float]](), list[int](), list[FileIssue]()
        given, cut_off = _whole_lines(text_of(file, LogError, most=MOST_LOG_BYTES))
        for line, text in given:
            found = _numbers(text)
            if isinstance(found, list):
                rows.append(found)
                lines.append(line)
            else:
                issues.append(FileIssue(str(file), line, 0, found[0], found[1]))
        skipped = len(issues) if self.skip_invalid_rows and rows else 0
        if (issues and not skipped) or not rows:
            raise LogError(shortened(issues) or [FileIssue(str(file), 0, 0, "", "holds no tuples")])
        drive = _drive(file, np.array(rows), np.array(lines), model)
        text = f"{skipped} line(s) that are no tuples are left out"
        drive = drive.with_found(Finding("skipped_rows", text) if skipped else None)
        return to_logs([drive.with_found(Finding("cut_off", CUT_OFF) if cut_off else None)], self, "keep")


def _whole_lines(text: str) -> tuple[list[tuple[int, str]], bool]:
    # Lines that are not blank, with their numbers; without the last one where the file breaks off in it.
    lines = [(line, one) for line, one in enumerate(text.splitlines(), 1) if one.strip()]
    cut_off = len(lines) > 1 and not text.endswith("\n") and not lines[-1][1].rstrip().endswith("}")
    return (lines[:-1], True) if cut_off else (lines, False)


def _numbers(text: str) -> list[float] | tuple[str, str]:
    # T, the wheels' speeds and the motion; or what is wrong, by its key.
    try:
        given: Any = json.loads(text, parse_int=float)
    except ValueError as error:
        return "", f"expected a tuple as JSON: {error}"
    except RecursionError:
        return "", "expected a tuple as JSON: it is nested too deep"
    if not isinstance(given, dict):
        return "", 'expected a tuple like {"T": 0.8, "phi_l": 0.5, "phi_r": 0.5, "sm": [0, 0, 0]}'
    missing = [key for key in (*KEYS, "sm") if key not in given]
    if missing:
        return missing[0], f"is missing; the tuple has {', '.join(map(str, given))}"
    motion = given["sm"]
    if not isinstance(motion, list) or len(motion) != len(QUANTITIES):
        return "sm", "expected x, y and heading"
    values = [*((key, given[key]) for key in KEYS), *(("sm", one) for one in motion)]
    for key, one in values:
        if isinstance(one, bool) or not isinstance(one, int | float) or not math.isfinite(one):
            return key, f"expected a finite number, got {one!r}"
    if given["T"] <= 0:
        return "T", f"expected a duration above 0 s, got {given['T']!r}"
    return [float(one) for _, one in values]


def _drive(file: Path, rows: np.typing.NDArray[np.float64], lines: Any, model: System) -> RecordedDrive:
    durations, ends = rows[:, 0], np.cumsum(rows[:, 0])
    turned = rows[:, [KEYS.index(INPUTS[name]) for name in model.input_names]] * durations[:, None]
    zero = np.zeros((1, turned.shape[1]))
    whole = np.concatenate([lines[:1], lines])
    times = np.concatenate([[0.0], ends])
    inputs = Series(str(file), "T", times, np.vstack([zero, np.cumsum(turned, axis=0)]), whole)
    motions = np.column_stack([times[:-1], rows[:, len(KEYS) :]])
    return RecordedDrive(
        name=file.stem,
        names=model.input_names,
        inputs=inputs,
        poses=Series(str(file), "T", ends, motions, lines),
        quantities=QUANTITIES,
        driving=np.array([entry.drives for entry in model.inputs]),
        bridged=np.ones(len(model.inputs), dtype=bool),
        one_clock=True,
        relative="pairs",
    )
