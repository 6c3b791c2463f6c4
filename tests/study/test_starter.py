"""`oed init`: for every robot and sensor a study that reads, tells its parameters apart, and solves."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from oed.cli import main
from oed.foundation.errors import StudyError, UserMistake
from oed.kernel.dynamics.trajectory import Trajectory
from oed.logs import read_logs
from oed.optimize import Ipopt, solve
from oed.records.path_file import write_trajectory
from oed.robots.presets import preset_names
from oed.robots.sensors.drift import USUAL
from oed.robots.usual_uncertainty import LEAST, MOST
from oed.study.starter import (
    DRAWS,
    PILOT,
    SENSORS,
    Choice,
    robots,
    sizes_needed,
    starter,
    usual_duration,
)
from oed.study.study import Study
from oed.uncertainty.departures import violation_probability
from oed.uncertainty.uncertainty import require_spread
from oed.workflow.studies import load_study, parse_study

LARGE = "8 m x 6 m"


@pytest.mark.slow
@pytest.mark.usefixtures("few_screened")
@pytest.mark.parametrize("robot", ["create_3"])
def test_it_solves(robot: str):
    # Fewer samples: the same problem in less time.
    problem = parse_study(starter(Choice(robot, room=LARGE)).replace("samples: 50", "samples: 25")).problem
    assert problem.design.samples == 25
    options = Ipopt(starts=1, perturbations=0, second_stage="none", max_iterations=200)
    found = solve(problem, options, workers=1)
    assert found.evaluation is not None
    assert found.evaluation.feasible
    assert not found.evaluation.singular


def uncommented(text: str, *keys: str) -> str:
    """The study with some keys, and what is inside of them, not commented out any more."""
    lines, inside = [], False
    for line in text.splitlines():
        inside = line.startswith(tuple(f"# {key}:" for key in keys)) or (inside and line.startswith("#   "))
        lines.append(line[2:] if inside else line)
    return "\n".join(lines)


SKIDDING = [robot for robot in robots() if usual_duration(robot) == PILOT]


@pytest.mark.slow
@pytest.mark.usefixtures("few_screened")
@pytest.mark.parametrize("robot", ["skid_steer_icr", "skid_steer_slip", "husky"])
def test_a_pilot_drive_stays_in_the_room_for_every_track(robot: str):
    # Every kind; for skid_steer, of which the presets are other sizes, the one with the widest track.
    text = starter(Choice(robot)).replace("samples: 50", "samples: 8")
    study = parse_study(text.replace(f"draws: {DRAWS}", "draws: 400"))
    (options,) = study.solvers
    quick = options.model_copy(update={"starts": 1, "perturbations": 0, "second_stage": "none"})
    found = solve(study.problem, quick, workers=1)
    assert found.trajectory is not None
    # Of robots drawn anew, more than the search counts with.
    assert violation_probability(study.problem, found.trajectory, draws=3000, seed=1).surely_below(0.01)


HALF_WIDTHS = {
    "create_3": {"wheel_radius_right": 0.02, "wheel_radius_left": 0.02, "track": 0.04},
    "ackermann": {
        "wheel_radius": 0.02,
        "wheelbase": 0.04,
        "steering_offset": np.radians(1),
        "steering_gain": 0.02,
    },
    "mecanum": {"wheel_radius": 0.02, "half_wheelbase_plus_half_track": 0.04},
    # Of a length that is 0, a share of the length that it scales with.
    "offset_drive": {
        "wheel_radius_right": 0.02,
        "wheel_radius_left": 0.02,
        "track": 0.04,
        "sensor_offset": 0.04 * 0.3,
    },
    "unicycle": {"gain_v": 0.02, "gain_omega": 0.02},
    "bicycle_dynamic": {
        **dict.fromkeys(("drive_gain", "viscous_drag", "stiffness_front", "stiffness_rear"), 0.05),
        **dict.fromkeys(("front_axle", "rear_axle", "gyration_radius"), 0.04),
    },
}
"""Half-widths of the ranges that `oed init` writes, as shares of nominal values that are not 0."""


@pytest.mark.slow
@pytest.mark.parametrize("robot", HALF_WIDTHS)
def test_init_writes_the_uncertainty_before_a_calibration(robot: str):
    study = parse_study(starter(Choice(robot, room=LARGE)))
    spread = require_spread(study.problem.uncertain_system)
    scales = np.where(spread.nominal == 0, 1.0, spread.nominal)
    widths = (spread.high - spread.low) / 2 / scales
    assert dict(zip(spread.names, widths, strict=True)) == pytest.approx(HALF_WIDTHS[robot], rel=1e-2)
    assert spread.uniform.all()
    robust = study.problem.robust
    assert (robust.kind, robust.confidence, robust.draws, robust.compare) == ("chance", 0.99, DRAWS, False)


@pytest.mark.slow
@pytest.mark.parametrize("robot", SKIDDING)
def test_a_pilot_drive_is_for_all_tracks_that_skidding_makes(robot: str):
    spread = require_spread(parse_study(starter(Choice(robot))).problem.uncertain_system)
    ratios = np.abs(spread.high / spread.low)
    assert np.maximum(ratios, 1 / ratios).max() == pytest.approx(MOST / LEAST, rel=0.01)


@pytest.mark.slow
@pytest.mark.usefixtures("few_screened")
def test_without_it_most_would_leave_the_room():
    study = parse_study(starter(Choice("skid_steer")).replace("samples: 50", "samples: 8"))
    options = Ipopt(starts=1, perturbations=0, second_stage="none")
    found = solve(replace(study.problem, robust=None), options, workers=1)
    assert found.trajectory is not None
    assert violation_probability(study.problem, found.trajectory, draws=1000).probability > 0.5


def with_its_log(text: str) -> str:
    """The study with the lines about its log not commented out any more."""
    return uncommented(text, "log")


def logged(study: Study, folder: Path) -> Path:
    """A log of a drive of the study's robot, with the columns of the package's own paths."""
    problem, rows = study.problem, 100
    inputs = np.sin(np.arange(rows)[:, None] / 9 + np.arange(len(problem.model.inputs)))
    drive = Trajectory.from_samples(inputs, 20.0, problem.start_states(np.zeros(3)))
    poses = np.cumsum(np.random.default_rng(0).uniform(0, 0.1, (rows + 1, len(problem.model.states))), axis=0)
    write_trajectory(folder / "drive.csv", problem, drive, poses)
    return folder / "drive.csv"


def fits(robot: str, sensor: str) -> bool:
    """Whether a robot can be measured so: steered ones have no coefficients."""
    return sensor != "displacements" or robot not in ("ackermann", "tricycle", "unicycle", "bicycle_dynamic")


# Every robot with one sensor in turn; presets are robots of the kinds.
KINDS = [robot for robot in robots() if robot not in preset_names()]
_, *OTHERS, COEFFICIENTS = SENSORS
IN_TURN = [(robot, OTHERS[place % len(OTHERS)]) for place, robot in enumerate(robots())]
# Every kind with what tells its coefficients as well (what tells its parameters is asked of logs alone); of
# those that sensors are told otherwise for, as a place is among their parameters or they have a trailer, all.
TOGETHER = [
    (robot, sensor)
    for robot in robots()
    for sensor in SENSORS
    if fits(robot, sensor)
    and (
        (robot, sensor) in IN_TURN
        or (robot in KINDS and sensor == COEFFICIENTS)
        or robot in ("offset_drive", "tractor_trailer")
    )
]


@cache
def in_a_large_room(robot: str, sensor: str) -> str:
    return starter(Choice(robot, room=LARGE, sensor=sensor))


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "sensor"), TOGETHER)
def test_every_robot_with_every_sensor(robot: str, sensor: str):
    study = parse_study(in_a_large_room(robot, sensor))
    study.require_identifiable()
    assert study.problem.robust is not None
    # A regression on displacements has no filter that takes drift in.
    drift = study.problem.process_noise
    assert drift == (None if sensor == COEFFICIENTS else USUAL)
    assert len(study.file.baselines) >= (1 if robot == "bicycle_dynamic" else 4)


# What is commented out is the same for all sensors, but for what a log says of headings and of motions; and
# for all presets, which have no sizes.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "sensor"),
    [
        *((robot, sensor) for robot, sensor in IN_TURN if robot in ("husky", *KINDS)),
        ("tractor_trailer", "poses"),
        ("offset_drive", COEFFICIENTS),
    ],
)
def test_what_is_commented_out_is_read(robot: str, sensor: str, tmp_path: Path):
    study = parse_study(uncommented(in_a_large_room(robot, sensor), "log"))
    assert study.file.log is not None
    require_read_as_it_says(study, logged(study, tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "sensor"),
    [
        *((robot, "poses") for robot in ("husky", *KINDS)),
        *(("omni_three", sensor) for sensor in ("positions", "relative_poses", COEFFICIENTS)),
    ],
)
def test_every_robot_and_sensor_for_logs_alone(robot: str, sensor: str, tmp_path: Path):
    study = parse_study(starter(Choice(robot, sensor=sensor, designs=False)))
    study.require_identifiable()
    assert not study.problem.designed
    require_read_as_it_says(study, logged(study, tmp_path))


def require_read_as_it_says(study: Study, file: Path) -> None:
    """The log of a drive has every input of the robot, as it was held, and the states that are measured."""
    model = study.problem.model
    (log,) = read_logs([file], study.log, model)
    table = np.genfromtxt(file, delimiter=",", names=True)
    held = np.column_stack([table[name][:-1] for name in model.input_names])
    steering = [not entry.drives for entry in model.inputs]
    means = np.diff(log.integrals, axis=0) / np.diff(log.input_times)[:, None]
    # An angle runs in straight lines from row to row, a speed is held.
    between = (held[1:] + held[:-1]) / 2
    expected = np.where(steering, between, held[:-1])
    np.testing.assert_allclose(means[: len(between)], expected, atol=1e-9)
    headings = any("heading" in getattr(one, "quantities", ()) for one in study.problem.sensors)
    relative = "relative_poses" in [one.kind for one in study.problem.sensors]
    assert ("heading" in log.quantities) == (headings or relative or not study.problem.sensors)
    assert ("trailer_angle" in log.quantities) == ("trailer_angle" in model.states and not relative)


@pytest.mark.parametrize(
    ("sensor", "noise", "found"),
    [
        ("poses", {"position": "4 mm"}, ["position: 4 mm", "heading: 1 deg"]),
        ("ranges", {"distance": "7 cm"}, ["noise: 7 cm"]),
        ("positions_and_yaw_rate", {"yaw_rate": "3 deg/s"}, ["kind: yaw_rate, noise: 3 deg/s"]),
    ],
)
@pytest.mark.slow
def test_the_noise_of_the_sensor_is_taken(sensor: str, noise: dict[str, str], found: list[str]):
    text = starter(Choice("create_3", room=LARGE, sensor=sensor, noise=noise))
    assert all(words in text for words in found)
    assert "put in your sensor's" not in text


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        ({"positon": "4 mm"}, "did you mean position?"),
        ({"position": "4 kg"}, "noise of the position: expected a length"),
        ({"heading": "1"}, "noise of the heading: 1 has no unit; say '1 deg' (0.017 rad) or '1 rad'"),
        ({"position": "4"}, "noise of the position: 4 has no unit; say '4 cm' (0.04 m) or '4 m'"),
        ({"heading": "1 rad"}, "measurement.noise.heading: 1 is taken as 1 rad, more than 0.5 rad"),
        ({"heading": "0 deg"}, "noise of the heading: expected a standard deviation above 0"),
    ],
)
def test_noise_that_will_not_do(noise: dict[str, str], words: str):
    with pytest.raises(UserMistake, match=re.escape(words)):
        starter(Choice("create_3", noise=noise))


@pytest.mark.parametrize(
    ("size", "words"),
    [
        ("4.9", "wheel_radius: 4.9 has no unit; say '4.9 cm' (0.049 m) or '4.9 m'"),
        ("4.9 m", "robot.wheel_radius: 4.9 is taken as 4.9 m, more than half of its room of 3 m"),
    ],
)
def test_sizes_that_will_not_do(size: str, words: str):
    with pytest.raises(UserMistake, match=re.escape(words)):
        starter(Choice("differential_drive", room="4 m x 3 m", sizes={"wheel_radius": size, "track": "6 m"}))


def test_the_papers_regression_is_not_for_steered_robots():
    with pytest.raises(StudyError, match="twist is linear in coefficients"):
        starter(Choice("ackermann", sensor="displacements"))


@pytest.mark.slow
def test_every_key_is_explained_and_every_number_has_its_unit():
    text = starter(Choice("ackermann"))
    assert text.startswith("# ")
    assert sum("#" in line for line in text.splitlines()) >= 10
    assert "wheelbase: 40 cm   # a typical size: put in yours" in text


@pytest.mark.slow
def test_sizes_given_are_taken():
    text = starter(Choice("ackermann", sizes={"wheelbase": "33 cm", "body_radius": "25 cm"}))
    model = parse_study(text).problem.model
    assert (model.wheelbase, model.body_radius) == (pytest.approx(0.33), pytest.approx(0.25))
    assert "typical" in text.split("wheel_radius")[1].splitlines()[0]


@pytest.mark.parametrize(
    ("room", "expected"),
    [
        ("4 m x 3 m", (-2, 2, -1.5, 1.5)),
        ("4x3", (-2, 2, -1.5, 1.5)),
        ("400 cm x 3", (-2, 2, -1.5, 1.5)),
        ("circle 2 m", (-2, 2, -2, 2)),
        ("circle 2", (-2, 2, -2, 2)),
    ],
)
@pytest.mark.slow
def test_rooms(room: str, expected: tuple[float, ...]):
    limits = parse_study(starter(Choice("turtlebot3_burger", room=room))).problem.limits
    workspace = next(limit for limit in limits if limit.name == "workspace")
    assert workspace.extent == pytest.approx(expected)


@pytest.mark.parametrize(
    "room", ["large", "4 m", "4 m x 3 kg", "0 m x 3 m", "circle", "circle -1 m", "2 x 3 x 4"]
)
def test_rooms_that_cannot_be_read(room: str):
    with pytest.raises(UserMistake, match="room"):
        starter(Choice("turtlebot3_burger", room=room))


def test_a_room_smaller_than_the_robot_is_said():
    with pytest.raises(StudyError, match="too small for a robot of radius"):
        starter(Choice("husky", room="1 m x 1 m"))


@pytest.mark.slow
def test_runs():
    assert parse_study(starter(Choice("create_3", runs=3))).problem.design.runs == 3


@pytest.mark.parametrize("wrong", [{"robot": "hovercraft"}, {"robot": "husky", "sensor": "sonar"}])
def test_what_is_unknown_is_answered_with_what_exists(wrong: dict[str, str]):
    with pytest.raises(UserMistake, match=r"expected a (robot|sensor) of .*(turtlebot3_burger|poses)"):
        starter(Choice(**wrong))


class Terminal(io.StringIO):
    """Somebody who answers."""

    def isatty(self) -> bool:
        return True


class TestCommand:
    """`oed init` itself."""

    @pytest.fixture(autouse=True)
    def elsewhere(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("sys.stdin", io.StringIO())

    @pytest.mark.slow
    def test_flags(self, capsys: pytest.CaptureFixture[str]):
        assert (
            main(["init", "mine.yaml", "--robot", "create_3", "--room", "5 m x 4 m", "--sensor", "ranges"])
            == 0
        )
        assert "oed run mine.yaml" in capsys.readouterr().err
        assert load_study("mine.yaml").problem.measurement.kind == "ranges"

    @pytest.mark.slow
    def test_the_default_name(self):
        assert main(["init", "--robot", "tricycle", "--size", "wheelbase=1.1 m", "--duration", "30 s"]) == 0
        problem = load_study("tricycle.yaml").problem
        assert (problem.model.wheelbase, problem.design.duration) == (1.1, 30)

    @pytest.mark.slow
    def test_json(self, capsys: pytest.CaptureFixture[str]):
        assert main(["init", "--robot", "husky", "--room", "9 m x 9 m", "--json"]) == 0
        assert json.loads(capsys.readouterr().out) == {"study": "husky.yaml"}

    @pytest.mark.slow
    def test_a_file_is_not_written_over(self, capsys: pytest.CaptureFixture[str]):
        Path("mine.yaml").write_text("mine")
        assert main(["init", "mine.yaml", "--robot", "create_3"]) == 2
        assert "mine.yaml exists" in capsys.readouterr().err
        assert Path("mine.yaml").read_text() == "mine"
        assert main(["init", "mine.yaml", "--robot", "create_3", "--force"]) == 0

    @pytest.mark.parametrize(
        ("flags", "words"),
        [
            ([], "give --robot, one of create_3"),
            (["--robot", "hovercraft"], "expected a robot of"),
            (["--robot", "husky", "--room", "1 m x 1 m"], "too small for a robot"),
            (["--robot", "ackermann", "--size", "wheelbse=1 m"], "did you mean wheelbase?"),
            (["--robot", "ackermann", "--size", "wheelbase=1 s"], "expected a length"),
        ],
    )
    def test_mistakes(self, flags: list[str], words: str, capsys: pytest.CaptureFixture[str]):
        assert main(["init", *flags]) == 2
        assert words in capsys.readouterr().err
        assert list(Path().iterdir()) == []

    @pytest.mark.slow
    def test_it_asks_at_a_terminal(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
        answers = [
            *("spaceship", "akermann", "ackermann"),  # the robot
            *("desing", ""),  # what for
            *("6 kg", "6 cm", ""),  # its sizes
            *("large", "circle 3 m"),
            *("sonar", "displacements", "positions"),
            *("0 m", "3 mm"),  # the noise
            *("-3 s", ""),
            *("2.5", "2"),  # the runs
        ]
        monkeypatch.setattr("sys.stdin", Terminal("\n".join(answers) + "\n"))
        assert main(["init"]) == 0
        problem = load_study("ackermann.yaml").problem
        assert problem.design.runs == 2
        assert problem.model.nominal[:2] == pytest.approx([0.06, 0.4])
        assert problem.sensors[0].quantities == ("x", "y")
        assert problem.sensors[0].noise.position == pytest.approx(3e-3)
        asked = capsys.readouterr().err
        assert asked.count("Which robot") == 3
        for words in (
            "did you mean ackermann?",
            "did you mean design?",
            "wheel_radius: expected a length",
            "expected a room like",
            "'sonar': not listed",
            "displacements need a robot",
            "expected a standard deviation above 0, got '0 m'",
            "expected more than 0",
        ):
            assert words in asked
        # What there is stands there once, and nothing is wider than a terminal.
        assert asked.count("pioneer_3dx") == asked.count("motion capture") == 1
        shown = re.split(r"\n|(?<=\]: )|(?<=robot: )", asked)
        assert max(len(one) for one in shown if one.endswith(": ") or re.match(r"  [a-z_\d]+  ", one)) <= 80

    @pytest.mark.parametrize(("answer", "code"), [("yes", 0), ("Y", 0), ("no", 2), ("n", 2), ("", 2)])
    @pytest.mark.slow
    def test_what_is_there_is_asked_about_first(
        self, answer: str, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ):
        Path("mine.yaml").write_text("mine")
        monkeypatch.setattr("sys.stdin", Terminal("\n".join([answer, "create_3"]) + "\n"))
        assert main(["init", "mine.yaml"]) == code
        assert capsys.readouterr().err.startswith("mine.yaml exists; write over it (yes, no) [no]: ")
        assert (Path("mine.yaml").read_text() == "mine") == (code == 2)

    @pytest.mark.slow
    def test_a_pilot_drive_is_one(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
        monkeypatch.setattr("sys.stdin", Terminal("\n" * 9))
        assert main(["init", "--robot", "husky", "--room", "9 m x 9 m"]) == 0
        assert "How many drives" not in capsys.readouterr().err

    @pytest.mark.slow
    def test_a_study_for_logs_alone(self, capsys: pytest.CaptureFixture[str]):
        assert main(["init", "--robot", "husky", "--only-estimate", "--noise", "position=3 cm"]) == 0
        assert "then: oed estimate husky.yaml LOG..." in capsys.readouterr().err
        study = load_study("husky.yaml")
        assert not study.problem.designed
        assert study.problem.sensors[0].noise.position == pytest.approx(0.03)

    @pytest.mark.slow
    def test_it_is_asked_for_and_no_room_then(self, monkeypatch, capsys: pytest.CaptureFixture[str]):
        answers = ["ackermann", "estimate", "6 cm", "", "positions", "3 mm"]
        monkeypatch.setattr("sys.stdin", Terminal("\n".join(answers) + "\n"))
        assert main(["init"]) == 0
        assert not load_study("ackermann.yaml").problem.designed
        asked = capsys.readouterr().err
        assert not [words for words in ("Which room", "How long", "How many drives") if words in asked]

    @pytest.mark.slow
    def test_a_drive_is_designed_or_not(self, capsys: pytest.CaptureFixture[str]):
        flags = ["--only-estimate", "--room", "3 m x 3 m", "--runs", "2"]
        assert main(["init", "--robot", "create_3", *flags]) == 2
        assert "--only-estimate designs no drive; leave --room and --runs out" in capsys.readouterr().err

    @pytest.mark.slow
    def test_a_new_folder_is_named(self, capsys: pytest.CaptureFixture[str]):
        assert main(["init", "new/mine.yaml", "--robot", "create_3"]) == 0
        assert "wrote new/mine.yaml in a new folder, new;" in capsys.readouterr().err
        assert main(["init", "new/other.yaml", "--robot", "create_3"]) == 0
        assert "new folder" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("called", "name"),
    [
        ("camera", "poses"),
        ("motion capture", "poses"),
        ("MoCap", "poses"),
        ("GPS", "positions"),
        ("laser_tracker", "positions"),
        ("imu", "positions_and_yaw_rate"),
        ("UWB anchors", "ranges"),
        ("pose", "poses"),
        ("visual odometry", "relative_poses"),
        ("lidar", "poses or relative_poses"),
    ],
)
def test_sensors_are_known_by_what_people_call_them(called: str, name: str):
    with pytest.raises(UserMistake, match=rf"did you mean {name}\?"):
        starter(Choice("create_3", sensor=called))


def test_every_robot_that_begins_so_is_proposed():
    with pytest.raises(UserMistake, match=r"did you mean turtlebot3_burger or turtlebot3_waffle\?"):
        sizes_needed("turtlebot")


@pytest.mark.slow
def test_a_study_says_how_it_is_given_what_a_first_one_calls_so():
    text = starter(Choice("create_3")).replace("kind: poses", "kind: positions")
    wanted = re.escape("what `oed init` calls positions is {kind: poses, quantities: [x, y], noise")
    with pytest.raises(StudyError, match=wanted):
        parse_study(text)


def test_sizes_of_presets_are_known():
    assert sizes_needed("husky") == {}
    assert sizes_needed("tricycle") == {"wheel_radius": "5 cm", "wheelbase": "40 cm"}
