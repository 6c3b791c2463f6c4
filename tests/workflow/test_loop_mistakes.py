"""What is wrong with a loop is said before anything is designed, and leaves nothing behind."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from driven_robot import QUICKLY
from looping import STUDY

import oed
from oed.cli import main
from oed.foundation.errors import RecordError, UserMistake
from oed.records.record import load_loop
from oed.study.study import Study
from oed.workflow import rounds as module
from oed.workflow.loop import _digest
from oed.workflow.studies import parse_study


@pytest.fixture(scope="module")
def study() -> Study:
    return parse_study(STUDY)


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    (tmp_path / "logs").mkdir()
    return tmp_path / "logs"


class TestMistakes:
    """Each is said before anything is designed, and leaves nothing behind."""

    @pytest.fixture
    def file(self, tmp_path: Path) -> Path:
        (tmp_path / "study.yaml").write_text(STUDY)
        return tmp_path / "study.yaml"

    @pytest.mark.parametrize(
        ("flags", "said"),
        [
            (["--logs", "nowhere"], "nowhere: no such folder; logs are to come into it"),
            (["--logs", "study.yaml"], "study.yaml: no such folder"),
            (["--target", "wheelbase 1 mm"], "--target wheelbase: expected one of wheel_radius_right"),
            (["--target", "track 1 deg"], "--target track: expected"),
            (["--target", "track -1 mm"], "--target track: expected more than 0"),
            (["--export", "ros2_yaml"], "ros2_yaml is no drive"),
            (["--export", "dxf"], "expected a format of csv, json, rosbag2, ros2_node; got 'dxf'"),
            (["--command", "'drive"], "command: No closing quotation"),
            (["--command", ""], "command: expected a program"),
            (["--out", "study.yaml"], "study.yaml: cannot write there: it is a file"),
        ],
    )
    def test_one_line(self, file: Path, logs: Path, capsys, monkeypatch, flags: list[str], said: str):
        monkeypatch.chdir(file.parent)
        given = ["--logs", "logs", "--out", "out", *flags]
        before = sorted(file.parent.rglob("*"))
        assert main(["loop", "study.yaml", *given, "--quiet"]) == 2
        error = capsys.readouterr().err
        assert said in error
        assert len(error.splitlines()) == 1
        assert sorted(file.parent.rglob("*")) == before

    @pytest.mark.parametrize(
        ("flags", "log", "said"),
        [
            (["--export", "rosbag2"], "", "writing ROS 2 bags needs an extra"),
            ([], "log: {kind: rosbag}\n", "reading ROS bags needs an extra"),
        ],
    )
    def test_an_extra_that_is_missing(
        self, file: Path, logs: Path, capsys, monkeypatch, flags: list[str], log: str, said: str
    ):
        for part in ("highlevel", "rosbag2", "typesys"):
            monkeypatch.setitem(sys.modules, f"rosbags.{part}", None)
        file.write_text(STUDY + log)
        before = sorted(file.parent.rglob("*"))
        out = file.parent / "out"
        assert main(["loop", str(file), "--logs", str(logs), "--out", str(out), "--quiet", *flags]) == 2
        error = capsys.readouterr().err
        assert error.startswith(said)
        assert error.endswith(": pip install 'oed[ros]'\n")
        assert sorted(file.parent.rglob("*")) == before

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("flags", "said"),
        [
            (["--target", "track"], "expected PARAMETER SIZE"),
            (["--most", "0"], "expected a whole number of at least 1"),
            (["--least-gain", "1.5"], "expected a share from 0 to 1"),
            (["--settle", "-1 s"], "expected more than 0 seconds"),
            (["--duration", "3 m"], "--duration"),
        ],
    )
    def test_options(self, file: Path, capsys, flags: list[str], said: str):
        with pytest.raises(SystemExit) as ended:
            main(["loop", str(file), "--logs", str(file.parent), *flags])
        assert ended.value.code == 2
        assert said in capsys.readouterr().err

    def test_coefficients_have_no_nominal_values(self, logs):
        study = parse_study(f"{STUDY}estimate: [c11, c12, c21, c22]\n")
        with pytest.raises(UserMistake, match="estimates c11, c12"):
            oed.loop(study, logs, logs.parent / "out")

    @pytest.mark.parametrize(
        ("options", "said"),
        [({"most": 0}, "most drives"), ({"least_gain": 1.0}, "least gain"), ({"poll": 0.0}, "above 0 s")],
    )
    def test_in_python(self, study, logs, options: dict[str, float], said: str):
        with pytest.raises(UserMistake, match=said):
            oed.loop(study, logs, logs.parent / "out", **options)

    def a_loop(self, digest: str, out: Path, **changes: object) -> None:
        out.mkdir(exist_ok=True)
        kept = {"format": 1, "oed_version": "0", "name": "mine", "study": digest, "asked": {}}
        state = {"rounds": [], "seen": [], "reached": False, "finished": True, "reason": ""}
        (out / "loop.json").write_text(json.dumps({**kept, **state, **changes}))

    def test_another_study(self, study, logs, tmp_path):
        self.a_loop("0", tmp_path / "out")
        with pytest.raises(UserMistake, match=r"begun with another study \(mine\)"):
            oed.loop(study, logs, tmp_path / "out")

    def test_logs_may_be_read_otherwise(self, study, logs, tmp_path, monkeypatch):
        """What a user mends in the study in the middle of a loop."""
        self.a_loop(_digest(study), tmp_path / "out")
        mended = STUDY.replace(QUICKLY, "calibration: {method: joint}\n")
        other = parse_study(f"{mended}log: {{skip_invalid_rows: true}}\n")

        def designed(*_: object, **__: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr(module, "run", designed)
        assert oed.loop(other, logs, tmp_path / "out").interrupted

    def test_interrupted_before_anything_is_saved(self, logs, tmp_path, monkeypatch, capsys):
        """Nothing is there that `oed report` could make a page of."""
        (tmp_path / "study.yaml").write_text(STUDY)

        def designed(*_: object, **__: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr(module, "run", designed)
        given = ["--logs", str(logs), "--out", str(tmp_path / "out"), "--quiet"]
        assert main(["loop", str(tmp_path / "study.yaml"), *given]) == 1
        said = "interrupted: the first drive had not been designed by then; the same command begins anew\n"
        assert capsys.readouterr().err == said

    def test_two_at_once(self, study, logs, tmp_path, monkeypatch):
        seen = []

        def designed(*_: object, **__: object) -> None:
            with pytest.raises(UserMistake, match="is writing there") as found:
                oed.loop(study, logs, tmp_path / "out")
            seen.append(found)
            raise KeyboardInterrupt

        monkeypatch.setattr(module, "run", designed)
        assert oed.loop(study, logs, tmp_path / "out").interrupted
        assert seen

    def test_names_of_logs(self, study, logs, tmp_path):
        """Any that files have, and none that leads elsewhere."""
        rounds = [{"folder": "round1", "logs": ["-1.csv", "aux.csv", "a b.csv"], "known": []}]
        self.a_loop(_digest(study), tmp_path / "out", rounds=rounds)
        assert load_loop(tmp_path / "out").logs == rounds[0]["logs"]
        for name in ("../a.csv", "..", "", "a/b.csv", "a\\b.csv"):
            rounds[0]["logs"] = [name]
            self.a_loop(_digest(study), tmp_path / "out", rounds=rounds)
            with pytest.raises(RecordError, match=r"rounds\.0\.logs\.0: expected the name of a file"):
                load_loop(tmp_path / "out")

    @pytest.mark.parametrize("damage", ["{", '{"format": 1}', '{"format": 2}', "[]"])
    def test_a_damaged_file(self, study, logs, tmp_path, damage: str):
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "loop.json").write_text(damage)
        with pytest.raises(RecordError, match=r"loop\.json"):
            oed.loop(study, logs, tmp_path / "out")
        assert (tmp_path / "out" / "loop.json").read_text() == damage
