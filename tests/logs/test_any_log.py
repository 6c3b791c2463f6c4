"""Whatever is in a file, it is read or refused with a reason: never a crash, never a number that is none."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logged import HEADER, INPUTS, ROBOT, cells, drive, form

from oed.foundation.errors import LogError
from oed.logs import Log, LogForm, read_logs

ROWS = [",".join(HEADER), *(",".join(row) for row in cells(drive(12)))]
JUNK = st.sampled_from(
    ["", "nan", "-inf", "1e308", "-1e308", "0", "x", '"', ",", "\x00", "#", "12,", ";", "1e-320"]
)
TICKS = {"form": "ticks", "ticks_per_turn": 10, "cumulative": True}
FORMS = [
    form(),
    form(skip_stationary=True, gap=1e-3),
    form(inputs={name: {"column": name, **TICKS} for name in INPUTS}),
    form(inputs={name: {"column": name, **TICKS, "wrap": 8} for name in INPUTS}),
    form(poses={"time": "t"}, keep={"x": [-1, 1]}),
    form(runs="heading"),
]


def read(text: str, log_form: LogForm) -> list[Log]:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "a.csv"
        file.write_text(text, encoding="utf-8", newline="")
        try:
            return read_logs([file], log_form, ROBOT)
        except LogError as error:
            told = error.issues
    assert told
    assert all(issue.message and issue.file == str(file) for issue in told)
    return []


def require_sound(logs: list[Log]) -> None:
    for log in logs:
        assert np.all(np.diff(log.input_times) > 0)
        assert np.all(np.diff(log.pose_times) > 0)
        assert log.integrals.shape == (len(log.input_times), 2)
        assert log.poses.shape == (len(log.pose_times), 3)
        for numbers in (log.input_times, log.integrals, log.pose_times, log.poses):
            assert np.all(np.isfinite(numbers))


@pytest.mark.slow
@settings(max_examples=60)
@given(st.sampled_from(FORMS), st.lists(st.tuples(st.integers(0, 12), st.integers(0, 6), JUNK), max_size=4))
def test_cells_of_a_sound_log_are_spoilt(log_form: LogForm, spoilt: list[tuple[int, int, str]]):
    rows = [line.split(",") for line in ROWS]
    for row, column, junk in spoilt:
        rows[row][column : column + 1] = [junk]
    require_sound(read("\n".join(",".join(row) for row in rows), log_form))


@pytest.mark.slow
@settings(max_examples=40)
@given(st.sampled_from(FORMS), st.permutations(ROWS), st.integers(0, 13))
def test_lines_of_a_sound_log_are_shuffled_and_lost(log_form: LogForm, lines: list[str], count: int):
    require_sound(read("\n".join(lines[:count]), log_form))


@settings(max_examples=40)
@given(st.sampled_from(FORMS), st.text(alphabet='t,x\n;"# \t01e-.nan\r', max_size=60))
def test_any_text_is_read(log_form: LogForm, text: str):
    require_sound(read(text, log_form))
