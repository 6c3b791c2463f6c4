"""Robots of the user's own: in Python as they are, in a study by the module and class that make them."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from builders import SPEED, make_problem

import oed
from oed.cli import main
from oed.errors import StudyError
from oed.models import PythonRobot

MODULE = '''
import casadi as ca
import oed


class Unicycle(oed.Model):
    """Speeds are commanded in m/s and rad/s, and come out a little wrong."""

    kind: str = "unicycle"
    gain: float = 1.0
    inputs = (oed.Input("wheel_speed", "wheel_speed", "rad/s"), oed.Input("spin", "wheel_speed", "rad/s"))

    @property
    def parameters(self):
        return (oed.Parameter("gain", self.gain, ""), oed.Parameter("turning_gain", 0.5, ""))

    def twist(self, inputs, parameters):
        return ca.vertcat(parameters[0] * inputs[0], 0, parameters[1] * inputs[1])


class Stranger:
    pass


raises = None
'''

STUDY = """
format: 1
name: My own
robot:
  kind: python
  object: {object}
  gain: 0.9
trajectory: {{duration: 10 s, samples: 30, spline: {{coefficients: 8}}}}
measurement: {{kind: poses, noise: {{position: 1 cm, heading: 1 deg}}}}
limits: {{wheel_speed: 1 rad/s, workspace: {{kind: circle, radius: 1 m}}}}
solvers: [{{kind: ipopt, starts: 2, perturbations: 0, second_stage: none}}]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "my_robots.py").write_text(MODULE)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "my_robots", raising=False)
    yield tmp_path
    sys.modules.pop("my_robots", None)


def load(folder: Path, place: str = "my_robots:Unicycle", **changes: str) -> oed.Study:
    text = STUDY.format(object=place)
    for old, new in changes.items():
        text = text.replace(old, new)
    (folder / "study.yaml").write_text(text)
    return oed.load_study(folder / "study.yaml")


def test_the_module_beside_the_study_is_found(folder: Path):
    study = load(folder)
    model = study.problem.model
    assert [entry.name for entry in model.parameters] == ["gain", "turning_gain"]
    assert model.nominal == [0.9, 0.5]
    assert np.array(ca.evalf(model.twist(ca.DM([2, 3]), ca.DM([0.9, 0.5])))).ravel() == pytest.approx(
        [1.8, 0, 1.5]
    )


def test_the_echo_is_the_same_study(folder: Path):
    study = load(folder)
    again = oed.parse_study(
        str(study.echo()).replace("'", '"').replace("True", "true").replace("False", "false")
    )
    assert again.problem.model == study.problem.model


def test_it_is_solved_whatever_the_number_of_workers(folder: Path):
    study = load(folder)
    found = [oed.solve(study.problem, study.solvers[0], seed=1, workers=workers) for workers in (1, 2)]
    assert found[0].evaluation.feasible
    assert found[0].evaluation.objective == found[1].evaluation.objective


def test_it_survives_pickling(folder: Path):
    model = load(folder).problem.model
    again = pickle.loads(pickle.dumps(model))
    assert again == model
    assert again.nominal == model.nominal


def test_its_body_radius_is_the_robots(folder: Path):
    study = load(folder, **{"gain: 0.9": "body_radius: 20 cm"})
    assert study.problem.model.body_radius == study.problem.model.robot.body_radius == 0.2


def test_an_object_in_python_needs_no_study(folder: Path):
    sys.path.append(str(folder))
    import my_robots

    problem = make_problem(
        model=my_robots.Unicycle(gain=1.1),
        measurement=oed.Poses(noise={"position": 0.01, "heading": 0.01}),
        limits=(SPEED,),
        criterion=oed.E(),
    )
    assert problem.any_estimations[0].parameters == ("gain", "turning_gain")


@pytest.mark.parametrize(
    ("place", "changes", "words"),
    [
        ("my_robots", {}, "expected module:Class"),
        ("no_such_module:Robot", {}, "no module no_such_module in"),
        ("my_robots:Tank", {}, "my_robots has no Tank"),
        ("my_robots:Stranger", {}, "inherits from oed.Model"),
        ("my_robots:Unicycle", {"gain: 0.9": "gian: 0.9"}, "gian: Extra inputs are not permitted"),
        ("my_robots:Unicycle", {"gain: 0.9": "gain: fast"}, "gain: Input should be a valid number"),
    ],
)
def test_mistakes_are_named_with_their_line(folder: Path, place: str, changes: dict, words: str):
    with pytest.raises(StudyError) as caught:
        load(folder, place, **changes)
    (flaw,) = caught.value.flaws
    assert flaw.line in (4, 5, 6)
    assert words in flaw.message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("import numpy_of_tomorrow", "cannot be imported"),
        ("1 / 0", "ZeroDivisionError"),
        ("def (", "SyntaxError"),
        ("raise SystemExit(0)", "cannot be imported: SystemExit: 0"),
        ("import sys; sys.exit()", "cannot be imported: SystemExit"),
        ("class End(BaseException): pass\nraise End('two\\nlines')", "cannot be imported: End: two lines"),
    ],
)
def test_a_module_that_fails(folder: Path, text: str, words: str):
    (folder / "broken_robots.py").write_text(text)
    with pytest.raises(StudyError, match=words):
        load(folder, "broken_robots:Robot")


def test_equal_robots_are_equal(folder: Path):
    load(folder)
    one, same, other = (
        PythonRobot(object="my_robots:Unicycle", folder=str(folder), gain=gain) for gain in (0.8, 0.8, 0.7)
    )
    assert one == same
    assert hash(one) == hash(same)
    assert one != other


METHODS = """
import sys
import casadi as ca
import oed


class Robot(oed.Model):
    kind: str = "own"
    gain: float = 1.0
    inputs = (oed.Input("v", "wheel_speed", "rad/s"), oed.Input("w", "wheel_speed", "rad/s"))

    @property
    def parameters(self):
        {parameters}
        return (oed.Parameter("gain", self.gain, ""),)

    def twist(self, inputs, parameters):
        {twist}
        return ca.vertcat(parameters[0] * inputs[0], 0, inputs[1])
"""


@pytest.mark.parametrize(
    ("method", "body", "words"),
    [
        ("twist", "sys.exit(0)", "SystemExit: 0"),
        ("parameters", "sys.exit()", "SystemExit"),
        ("twist", "raise GeneratorExit", "GeneratorExit"),
        ("twist", "1 / 0", "ZeroDivisionError: division by zero"),
        ("twist", "return ca.vertcat(inputs[0], inputs[1])", "ValueError"),
        ("twist", "return None", "cannot be made: "),
        ("parameters", "return ()", "expected a tuple of oed.Parameter, got ()"),
        ("parameters", "return (1, 2)", "expected a tuple of oed.Parameter, got (1, 2)"),
        ("parameters", "return (oed.Parameter('gain', float('nan'), ''),)", "gain: expected a finite"),
    ],
)
def test_a_robot_that_does_not_work_is_named_where_it_is(folder: Path, method: str, body: str, words: str):
    bodies = {"parameters": "", "twist": "", method: body}
    (folder / f"own_{abs(hash(body))}.py").write_text(METHODS.format(**bodies))
    with pytest.raises(StudyError) as caught:
        load(folder, f"own_{abs(hash(body))}:Robot")
    (flaw,) = caught.value.flaws
    assert flaw.key == "robot"
    assert flaw.line == 4
    assert words in flaw.message
    assert "\n" not in flaw.message


def test_a_robot_that_ends_programs_ends_no_check(folder: Path, capsys: pytest.CaptureFixture[str]):
    (folder / "ender.py").write_text(METHODS.format(parameters="", twist="sys.exit(0)"))
    (folder / "study.yaml").write_text(STUDY.format(object="ender:Robot"))
    assert main(["check", str(folder / "study.yaml")]) == 2
    assert "study.yaml:4: robot: ender:Robot cannot be made: SystemExit: 0" in capsys.readouterr().err
