"""Commands at any rate: what wheels turn, where the robot gets, and what stops it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from export_records import (
    DIFFERENTIAL,
    MECANUM,
    STEERED,
    TRICYCLE,
    entry,
    saved,
    simulated,
    study_of,
    winding,
)
from hypothesis import given
from hypothesis import strategies as st

from oed.exporters import EXPORTERS, export
from oed.exporters.commands import commands, joint_name, resampled
from oed.foundation.errors import RecordError, UserMistake
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.robots.models import SkidSteerSlip

SPEEDS = np.array([True, False])
LAGGING = {"wheel_radius": 0.05, "track": 0.2}


def test_twists_are_those_asked_for_of_a_robot_that_lags():
    study = study_of(DIFFERENTIAL)
    robot = SkidSteerSlip(**LAGGING, yaw_lag=0.4)
    lagging = replace(study.problem, model=robot)
    drive = Trajectory.from_samples(
        np.random.default_rng(0).uniform(-2, 2, (30, 2)), 6.0, (0, 0, 0, 0), rest_to_rest=False
    )
    (found,) = commands(lagging.model, drive)
    right, left = 0.05 * drive.inputs.T
    asked = np.column_stack([(right + left) / 2, 0 * right, (right - left) / 0.2])
    assert found.twists[:-1] == pytest.approx(asked, abs=1e-14)
    assert np.abs(np.diff(found.poses[:, 2]) - drive.period * asked[:, 2]).max() > 0.01


class TestResampled:
    def test_the_same_rate_changes_nothing(self):
        inputs = np.random.default_rng(0).normal(size=(7, 2))
        assert np.array_equal(resampled(inputs, 0.1, 1 / 0.1, SPEEDS), inputs)

    def test_a_multiple_of_the_rate_repeats(self):
        inputs = np.random.default_rng(0).normal(size=(7, 2))
        assert np.array_equal(resampled(inputs, 0.1, 30.0, SPEEDS), np.repeat(inputs, 3, axis=0))

    def test_half_the_rate_takes_means(self):
        inputs = np.array([[1.0, 0.1], [3.0, 0.3], [2.0, 0.2], [0.0, 0.4]])
        assert resampled(inputs, 0.1, 5.0, SPEEDS) == pytest.approx(np.array([[2.0, 0.2], [1.0, 0.3]]))

    def test_a_wheel_stands_still_after_the_end_and_an_angle_is_held(self):
        # 0.3 s in periods of 0.2 s: the second one is half over when the drive ends.
        inputs = np.array([[1.0, 0.1], [3.0, 0.3], [2.0, 0.2]])
        assert resampled(inputs, 0.1, 5.0, SPEEDS) == pytest.approx(np.array([[2.0, 0.2], [1.0, 0.2]]))

    def test_a_period_longer_than_the_drive(self):
        inputs = np.array([[1.0, 0.1], [3.0, 0.3]])
        assert resampled(inputs, 0.1, 1.0, SPEEDS) == pytest.approx(np.array([[0.4, 0.2]]))

    @given(st.integers(1, 12), st.floats(0.01, 1.0), st.floats(0.3, 200.0), st.integers(0, 2**32 - 1))
    def test_the_angles_turned_are_kept(self, count: int, period: float, rate: float, seed: int):
        inputs = np.random.default_rng(seed).normal(size=(count, 2))
        new = resampled(inputs, period, rate, np.array([True, True]))
        assert len(new) / rate >= count * period * (1 - 1e-6)
        assert new.sum(axis=0) / rate == pytest.approx(inputs.sum(axis=0) * period, abs=1e-9)
        # At every new edge as well, not only at the end.
        known = np.vstack([np.zeros((1, 2)), np.cumsum(inputs, axis=0) * period])
        edges = np.arange(1, len(new) + 1) / rate
        turned = np.cumsum(new, axis=0) / rate
        for column in range(2):
            expected = np.interp(edges, np.arange(count + 1) * period, known[:, column])
            assert turned[:, column] == pytest.approx(expected, abs=1e-8)


class TestCommands:
    def test_at_the_own_rate_the_robot_does_what_the_design_says(self):
        study = study_of()
        drive = winding(study)
        (run,) = commands(study.problem.model, drive)
        assert run.rate == pytest.approx(4.0)
        assert run.times == pytest.approx(np.arange(9) * 0.25)
        assert np.array_equal(run.inputs[:-1], drive.inputs)
        assert run.poses == pytest.approx(evaluate(study.problem, drive).states, abs=1e-12)
        assert run.poses == pytest.approx(simulated(study.problem.model, drive), abs=1e-12)

    @pytest.mark.parametrize("rate", [8.0, 20.0, 400.0])
    def test_at_a_multiple_of_it_too(self, rate: float):
        study = study_of()
        drive = winding(study)
        (run,) = commands(study.problem.model, drive, rate)
        every = round(rate / 4)
        assert run.poses[::every] == pytest.approx(simulated(study.problem.model, drive), abs=1e-11)

    @pytest.mark.parametrize("rate", [3.0, 3.3, 7.0])
    def test_at_any_rate_the_heading_ends_the_same(self, rate: float):
        # The heading of two wheels follows from the angles turned alone.
        study = study_of()
        drive = winding(study)
        (run,) = commands(study.problem.model, drive, rate)
        assert run.turned[-1] == pytest.approx(drive.inputs.sum(axis=0) * drive.period)
        assert run.poses[-1, 2] == pytest.approx(simulated(study.problem.model, drive)[-1, 2])

    def test_twists_are_the_robots(self):
        study = study_of()
        (run,) = commands(study.problem.model, winding(study))
        right, left = run.inputs.T
        assert run.twists[:, 0] == pytest.approx((0.051 * right + 0.049 * left) / 2)
        assert run.twists[:, 1] == pytest.approx(0.0)
        assert run.twists[:, 2] == pytest.approx((0.051 * right - 0.049 * left) / 0.2)

    def test_the_last_command_stops_and_leaves_the_steering(self):
        study = study_of(TRICYCLE, STEERED)
        (run,) = commands(study.problem.model, winding(study))
        assert run.inputs[-1].tolist() == [0.0, run.inputs[-2, 1]]
        assert run.twists[-1].tolist() == [0.0, 0.0, 0.0]

    @pytest.mark.parametrize("rate", [None, 7.0])
    def test_every_joint_moves_by_its_velocity(self, rate: float | None):
        study = study_of(TRICYCLE, STEERED)
        (run,) = commands(study.problem.model, winding(study), rate)
        assert np.diff(run.positions, axis=0) == pytest.approx(run.velocities[:-1] / run.rate)
        assert run.positions[:, 1] == pytest.approx(run.inputs[:, 1])
        assert run.velocities[-1].tolist() == [0.0, 0.0]

    def test_runs_begin_at_their_own_starts(self):
        study = study_of(runs=2)
        drive = winding(study)
        first, second = commands(study.problem.model, drive, 8.0)
        assert first.poses[0] == pytest.approx(drive.starts[0])
        assert second.poses[0] == pytest.approx(drive.starts[1])
        assert first.times[0] == second.times[0] == 0.0
        expected = simulated(study.problem.model, drive.each[1])
        assert second.poses[::2] == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize(
    ("robot", "limits", "joints"),
    [
        (DIFFERENTIAL, "", ["wheel_right_joint", "wheel_left_joint"]),
        (TRICYCLE, STEERED, ["wheel_joint", "steering_joint"]),
        (
            MECANUM,
            "",
            [f"wheel_{place}_joint" for place in ("front_left", "front_right", "rear_left", "rear_right")],
        ),
    ],
)
def test_joint_names(robot: str, limits: str, joints: list[str]):
    model = study_of(robot, limits).problem.model
    assert [joint_name(entry) for entry in model.inputs] == joints


class TestMistakes:
    def test_unknown_format(self, tmp_path: Path):
        with pytest.raises(UserMistake, match="csv, json, rosbag2, ros2_node, ros2_yaml; got 'xml'"):
            export(tmp_path, "xml")

    def test_no_record(self, tmp_path: Path):
        for to in EXPORTERS:
            with pytest.raises(RecordError, match="no record there"):
                export(tmp_path, to)

    @pytest.mark.parametrize("to", EXPORTERS)
    def test_unknown_result(self, tmp_path: Path, to: str):
        folder = saved(tmp_path, study_of())
        with pytest.raises(RecordError, match=r"record\.json: no result 'best'; the record has my drive"):
            export(folder, to, result="best")

    def test_nothing_feasible(self, tmp_path: Path):
        study = study_of()
        folder = saved(tmp_path, study, [entry("fast", winding(study), feasible=False)])
        with pytest.raises(RecordError, match="no feasible result; the record has fast"):
            export(folder, "csv")
        # By its name it can be had.
        assert export(folder, "csv", result="fast").name == "fast_commands.csv"

    def test_a_result_without_a_drive(self, tmp_path: Path):
        study = study_of()
        results = [entry("genetic", None, feasible=False), entry("arc", winding(study))]
        folder = saved(tmp_path, study, results)
        with pytest.raises(RecordError, match="genetic holds no drive; those that do: arc"):
            export(folder, "json", result="genetic")

    def test_a_rate_that_is_none(self, tmp_path: Path):
        folder = saved(tmp_path, study_of())
        for rate in (0.0, -5.0, float("nan"), float("inf")):
            with pytest.raises(UserMistake, match="rate: expected more than 0 Hz"):
                export(folder, "csv", rate=rate)

    def test_a_mistyped_rate(self, tmp_path: Path):
        with pytest.raises(UserMistake, match="more than 1000000 commands in 2 s"):
            export(saved(tmp_path, study_of()), "csv", rate=1e6)

    def test_a_place_that_cannot_be_written(self, tmp_path: Path):
        folder = saved(tmp_path / "record", study_of())
        (tmp_path / "file").write_text("")
        for to in EXPORTERS:
            with pytest.raises(UserMistake, match="cannot write there"):
                export(folder, to, out=tmp_path / "file" / "inside")
