"""Drives of several runs in reports: apart in every figure, told in the text, played one by one."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import sample_rooms
from matplotlib.figure import Figure
from sample_records import full
from shown_in import section

from oed.report.figures import chart
from oed.report.figures.draw import drawn
from oed.report.figures.driven import Run, path_of, room_of
from oed.report.figures.paths import number_places, paths
from oed.report.parts.inputs import groups_of, series_of
from oed.robots.models.arcs import TURN


@cache
def crabs() -> Figure:
    """The paths of the crab's drives."""
    record = sample_rooms.crab()
    return drawn(paths([path_of(record, one) for one in record.results], room_of(record)))


def test_paths_are_split_where_runs_begin() -> None:
    record = sample_rooms.crab()
    path = path_of(record, record.results[0])
    assert [(run.x[0], run.y[0]) for run in path.runs] == [(0, 0), (-0.6, -0.6), (0, 0)]
    assert [len(run.x) for run in path.runs] == [41] * 3
    assert [len(run.speed) for run in path.runs] == [40] * 3
    assert [list(run.edges) for run in path.runs] == [[10, 20, 30]] * 3


@pytest.mark.slow
def test_no_line_joins_two_runs() -> None:
    record = sample_rooms.crab()
    drives = [path_of(record, one) for one in record.results]
    longest = max(run.steps.max() for drive in drives for run in drive.runs)
    for ax in crabs().axes[:2]:
        lines = [line.get_xydata() for line in ax.lines if len(line.get_xydata()) > 1]
        assert len(lines) >= 3
        assert max(np.hypot(*np.diff(points, axis=0).T).max() for points in lines) <= longest + 1e-12


@pytest.mark.slow
def test_every_run_has_its_marks_and_its_number() -> None:
    record = sample_rooms.crab()
    ax = crabs().axes[0]
    assert [text.get_text() for text in ax.texts] == ["1", "2", "3"]
    assert sum(line.get_marker() == "o" for line in ax.lines) == 3
    assert sum(line.get_marker() == "s" for line in ax.lines) == 3
    assert "in 3 runs, numbered" in section(record, "Paths in the workspace").figures[0].caption


@pytest.mark.slow
def test_a_single_run_has_no_number() -> None:
    figure = drawn(paths([path_of(full(), full().results[0])], room_of(full())))
    assert not figure.axes[0].texts
    assert "runs" not in section(full(), "Paths in the workspace").figures[0].caption


def run_along(angle: float) -> Run:
    way = np.linspace(0.0, 1.0, 11)
    none = np.zeros(0, dtype=np.int64)
    return Run(way * np.cos(angle), way * np.sin(angle), np.zeros(11), np.ones(10), none)


def test_numbers_of_runs_from_one_start_keep_apart() -> None:
    runs = [run_along(0.0), run_along(1.0), run_along(1.0)]
    places = number_places(runs, 0.15)
    assert places[0] == (0.0, 0.0)
    gaps = [np.hypot(*np.subtract(one, other)) for one in places for other in places if one is not other]
    assert min(gaps) >= 0.15
    # Where there is no room they are as far apart as can be.
    assert np.allclose(number_places(runs[:2], 5.0)[1], [np.cos(1.0), np.sin(1.0)])


@pytest.mark.slow
def test_lines_over_time_break_between_runs() -> None:
    record = sample_rooms.crab()
    ((values, rates),) = groups_of(record, 4)
    for group in (values, rates):
        series = series_of(record.results[0], group)
        assert series.breaks == (8.0, 16.0)
        figure = drawn(chart.series([series], group, ["a", "b", "c", "d"], None))
        lines, separators = figure.axes[0].lines[:4], figure.axes[0].lines[4:]
        for line in lines:
            gaps = np.isnan(np.asarray(line.get_ydata(), dtype=float))
            assert np.allclose(np.asarray(line.get_xdata())[gaps], [8, 16])
        assert [line.get_xdata()[0] for line in separators] == [8.0, 16.0]
        assert figure.axes[0].get_xlabel() == "time [s], runs one after the other"


def test_a_run_is_drawn_to_its_own_end() -> None:
    # At the time where two runs meet the first is at rest, while its acceleration is not yet the next one's.
    record = sample_rooms.crab()
    ((_, rates),) = groups_of(record, 4)
    series = series_of(record.results[0], rates)
    gap = int(np.flatnonzero(np.isnan(series.values[:, 0]))[0])
    before, after = series.values[gap - 1], series.values[gap + 1]
    coefficients = np.array(record.results[0].drive.coefficients)
    ends = coefficients[[6, 7, 8, 9]]
    assert np.allclose(np.sign(before), np.sign(ends[1] - ends[0]), atol=1e-9)
    assert np.allclose(np.sign(after), np.sign(ends[3] - ends[2]), atol=1e-9)


def test_piecewise_constant_runs_break_as_well() -> None:
    record = sample_rooms.stepped()
    ((values, rates),) = groups_of(record, 2)
    inputs, jumps = (series_of(record.results[0], group) for group in (values, rates))
    assert inputs.steps
    assert np.isnan(inputs.values).any(axis=1).sum() == np.isnan(jumps.values).any(axis=1).sum() == 1
    assert len(inputs.times) == 2 * 41 + 1
    # From rest, between the periods, and to rest.
    assert len(jumps.times) == 2 * 41 + 1


def test_player_plays_runs_one_by_one() -> None:
    record = sample_rooms.crab()
    animation = section(record, "Summary").animation
    assert animation is not None
    best = str(record.best.name) if record.best else ""
    names = [drive["name"] for drive in animation.drives]
    assert names[:3] == [f"{best}, run {number}" for number in (1, 2, 3)]
    assert len(names) == 6
    assert {drive["duration"] for drive in animation.drives} == {8.0}
    # Each goes through its samples, and between them along arcs that look round.
    assert all(not (len(drive["x"]) - 1) % 40 for drive in animation.drives)
    runs = [poses for one in record.results if one.drive for poses in one.drive.by_run]
    for drive, poses in zip(animation.drives, runs, strict=True):
        step = (len(drive["x"]) - 1) // 40
        assert np.allclose(np.column_stack([drive["x"], drive["y"]])[::step], poses[:, :2], atol=1e-4)
        assert np.abs(np.diff(drive["heading"])).max() <= TURN + 1e-4


@pytest.mark.slow
def test_texts_count_the_runs() -> None:
    crab, steered = sample_rooms.crab(), sample_rooms.steered()
    question = section(crab, "Question and search").paragraphs[0]
    assert "Which drive in 3 runs of 8 s is the most informative about" in question
    assert "displacements of 4 segments in each run" in question
    assert "the initial pose of each run." in section(steered, "Question and search").paragraphs[0]
    assert "segments of each run meet" in section(crab, "Paths in the workspace").figures[0].caption
    assert (
        "Which drive of 4 s is the most informative about"
        in section(full(), "Question and search").paragraphs[0]
    )
