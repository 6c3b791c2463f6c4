"""Drives of several runs against the same runs one by one: splines, scores, path files."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import casadi as ca
import numpy as np
import oracle
import pytest
from builders import ACCELERATION, BOX, RADIUS, SPEED, new_problem_of, problem_of, random_drive
from hypothesis import given, settings
from hypothesis import strategies as st
from studies import SMALL, write_study

from oed.cli import main
from oed.foundation.errors import PathFileError
from oed.kernel.dynamics.embedding import Embedding
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.results import Evaluation
from oed.records.path_file import read_trajectory, write_trajectory
from oed.robots.limits import BodySpeed, PathLength, WheelJerk
from oed.robots.sensors import Displacements
from oed.robots.space import DesignSpace, StartPose

RUNS, COEFFICIENTS = 3, 9
STARTS = (StartPose(x=0.1), StartPose(x=-0.2, y=0.3, heading=2.0), StartPose(y=-0.4, heading=-1.0))

degrees = pytest.mark.parametrize("degree", range(6))
rests = pytest.mark.parametrize("rest", [True, False], ids=["rest", "moving"])
durations = st.floats(0.1, 30.0)
seeds = st.integers(0, 2**32 - 1)


def space_of(degree: int = 3, *, rest: bool = True, runs: int = RUNS, **parts) -> DesignSpace:
    given = {"duration": 7.3, "samples": 20, "start": "free", **parts}
    return DesignSpace(
        spline=Spline(degree=degree, coefficients=COEFFICIENTS), rest_to_rest=rest, runs=runs, **given
    )


def some_drive(space: DesignSpace, seed: int = 0, amplitude: float = 8.0) -> Trajectory:
    return random_drive(problem_of(design=space, limits=(SPEED,)), seed, amplitude)


def alone(drive: Trajectory, run: int) -> Trajectory:
    """One run as a drive of its own, taken out by hand."""
    count = len(drive.coefficients) // drive.runs
    knots = drive.knots[: count + drive.degree + 1]
    rows = drive.coefficients[run * count : (run + 1) * count]
    return Trajectory(knots, drive.degree, rows, drive.start[run], drive.samples // drive.runs)


def single_problem(problem: Problem, run: int) -> Problem:
    """The problem of one of the runs."""
    space = problem.design
    start = space.start[run] if isinstance(space.start, tuple) else space.start
    design = space.model_copy(update={"runs": 1, "start": start})
    return problem_of(
        design=design, measurement=problem.measurement, limits=problem.limits, criterion=problem.criterion
    )


class TestSplines:
    @degrees
    @rests
    def test_values_rates_and_jerks_are_those_of_single_runs(self, degree: int, rest: bool):
        drive = some_drive(space_of(degree, rest=rest))
        each = drive.duration / RUNS
        # No knot of any degree is at such a time.
        times = (np.arange(200) + 0.4321) * each / 200
        for run in range(RUNS):
            one, clock = alone(drive, run), times + run * each
            np.testing.assert_allclose(drive.inputs_at(clock), one.inputs_at(times), rtol=0, atol=1e-11)
            if degree > 0:
                rates = drive.inputs_at(clock, 1)
                np.testing.assert_allclose(rates, one.inputs_at(times, 1), rtol=0, atol=1e-10)
                expected = oracle.spline_values(one, times, 1)
                np.testing.assert_allclose(rates, expected, rtol=0, atol=1e-10)
            if degree > 1:
                jerks = drive.inputs_at(clock, 2)
                np.testing.assert_allclose(jerks, one.inputs_at(times, 2), rtol=0, atol=1e-9)
                expected = oracle.spline_values(one, times, 2)
                np.testing.assert_allclose(jerks, expected, rtol=0, atol=1e-9)

    @degrees
    def test_just_before_and_after_a_meeting_only_the_own_run_counts(self, degree: int):
        drive = some_drive(space_of(degree, rest=False))
        each, moment = drive.duration / RUNS, 1e-7
        for run in range(1, RUNS):
            before, after = drive.inputs_at(np.array([run * each - moment, run * each + moment]))
            own = drive.coefficients[run * COEFFICIENTS - 1 : run * COEFFICIENTS + 1]
            np.testing.assert_allclose([before, after], own, rtol=0, atol=1e-4)
            assert np.abs(after - before).max() > 0.5
            if degree > 0:
                slopes = drive.inputs_at(np.array([run * each - moment, run * each + moment]), 1)
                ends = [alone(drive, run - 1).inputs_at(np.array([each - moment]), 1)[0]]
                ends.append(alone(drive, run).inputs_at(np.array([moment]), 1)[0])
                np.testing.assert_allclose(slopes, ends, rtol=0, atol=1e-4)

    @degrees
    def test_without_times_changes_are_of_neighbours_in_a_run(self, degree: int):
        """Rates of a piecewise constant drive, jerks of one whose rates jump."""
        drive, nothing = some_drive(space_of(degree, rest=False)), np.zeros(1)
        singles = [alone(drive, run) for run in range(RUNS)]
        if degree == 0:
            expected = np.vstack([one.inputs_at(nothing, 1) for one in singles])
            np.testing.assert_allclose(drive.inputs_at(nothing, 1), expected, rtol=0, atol=1e-10)
        if degree < 2:
            expected = np.vstack([one.inputs_at(nothing, 2) for one in singles])
            np.testing.assert_allclose(drive.inputs_at(nothing, 2), expected, rtol=0, atol=1e-9)

    @given(duration=durations, runs=st.integers(2, 6), degree=st.integers(0, 3))
    def test_each_run_is_the_same_drive_whatever_its_place(self, duration: float, runs: int, degree: int):
        """Bit by bit: also where knots lie in the middle of periods, and rounding decides between sides."""
        space = DesignSpace(
            duration=duration,
            samples=10,
            spline=Spline(degree=degree, coefficients=4 + degree),
            rest_to_rest=False,
            runs=runs,
        )
        rows = np.random.default_rng(1).uniform(-5, 5, (4 + degree, 2))
        drive = space.trajectory(np.tile(rows, (runs, 1)), np.zeros((runs, 3)))
        one = space.model_copy(update={"runs": 1}).trajectory(rows, np.zeros(3))
        np.testing.assert_array_equal(drive.inputs, np.tile(one.inputs, (runs, 1)))
        embedding = Embedding(space, 2)
        held = embedding.held_inputs(ca.DM(embedding.unknowns(drive.coefficients)))
        np.testing.assert_allclose(np.array(held), drive.inputs, atol=1e-12)
        for run, part in enumerate(drive.each):
            np.testing.assert_array_equal(part.coefficients, one.coefficients)
            np.testing.assert_array_equal(part.knots, one.knots)
            np.testing.assert_array_equal(part.start, drive.starts[run])
            assert (part.samples, part.runs, part.duration) == (10, 1, duration)

    @rests
    def test_from_samples(self, rest: bool):
        rows = np.random.default_rng(2).uniform(-5, 5, (12, 2))
        starts = np.arange(9.0).reshape(3, 3)
        drive = Trajectory.from_samples(rows, 7.5, starts, rest_to_rest=rest, runs=3)
        np.testing.assert_allclose(drive.inputs, rows, rtol=0, atol=1e-13)
        assert (drive.duration, drive.samples, drive.runs) == (7.5, 12, 3)
        for run, part in enumerate(drive.each):
            own = rows[4 * run : 4 * run + 4]
            one = Trajectory.from_samples(own, 2.5, starts[run], rest_to_rest=rest)
            np.testing.assert_array_equal(part.coefficients, one.coefficients)
            np.testing.assert_array_equal(part.knots, one.knots)
            ends = part.inputs_at(np.array([0.0, 2.5]))
            np.testing.assert_array_equal(ends, np.zeros((2, 2)) if rest else own[[0, -1]])

    @pytest.mark.parametrize(("degree", "order"), [(1, 1), (2, 1), (2, 2), (3, 1), (3, 2), (5, 1), (5, 2)])
    def test_what_bounds_derivatives_bounds_those_of_every_run(self, degree: int, order: int):
        space = space_of(degree, rest=False)
        drive, embedding = some_drive(space, 5), Embedding(space, 2)
        bounding = embedding.bounding(ca.DM(embedding.unknowns(drive.coefficients)))
        hulls = np.split(np.array(bounding.rates if order == 1 else bounding.jerks), RUNS)
        for run, hull in enumerate(hulls):
            values = oracle.spline_values(alone(drive, run), np.linspace(0, space.duration, 500)[:-1], order)
            assert np.all(values <= hull.max(axis=0) + 1e-8)
            assert np.all(values >= hull.min(axis=0) - 1e-8)

    @degrees
    def test_no_row_links_two_runs(self, degree: int):
        embedding = Embedding(space_of(degree), 2)
        unknowns = ca.SX.sym("unknowns", embedding.size)
        bounding, held = embedding.bounding(unknowns), embedding.held_inputs(unknowns)
        run_of = np.tile(np.repeat(np.arange(RUNS), embedding.counts[0]), 2)
        for table in (held, bounding.values, bounding.rates, bounding.jerks):
            rows = np.array(ca.DM(ca.jacobian_sparsity(ca.vec(table), unknowns), 1.0)) != 0
            expected = np.tile(np.repeat(np.arange(RUNS), table.shape[0] // RUNS), 2)
            for row, run in zip(rows, expected, strict=True):
                assert set(run_of[row]) <= {run}

    def test_all_runs_rest_at_both_ends(self):
        space = space_of()
        fixed = sorted(set(range(space.all_coefficients)) - set(space.free_rows.tolist()))
        assert fixed == [0, 8, 9, 17, 18, 26]
        for one in some_drive(space).each:
            np.testing.assert_array_equal(one.inputs_at(np.array([0.0, one.duration])), np.zeros((2, 2)))
        assert space_of(rest=False).free_rows.tolist() == list(range(27))

    def test_pickling(self):
        drive = some_drive(space_of())
        again = pickle.loads(pickle.dumps(drive))
        assert (again.degree, again.samples, again.runs) == (drive.degree, drive.samples, drive.runs)
        for name in ("knots", "coefficients", "start", "inputs"):
            np.testing.assert_array_equal(getattr(again, name), getattr(drive, name))

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"samples": 61}, "share equally"),
            ({"start": np.zeros((2, 3))}, "a start for each"),
            ({"start": np.zeros(3)}, "a start for each"),
            ({"runs": 2, "start": np.zeros((2, 3))}, "repeat in each of the 2 runs"),
            ({"runs": 9, "samples": 63, "start": np.zeros((9, 3))}, "repeat in each of the 9 runs"),
        ],
    )
    def test_parts_that_do_not_fit_are_refused(self, change: dict, message: str):
        drive = some_drive(space_of())
        parts = {
            name: getattr(drive, name)
            for name in ("knots", "degree", "coefficients", "start", "samples", "runs")
        }
        with pytest.raises(ValueError, match=message):
            Trajectory(**{**parts, **change})

    def test_splines_of_unequal_runs_are_refused(self):
        knots = np.array([0.0, 0, 1, 1, 3, 3])
        with pytest.raises(ValueError, match="repeat in each of the 2 runs"):
            Trajectory(knots, 1, np.zeros((4, 2)), np.zeros((2, 3)), 4, 2)

    def test_starts_as_many_as_runs(self):
        with pytest.raises(ValueError, match="one for each of the 3 runs"):
            space_of(start=STARTS[:2])
        np.testing.assert_array_equal(space_of(start=STARTS[0]).fixed_starts, [[0.1, 0, 0]] * 3)
        assert space_of(start=STARTS).fixed_starts[1].tolist() == [-0.2, 0.3, 2.0]


LIMITS = (SPEED, ACCELERATION, BOX, WheelJerk(bounds=30), BodySpeed(bounds=0.4), PathLength(bounds=1.5))


class TestEvaluation:
    @pytest.mark.parametrize(("degree", "rest"), [(0, True), (1, False), (3, True)])
    @pytest.mark.slow
    def test_poses_path_and_margins_are_the_single_runs_together(self, degree: int, rest: bool):
        limits = LIMITS if degree > 1 else (*LIMITS[:3], *LIMITS[4:])
        problem = problem_of(design=space_of(degree, rest=rest, start=STARTS), limits=limits)
        for seed in range(2):
            drive = random_drive(problem, seed)
            found = evaluate(problem, drive)
            singles = [evaluate(single_problem(problem, run), alone(drive, run)) for run in range(RUNS)]
            np.testing.assert_allclose(found.states, np.vstack([one.states for one in singles]), atol=1e-10)
            np.testing.assert_allclose(found.path, np.vstack([one.path for one in singles]), atol=1e-10)
            assert found.path_length == pytest.approx(sum(one.path_length for one in singles), rel=1e-12)
            for name in (limit.name for limit in limits):
                margins = {margin.name: margin for margin in found.margins}
                least = min(m.margin for one in singles for m in one.margins if m.name == name)
                assert margins[name].margin == pytest.approx(least, rel=1e-9, abs=1e-9)
                assert margins[name].size == singles[0].margins[0].size or name != "wheel_speed"

    @pytest.mark.parametrize("place", [0, COEFFICIENTS - 1])
    @pytest.mark.parametrize("run", range(RUNS))
    def test_a_limit_is_checked_at_both_ends_of_every_run(self, run: int, place: int):
        problem = problem_of(design=space_of(rest=False), limits=(SPEED,))
        rows = np.zeros((RUNS * COEFFICIENTS, 2))
        rows[run * COEFFICIENTS + place, 1] = 12.5
        found = evaluate(problem, problem.design.trajectory(rows, np.zeros((RUNS, 3))))
        assert found.violations == pytest.approx({"wheel_speed": 2.5}, rel=1e-9)

    @settings(max_examples=10)
    @given(duration=durations, runs=st.integers(2, 5), run=st.integers(0, 4), last=st.booleans())
    @pytest.mark.slow
    def test_every_run_has_to_rest_at_its_ends(self, duration: float, runs: int, run: int, last: bool):
        space = DesignSpace(duration=duration, samples=4, spline=Spline(degree=1, coefficients=5), runs=runs)
        rows = np.zeros((5 * runs, 2))
        rows[5 * (run % runs) + (4 if last else 0), 0] = 1.0
        problem = problem_of(design=space, limits=(SPEED,))
        found = evaluate(problem, space.trajectory(rows, np.zeros((runs, 3))))
        assert found.violations == pytest.approx({"rest_to_rest": 1.0}, rel=1e-9)

    def test_start_and_duration_are_those_of_all_runs(self):
        problem = problem_of(design=space_of(start=STARTS))
        drive = random_drive(problem, 0, 0.5)
        assert evaluate(problem, drive).feasible
        moved = drive.start.copy()
        moved[2, 1] += 0.05
        shifted = Trajectory(drive.knots, 3, drive.coefficients, moved, drive.samples, RUNS)
        assert evaluate(problem, shifted).violations == pytest.approx({"start": 0.05}, rel=1e-9)
        longer = Trajectory(drive.knots * 1.1, 3, drive.coefficients, drive.start, drive.samples, RUNS)
        assert evaluate(problem, longer).violations["duration"] == pytest.approx(0.1 * RUNS * 7.3, rel=1e-9)

    def test_the_limit_on_length_holds_for_each_run(self):
        problem = problem_of(design=space_of(), limits=(SPEED, PathLength(bounds=1.0)))
        rows = np.zeros((RUNS, COEFFICIENTS, 2))
        rows[:, 1:-1] = [[[2.0, 2.0]], [[4.0, 4.0]], [[-3.0, -3.0]]]
        found = evaluate(problem, problem.design.trajectory(rows.reshape(-1, 2), np.zeros((RUNS, 3))))
        lengths = [np.abs(one.inputs).sum() / 2 * RADIUS * one.period for one in found_runs(problem, rows)]
        assert found.path_length == pytest.approx(sum(lengths), rel=1e-6)
        margin = next(margin for margin in found.margins if margin.name == "path_length")
        assert margin.margin == pytest.approx(1.0 - max(lengths), abs=1e-3)

    def test_another_number_of_runs_is_refused(self):
        problem = problem_of(design=space_of(start=STARTS))
        single = single_problem(problem, 0)
        with pytest.raises(ValueError, match=r"start of 3 run\(s\)"):
            evaluate(problem, random_drive(single, 0))
        with pytest.raises(ValueError, match=r"start of 1 run\(s\)"):
            evaluate(single, random_drive(problem, 0))

    @pytest.mark.parametrize("degree", [0, 1, 3])
    def test_one_run_is_as_without_the_key(self, degree: int):
        plain = DesignSpace(duration=10, samples=40, spline=Spline(degree=degree, coefficients=9))
        keyed = [
            DesignSpace(duration=10, samples=40, spline=plain.spline, runs=1),
            DesignSpace(duration=10, samples=40, spline=plain.spline, runs=1, start=[StartPose()]),
        ]
        first = outcome(plain)
        for space in keyed:
            np.testing.assert_equal(outcome(space), first)


def found_runs(problem: Problem, rows: np.ndarray) -> tuple[Trajectory, ...]:
    return problem.design.trajectory(rows.reshape(-1, 2), np.zeros((RUNS, 3))).each


def outcome(space: DesignSpace) -> dict:
    """All numbers of one drive's score by a problem of its own: spaces alike have one problem else."""
    measurement = Displacements(segments=4, regressor="both", noise={"position": 0.01, "heading": 0.02})
    problem = new_problem_of(design=space, measurement=measurement)
    found: Evaluation = evaluate(problem, random_drive(problem, 3))
    others = {"margins", "square_roots", "full_square_roots"}
    numbers = {name: getattr(found, name) for name in found.__dataclass_fields__ if name not in others}
    return {
        **numbers,
        "information": found.information,
        "margins": [(m.name, m.margin, m.size) for m in found.margins],
    }


HEADER = "run,t,wheel_speed_right,wheel_speed_left,x,y,heading"
TWO_RUNS = [
    HEADER,
    "1,0,1,2,0.5,0,0",
    "1,1,3,4,9,9,9",
    "1,2,,,9,9,9",
    "2,0,5,6,0,0.5,1",
    "2,1,7,8,9,9,9",
    "2,2,,,9,9,9",
]
FOUR_ROWS = ["1,0,1,2", "1,1,3,4", "2,0,5,6", "2,1,7,8"]
WITHOUT_RUN = ["t,wheel_speed_right,wheel_speed_left", "0,1,2", "1,3,4", "2,5,6", "3,7,8"]


def two_runs(**parts) -> Problem:
    return problem_of(design=DesignSpace(duration=10, samples=40, runs=2, **parts), limits=(SPEED,))


def read_lines(folder: Path, lines: list[str], problem: Problem) -> Trajectory:
    file = folder / "path.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_trajectory(file, problem)


def replaced(line: int, text: str) -> list[str]:
    """The file of two runs with another text in that line (from 1)."""
    return [*TWO_RUNS[: line - 1], text, *TWO_RUNS[line:]]


REFUSED = {
    "one run of two": (TWO_RUNS[:4], 2, "run", "expected 2 run(s)"),
    "three runs of two": ([*TWO_RUNS, "3,0,1,1,0,0,0", "3,1,1,1,0,0,0"], 2, "run", "got 3"),
    "no column": (WITHOUT_RUN, 2, "run", "told apart by a column `run`; got 1"),
    "a run not named": (replaced(6, ",1,7,8,9,9,9"), 2, "run", "got 3"),
    "fewer periods": ([*TWO_RUNS[:3], "1,2,1,1,9,9,9", "1,3,,,9,9,9", *TWO_RUNS[4:]], 6, "run", "3 periods"),
    "shorter periods": (
        [*TWO_RUNS[:5], "2,0.5,7,8,9,9,9", "2,1,,,9,9,9"],
        5,
        "run",
        "expected 2 s, as in the first run, got 1 s",
    ),
    "uneven steps": (replaced(6, "2,1.5,7,8,9,9,9"), 6, "t", "even steps"),
    "not a number": (replaced(6, "2,1,seven,8,9,9,9"), 6, "wheel_speed_right", "'seven'"),
    "no input": (replaced(3, "1,1,,4,9,9,9"), 3, "wheel_speed_right", "expected a finite number"),
    "no start": (replaced(5, "2,0,5,6,,0.5,1"), 5, "x", "expected a finite number"),
    "a single row": (TWO_RUNS[:5], 5, "run", "at least two rows of a run"),
}


class TestPathFile:
    @pytest.mark.parametrize(
        ("degree", "start"), [(0, STARTS), (1, STARTS[0]), (3, "free")], ids=["list", "one", "free"]
    )
    def test_the_score_is_the_same(self, tmp_path: Path, degree: int, start):
        problem = problem_of(design=space_of(degree, start=start))
        for seed in range(3):
            drive = random_drive(problem, seed)
            before = evaluate(problem, drive)
            write_trajectory(tmp_path / "path.csv", problem, drive, before.states)
            again = read_trajectory(tmp_path / "path.csv", problem)
            after = evaluate(problem, again)
            assert (again.runs, again.samples) == (RUNS, drive.samples)
            np.testing.assert_allclose(again.inputs, drive.inputs, rtol=0, atol=1e-12)
            np.testing.assert_array_equal(again.start, drive.start)
            assert after.objective == pytest.approx(before.objective, rel=1e-8)
            np.testing.assert_allclose(after.states, before.states, rtol=0, atol=1e-8)
            assert after.path_length == pytest.approx(before.path_length, rel=1e-8)

    def test_the_form(self, tmp_path: Path):
        drive = read_lines(tmp_path, TWO_RUNS, two_runs(start="free"))
        assert drive.start.tolist() == [[0.5, 0, 0], [0, 0.5, 1]]
        assert drive.inputs.tolist() == [[1, 2], [3, 4], [5, 6], [7, 8]]
        assert (drive.duration, drive.samples, drive.runs) == (4.0, 4, 2)
        problem = two_runs(start="free")
        write_trajectory(tmp_path / "again.csv", problem, drive, evaluate(problem, drive).states)
        lines = (tmp_path / "again.csv").read_text().splitlines()
        assert lines[0] == HEADER
        rows = [[float(cell) if cell else None for cell in line.split(",")[:4]] for line in lines[1:]]
        assert rows[:3] == [[1, 0, 1, 2], [1, 1, 3, 4], [1, 2, None, None]]
        assert rows[3:] == [[2, 0, 5, 6], [2, 1, 7, 8], [2, 2, None, None]]

    def test_without_poses_the_studys_starts_are_taken(self, tmp_path: Path):
        lines = [HEADER.removesuffix(",x,y,heading"), *FOUR_ROWS]
        drive = read_lines(tmp_path, lines, two_runs(start=STARTS[:2]))
        assert drive.start.tolist() == [[0.1, 0, 0], [-0.2, 0.3, 2.0]]
        assert read_lines(tmp_path, lines, two_runs(start="free")).start.tolist() == [[0, 0, 0], [0, 0, 0]]

    def test_runs_may_have_any_names_and_mixed_rows(self, tmp_path: Path):
        rows = [line.replace("2,", "back,", 1) if line.startswith("2,") else line for line in TWO_RUNS]
        mixed = [rows[0], rows[1], rows[4], rows[2], rows[5], rows[3], rows[6]]
        drive = read_lines(tmp_path, mixed, two_runs(start="free"))
        np.testing.assert_array_equal(drive.inputs, [[1, 2], [3, 4], [5, 6], [7, 8]])
        np.testing.assert_array_equal(drive.start, [[0.5, 0, 0], [0, 0.5, 1]])

    def test_the_column_is_not_needed_for_one_run_and_does_no_harm(self, tmp_path: Path):
        problem = problem_of()
        plain = read_lines(tmp_path, WITHOUT_RUN, problem)
        named = read_lines(
            tmp_path, [f"run,{WITHOUT_RUN[0]}", *(f"7,{line}" for line in WITHOUT_RUN[1:])], problem
        )
        np.testing.assert_array_equal(plain.inputs, named.inputs)
        with pytest.raises(PathFileError, match=r"expected 1 run\(s\)"):
            read_lines(tmp_path, TWO_RUNS, problem)

    @pytest.mark.parametrize(("lines", "line", "key", "text"), REFUSED.values(), ids=REFUSED.keys())
    def test_mistakes_are_named_by_their_line(self, tmp_path: Path, lines: list[str], line, key, text: str):
        with pytest.raises(PathFileError) as caught:
            read_lines(tmp_path, lines, two_runs(start="free"))
        (issue,) = caught.value.issues
        assert (issue.file, issue.line, issue.key) == (str(tmp_path / "path.csv"), line, key)
        assert text in issue.message

    def test_mistakes_of_all_runs_are_listed(self, tmp_path: Path):
        lines = [*TWO_RUNS[:2], "1,1,a,4,9,9,9", *TWO_RUNS[3:5], "2,1,7,b,9,9,9", TWO_RUNS[6]]
        with pytest.raises(PathFileError) as caught:
            read_lines(tmp_path, lines, two_runs(start="free"))
        assert [issue.line for issue in caught.value.issues] == [3, 6]


STUDY = SMALL.replace("duration: 10 s,", "duration: 10 s, runs: 2,")


def call(capsys, *arguments: str) -> tuple[int, str, str]:
    capsys.readouterr()
    code = main(arguments)
    captured = capsys.readouterr()
    return code, captured.out, captured.err


class TestCommandLine:
    @pytest.fixture(autouse=True)
    def _folder(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.chdir(tmp_path)
        assert STUDY != SMALL
        write_study(tmp_path, STUDY)

    def test_a_drive_of_two_runs_is_scored(self, capsys, tmp_path: Path):
        design = DesignSpace(duration=10, samples=40, spline=Spline(coefficients=8), runs=2)
        noise = {"position": "1 cm", "heading": "1 deg"}
        problem = problem_of(design=design, measurement=Displacements(segments=4, noise=noise))
        drive = random_drive(problem, 1, 2.0)
        found = evaluate(problem, drive)
        write_trajectory(tmp_path / "path.csv", problem, drive, found.states)
        code, out, err = call(capsys, "evaluate", "study.yaml", "path.csv", "--json")
        assert (code, err) == (0, "")
        assert json.loads(out)["objective"] == pytest.approx(found.objective, rel=1e-9)

    def test_one_run_of_two_is_refused(self, capsys, tmp_path: Path):
        (tmp_path / "path.csv").write_text("\n".join(WITHOUT_RUN) + "\n")
        code, out, err = call(capsys, "evaluate", "study.yaml", "path.csv")
        assert (code, out) == (2, "")
        assert err.startswith("path.csv:2: run: expected 2 run(s)")
