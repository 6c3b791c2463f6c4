"""The node that plays a drive, run with a fake of rclpy: what it sends, when it stops, what it records."""

from __future__ import annotations

import ast
import json
import signal
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import fake_ros
import numpy as np
import pytest
from export_records import DIFFERENTIAL, MECANUM, STEERED, TRICYCLE, entry, saved, study_of, winding
from fake_ros import Ros, play

from oed.cli import main
from oed.exporters import MESSAGES, export
from oed.foundation.errors import RecordError, UserMistake
from oed.study.study import Study
from oed.workflow.studies import parse_study

ACCELERATION = "wheel_acceleration: 20 rad/s^2"
ROBOTS = {"differential": (DIFFERENTIAL, ""), "mecanum": (MECANUM, ""), "tricycle": (TRICYCLE, STEERED)}
FITTING = [
    (robot, message)
    for robot in ROBOTS
    for message in MESSAGES
    if (message == "ackermann") <= (robot == "tricycle")
    and (message in ("joint_state", "float64_array")) <= (robot != "tricycle")
]
QUIET = ("--yes", "--no-record")


def from_rest(robot: str = DIFFERENTIAL, limits: str = ACCELERATION) -> Study:
    """A study whose drives begin and end at rest."""
    study = study_of(robot, limits)
    text = study.text.replace("rest_to_rest: false", "rest_to_rest: true").replace(
        "samples: 8", "samples: 20"
    )
    return parse_study(text.replace("coefficients: 4", "coefficients: 8").replace("degree: 1", "degree: 3"))


def resting(folder: Path, study: Study) -> Path:
    """A record of a drive that begins and ends at rest."""
    drive = winding(study)
    coefficients = np.random.default_rng(2).uniform(-4, 4, (8, 2))
    coefficients[[0, -1]] = 0.0
    knots = [0, 0, 0, *np.linspace(0, drive.duration, 6), *[drive.duration] * 3]
    smooth = replace(drive, knots=np.array(knots, float), degree=3, coefficients=coefficients)
    return saved(folder, study, [entry("my drive", smooth)])


@pytest.fixture
def ros() -> Ros:
    return Ros()


@pytest.fixture
def run(ros: Ros, monkeypatch: pytest.MonkeyPatch):
    return lambda file, *arguments: play(file, *arguments, ros=ros, patch=monkeypatch)


def twists(ros: Ros) -> np.ndarray:
    """Time, forward speed and yaw rate of each command."""
    return np.array([(time, one.twist.linear.x, one.twist.angular.z) for time, one in ros.sent])


def driven(table: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Where held twists lead: exact arcs, written independently of the package; (K, 3)."""
    x, y, heading = start
    poses = [(x, y, heading)]
    for (time, speed, rate), (later, *_) in pairwise(table):
        after = heading + rate * (later - time)
        if abs(rate) > 1e-12:
            x += speed / rate * (np.sin(after) - np.sin(heading))
            y -= speed / rate * (np.cos(after) - np.cos(heading))
        else:
            x, y = x + speed * (later - time) * np.cos(heading), y + speed * (later - time) * np.sin(heading)
        heading = after
        poses.append((x, y, heading))
    return np.array(poses)


def design_poses(folder: Path) -> np.ndarray:
    rows = np.genfromtxt(export(folder, "csv", out=folder / "poses.csv"), delimiter=",", names=True)
    return np.column_stack([rows[name] for name in ("x", "y", "heading")])


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The node of a drive that neither begins nor ends at rest."""
    return export(saved(tmp_path_factory.mktemp("plain"), study_of()), "ros2_node")


@pytest.fixture(scope="module")
def smooth(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That of one that begins and ends at rest."""
    return export(resting(tmp_path_factory.mktemp("smooth"), from_rest()), "ros2_node")


class TestFile:
    @pytest.mark.slow
    def test_is_clean(self, tmp_path: Path):
        for robot in ROBOTS:
            folder = saved(tmp_path / robot, study_of(*ROBOTS[robot]))
            for message in [one for name, one in FITTING if name == robot]:
                file = export(folder, "ros2_node", message=message, out=tmp_path / f"{robot}_{message}.py")
                ast.parse(file.read_text(), feature_version=(3, 10))
        settings = Path(__file__).parents[2] / "pyproject.toml"
        files = [str(one) for one in tmp_path.glob("*.py")]
        assert len(files) == len(FITTING)
        # It runs by itself, beside no package, and begins a program that is asked for by name.
        checks = [
            ["check", "--target-version", "py310", "--ignore", "INP,S603,S607", "--config", str(settings)],
            ["format", "--check", "--diff", "--isolated", "--line-length", "110"],
        ]
        for check in checks:
            done = subprocess.run(
                [sys.executable, "-m", "ruff", *check, *files], capture_output=True, text=True
            )
            assert done.returncode == 0, done.stdout + done.stderr

    def test_says_what_is_driven(self, smooth: Path):
        text = " ".join((ast.get_docstring(ast.parse(smooth.read_text())) or "").split())
        assert "plays the drive my drive of the study Out to the robot" in text
        assert "differential_drive" in text
        assert "1 run of 2.00 s" in text
        poses = design_poses(smooth.parent)
        assert f"x from {poses[:, 0].min():.2f} m to {poses[:, 0].max():.2f} m" in text
        assert "Ramps" not in text

    @pytest.mark.slow
    def test_the_hash_is_the_designs(self, tmp_path: Path):
        def digest(folder: str, study: Study) -> str:
            text = export(saved(tmp_path / folder, study), "ros2_node", rate=30).read_text()
            return next(line for line in text.splitlines() if line.startswith("DESIGN = "))

        assert digest("a", study_of()) == digest("b", study_of())
        assert digest("a", study_of()) != digest("c", study_of(MECANUM))

    @pytest.mark.slow
    def test_names_are_no_code(self, tmp_path: Path, plain: Path):
        folder = saved(tmp_path, study_of())
        data = json.loads((folder / "record.json").read_text())
        data["study"]["name"] = 'x"""\nimport os\nos.abort()\n"""\\'
        data["provenance"]["study"] = '"+exit()+"'
        (folder / "record.json").write_text(json.dumps(data))
        tree, other = (ast.parse(one.read_text()) for one in (export(folder, "ros2_node"), plain))
        assert [type(one) for one in tree.body] == [type(one) for one in other.body]
        assert "import os" not in [ast.unparse(one) for one in tree.body]

    def test_topics_are_those_that_the_study_reads(self, tmp_path: Path, run, ros: Ros, capsys):
        log = "log: {kind: rosbag, joint_states: /wheels, poses: /mocap}\n"
        study = parse_study(study_of().text + log)
        assert run(export(saved(tmp_path, study), "ros2_node"), "--yes") == 0
        (recorder,) = ros.recorders
        assert recorder.command[:4] == ["ros2", "bag", "record", "--output"]
        assert recorder.command[-1] == "^(/cmd_vel|/mocap|/wheels)$"
        assert recorder.signals == [signal.SIGINT]
        assert capsys.readouterr().out.splitlines()[-1].startswith("oed estimate STUDY.yaml my_drive_")


class TestPlaying:
    def test_commands_lead_along_the_design(self, smooth: Path, run, ros: Ros):
        assert run(smooth, *QUIET, "--rate", "50") == 0
        poses = design_poses(smooth.parent)
        found = driven(twists(ros), poses[0])
        assert found[-1] == pytest.approx(poses[-1], abs=1e-6)
        moving = np.flatnonzero(twists(ros)[:, 1])
        # Every fifth command begins a period of the design.
        assert found[moving[0] :: 5][: len(poses)] == pytest.approx(poses, abs=1e-6)
        assert np.diff(twists(ros)[moving, 0]) == pytest.approx(np.full(len(moving) - 1, 0.02))

    @pytest.mark.parametrize("scale", [0.5, 0.3])
    def test_slower_along_the_same_path(self, smooth: Path, run, ros: Ros, scale: float):
        assert run(smooth, *QUIET, "--scale", str(scale)) == 0
        table, poses = twists(ros), design_poses(smooth.parent)
        assert driven(table, poses[0])[-1] == pytest.approx(poses[-1], abs=1e-6)
        moving = table[np.flatnonzero(table[:, 1]), 0]
        assert moving[-1] - moving[0] == pytest.approx(2.0 / scale, abs=0.06)
        assert np.diff(moving).max() <= 1 / 20 + 1e-9

    def test_ramps_where_a_drive_does_not_begin_at_rest(self, tmp_path: Path, run, ros: Ros):
        folder = saved(tmp_path, study_of(DIFFERENTIAL, "wheel_acceleration: 4 rad/s^2"))
        file = export(folder, "ros2_node")
        assert run(file, *QUIET) == 0
        module, poses = sys.modules["played"], design_poses(folder)
        x, y, heading = module.STARTS[0]
        found = driven(twists(ros), np.array([x, y, np.radians(heading)]))
        # On its way it passes the design's start as the design does, and goes on to where it stops.
        near = np.abs(found - poses[0]).max(axis=1).argmin()
        assert found[near] == pytest.approx(poses[0], abs=3e-4)
        per_row = 5
        rows = found[near::per_row][: len(poses)]
        assert rows == pytest.approx(poses[:, :], abs=3e-4)
        assert "Ramps" in module.__doc__
        table = twists(ros)
        wheels = table[:, 1:] @ np.linalg.inv([[0.0255, 0.255], [0.0245, -0.245]])
        own = winding(study_of()).inputs
        first, last = np.flatnonzero(wheels.any(axis=1))[[0, -1]]
        start = round((near - first) / per_row)
        led = np.vstack([[0, 0], wheels[first : last + 1 : per_row][: start + 1]])
        assert np.abs(np.diff(led, axis=0)).max() <= 4 * 0.25 * (1 + 1e-6)
        assert led[-1] == pytest.approx(own[0])

    def test_wheels_are_steered_before_they_roll(self, tmp_path: Path, run, ros: Ros):
        folder = saved(tmp_path, study_of(TRICYCLE, f"{STEERED}\n  steering_rate: 10 deg/s"))
        file = export(folder, "ros2_node")
        assert run(file, *QUIET, "--repeat", "2") == 0
        half = len(ros.sent) // 2
        table = np.array([(one.drive.speed, one.drive.steering_angle) for _, one in ros.sent])
        assert table[half:] == pytest.approx(table[:half])
        table = table[:half]
        rolling = np.flatnonzero(table[:, 0])[0]
        first = winding(study_of(TRICYCLE, STEERED)).inputs[0, 1]
        assert table[rolling - 1] == pytest.approx([0.0, first])
        assert np.abs(np.diff(table[:rolling, 1])).max() <= np.radians(10) * 0.25 * (1 + 1e-6)
        # From straight ahead, whatever was before.
        assert table[0, 1] == 0.0
        # Steered wheels stay where they are when the robot stands.
        assert table[-1, 0] == 0.0
        assert table[-1, 1] != 0.0

    @pytest.mark.parametrize("message", ["joint_state", "float64_array"])
    def test_wheels_turn_by_the_designs_angles(self, tmp_path: Path, run, ros: Ros, message: str):
        study = study_of(MECANUM, "wheel_acceleration: 100 rad/s^2")
        assert run(export(saved(tmp_path, study), "ros2_node", message=message), *QUIET) == 0
        name = {"joint_state": "velocity", "float64_array": "data"}[message]
        times = np.array([time for time, _ in ros.sent])
        speeds = np.array([getattr(one, name) for _, one in ros.sent])
        turned = np.diff(times) @ speeds[:-1]
        assert turned == pytest.approx(winding(study).inputs.sum(axis=0) * 0.25, abs=1e-6)
        if message == "joint_state":
            assert ros.sent[0][1].name[0] == "wheel_front_left_joint"

    def test_runs_one_by_one_and_again(self, tmp_path: Path, run, ros: Ros, capsys):
        file = export(saved(tmp_path, study_of(runs=2)), "ros2_node")
        assert run(file, "--repeat", "2") == 0
        assert len(ros.asked) == len(ros.recorders) == 4
        said = capsys.readouterr().out
        assert "run 2, 2 of 2: put the robot at" in said
        assert said.splitlines()[-2].count("_run") == 4
        assert run(file, "--run", "2", *QUIET) == 0
        assert len(ros.asked) == 4

    def test_dry_run_commands_nothing(self, plain: Path, run, ros: Ros, capsys):
        assert run(plain, "--dry-run", "--scale", "0.5") == 0
        assert (ros.sent, ros.recorders, ros.initialised) == ([], [], 0)
        said = capsys.readouterr().out
        assert "ros2 bag record" in said
        assert "at 0.5 of its speed" in said

    def test_robots_that_leave_are_told_of_first(self, tmp_path: Path, run, capsys):
        folder = saved(tmp_path, study_of())
        data = json.loads((folder / "record.json").read_text())
        track = {"name": "track", "unit": "m", "nominal": 0.2, "low": 0.19, "high": 0.21, "uniform": True}
        entry = {"name": "my drive", "share": 0.43, "interval": [0.4, 0.46], "distance": 0.04}
        known = {"usual": False, "robust": False, "limits": ["workspace"], "draws": 1000, "seed": 0}
        data["departures"] = {**known, "uncertain": [track], "results": [entry]}
        (folder / "record.json").write_text(json.dumps(data))
        assert run(export(folder, "ros2_node"), "--dry-run") == 0
        said = capsys.readouterr().out
        assert said.startswith("Warning: 43 % of 1,000 robots with track ±5 % leave the workspace")
        exported = json.loads(export(folder, "json").read_text())["departures"]
        assert (exported["share"], exported["distance"], exported["name"]) == (0.43, 0.04, "my drive")

    def test_options_of_ros_are_ros(self, plain: Path, run):
        assert run(plain, *QUIET, "--ros-args", "-p", "use_sim_time:=true") == 0

    def test_there_is_no_recorder(self, run, plain: Path, capsys, monkeypatch):
        def missing(*_: object, **__: object) -> None:
            raise FileNotFoundError(2, "No such file or directory", "ros2")

        monkeypatch.setattr(fake_ros.Recorder, "__init__", missing)
        assert run(plain, "--yes") == 1
        said = capsys.readouterr().err
        assert "given up: nothing can be recorded" in said
        assert "--no-record does without" in said


class TestStopping:
    """Whatever happens, the last command is to stand still."""

    @pytest.fixture
    def file(self, smooth: Path) -> Path:
        return smooth

    @pytest.fixture(autouse=True)
    def ends_at_rest(self, ros: Ros):
        yield
        assert twists(ros)[-1, 1:].tolist() == [0.0, 0.0]
        assert ros.initialised == 0
        assert all(one.signals == [signal.SIGINT] for one in ros.recorders)

    def stopped(self, ros: Ros, since: float) -> np.ndarray:
        """What was sent from a time on."""
        table = twists(ros)
        return table[table[:, 0] >= since]

    def test_interrupted(self, run, ros: Ros, file: Path, capsys):
        def strike() -> None:
            raise KeyboardInterrupt

        ros.events.append((102.0, strike))
        assert run(file, "--yes") == 1
        assert "interrupted" in capsys.readouterr().err
        table = self.stopped(ros, 101.9)
        wheels = table[:, 1:] @ np.linalg.inv([[0.0255, 0.255], [0.0245, -0.245]])
        assert np.abs(wheels[0]).max() > 0.5
        # No wheel brakes harder than the study allows.
        assert np.abs(np.diff(wheels, axis=0)).max() <= 20 * 0.05 * (1 + 1e-6)
        assert len(ros.recorders) == 1

    @pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
    def test_ended_or_cut_off(self, run, ros: Ros, file: Path, capsys, number: int):
        ros.events.append((102.0, lambda: ros.handlers[number](number, None)))
        assert run(file, *QUIET) == 1
        assert "interrupted" in capsys.readouterr().err

    def test_interrupted_again_it_stops_at_once(self, run, ros: Ros, file: Path):
        def strike() -> None:
            raise KeyboardInterrupt

        ros.events += [(102.0, strike), (102.08, strike)]
        assert run(file, *QUIET) == 1
        assert ros.now < 102.3

    def test_the_timer_falls_behind(self, run, ros: Ros, file: Path, capsys):
        ros.stall = (102.0, 0.6)
        assert run(file, *QUIET) == 1
        assert "s late" in capsys.readouterr().err
        assert len(self.stopped(ros, 103.5)) == 0

    def test_a_short_delay_is_made_up_for(self, run, ros: Ros, file: Path):
        ros.stall = (102.0, 0.12)
        assert run(file, *QUIET) == 0
        moving = twists(ros)[np.flatnonzero(twists(ros)[:, 1]), 0]
        assert moving[-1] - moving[0] == pytest.approx(2.0, abs=0.11)

    @pytest.mark.parametrize("simulated", [False, True])
    def test_the_clock_is_set_back(self, run, ros: Ros, file: Path, capsys, simulated: bool):
        """No timer comes for an hour, and the last command holds; or the drive begins anew."""
        ros.events.append((102.0, lambda: ros.set_back(3600.0, simulated=simulated)))
        assert run(file, *QUIET) == 1
        assert "given up: the clock went back by 3" in capsys.readouterr().err
        assert len(self.stopped(ros, 103.5)) == 0

    def test_the_clock_is_set_back_a_little_as_a_drive_begins(self, run, ros: Ros, file: Path):
        """No row from the drive's end is sent."""
        assert run(file, *QUIET) == 0
        table = twists(ros)
        began = table[np.flatnonzero(table[:, 1])[0]]
        passed = ros.now - 100.0
        ros.sent.clear()
        ros.events.append((began[0] + passed + 0.02, lambda: ros.set_back(0.2, simulated=True)))
        assert run(file, *QUIET) == 0
        again = twists(ros)
        first = np.flatnonzero(again[:, 1])[0]
        np.testing.assert_allclose(again[first : first + 4, 1:], np.tile(began[1:], (4, 1)))

    @pytest.mark.slow
    @pytest.mark.parametrize("rate", ["4", "2"])
    def test_commands_as_seldom_as_asked_for_are_not_late(self, run, ros: Ros, file: Path, rate: str):
        assert run(file, *QUIET, "--scale", "0.01", "--rate", rate) == 0

    def test_feedback_stops(self, run, ros: Ros, file: Path, capsys):
        ros.events.append((102.0, lambda: setattr(ros, "hearing", False)))
        assert run(file, *QUIET, "--feedback", "/odom") == 1
        assert "nothing came on /odom for 0.5 s" in capsys.readouterr().err

    def test_feedback_arrives(self, run, file: Path):
        assert run(file, *QUIET, "--feedback", "/odom") == 0

    def test_feedback_is_waited_for_before_every_run(self, run, ros: Ros, file: Path, capsys):
        """However long somebody thinks before Enter."""
        ros.events.append((104.0, lambda: setattr(ros, "hearing", False)))
        assert run(file, *QUIET, "--feedback", "/odom", "--repeat", "2") == 1
        assert "nothing comes on /odom" in capsys.readouterr().err

    def test_the_recorder_ends(self, run, ros: Ros, file: Path, capsys):
        ros.events.append((102.0, lambda: setattr(ros.recorders[0], "code", 1)))
        assert run(file, "--yes") == 1
        assert "the recorder has ended" in capsys.readouterr().err

    @pytest.mark.parametrize("moment", [100.5, 103.5])
    def test_the_recorder_ends_while_the_robot_rests(self, run, ros: Ros, file: Path, capsys, moment: float):
        ros.events.append((moment, lambda: setattr(ros.recorders[0], "code", 1)))
        assert run(file, "--yes") == 1
        said = capsys.readouterr()
        assert "given up: the recorder has ended" in said.err
        # Its bag lacks how the robot stopped, or all of the drive.
        assert "oed estimate" not in said.out

    def test_the_recorder_does_not_end(self, run, ros: Ros, file: Path, capsys):
        ros.events.append((102.0, lambda: setattr(ros.recorders[0], "ends", False)))
        assert run(file, "--yes") == 1
        said = capsys.readouterr()
        assert "given up: the recorder did not end" in said.err
        assert "oed estimate" not in said.out
        assert ros.recorders[0].code == -9

    def test_what_ended_a_drive_is_said_whatever_the_recorder_does(self, run, ros: Ros, file: Path, capsys):
        ros.stall = (102.0, 0.6)
        ros.events.append((102.0, lambda: setattr(ros.recorders[0], "ends", False)))
        assert run(file, "--yes") == 1
        assert "s late" in capsys.readouterr().err

    def test_an_error(self, run, ros: Ros, file: Path):
        def fail() -> None:
            raise RuntimeError("no memory")

        ros.events.append((102.0, fail))
        with pytest.raises(RuntimeError, match="no memory"):
            run(file, *QUIET)


class TestMistakes:
    """Of who plays it: nothing is commanded."""

    @pytest.mark.parametrize(
        ("arguments", "said"),
        [
            (["--scale", "1.5"], "at most 1"),
            (["--scale", "0"], "more than 0"),
            (["--rate", "0"], "at most 1000 Hz"),
            (["--rate", "1e9"], "at most 1000 Hz"),
            (["--run", "2"], "expected 1 to 1"),
            (["--repeat", "0"], "expected 1 or more"),
            (["--silence", "nan"], "more than 0"),
            (["--late", "-1"], "more than 0"),
            (["--sale", "1"], "unrecognized arguments"),
        ],
    )
    def test_options(self, plain: Path, run, ros: Ros, capsys, arguments: list[str], said: str):
        with pytest.raises(SystemExit) as ended:
            run(plain, *arguments)
        assert ended.value.code == 2
        assert said in capsys.readouterr().err
        assert ros.sent == []

    @pytest.mark.parametrize(
        ("arguments", "change", "said"),
        [
            ([], {"listeners": 0}, "nobody listens to /cmd_vel"),
            (["--feedback", "/odom"], {"hearing": False}, "nothing comes on /odom"),
            (
                ["--feedback", "/odom", "--feedback-type", "nav_msgs/msg/Odo"],
                {},
                "no message 'nav_msgs/msg/Odo'",
            ),
            ([], {"topics": []}, "no topic to record"),
        ],
    )
    def test_surroundings(
        self, plain: Path, run, ros: Ros, capsys, arguments: list[str], change: dict, said: str
    ):
        for name, value in change.items():
            setattr(ros, name, value)
        assert run(plain, "--yes", *arguments) == 1
        assert said in capsys.readouterr().err
        assert ros.sent == []
        assert ros.initialised == 0


class TestExportMistakes:
    """Of who exports it: ten of them, and nothing is written."""

    @pytest.mark.parametrize(
        ("robot", "options", "said"),
        [
            ("differential", {"message": "ackermann"}, "robots with a wheel speed and a steering angle"),
            ("mecanum", {"message": "ackermann"}, "take twist_stamped, twist, joint_state, float64_array"),
            ("tricycle", {"message": "joint_state"}, "robots whose inputs are all wheel speeds"),
            ("tricycle", {"message": "float64_array"}, "robots whose inputs are all wheel speeds"),
            ("differential", {"message": "twists"}, "expected one of twist_stamped, twist"),
            ("differential", {"rate": 0.0}, "expected more than 0 Hz"),
            ("differential", {"rate": float("inf")}, "expected more than 0 Hz"),
            ("differential", {"rate": 2000.0}, "at most 1000 Hz for a node"),
            ("differential", {"result": "square"}, "no result 'square'"),
            ("differential", {"out": "record.json"}, "holds results"),
        ],
    )
    def test_refused(self, tmp_path: Path, robot: str, options: dict, said: str):
        folder = saved(tmp_path, study_of(*ROBOTS[robot]))
        options = {name: folder / value if name == "out" else value for name, value in options.items()}
        with pytest.raises(UserMistake, match=said):
            export(folder, "ros2_node", **options)
        assert [one.name for one in folder.iterdir()] == ["record.json"]

    def test_a_result_without_a_drive(self, tmp_path: Path):
        folder = saved(tmp_path, study_of(), [entry("my drive", None, feasible=False)])
        with pytest.raises(RecordError, match="holds no drive"):
            export(folder, "ros2_node", result="my drive")

    def test_from_the_command_line(self, tmp_path: Path, capsys):
        folder = saved(tmp_path, study_of())
        assert main(["export", str(folder), "--to", "ros2_node", "--message", "ackermann"]) == 2
        assert "message: ackermann commands robots with a wheel speed" in capsys.readouterr().err
        assert main(["export", str(folder), "--to", "ros2_node", "--message", "twist", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["export"] == str(folder / "my_drive_drive.py")
