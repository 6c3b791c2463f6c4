"""The loop: designs, logs that come into a folder, estimates, until it is enough; by a simulated robot."""

from __future__ import annotations

import errno
import itertools
import json
import re
import shlex
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driven_robot import write_log
from looping import SOON, STUDY, TARGETS, TRUTH, Drive, Heard, robot, stopping_at

import oed
from oed.cli import main
from oed.foundation.errors import Failure, LogError, UserMistake
from oed.records.record import load_record
from oed.report import write_loop
from oed.study.study import Study
from oed.workflow import rounds as module
from oed.workflow.loop import Loop
from oed.workflow.studies import parse_study


@pytest.fixture(scope="module")
def study() -> Study:
    return parse_study(STUDY)


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    (tmp_path / "logs").mkdir()
    return tmp_path / "logs"


def contents(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "loop.json").read_text())


@pytest.fixture(scope="module")
def done(study: Study, tmp_path_factory: pytest.TempPathFactory) -> tuple[Loop, Path, Heard]:
    """A loop that has reached what is wanted, its logs, and what it said."""
    logs, heard = tmp_path_factory.mktemp("loop") / "logs", Heard()
    logs.mkdir()
    found = oed.loop(
        study,
        logs,
        logs.parent / "out",
        targets=TARGETS,
        command=robot(study),
        progress=heard,
        least_gain=0.0,
        **SOON,
    )
    return found, logs, heard


@pytest.mark.slow
class TestLoop:
    def test_reaches_what_is_wanted(self, done):
        found, logs, heard = done
        assert found.reached
        assert found.found.finished
        assert "as precise as wanted" in found.found.reason
        assert len(found.found.rounds) == len(list(logs.iterdir())) > 1
        last = found.found.driven[-1].known
        for one in last:
            assert one.now <= one.wanted
            assert abs(one.value - TRUTH[one.name]) < 4 * one.now
            assert one.value == found.estimate.values[one.name]
        assert contents(found.folder) == found.found.plain()
        assert any(line.startswith("Drive 1: ") for line in heard.said)
        assert any("track" in line and "wanted" in line for line in heard.said)

    def test_ended_it_does_nothing_more(self, study, done):
        found, logs, _ = done

        def never(*_: object) -> None:
            pytest.fail("nothing is left to drive")

        again = oed.loop(study, logs, found.folder, targets=TARGETS, command=never, least_gain=0.0, **SOON)
        assert again.found == found.found

    def test_with_more_wanted_it_goes_on(self, study, done, tmp_path):
        found, logs, _ = done
        finer = {"track": "0.9 %", "wheel_radius": "0.4 %"}
        again = oed.loop(
            study, logs, found.folder, targets=finer, command=robot(study), least_gain=0.0, **SOON
        )
        assert again.reached
        assert len(again.found.rounds) >= len(found.found.rounds)
        assert again.found.driven[-1].known[0].wanted < found.found.driven[-1].known[0].wanted

    def test_its_page(self, done, capsys, tmp_path):
        found, _, _ = done
        page = write_loop(found.found, tmp_path).read_text()
        assert "share of what is wanted" in page
        assert "wheel radius left" in page
        assert main(["report", str(found.folder.parent), "--out", str(tmp_path), "--json"]) == 0
        index = (tmp_path / "index.md").read_text()
        # Its rounds are no runs of their own, nor is its estimate.
        (row,) = (line for line in index.splitlines() if line.startswith("| A robot in a room"))
        assert "| loop |" in row
        capsys.readouterr()


@pytest.mark.slow
class TestGoingOn:
    def run(self, study: Study, logs: Path, command: Drive, **more: Any) -> Loop:
        targets = more.pop("targets", TARGETS)
        return oed.loop(
            study, logs, logs.parent / "out", targets=targets, command=command, least_gain=0.0, **SOON, **more
        )

    def test_interrupted_it_goes_on_to_the_same_end(self, study, logs, done):
        first = self.run(study, logs, stopping_at(2, robot(study)))
        assert first.interrupted
        assert not first.found.finished
        assert [one.driven for one in first.found.rounds] == [True, False]
        second = self.run(study, logs, robot(study))
        assert second.reached
        # As if nothing had happened: the same seed, the same designs, the same numbers.
        assert second.found.rounds == done[0].found.rounds

    def test_interrupted_in_the_search(self, study, logs, monkeypatch):
        def strike(*_: object, **__: object) -> None:
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr("oed.workflow.runner.solve", strike)
            found = self.run(study, logs, robot(study))
        assert found.interrupted
        assert found.found.rounds == []
        found = self.run(study, logs, stopping_at(1, robot(study)))
        assert [one.folder for one in found.found.rounds] == ["round1"]

    def test_the_log_of_a_drive_that_was_made_meanwhile(self, study, logs):
        self.run(study, logs, stopping_at(1, robot(study)))
        robot(study)(logs.parent / "out" / "round1" / "x.csv", logs)

        def never(*_: object) -> None:
            raise KeyboardInterrupt

        found = oed.loop(study, logs, logs.parent / "out", targets=dict.fromkeys(TRUTH, "50 %"), **SOON)
        assert found.reached
        assert found.found.logs == ["drive1.csv"]

    def test_logs_from_before_are_left_alone(self, study, logs):
        (logs / "old.csv").write_text("t,x\n")
        found = self.run(study, logs, robot(study), targets=dict.fromkeys(TRUTH, "50 %"))
        assert found.reached
        assert found.found.logs == ["drive2.csv"]

    def test_a_log_that_is_gone_is_driven_again(self, study, logs):
        coarse = dict.fromkeys(TRUTH, "50 %")
        self.run(study, logs, robot(study), targets=coarse)
        (logs / "drive1.csv").unlink()
        found = self.run(study, logs, robot(study, seed=1), targets=coarse)
        assert found.reached
        assert len(found.found.logs) == 1

    def test_another_drive_gains_too_little(self, study, logs):
        found = oed.loop(
            study, logs, logs.parent / "out", targets={"track": "1e-6 m"}, command=robot(study),
            least_gain=0.9, **SOON,
        )  # fmt: skip
        assert found.found.finished
        assert not found.reached
        assert "less than 90.0 %: stop" in found.found.reason

    def test_as_many_drives_as_are_allowed(self, study, logs):
        found = self.run(study, logs, robot(study), targets={"track": "1e-6 m"}, most=1)
        assert found.found.finished
        assert not found.reached
        assert "as many drives as are allowed (1)" in found.found.reason

    def test_a_page_that_cannot_be_written_names_the_command_with_its_folder_quoted(self, study, logs):
        def no_room(_: Path) -> None:
            raise OSError(errno.ENOSPC, "no room")

        out, heard = logs.parent / "my out; $(x)", Heard()
        oed.loop(
            study, logs, out, targets=dict.fromkeys(TRUTH, "50 %"), command=robot(study), written=no_room,
            progress=heard, **SOON,
        )  # fmt: skip
        command, *_ = re.findall(r"`(oed report [^`]*)`", "\n".join(heard.said))
        assert shlex.split(command) == ["oed", "report", str(out / "round1")]


@pytest.mark.slow
class TestLogs:
    """Each in a loop that one log is enough for."""

    def run(self, study: Study, logs: Path, **more: Any) -> tuple[Loop, Heard]:
        heard, coarse = Heard(), dict.fromkeys(TRUTH, "50 %")
        found = oed.loop(study, logs, logs.parent / "out", targets=coarse, progress=heard, **SOON, **more)
        return found, heard

    def test_one_that_cannot_be_read(self, study, logs):
        good, turns = robot(study), itertools.count(1)

        def drive(file: Path, logs: Path) -> None:
            if next(turns) == 1:
                (logs / "broken.csv").write_text("t,wheel_speed_right\n0,1\nx,2\n")
            else:
                good(file, logs)

        found, heard = self.run(study, logs, command=drive)
        assert found.reached
        assert found.found.logs == ["drive2.csv"]
        assert [one.name for one in found.found.seen] == ["broken.csv"]
        assert any("broken.csv is not used: waiting for another log" in line for line in heard.said)

    def test_nothing_but_those(self, study, logs):
        def drive(file: Path, logs: Path) -> None:
            (logs / f"broken{len(list(logs.iterdir()))}.csv").write_text("t\n0\n")

        with pytest.raises(Failure, match="3 times the command has left no log of a whole drive"):
            self.run(study, logs, command=drive)

    def test_one_of_a_part_of_the_drive(self, study, logs):
        good = robot(study)

        def drive(file: Path, logs: Path) -> None:
            good(file, logs)
            newest = max(logs.iterdir(), key=lambda one: one.stat().st_mtime_ns)
            if newest.name == "drive1.csv":
                newest.write_text("\n".join(newest.read_text().splitlines()[:20]) + "\n")

        found, heard = self.run(study, logs, command=drive)
        assert found.found.logs == ["drive1.csv", "drive2.csv"]
        assert any("of 20 s are there: waiting for the rest" in line for line in heard.said)

    def test_of_several_runs_all_are_waited_for(self, logs):
        study = parse_study(STUDY.replace("samples: 40", "samples: 40\n  runs: 2"))

        def drive(file: Path, logs: Path) -> None:
            number = len(list(logs.iterdir()))
            one = load_record(file.parent).best.drive.trajectory.each[number]
            rng = np.random.default_rng(number)
            write_log(logs / f"run{number + 1}.csv", study.problem, one, TRUTH, rng)

        found, heard = self.run(study, logs, command=drive)
        assert [one.logs for one in found.found.rounds] == [["run1.csv", "run2.csv"]]
        assert any("20 s of 40 s are there" in line for line in heard.said)

    def test_a_copy_of_an_earlier_one(self, study, logs):
        good, turns = robot(study), itertools.count(1)

        def drive(file: Path, logs: Path) -> None:
            if next(turns) == 2:
                (logs / "again.csv").write_bytes((logs / "drive1.csv").read_bytes())
            else:
                good(file, logs)

        heard, wanted = Heard(), dict.fromkeys(TRUTH, "0.001 %")
        keys = {**SOON, "targets": wanted, "progress": heard, "most": 2, "least_gain": 0.0}
        found = oed.loop(study, logs, logs.parent / "out", command=drive, **keys)
        assert found.found.logs == ["drive1.csv", "drive3.csv"]
        assert any("again.csv: is the same as drive1.csv to the byte" in line for line in heard.said)

    def test_only_those_that_are_wrong_are_dropped(self, study, logs):
        """Half a drive that is fine, and the rest of which no estimate can be made."""
        good, turns = robot(study), itertools.count(1)

        def drive(file: Path, logs: Path) -> None:
            turn = next(turns)
            if turn == 2:
                rows = [f"{0.5 * k},{2 + k % 3},{3 - k % 2},{1e-4 * (k % 2)},0,0" for k in range(41)]
                header = "t,wheel_speed_right,wheel_speed_left,x,y,heading"
                (logs / "standing.csv").write_text("\n".join([header, *rows]) + "\n")
                return
            good(file, logs)
            if turn == 1:
                (half,) = logs.iterdir()
                half.write_text("\n".join(half.read_text().splitlines()[:20]) + "\n")

        found, heard = self.run(study, logs, command=drive)
        assert found.found.logs == ["drive1.csv", "drive3.csv"]
        assert any("no estimate can be made with standing.csv" in line for line in heard.said)

    def test_one_that_is_moved_away_meanwhile(self, study, logs, monkeypatch):
        good, turns, estimated = robot(study), itertools.count(1), module.next_drive

        def refused(saved: Study, files: list[Path], **more: Any) -> object:
            if next(turns) > 1:
                return estimated(saved, files, **more)
            files[0].unlink()
            raise LogError.about(str(files[0]), "cannot be read: no such file")

        monkeypatch.setattr(module, "next_drive", refused)
        found, heard = self.run(study, logs, command=good)
        assert found.reached
        assert found.found.seen == []
        assert "no estimate can be made with drive1.csv: drive again" in heard.said

    def test_one_in_which_the_robot_stands(self, study, logs):
        good, turns = robot(study), itertools.count(1)

        def drive(file: Path, logs: Path) -> None:
            if next(turns) > 1:
                return good(file, logs)
            rows = [f"{0.5 * k},0,0,0,0,0" for k in range(41)]
            header = "t,wheel_speed_right,wheel_speed_left,x,y,heading"
            (logs / "standing.csv").write_text("\n".join([header, *rows]) + "\n")

        found, _ = self.run(study, logs, command=drive)
        assert found.found.logs == ["drive2.csv"]

    def test_one_that_somebody_writes(self, study, logs):
        """Slowly, and nobody calls a command."""
        out = logs.parent / "out"

        def write() -> None:
            deadline = time.monotonic() + 20
            while not (out / "loop.json").is_file() and time.monotonic() < deadline:
                time.sleep(0.01)
            robot(study)(out / "round1" / "x", out.parent)
            # As `robot` names it by what there is beside it.
            (whole,) = out.parent.glob("drive*.csv")
            text = whole.read_text()
            with (logs / "mine.csv").open("w") as handle:
                for part in (text[: len(text) // 2], text[len(text) // 2 :]):
                    handle.write(part)
                    handle.flush()
                    time.sleep(0.02)

        writer = threading.Thread(target=write)
        writer.start()
        found, heard = self.run(study, logs)
        writer.join()
        assert found.reached
        assert found.found.logs == ["mine.csv"]
        assert any("Ctrl-C ends, and the same command goes on" in line for line in heard.said)


@pytest.mark.slow
class TestCommand:
    """`--command`, in a process of its own."""

    @pytest.mark.usefixtures("blank_figures")
    def test_from_the_command_line(self, done, tmp_path: Path, logs: Path, capsys):
        (tmp_path / "study.yaml").write_text(STUDY)
        script, given = tmp_path / "drive.py", tmp_path / "given"
        # The same first drive as before, and the same log: a process that loads the package takes a second.
        script.write_text(
            "import pathlib, shutil, sys\n"
            "print('driving')\n"
            f"pathlib.Path({str(given)!r}).write_text('\\n'.join(sys.argv[1:]))\n"
            f"shutil.copy({str(done[1] / 'drive1.csv')!r}, sys.argv[2])\n"
        )
        command = f"{sys.executable} -S {script} {{drive}} {{logs}}"
        flags = ["--command", command, "--export", "ros2_node", "--workers", "1", "--quiet", "--json"]
        flags += ["--logs", str(logs), "--out", str(tmp_path / "out"), "--target", "track 50 %"]
        assert main(["loop", str(tmp_path / "study.yaml"), *flags]) == 0
        data = json.loads(capsys.readouterr().out)
        assert data["reached"]
        assert data["rounds"][0]["logs"] == ["drive1.csv"]
        file = tmp_path / "out" / "round1" / "genetic_drive.py"
        assert given.read_text().splitlines() == [str(file), str(logs)]
        assert file.is_file()
        designed, before = (load_record(one / "round1") for one in (tmp_path / "out", done[0].folder))
        assert designed.best.drive == before.best.drive
        assert (tmp_path / "out" / "report.html").is_file()
        assert (tmp_path / "out" / "estimate.html").is_file()

    @pytest.mark.parametrize(
        ("command", "kind", "said"),
        [
            ("false {drive}", Failure, "the command ended with exit code 1: false"),
            ("true", Failure, "the command has left no new log in"),
            ("no_such_program {logs}", UserMistake, "command: no_such_program: No such file"),
        ],
    )
    def test_that_fails(self, study, logs, command: str, kind: type[Exception], said: str):
        with pytest.raises(kind, match=said):
            oed.loop(study, logs, logs.parent / "out", command=command, **SOON)
        # The design is there: the same command goes on with it.
        assert contents(logs.parent / "out")["rounds"][0]["folder"] == "round1"
