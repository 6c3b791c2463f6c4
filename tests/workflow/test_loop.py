"""The loop: designs, logs that come into a folder, estimates, until it is enough; by a simulated robot."""

from __future__ import annotations

import itertools
import json
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driven_robot import ROOM_STUDY, write_log
from fake_ros import Ros, play

import oed
from oed.cli import main
from oed.foundation.errors import Failure, RecordError, UserMistake
from oed.records.record import load_loop, load_record
from oed.records.stored.loop import KnownParameter, LoopRound, StoredLoop
from oed.report import write_loop
from oed.study.study import Study
from oed.workflow import rounds as module
from oed.workflow.arrivals import LogFolder
from oed.workflow.loop import Loop, _digest
from oed.workflow.studies import parse_study

SEARCH = "solvers: [{kind: genetic, population: 20, generations: 3}]\n"
STUDY = f"{ROOM_STUDY}{SEARCH}"
TRUTH = {"wheel_radius_right": 0.0325, "wheel_radius_left": 0.0334, "track": 0.1635}
TARGETS = {"wheel_radius": "0.4 %", "track": "0.7 %"}
SOON = {"poll": 0.01, "settle": 0.03, "workers": 1}

Drive = Callable[[Path, Path], object]


class Heard:
    """A listener that keeps what is said."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def begin(self, description: str, total: int) -> None:
        self.said.append(description)

    def advance(self, note: str = "") -> None:
        """Not of interest."""

    def say(self, sentence: str) -> None:
        self.said.append(sentence)


@pytest.fixture(scope="module")
def study() -> Study:
    return parse_study(STUDY)


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    (tmp_path / "logs").mkdir()
    return tmp_path / "logs"


def robot(study: Study, seed: int = 0, truth: dict[str, float] = TRUTH) -> Drive:
    """What drives the design beside a file, and logs it; other errors each time, the same for a seed."""

    def drive(file: Path, logs: Path) -> None:
        number = len(list(logs.iterdir())) + 1
        trajectory = load_record(file.parent).best.drive.trajectory
        rng = np.random.default_rng([seed, number])
        write_log(logs / f"drive{number}.csv", study.problem, trajectory, truth, rng)

    return drive


def stopping_at(number: int, drive: Drive) -> Drive:
    """The same, that is interrupted instead of driving for the n-th time."""
    turns = itertools.count(1)

    def drive_or_stop(file: Path, logs: Path) -> None:
        if next(turns) == number:
            raise KeyboardInterrupt
        drive(file, logs)

    return drive_or_stop


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
        finer = {"track": "0.7 %", "wheel_radius": "0.35 %"}
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


def rounds_of(count: int, wanted: float | None, **changes: Any) -> StoredLoop:
    known = {"name": "track", "unit": "m", "value": 0.16, "size": 0.16, "wanted": wanted}
    rounds = [
        LoopRound(
            folder=f"round{n}",
            logs=[f"{n}.csv"],
            known=[KnownParameter(**known, now=1e-3 / n, next=1e-3 / (n + 1))],
        )
        for n in range(1, count + 1)
    ]
    state = {"seen": [], "reached": False, "finished": False, "reason": "drive it"} | changes
    return StoredLoop(format=1, oed_version="0", name="Mine", study="0", asked={}, rounds=rounds, **state)


@pytest.mark.slow
class TestPage:
    """Of a single parameter: its own unit."""

    @pytest.mark.parametrize(
        ("loop", "title"),
        [
            (rounds_of(2, 1e-4), "## After 2 drives; the next one is to be driven"),
            (rounds_of(1, 1e-4, finished=True), "## Ended after 1 drive, short of what is wanted"),
            (rounds_of(2, None, finished=True), "## Ended after 2 drives"),
            (rounds_of(2, 1e-2, finished=True, reached=True), "## Enough after 2 drives"),
            (rounds_of(0, None), "## The first drive is to be driven"),
        ],
    )
    def test_says_how_it_stands(self, tmp_path: Path, loop: StoredLoop, title: str):
        write_loop(loop, tmp_path)
        page = (tmp_path / "report.md").read_text()
        assert title in page.splitlines()
        wanted = any(one.wanted for each in loop.rounds for one in each.known)
        assert ("| wanted |" in page) == wanted
        assert (tmp_path / "figures" / "precision.svg").exists() == (len(loop.rounds) > 1)


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
        assert any("broken.csv cannot be read: waiting for another log" in line for line in heard.said)

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


class TestFolder:
    def folder(self, logs: Path, text: str = "", pattern: str | None = None) -> LogFolder:
        return LogFolder(logs, parse_study(f"{ROOM_STUDY}{SEARCH}{text}").log, pattern)

    def test_what_may_be_a_log(self, logs):
        for name in ("a.csv", "b.txt", ".hidden", "c.csv.part", "d.csv~", "empty.csv"):
            (logs / name).write_text("" if name == "empty.csv" else "x")
        (logs / "bag").mkdir()
        assert list(self.folder(logs).found()) == ["a.csv", "b.txt"]
        assert list(self.folder(logs, pattern="*.csv").found()) == ["a.csv"]

    def test_poses_beside_a_log_are_part_of_it(self, logs):
        log = "log: {poses: {file: '{stem}_poses.csv'}}\n"
        (logs / "a.csv").write_text("x")
        before = self.folder(logs, log).found()
        (logs / "a_poses.csv").write_text("x")
        after = self.folder(logs, log).found()
        assert list(after) == ["a.csv"]
        assert before != after

    def test_bags_are_complete_with_their_metadata(self, logs):
        log = "log: {kind: rosbag}\n"
        (logs / "bag").mkdir()
        (logs / "bag" / "bag_0.mcap").write_text("x")
        (logs / "other.csv").write_text("x")
        assert self.folder(logs, log).found() == {}
        (logs / "bag" / "metadata.yaml").write_text("x")
        assert list(self.folder(logs, log).found()) == ["bag"]

    def test_one_that_still_grows_is_waited_for(self, logs, monkeypatch):
        file, looks, now = logs / "a.csv", itertools.count(), [0.0]
        (logs / "known.csv").write_text("x")
        known = self.folder(logs).found()

        def pause(seconds: float) -> None:
            now[0] += seconds
            if next(looks) < 5:
                file.write_text("x" * int(now[0] + 1))

        monkeypatch.setattr("oed.workflow.arrivals.time.sleep", pause)
        monkeypatch.setattr("oed.workflow.arrivals.time.monotonic", lambda: now[0])
        found = self.folder(logs).complete(known, 1.0, 3.0)
        assert [(name, size) for name, (size, _) in found.items()] == [("a.csv", 6)]
        assert now[0] == pytest.approx(8.0, abs=1.1)


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
        ("flags", "said"),
        [
            (["--target", "track"], "expected PARAMETER SIZE"),
            (["--most", "0"], "expected a whole number from 1 on"),
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
        other = parse_study(f"{STUDY}log: {{skip_invalid_rows: true}}\ncalibration: {{method: joint}}\n")

        def designed(*_: object, **__: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr(module, "run", designed)
        assert oed.loop(other, logs, tmp_path / "out").interrupted

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


def recorded(bag: Path, times: np.ndarray, wheels: np.ndarray, poses: np.ndarray) -> None:
    """Write what a robot's joints and a tracker say, as the recorder does: the metadata last."""
    library, typesys = pytest.importorskip("rosbags.rosbag2"), pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds = {"/joint_states": "sensor_msgs/msg/JointState", "/mocap": "geometry_msgs/msg/PoseStamped"}

    def make(kind: str, *values: Any) -> Any:
        return store.types[kind](*values)

    with library.Writer(bag, version=8) as writer:
        topics = {name: writer.add_connection(name, kind, typestore=store) for name, kind in kinds.items()}
        for time_, speeds, (x, y, heading) in zip(times, wheels, poses, strict=True):
            stamp = round(time_ * 1e9)
            header = make(
                "std_msgs/msg/Header", make("builtin_interfaces/msg/Time", *divmod(stamp, 10**9)), "odom"
            )
            turn = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2))
            pose = make("geometry_msgs/msg/Pose", make("geometry_msgs/msg/Point", x, y, 0.0), turn)
            names = ["right_wheel_joint", "left_wheel_joint"]
            messages = {
                "/joint_states": (header, names, np.zeros(0), np.asarray(speeds), np.zeros(0)),
                "/mocap": (header, pose),
            }
            for topic, parts in messages.items():
                data = store.serialize_cdr(make(kinds[topic], *parts), kinds[topic])
                writer.write(topics[topic], stamp, data)


@pytest.mark.slow
def test_drives_that_their_nodes_play(logs: Path, monkeypatch: pytest.MonkeyPatch):
    """The file for ROS commands a controller that knows nominal radii and track; the robot has others. What
    is recorded where the file says is the log.
    """
    held = "inputs: {wheel_speed_right: {held: next}, wheel_speed_left: {held: next}}"
    study = parse_study(f"{STUDY}log: {{kind: rosbag, poses: /mocap, {held}}}\n")
    rng, recorders = np.random.default_rng(5), []

    def drive(file: Path, logs: Path) -> None:
        ros = Ros()
        assert play(file, "--yes", "--out", str(logs), ros=ros, patch=monkeypatch) == 0
        sent = np.array([(at, one.twist.linear.x, one.twist.angular.z) for at, one in ros.sent])
        sent = sent[np.diff(sent[:, 0], append=np.inf) > 0]
        wheels = sent[:, 1:] @ np.array([[1, 1], [0.08, -0.08]]) / 0.033
        right, left = wheels.T * [[TRUTH["wheel_radius_right"]], [TRUTH["wheel_radius_left"]]]
        steps = np.diff(sent[:, 0], append=sent[-1, 0])
        turns = steps * (right - left) / TRUTH["track"]
        headings = np.cumsum(turns) - turns
        along = (
            steps * (right + left) / 2 * np.sinc(turns / (2 * np.pi)) * np.exp(1j * (headings + turns / 2))
        )
        places = np.cumsum(along) - along
        poses = np.column_stack([places.real, places.imag, headings])
        poses += rng.normal(size=poses.shape) * [0.01, 0.01, 0.0175]
        (recorder,) = ros.recorders
        recorders.append(recorder)
        recorded(Path(recorder.command[4]), sent[:, 0], wheels, poses)

    out, more = logs.parent / "out", {"to": "ros2_node", "least_gain": 0.0}
    found = oed.loop(study, logs, out, targets=TARGETS, command=drive, **more, **SOON)
    assert found.reached
    assert recorders[0].command[-1] == "^(/cmd_vel|/joint_states|/mocap)$"
    for one in found.found.driven[-1].known:
        assert abs(one.value - TRUTH[one.name]) < 4 * one.now


@pytest.mark.slow
class TestCommand:
    """`--command`, in a process of its own."""

    def test_from_the_command_line(self, tmp_path: Path, logs: Path, capsys):
        (tmp_path / "study.yaml").write_text(STUDY)
        script = tmp_path / "drive.py"
        tests = Path(__file__).parent
        script.write_text(
            f"import sys; sys.path[:0] = {[str(tests), str(tests.parent)]!r}\n"
            "from pathlib import Path\n"
            "import test_loop as t\n"
            "print('driving')\n"
            "t.robot(t.parse_study(t.STUDY))(Path(sys.argv[1]), Path(sys.argv[2]))\n"
        )
        command = f"{sys.executable} {script} {{drive}} {{logs}}"
        flags = ["--command", command, "--export", "ros2_node", "--workers", "1", "--quiet", "--json"]
        flags += ["--logs", str(logs), "--out", str(tmp_path / "out"), "--target", "track 50 %"]
        assert main(["loop", str(tmp_path / "study.yaml"), *flags]) == 0
        data = json.loads(capsys.readouterr().out)
        assert data["reached"]
        assert data["rounds"][0]["logs"] == ["drive1.csv"]
        assert (tmp_path / "out" / "round1" / "genetic_drive.py").is_file()
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
