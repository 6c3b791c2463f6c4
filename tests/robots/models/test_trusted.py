"""A record is data: code that it names is run for nobody who has not said so; names lead nowhere."""

from __future__ import annotations

import ast
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studies import SMALL

from oed.cli import main
from oed.exporters import export
from oed.exporters.request import Request
from oed.foundation.errors import RecordError, StudyError, UserMistake
from oed.foundation.own import code as own_module
from oed.kernel.solution import scored
from oed.records.record import Record, load_record, save_record
from oed.records.recorded_study import recorded_study
from oed.study.study import Study
from oed.workflow.experiments import validated, validation_options
from oed.workflow.next_drive import next_drive
from oed.workflow.runner import record
from oed.workflow.studies import load_study, parse_study

MODULE = """
from pathlib import Path

import casadi as ca
import oed

Path(__file__).with_name("was_run").touch()


class Unicycle(oed.Model):
    kind: str = "unicycle"
    gain: float = 1.0
    inputs = (oed.Input("wheel_speed", "wheel_speed", "rad/s"), oed.Input("spin", "wheel_speed", "rad/s"))

    @property
    def parameters(self):
        return (oed.Parameter("gain", self.gain, ""), oed.Parameter("turning_gain", 0.5, ""))

    def twist(self, inputs, parameters):
        return ca.vertcat(parameters[0] * inputs[0], SIDEWAYS * inputs[1], parameters[1] * inputs[1])
"""
STUDY = """\
format: 1
name: My own
robot: {kind: python, object: OBJECT, gain: 0.9}
trajectory:
  {duration: 10 s, samples: 20, integration: RULE, spline: {coefficients: 8}, start: START}
measurement: {kind: poses, noise: {position: 1 cm, heading: 1 deg}}
limits: {wheel_speed: 1 rad/s}
"""
COMMANDS = (
    ["validate", "--replicates", "100", "--quiet"],
    ["next", "log.csv", "--quiet"],
    ["export", "--to", "ros2_yaml"],
)
"""Commands that take a record, without it."""
START = "{x: 0.1 m, y: 0.2 m, heading: 0.3 rad}"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


def study_in(folder: Path, rule: str = "arc", sideways: float = 0.0) -> Study:
    # A module of its own for every test: modules stay loaded.
    name = f"robots_of_{abs(hash(str(folder)))}"
    (folder / f"{name}.py").write_text(MODULE.replace("SIDEWAYS", repr(sideways)))
    (folder / "study.yaml").write_text(
        STUDY.replace("OBJECT", f"{name}:Unicycle").replace("RULE", rule).replace("START", START)
    )
    return load_study(folder / "study.yaml")


def made(study: Study) -> Record:
    wave = np.array([0.0, 0.6, 0.8, 0.9, -0.7, 0.2, 0.3, 0.0])
    drive = study.problem.design.trajectory(np.column_stack([wave, 0.9 * wave[::-1]]), [0.1, 0.2, 0.3])
    return record(study, [scored(study.problem, drive, "winding")], 0)


def saved(folder: Path, **options: Any) -> Path:
    """A record of somebody's robot whose code has not been run since."""
    save_record(made(study_in(folder, **options)), folder)
    (folder / "was_run").unlink()
    for module in [name for name in sys.modules if name.startswith(own_module.PREFIX)]:
        del sys.modules[module]
    own_module._packages.clear()
    return folder


class TestCode:
    @pytest.mark.slow
    def test_is_not_run_unasked(self, folder: Path, capsys: pytest.CaptureFixture[str]):
        saved(folder)
        (module,) = folder.glob("robots_of_*.py")
        for command, *flags in (*COMMANDS, ["animate", "--physics", "--quiet"]):
            assert main([command, str(folder), *flags]) == 2, command
            said = capsys.readouterr().err
            assert said.startswith(f"{folder / 'record.json'}: study.robot: robots_of_"), command
            assert f"is code, of {module}, and would be run" in said, command
            assert "give --trust" in said, command
            assert not (folder / "was_run").exists(), command

    @pytest.mark.slow
    def test_is_run_for_who_trusts_it_and_that_is_not_remembered(self, folder: Path):
        saved(folder)
        assert main(["export", str(folder), "--to", "csv", "--trust"]) == 0
        assert (folder / "was_run").exists()
        (folder / "was_run").unlink()
        assert main(["validate", str(folder), "--quiet"]) == 2
        assert not (folder / "was_run").exists()

    @pytest.mark.slow
    @pytest.mark.usefixtures("blank_figures")
    def test_is_not_needed_for_reports_and_films(self, folder: Path):
        saved(folder)
        assert main(["report", str(folder)]) == 0
        assert main(["animate", str(folder), "--speed", "500", "--fps", "10", "--quiet"]) == 0
        assert not (folder / "was_run").exists()

    def test_of_alternatives_is_found_as_well(self, folder: Path):
        data = made(study_in(folder)).data
        robot = data["study"]["robot"]
        data["study"]["robot"] = {"kind": "differential_drive", "wheel_radius": 0.05, "track": 0.2}
        data["study"]["calibration"] = {"models": [robot]}
        (folder / "record.json").write_text(json.dumps(data))
        with pytest.raises(RecordError, match=r"study\.calibration\.models\.0\.robot: robots_of_.* is code"):
            recorded_study(load_record(folder))

    @pytest.mark.slow
    def test_of_ones_own_run_needs_no_word(self, folder: Path):
        fresh = made(study_in(folder))
        assert fresh.file is None
        assert recorded_study(fresh).problem.model.parameters[0].nominal == 0.9
        options = validation_options(fresh, replicates=100)
        assert validated(fresh, options, workers=1).data["validation"]["results"]

    @pytest.mark.slow
    def test_api(self, folder: Path):
        record = load_record(saved(folder))
        for use in (
            lambda: validated(record, validation_options(record, replicates=100)),
            lambda: next_drive(record, ["log.csv"]),
            lambda: export(folder, "ros2_yaml"),
        ):
            with pytest.raises(RecordError, match="trust=True"):
                use()
        assert recorded_study(record, trust=True).problem.model.input_names == ("wheel_speed", "spin")


class TestExportOfSomebodysRobot:
    @pytest.mark.slow
    def test_a_node_is_written_without_the_code(self, folder: Path):
        file = export(saved(folder), "ros2_node")
        assert not (folder / "was_run").exists()
        played, trusted = (
            np.array(ast.literal_eval(one.read_text().partition("\nRUNS = ")[2].partition("# fmt: on")[0]))
            for one in (file, export(folder, "ros2_node", trust=True, out=folder / "by_code.py"))
        )
        assert (folder / "was_run").exists()
        assert played == pytest.approx(trusted, abs=1e-7)

    # Each with each other once.
    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("rule", "sideways", "rate"),
        [("arc", 0.0, None), ("arc", 0.4, 6.0), ("midpoint", 0.4, None), ("midpoint", 0.0, 6.0)],
    )
    def test_the_record_says_what_the_code_would(
        self, folder: Path, rule: str, sideways: float, rate: float | None
    ):
        saved(folder, rule=rule, sideways=sideways)
        told = json.loads(export(folder, "json", rate=rate).read_text())
        assert not (folder / "was_run").exists()
        trusted = json.loads(
            export(folder, "json", rate=rate, trust=True, out=folder / "by_code").read_text()
        )
        assert (folder / "was_run").exists()
        (one,), (other,) = told.pop("runs"), trusted.pop("runs")
        assert told == trusted
        assert (one["t"], one["inputs"]) == (other["t"], other["inputs"])
        for part in ("twist", "poses"):
            assert one[part].keys() == other[part].keys()
            if rule == "arc" or rate is None:
                for name, values in one[part].items():
                    assert values == pytest.approx(other[part][name], abs=1e-6), name

    def test_an_older_record_does_not_name_its_inputs(self, folder: Path):
        saved(folder)
        data = json.loads((folder / "record.json").read_text())
        del data["inputs"]
        (folder / "record.json").write_text(json.dumps(data))
        with pytest.raises(RecordError, match="inputs: missing: an older record"):
            export(folder, "csv")

    def test_states_beyond_the_pose_have_names_in_any_case(self, folder: Path):
        data = made(study_in(folder)).data
        for pose in data["results"][0]["drive"]["poses"]:
            pose.append(0.5)
        data["results"][0]["drive"]["start"].append(0.5)
        del data["states"]
        (folder / "record.json").write_text(json.dumps(data))
        header, first, *_ = export(folder, "csv").read_text().splitlines()
        assert header == "t,wheel_speed,spin,v,omega,x,y,heading,state_4"
        assert first.endswith(",0.1,0.2,0.3,0.5")


class TestNames:
    def test_no_export_leaves_its_folder(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
        inner = tmp_path / "a" / "b"
        save_record(made(parse_study(SMALL.replace("samples: 40", "samples: 20"))), inner)
        data = json.loads((inner / "record.json").read_text())
        data["results"][0]["name"] = data["best"] = "../../evil"
        (inner / "record.json").write_text(json.dumps(data))
        assert main(["export", str(inner), "--to", "csv"]) == 2
        assert "results.0.name: expected a name that files can have, without /" in capsys.readouterr().err
        assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["record.json"]

    def test_nor_does_one_of_a_record_in_memory(self, tmp_path: Path):
        fresh = made(parse_study(SMALL))
        evil = fresh.results[0].model_copy(update={"name": "../evil"})
        changed = fresh.model_copy(update={"results": [evil]})
        request = Request(tmp_path, changed, "../evil", None, None, "sqlite3", force=False)
        with pytest.raises(UserMistake, match="expected a name"):
            request.path("commands.csv")

    def test_a_study_gives_no_such_name_either(self, tmp_path: Path):

        text = SMALL + "baselines: [{file: 'x/a\\b.csv'}]\n" if "baselines" not in SMALL else SMALL
        with pytest.raises(StudyError, match="a name that files can have"):
            parse_study(text)

    @pytest.mark.slow
    @pytest.mark.usefixtures("blank_figures")
    def test_a_report_writes_through_no_link(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
        save_record(made(parse_study(SMALL)), tmp_path / "own")
        (tmp_path / "elsewhere").mkdir()
        (tmp_path / "own" / "figures").symlink_to(tmp_path / "elsewhere")
        assert main(["report", str(tmp_path / "own")]) == 2
        assert "figures: a link that leads out of the folder" in capsys.readouterr().err
        assert not list((tmp_path / "elsewhere").iterdir())


class TestFiles:
    """A record has no file read that its reader does not know of."""

    @pytest.fixture
    def place(self, tmp_path: Path) -> Path:
        poses = SMALL.replace("displacements, segments: 4", "poses")
        save_record(made(parse_study(poses)), tmp_path / "own")
        (tmp_path / "logs").mkdir()
        (tmp_path / "logs" / "log.csv").write_text(
            "t,wheel_speed_right,wheel_speed_left\n0,1,1\n1,1,1\n2,0,0\n"
        )
        (tmp_path / "private.txt").write_text("private:1\nprivate:2\nprivate:3\n")
        (tmp_path / "logs" / "link.csv").symlink_to(tmp_path / "private.txt")
        return tmp_path

    def changed(self, place: Path, **study: Any) -> Path:
        data = json.loads((place / "own" / "record.json").read_text())
        data["study"].update(study)
        (place / "own" / "record.json").write_text(json.dumps(data))
        return place / "own"

    @pytest.mark.parametrize(
        "file", ["../private.txt", "{stem}/../../private.txt", "/etc/passwd", "link.csv"]
    )
    @pytest.mark.slow
    def test_poses_lie_beside_their_log(self, place: Path, capsys: pytest.CaptureFixture[str], file: str):
        self.changed(place, log={"kind": "csv", "poses": {"file": file, "form": "csv"}})
        command = ["next", str(place / "own"), str(place / "logs" / "log.csv"), "--quiet"]
        assert main(command) == 2
        said = capsys.readouterr().err
        assert "record.json: study.log.poses.file: leads to" in said
        assert "give --trust" in said
        assert main([*command, "--trust"]) == 2
        trusted = capsys.readouterr().err
        assert "study.log" not in trusted
        assert not [
            word for word in ("private:", "root:") if word in (said + trusted).replace(str(place), "")
        ]

    @pytest.mark.slow
    def test_poses_beside_their_log_are_read(self, place: Path, capsys: pytest.CaptureFixture[str]):
        (place / "logs" / "log.poses.csv").write_text("no poses\n")
        self.changed(place, log={"kind": "csv", "poses": {"file": "{stem}.poses.csv"}})
        assert main(["next", str(place / "own"), str(place / "logs" / "log.csv"), "--quiet"]) == 2
        assert capsys.readouterr().err.startswith(str(place / "logs" / "log.poses.csv"))

    @pytest.mark.slow
    def test_priors_are_numbers(self, place: Path, capsys: pytest.CaptureFixture[str]):
        os.mkfifo(place / "pipe")
        folder = self.changed(place, prior={"record": str(place / "pipe")})
        for command, *flags in COMMANDS:
            assert main([command, str(folder), *flags]) == 2, command
            said = capsys.readouterr().err
            assert "study.prior.record: would be read from " in said, command
            assert main([command, str(folder), *flags, "--trust"]) == 2, command
            assert "expected a file, got a pipe" in capsys.readouterr().err, command
