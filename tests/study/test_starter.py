"""`oed init`: for every robot and sensor a study that reads, tells its parameters apart, and solves."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest

from oed.cli import main
from oed.foundation.errors import StudyError, UserMistake
from oed.kernel.dynamics.trajectory import Trajectory
from oed.logs import read_logs
from oed.optimize import Ipopt, solve
from oed.records.path_file import write_trajectory
from oed.study.starter import SENSORS, Choice, robots, sizes_needed, starter
from oed.study.study import Study
from oed.workflow.studies import load_study, parse_study

every_robot = pytest.mark.parametrize("robot", robots())
LARGE = "8 m x 6 m"


@every_robot
@pytest.mark.slow
def test_every_robot_has_a_study_that_can_be_told(robot: str):
    study = parse_study(starter(Choice(robot, room=LARGE)))
    study.require_identifiable()
    assert len(study.file.baselines) >= 4


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["create_3"])
def test_it_solves(robot: str):
    # Half the samples: the same problem in half the time.
    text = starter(Choice(robot, room=LARGE)).replace("samples: 100", "samples: 50")
    problem = parse_study(text).problem
    assert problem.design.samples == 50
    options = Ipopt(starts=1, perturbations=0, second_stage="none", max_iterations=200)
    found = solve(problem, options, workers=1)
    assert found.evaluation is not None
    assert found.evaluation.feasible
    assert not found.evaluation.singular


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("robot", ["turtlebot3_burger", "mecanum", "skid_steer"])
@pytest.mark.slow
def test_every_sensor(robot: str, sensor: str):
    study = parse_study(starter(Choice(robot, room=LARGE, sensor=sensor)))
    study.require_identifiable()


def with_its_log(text: str) -> str:
    """The study with the lines about its log not commented out any more."""
    lines = text.splitlines()
    first = lines.index("# log:")
    count = next(row for row, line in enumerate(lines[first + 1 :], start=1) if not line.startswith("#   "))
    return "\n".join(
        [*lines[:first], *(line[2:] for line in lines[first : first + count]), *lines[first + count :]]
    )


def logged(study: Study, folder: Path) -> Path:
    """A log of a drive of the study's robot, with the columns of the package's own paths."""
    problem, rows = study.problem, 100
    inputs = np.sin(np.arange(rows)[:, None] / 9 + np.arange(len(problem.model.inputs)))
    drive = Trajectory.from_samples(inputs, 20.0, problem.start_states(np.zeros(3)))
    poses = np.cumsum(np.random.default_rng(0).uniform(0, 0.1, (rows + 1, len(problem.model.states))), axis=0)
    write_trajectory(folder / "drive.csv", problem, drive, poses)
    return folder / "drive.csv"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "sensor"), [*((robot, "poses") for robot in robots()), ("tricycle", "positions")]
)
def test_its_log_is_read_as_it_says(robot: str, sensor: str, tmp_path: Path):
    study = parse_study(with_its_log(starter(Choice(robot, room=LARGE, sensor=sensor))))
    assert study.file.log is not None
    model = study.problem.model
    file = logged(study, tmp_path)
    (log,) = read_logs([file], study.log, model)
    table = np.genfromtxt(file, delimiter=",", names=True)
    held = np.column_stack([table[name][:-1] for name in model.input_names])
    steering = [not entry.drives for entry in model.inputs]
    means = np.diff(log.integrals, axis=0) / np.diff(log.input_times)[:, None]
    # An angle runs in straight lines from row to row, a speed is held.
    between = (held[1:] + held[:-1]) / 2
    expected = np.where(steering, between, held[:-1])
    np.testing.assert_allclose(means[: len(between)], expected, atol=1e-9)
    assert ("heading" in log.quantities) == (sensor == "poses")
    assert ("trailer_angle" in log.quantities) == ("trailer_angle" in model.states)


def test_the_papers_regression_is_not_for_steered_robots():
    with pytest.raises(StudyError, match="twist is linear in coefficients"):
        starter(Choice("ackermann", sensor="displacements"))


def test_every_key_is_explained_and_every_number_has_its_unit():
    text = starter(Choice("ackermann"))
    assert text.startswith("# ")
    assert sum("#" in line for line in text.splitlines()) >= 10
    assert "wheelbase: 40 cm   # a typical size: put in yours" in text


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


def test_runs():
    assert parse_study(starter(Choice("create_3", runs=3))).problem.design.runs == 3


@pytest.mark.parametrize("wrong", [{"robot": "hovercraft"}, {"robot": "husky", "sensor": "sonar"}])
def test_what_is_unknown_is_answered_with_what_exists(wrong: dict[str, str]):
    with pytest.raises(UserMistake, match=r"expected a (robot|sensor) of .*(turtlebot3_burger|poses)"):
        starter(Choice(**wrong))


class TestCommand:
    """`oed init` itself."""

    @pytest.fixture(autouse=True)
    def elsewhere(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("sys.stdin", io.StringIO())

    def test_flags(self, capsys: pytest.CaptureFixture[str]):
        assert (
            main(["init", "mine.yaml", "--robot", "create_3", "--room", "5 m x 4 m", "--sensor", "ranges"])
            == 0
        )
        assert "oed run mine.yaml" in capsys.readouterr().err
        assert load_study("mine.yaml").problem.measurement.kind == "ranges"

    def test_the_default_name(self):
        assert main(["init", "--robot", "tricycle", "--size", "wheelbase=1.1 m", "--duration", "30 s"]) == 0
        problem = load_study("tricycle.yaml").problem
        assert (problem.model.wheelbase, problem.design.duration) == (1.1, 30)

    def test_json(self, capsys: pytest.CaptureFixture[str]):
        assert main(["init", "--robot", "husky", "--room", "9 m x 9 m", "--json"]) == 0
        assert json.loads(capsys.readouterr().out) == {"study": "husky.yaml"}

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

    def test_it_asks_at_a_terminal(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
        class Terminal(io.StringIO):
            def isatty(self) -> bool:
                return True

        answers = ["spaceship", "ackermann", "6 cm", "", "circle 3 m", "positions", ""]
        monkeypatch.setattr("sys.stdin", Terminal("\n".join(answers) + "\n"))
        assert main(["init"]) == 0
        problem = load_study("ackermann.yaml").problem
        assert problem.model.nominal[:2] == pytest.approx([0.06, 0.4])
        assert problem.measurement.quantities == ("x", "y")
        assert capsys.readouterr().err.count("Which robot") == 2


def test_sizes_of_presets_are_known():
    assert sizes_needed("husky") == {}
    assert sizes_needed("tricycle") == {"wheel_radius": "5 cm", "wheelbase": "40 cm"}
