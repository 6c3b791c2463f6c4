"""Commands as CSV and JSON."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from export_records import (
    COMMANDED,
    MECANUM,
    STEERED,
    TRICYCLE,
    UNICYCLE,
    saved,
    simulated,
    study_of,
    winding,
)

from oed.cli import main
from oed.exporters import export
from oed.foundation.errors import UserMistake
from oed.foundation.files import write_files
from oed.kernel.solution import scored
from oed.logs import CsvForm, read_logs
from oed.records.path_file import read_trajectory
from oed.records.record import ESTIMATE_FILE as ESTIMATE
from oed.records.record import FILE as RECORD
from oed.records.record import LOOP_FILE as LOOP
from oed.records.record import PLAN_FILE as PLAN
from oed.records.record import RESULTS
from oed.study.study import Study
from oed.workflow.runner import record, record_files
from oed.workflow.sweep.run import FILE as SWEEP


def table(file: Path) -> tuple[list[str], np.ndarray]:
    with file.open(newline="") as handle:
        header, *rows = csv.reader(handle)
    return header, np.array(rows, dtype=float)


def exported(folder: Path, study: Study, to: str = "csv", **options) -> Path:
    return export(saved(folder, study), to, **options)


class TestCsv:
    def test_columns(self, tmp_path: Path):
        header, rows = table(exported(tmp_path, study_of()))
        expected = "t,wheel_speed_right,wheel_speed_left,v,omega,x,y,heading"
        assert ",".join(header) == expected
        assert rows.shape == (9, 8)

    def test_commands_are_no_columns_of_twists_as_well(self, tmp_path: Path):
        study = study_of(UNICYCLE, COMMANDED)
        file = exported(tmp_path, study)
        header, rows = table(file)
        assert header == ["t", "v", "omega", "x", "y", "heading"]
        assert np.array_equal(rows[:-1, 1:3], winding(study).inputs)
        (log,) = read_logs([file], CsvForm(), study.problem.model)
        assert log.inputs_between(log.input_times) == pytest.approx(winding(study).inputs)

    def test_values(self, tmp_path: Path):
        study = study_of()
        drive = winding(study)
        _, rows = table(exported(tmp_path, study))
        assert rows[:, 0] == pytest.approx(np.arange(9) * 0.25)
        assert np.array_equal(rows[:-1, 1:3], drive.inputs)
        assert rows[-1, 1:5].tolist() == [0.0, 0.0, 0.0, 0.0]
        assert rows[:, 3] == pytest.approx(rows[:, 1:3] @ [0.0255, 0.0245])
        assert rows[:, 4] == pytest.approx(rows[:, 1:3] @ [0.255, -0.245])
        assert rows[:, 5:] == pytest.approx(simulated(study.problem.model, drive))

    def test_a_robot_that_moves_sideways(self, tmp_path: Path):
        header, rows = table(exported(tmp_path, study_of(MECANUM)))
        assert header[5:] == ["v", "omega", "v_lateral", "x", "y", "heading"]
        # Rollers at 45 degrees: front left and rear right wheels pull to the right.
        front_left, front_right, rear_left, rear_right = rows[:, 1:5].T
        lateral = 0.05 / 4 * (-front_left + front_right + rear_left - rear_right)
        assert rows[:, 7] == pytest.approx(lateral)

    def test_it_is_read_again(self, tmp_path: Path):
        study = study_of()
        drive = winding(study)
        read = read_trajectory(exported(tmp_path, study), study.problem)
        assert read.period == pytest.approx(drive.period)
        assert read.inputs[:-1] == pytest.approx(drive.inputs, abs=1e-12)
        # The command to stop counts as a period.
        assert read.inputs[-1].tolist() == [0.0, 0.0]
        assert read.start == pytest.approx(drive.start)

    def test_several_runs_are_read_again(self, tmp_path: Path):
        study = study_of(runs=2)
        drive, file = winding(study), exported(tmp_path, study)
        header, rows = table(file)
        assert header[:2] == ["run", "t"]
        assert rows[:, 0].tolist() == [1.0] * 9 + [2.0] * 9
        assert rows[9, 1] == 0.0
        read = read_trajectory(file, study.problem)
        assert read.starts == pytest.approx(drive.starts)
        for own, expected in zip(read.each, drive.each, strict=True):
            assert own.inputs[:-1] == pytest.approx(expected.inputs, abs=1e-12)

    def test_another_rate(self, tmp_path: Path):
        study = study_of()
        _, rows = table(exported(tmp_path, study, rate=5.0))
        assert rows[:, 0] == pytest.approx(np.arange(11) / 5)
        turned = winding(study).inputs.sum(axis=0) * 0.25
        assert rows[:, 1:3].sum(axis=0) / 5 == pytest.approx(turned)

    def test_where_it_is_written(self, tmp_path: Path):
        folder = saved(tmp_path / "record", study_of())
        assert export(folder, "csv") == folder / "my_drive_commands.csv"
        # The record's file stands for its folder.
        assert export(folder / "record.json", "json") == folder / "my_drive_commands.json"
        assert export(folder, "csv", out=tmp_path / "new" / "a.csv") == tmp_path / "new" / "a.csv"
        assert (tmp_path / "new" / "a.csv").read_text() == (folder / "my_drive_commands.csv").read_text()

    def test_from_a_record_that_was_made_by_the_package(self, tmp_path: Path):
        study = study_of()
        drives = [scored(study.problem, winding(study), "mine")]
        write_files(tmp_path, record_files(study, drives, record(study, drives, 0, named=True)))
        _, rows = table(export(tmp_path, "csv", result="mine"))
        _, own = table_without_last_inputs(tmp_path / "mine.csv")
        assert rows[:-1, :3] == pytest.approx(own[:, :3], abs=1e-9)
        assert rows[:-1, 5:] == pytest.approx(own[:, 3:], abs=1e-9)


def table_without_last_inputs(file: Path) -> tuple[list[str], np.ndarray]:
    # The last row of a trajectory's own file has no inputs.
    header, *rows = csv.reader(file.read_text().splitlines())
    return header, np.array(rows[:-1], dtype=float)


class TestJson:
    def test_what_it_says(self, tmp_path: Path):
        study = study_of()
        data = json.loads(exported(tmp_path, study, "json").read_text())
        (run,) = data.pop("runs")
        assert data.pop("departures") is None
        assert data == {
            "format": 1,
            "study": "Out to the robot",
            "result": "my drive",
            "robot": study.echo()["robot"],
            "rate": 4.0,
            "inputs": ["wheel_speed_right", "wheel_speed_left"],
            "units": {
                "t": "s",
                "wheel_speed_right": "rad/s",
                "wheel_speed_left": "rad/s",
                "v": "m/s",
                "omega": "rad/s",
                "x": "m",
                "y": "m",
                "heading": "rad",
            },
        }
        assert data["robot"]["kind"] == "differential_drive"
        assert {key: list(value) for key, value in run.items() if key != "t"} == {
            "inputs": data["inputs"],
            "twist": ["v", "omega"],
            "poses": ["x", "y", "heading"],
        }

    @pytest.mark.parametrize(("robot", "limits"), [(TRICYCLE, STEERED), (MECANUM, "")])
    def test_it_holds_the_numbers_of_the_table(self, tmp_path: Path, robot: str, limits: str):
        study = study_of(robot, limits, runs=2)
        header, rows = table(exported(tmp_path, study))
        data = json.loads(exported(tmp_path, study, "json").read_text())
        for number, run in enumerate(data["runs"]):
            columns = {"t": run["t"], **run["inputs"], **run["twist"], **run["poses"]}
            assert ["run", *columns] == header
            assert set(columns) == set(data["units"])
            own = rows[9 * number : 9 * (number + 1), 1:]
            assert np.array_equal(np.column_stack(list(columns.values())), own)


class TestResults:
    """What was found is not lost to a file of another kind."""

    def test_their_names(self):
        assert RESULTS == (RECORD, ESTIMATE, SWEEP, PLAN, LOOP)

    @pytest.mark.parametrize("name", ["record.json", "estimate.json", "sweep.json", "plan.json", "loop.json"])
    def test_they_stay(self, tmp_path: Path, name: str):
        folder = saved(tmp_path / "run", study_of())
        place = folder if name == "record.json" else tmp_path
        if place == tmp_path:
            (place / name).write_text("found")
        before = (place / name).read_bytes()
        for to in ("csv", "json", "ros2_yaml", "rosbag2"):
            with pytest.raises(UserMistake, match=f"{name}: cannot be written: it holds results"):
                export(folder, to, out=place / name, force=True)
            assert (place / name).read_bytes() == before, to

    def test_a_first_study_takes_no_place_of_theirs(self, tmp_path: Path, capsys):
        (tmp_path / "sweep.json").write_text("found")
        choice = ["--robot", "khepera_4", "--room", "4 m x 3 m", "--sensor", "poses", "--duration", "20 s"]
        assert main(["init", str(tmp_path / "sweep.json"), *choice, "--force"]) == 2
        assert "it holds results" in capsys.readouterr().err
        assert (tmp_path / "sweep.json").read_text() == "found"

    @pytest.mark.slow
    def test_nor_does_a_bag_of_a_folder_of_theirs(self, tmp_path: Path):
        pytest.importorskip("rosbags")
        folder = saved(tmp_path / "run", study_of())
        export(folder, "rosbag2", out=folder / "run1")
        with pytest.raises(UserMistake, match="holds results, which would be lost"):
            export(folder, "rosbag2", out=folder, force=True)
        assert (folder / "record.json").is_file()
