"""A baseline of the user's own: from YAML and Python, placed and scaled as any other, refused in words."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import pytest

import oed
from oed.foundation.errors import StudyError
from oed.foundation.own import code
from oed.robots.baselines import PythonBaseline, baselines
from oed.workflow.studies import load_study, parse_study

OWN = """
from typing import Literal
from pathlib import Path
import oed

Path(__file__).with_name("was_run").touch()

class Zigzag(oed.Baseline):
    '''There, a turn, half as far, and back.'''

    kind: Literal["zigzag"] = "zigzag"
    angle: float = 1.0

    def moves(self, size, lap):
        return MOVES
"""
MOVES = (
    "[oed.Move(size, 0.0), oed.Move(0.0, self.angle), oed.Move(-size / 2, 0.0), oed.Move(0.0, -self.angle)]"
)
STUDY = """\
format: 1
name: My own baseline
robot: ROBOT
trajectory: {duration: 8 s, samples: 20, spline: {coefficients: 6}}
measurement: {kind: poses, noise: {position: 1 cm, heading: 1 deg}}
limits: {wheel_speed: 6 rad/s,LIMIT workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}}
baselines: [straight, {kind: python, object: own:Zigzag, angle: 0.5}]
"""
ROBOT = "{kind: differential_drive, wheel_radius: 5 cm, track: 20 cm}"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    for name in [name for name in sys.modules if name.startswith(code.PREFIX)]:
        del sys.modules[name]
    code._packages.clear()


def load(folder: Path, moves: str = MOVES, robot: str = ROBOT, limit: str = "") -> oed.Study:
    (folder / "own.py").write_text(OWN.replace("MOVES", moves))
    (folder / "study.yaml").write_text(STUDY.replace("ROBOT", robot).replace("LIMIT", limit))
    return load_study(folder / "study.yaml")


@pytest.mark.slow
def test_it_is_made_as_large_as_fits_and_as_long_as_asked(folder: Path) -> None:
    study = load(folder)
    own = study.file.baselines[1]
    first, second = baselines(study.problem, own, length=0.7)
    assert [first.name, second.name] == ["zigzag", "zigzag_same_length"]
    assert first.evaluation.feasible
    assert first.evaluation.path_length > 1
    assert second.evaluation.path_length == pytest.approx(0.7, rel=1e-3)


def test_its_echo_is_the_same_study_and_names_it_without_its_code(folder: Path) -> None:
    study = load(folder)
    echo = study.echo()
    assert echo["baselines"][1]["object"] == "own:Zigzag"
    assert echo["baselines"][1]["described"] == {"kind": "zigzag"}
    assert parse_study(str(echo)).file.baselines == study.file.baselines
    (folder / "was_run").unlink()
    read = oed.study.study.RobotStudyFile.model_validate(echo, context={"code": "is not run"})
    (key, named) = next(read.named_code())
    assert (key, named.label) == ("study.baselines.1", "zigzag")
    assert isinstance(named, PythonBaseline)
    assert not (folder / "was_run").exists()


@pytest.mark.parametrize(
    ("moves", "reason"),
    [
        ("[]", "expected a list of at least one oed.Move, got \\[\\]"),
        ("[size]", r"expected a list of at least one oed.Move, got \[1.0\]"),
        ("[oed.Move(float('nan'), 0.0)]", "expected finite numbers"),
        ("1 / 0", "ZeroDivisionError"),
        ("[oed.Move(size, 0.0)] if size == 1 else None", "moves: expected a list"),
    ],
)
def test_what_is_no_list_of_moves_is_refused_by_its_key(folder: Path, moves: str, reason: str) -> None:
    with pytest.raises(StudyError, match=rf"study.yaml:7: baselines\.1.*{reason}"):
        load(folder, moves)


@pytest.mark.slow
def test_a_robot_that_cannot_drive_it_is_named(folder: Path) -> None:
    car = "{kind: ackermann, wheel_radius: 5 cm, wheelbase: 30 cm}"
    study = load(folder, robot=car, limit=" steering_angle: 30 deg,")
    (found,) = baselines(study.problem, study.file.baselines[1])
    assert "ackermann cannot drive a zigzag (it cannot turn in place)" in found.message
    assert found.evaluation is None


def test_another_class_is_refused(folder: Path) -> None:
    (folder / "own.py").write_text("class Zigzag: pass\n")
    (folder / "study.yaml").write_text(STUDY.replace("ROBOT", ROBOT).replace("LIMIT", ""))
    reason = "baselines.1: own:Zigzag is no baseline: .* inherits from oed.Baseline"
    with pytest.raises(StudyError, match=reason):
        load_study(folder / "study.yaml")


class Bow(oed.Baseline):
    """An arc, there and back."""

    kind: Literal["bow"] = "bow"

    def moves(self, size, lap):
        """Back on odd laps."""
        sign = -1 if lap % 2 else 1
        return [oed.Move(sign * size, sign * 0.5)]


@pytest.mark.slow
def test_in_python_the_baseline_itself_will_do(folder: Path) -> None:
    study = load(folder).changed(baselines=["straight", Bow(name="my bow")])
    (found,) = baselines(study.problem, study.file.baselines[1])
    assert (found.name, found.kind, found.evaluation.feasible) == ("my bow", "baseline", True)
    assert study.echo()["baselines"][1]["object"].endswith(":Bow")
