"""Laws of wheel motion: no tick is lost, whatever form it is logged in and however it is cut."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logged import INPUTS, ROBOT, form, read_one, write

from oed.logs import Log, read_logs

TURN, GEAR = 64.0, 43.7
ANGLE = 2 * np.pi / (TURN * GEAR)
HEADER = ("t", *INPUTS, "x", "y", "heading")
FEW = settings(max_examples=15)


@st.composite
def drives(draw: st.DrawFn) -> np.ndarray:
    """Ticks (rows, 2) since the row before, both wheels turning."""
    rows = draw(st.integers(12, 30))
    steps = st.lists(st.integers(-90, 90), min_size=rows, max_size=rows)
    ticks = np.column_stack([draw(steps), draw(steps)])
    ticks[1] = 7
    return ticks


def table(values: np.ndarray) -> list[list[str]]:
    number = np.arange(len(values))
    poses = np.column_stack([0.1 * number, 0.02 * number, 0.01 * number])
    return [
        [repr(0.05 * row), *(str(int(value)) for value in own), *map(repr, map(float, pose))]
        for row, (own, pose) in enumerate(zip(values, poses, strict=True))
    ]


def read(values: np.ndarray, **keys: object) -> Log:
    form_of = {"form": "ticks", "ticks_per_turn": TURN, "gear": GEAR, **keys}
    with tempfile.TemporaryDirectory() as folder:
        file = write(Path(folder) / "a.csv", table(values), HEADER)
        return read_one(file, inputs={name: {"column": name, **form_of} for name in INPUTS})


def counts(log: Log) -> np.ndarray:
    """Ticks since the first row, which have to be whole numbers."""
    ticks = log.integrals / ANGLE
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-6)
    return np.round(ticks)


@FEW
@given(ticks=drives())
@pytest.mark.slow
def test_ticks_of_each_row_are_all_counted(ticks: np.ndarray):
    expected = np.cumsum(ticks, axis=0) - ticks[0]
    np.testing.assert_array_equal(counts(read(ticks)), expected)


@FEW
@given(ticks=drives(), start=st.integers(0, 65_535), wrap=st.sampled_from([256, 1000, 65_536]))
@pytest.mark.slow
def test_a_running_counter_counts_the_same_even_where_it_begins_anew(
    ticks: np.ndarray, start: int, wrap: int
):
    running = np.cumsum(ticks, axis=0) + start
    expected = np.cumsum(ticks, axis=0) - ticks[0]
    np.testing.assert_array_equal(counts(read(np.mod(running, wrap), cumulative=True, wrap=wrap)), expected)


@FEW
@given(ticks=drives(), sign=st.sampled_from([1, -1]))
@pytest.mark.slow
def test_the_sign_turns_everything_round(ticks: np.ndarray, sign: int):
    np.testing.assert_array_equal(read(ticks, sign=sign).integrals, sign * read(ticks).integrals)


@pytest.mark.slow
@FEW
@given(ticks=drives(), data=st.data())
def test_what_lies_between_two_rows_does_not_depend_on_where_the_log_is_cut(
    ticks: np.ndarray, data: st.DataObject
):
    cut = data.draw(st.integers(4, len(ticks) - 4))
    rows = [["1" if row < cut else "2", *cells] for row, cells in enumerate(table(ticks))]
    columns = {
        name: {"column": name, "form": "ticks", "ticks_per_turn": TURN, "gear": GEAR} for name in INPUTS
    }
    with tempfile.TemporaryDirectory() as folder:
        file = write(Path(folder) / "a.csv", rows, ("run", *HEADER))
        parts = read_logs([file], form(inputs=columns), ROBOT)
    steps = np.vstack([np.diff(part.integrals, axis=0) for part in parts])
    whole = np.diff(read(ticks).integrals, axis=0)
    # Only the step across the cut belongs to neither part.
    np.testing.assert_allclose(steps, np.delete(whole, cut - 1, axis=0), atol=1e-12)


@pytest.mark.slow
@FEW
@given(ticks=drives(), data=st.data())
def test_means_over_intervals_add_up(ticks: np.ndarray, data: st.DataObject):
    log = read(ticks)
    end = float(log.input_times[-1])
    inner = data.draw(st.lists(st.floats(0.001, end - 0.001), min_size=1, max_size=8, unique=True))
    edges = np.unique([0.0, *inner, end])
    turned = (log.inputs_between(edges) * np.diff(edges)[:, None]).sum(axis=0)
    np.testing.assert_allclose(turned, log.integrals[-1], atol=1e-9)


@pytest.mark.parametrize(
    "times", [(-3, -1), (-1, 0), (0, 0.7), (0.31, 0.32), (2.2, 9.9), (9.7, 12), (11, 12), (-5, 15)]
)
def test_integrals_within_a_long_log_are_found_from_its_rows_around(times, monkeypatch: pytest.MonkeyPatch):
    rng, interp, looked_at = np.random.default_rng(0), np.interp, []
    at = np.sort(rng.uniform(0, 10, 5000))
    log = Log("a", "a.csv", at, np.cumsum(rng.normal(size=(5000, 2)), axis=0), at[:2], np.zeros((2, 3)))
    moments = np.linspace(*times, 7)
    whole = np.column_stack([interp(moments + 0.1, at, column) for column in log.integrals.T])

    def counted(x: np.ndarray, known: np.ndarray, column: np.ndarray) -> np.ndarray:
        looked_at.append(len(known))
        return interp(x, known, column)

    monkeypatch.setattr("numpy.interp", counted)
    np.testing.assert_array_equal(log.integrals_at(moments, 0.1), whole)
    within = np.count_nonzero((at > times[0] + 0.1) & (at < times[1] + 0.1))
    assert max(looked_at) <= within + 2
    assert log.integrals_at(moments[:0]).shape == (0, 2)
