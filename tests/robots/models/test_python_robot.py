"""Robots of the user's own: in Python as they are, in a study by the module and class that make them."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from builders import SPEED, problem_of

import oed
from oed.cli import main
from oed.foundation.errors import StudyError, UserMistake
from oed.kernel.limit import implied_bounds
from oed.robots.limits import YawRate
from oed.robots.models import PythonRobot

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


def gains_of(study: oed.Study) -> list[float]:
    return study.problem.model.nominal


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


@pytest.mark.slow
@pytest.mark.usefixtures("few_screened")
def test_the_number_of_workers_changes_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("oed.optimize.search.POOL_SECONDS", 0.0)
    study = load(folder)
    # Where all starts are after some steps: the first alone, the others in processes.
    solver = study.solvers[0].model_copy(update={"starts": 3, "max_iterations": 5})
    found = [oed.solve(study.problem, solver, seed=1, workers=workers) for workers in (1, 2)]
    one, two = ([start.objective for start in each.starts] for each in found)
    assert one == two
    assert None not in one


def test_it_survives_pickling(folder: Path):
    model = load(folder).problem.model
    again = pickle.loads(pickle.dumps(model))
    assert again == model
    assert again.nominal == model.nominal


def test_its_body_radius_is_the_robots(folder: Path):
    study = load(folder, **{"gain: 0.9": "body_radius: 20 cm"})
    assert study.problem.model.body_radius == 0.2


def test_an_object_in_python_needs_no_study(folder: Path):
    sys.path.append(str(folder))
    import my_robots

    problem = problem_of(
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
        ("my_robots:Unicycle", {"gain: 0.9": "gian: 0.9"}, "gian: unknown key"),
        ("my_robots:Unicycle", {"gain: 0.9": "gain: fast"}, "gain: expected a number, got 'fast'"),
    ],
)
def test_mistakes_are_named_with_their_line(folder: Path, place: str, changes: dict, words: str):
    with pytest.raises(StudyError) as caught:
        load(folder, place, **changes)
    (issue,) = caught.value.issues
    assert issue.line in (4, 5, 6)
    assert words in issue.message


@pytest.mark.parametrize(
    ("new", "words"),
    [
        ("ca.vertcat(inputs[0], inputs[1])", r"expected a twist \(3, 1\): .*got one of shape \(2, 1\)"),
        ("ca.horzcat(inputs[0], 0, inputs[1])", r"got one of shape \(1, 3\)"),
        ("inputs[7]", "its twist cannot be made: "),
        ("'fast'", "its twist cannot be made: "),
        ("1 / 0", "its twist cannot be made: ZeroDivisionError"),
    ],
)
def test_a_twist_that_is_none(folder: Path, new: str, words: str):
    text = MODULE.replace("ca.vertcat(parameters[0] * inputs[0], 0, parameters[1] * inputs[1])", new)
    (folder / "my_robots.py").write_text(text)
    with pytest.raises(StudyError, match=words) as caught:
        load(folder)
    assert caught.value.issues[0].key == "robot"


VELOCITIES = MODULE.replace('"wheel_speed", "wheel_speed", "rad/s"', '"v", "speed", "m/s"').replace(
    '"spin", "wheel_speed", "rad/s"', '"w", "yaw_rate", "rad/s"'
)


class TestVelocityCommands:
    """A robot that is told how fast to drive and turn, bounded by how fast it may."""

    def load(self, folder: Path, limits: str) -> oed.Study:
        (folder / "my_robots.py").write_text(VELOCITIES)
        return load(folder, **{"wheel_speed: 1 rad/s": limits})

    def test_limits_on_the_motion_bound_them(self, folder: Path):
        problem = self.load(folder, "body_speed: [-0.1 m/s, 0.45 m/s], yaw_rate: 1 rad/s").problem
        # At the nominal gains of 0.9 and 0.5.
        expected = [[-0.1 / 0.9, 0.5], [-2.0, 2.0]]
        np.testing.assert_allclose(problem.input_bounds, expected, rtol=1e-8)
        low, high = np.abs(problem.input_bounds.T) - np.abs(np.transpose(expected))
        assert (low >= 0).all()
        assert (high >= 0).all()

    @pytest.mark.slow
    @pytest.mark.usefixtures("few_screened")
    def test_a_drive_is_found_that_keeps_them(self, folder: Path):
        study = self.load(folder, "body_speed: 0.4 m/s, yaw_rate: 1 rad/s")
        solver = study.solvers[0].model_copy(update={"starts": 1, "perturbations": 0, "second_stage": "none"})
        found = oed.solve(study.problem, solver, seed=1, workers=1)
        assert found.evaluation.feasible
        assert oed.bound(study.problem).upper_bound >= found.evaluation.objective

    @pytest.mark.parametrize(
        ("limits", "told"),
        [
            ("body_speed: 1 m/s", ["w; add yaw_rate"]),
            ("yaw_rate: 1 rad/s", ["v; add body_speed"]),
            ("path_length: 3 m", ["v; add body_speed", "w; add yaw_rate"]),
        ],
    )
    def test_what_nothing_bounds_is_said_with_what_would(self, folder: Path, limits: str, told: list[str]):
        with pytest.raises(StudyError) as caught:
            self.load(folder, limits)
        messages = [issue.message for issue in caught.value.issues]
        assert messages == [f"nothing bounds {one}, without which no design is best" for one in told]

    def test_motion_that_is_not_linear_is_said_to_bound_nothing(self, folder: Path):
        (folder / "my_robots.py").write_text(
            VELOCITIES.replace("parameters[0] * inputs[0]", "inputs[0] ** 3")
        )
        with pytest.raises(
            StudyError, match="nothing bounds v; body_speed does not, for the motion does not"
        ):
            load(folder, **{"wheel_speed: 1 rad/s": "body_speed: 1 m/s, yaw_rate: 1 rad/s"})


def test_limits_on_the_motion_bound_wheels_as_well():
    wheels = oed.DifferentialDrive(wheel_radius=0.05, track=0.2)
    limits = (oed.BodySpeed(bounds=0.5), YawRate(bounds=2.0))
    problem = problem_of(model=wheels, limits=limits)
    # Driving as fast as allowed while turning as fast as allowed: (0.5 + 0.1 * 2) / 0.05.
    np.testing.assert_allclose(problem.input_bounds, [[-14, 14]] * 2, rtol=1e-8)


def test_one_wheels_bound_helps_to_bound_the_other():
    own = oed.WheelSpeed(each={"wheel_speed_right": (-4, 6), "wheel_speed_left": (-1e6, 1e6)})
    known = np.array([[-4.0, 6.0], [-np.inf, np.inf]])
    wheels = oed.DifferentialDrive(wheel_radius=0.05, track=0.2)
    found = implied_bounds(known, [*YawRate(bounds=1.0).linear_bounds(wheels), *own.linear_bounds(wheels)])
    np.testing.assert_allclose(found, [[-4, 6], [-8, 10]], rtol=1e-8)


def test_what_is_not_linear_bounds_nothing():
    car = oed.Ackermann(wheel_radius=0.05, wheelbase=0.3)
    found = implied_bounds(np.tile([-np.inf, np.inf], (2, 1)), YawRate(bounds=1.0).linear_bounds(car))
    assert np.isinf(found).all()


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
        PythonRobot(object="my_robots:Unicycle", folder=str(folder), gain=gain).made(oed.Model)
        for gain in (0.8, 0.8, 0.7)
    )
    assert one == same
    assert hash(one) == hash(same)
    assert one != other


class TestTwoFolders:
    """Modules of one name in two folders are two modules."""

    @pytest.fixture
    def other(self, folder: Path) -> Path:
        place = folder / "other"
        place.mkdir()
        (place / "my_robots.py").write_text(MODULE.replace('turning_gain", 0.5', 'turning_gain", 0.7'))
        return place

    @pytest.mark.slow
    def test_each_study_has_the_class_beside_it(self, folder: Path, other: Path):
        assert [gains_of(load(place)) for place in (folder, other, folder)] == [
            [0.9, 0.5],
            [0.9, 0.7],
            [0.9, 0.5],
        ]

    @pytest.mark.slow
    def test_check_reads_each_of_them(self, folder: Path, other: Path, capsys: pytest.CaptureFixture[str]):
        load(folder)
        load(other)
        (other / "my_robots.py").write_text(MODULE.replace("class Unicycle", "class Bicycle"))
        assert main(["check", str(folder / "study.yaml"), str(other / "study.yaml")]) == 2
        told = capsys.readouterr()
        assert f"{other / 'study.yaml'}:4" in told.err
        assert "my_robots has no Unicycle" in told.err

    def test_a_module_of_that_name_that_is_already_there_is_not_taken(self, folder: Path, other: Path):
        sys.path.insert(0, str(other))
        import my_robots

        assert my_robots.Unicycle().nominal == [1.0, 0.7]
        assert gains_of(load(folder)) == [0.9, 0.5]

    def test_nothing_is_left_on_pythons_path(self, folder: Path):
        before = list(sys.path)
        load(folder)
        assert sys.path == before
        assert "my_robots" not in sys.modules

    @pytest.mark.parametrize("line", ["from sizes import TURNING", "from .sizes import TURNING"])
    def test_what_they_import_stands_beside_each(self, folder: Path, other: Path, line: str):
        for place, size in ((folder, 0.3), (other, 0.4)):
            (place / "sizes.py").write_text(f"TURNING = {size}")
            text = MODULE.replace("import casadi", f"{line}\nimport casadi").replace("0.5, ", "TURNING, ")
            (place / "my_robots.py").write_text(text)
        assert [gains_of(load(place))[1] for place in (folder, other)] == [0.3, 0.4]

    def test_what_they_import_late_stands_beside_each(self, folder: Path, other: Path):
        for place, size in ((folder, 0.3), (other, 0.4)):
            (place / "sizes").mkdir()
            (place / "sizes" / "__init__.py").write_text("from sizes.all import TURNING")
            (place / "sizes" / "all.py").write_text(f"TURNING = {size}")
            text = MODULE.replace("        return (oed.P", "        import sizes.all\n        return (oed.P")
            (place / "my_robots.py").write_text(text.replace("0.5, ", "sizes.all.TURNING, "))
        assert [gains_of(load(place))[1] for place in (folder, other)] == [0.3, 0.4]


def test_a_module_that_has_changed_is_read_again(folder: Path):
    before = load(folder).problem.model
    # As long as before and within the same second.
    (folder / "my_robots.py").write_text(MODULE.replace("0.5, ", "0.6, "))
    after = load(folder).problem.model
    assert (before.nominal[1], after.nominal[1]) == (0.5, 0.6)
    assert before != after


def test_a_module_that_is_as_it_was_is_one_module(folder: Path):
    first, again = (load(folder).problem.model for _ in range(2))
    assert type(first) is type(again)


def test_a_module_in_a_folder_below(folder: Path):
    (folder / "robots").mkdir()
    (folder / "my_robots.py").rename(folder / "robots" / "mine.py")
    assert gains_of(load(folder, "robots.mine:Unicycle")) == [0.9, 0.5]


def test_an_installed_module_needs_no_file_beside_the_study(folder: Path):
    study = load(
        folder,
        "oed.robots.models.differential_drive:OffsetDrive",
        **{"gain: 0.9": "wheel_radius: 5 cm\n  track: 20 cm"},
    )
    assert study.problem.model.track == 0.2


def test_a_module_that_ends_the_program_does_not_end_the_check_as_if_all_were_well(
    folder: Path, capsys: pytest.CaptureFixture[str]
):
    load(folder)
    (folder / "my_robots.py").write_text("import sys\nsys.exit(0)")
    assert main(["check", str(folder / "study.yaml")]) == 2
    assert "my_robots cannot be imported: SystemExit: 0" in capsys.readouterr().err


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
    (issue,) = caught.value.issues
    assert issue.key == "robot"
    assert issue.line == 4
    assert words in issue.message
    assert "\n" not in issue.message


def test_a_robot_that_ends_programs_ends_no_check(folder: Path, capsys: pytest.CaptureFixture[str]):
    (folder / "ender.py").write_text(METHODS.format(parameters="", twist="sys.exit(0)"))
    (folder / "study.yaml").write_text(STUDY.format(object="ender:Robot"))
    assert main(["check", str(folder / "study.yaml")]) == 2
    assert "study.yaml:4: robot: ender:Robot cannot be made: SystemExit: 0" in capsys.readouterr().err


OWN = """
import sys
import casadi as ca
import oed


class Robot(oed.Model):
    kind: str = "own"
    inputs = (oed.Input("v", "wheel_speed", "rad/s"), oed.Input("w", "wheel_speed", "rad/s"))

    @property
    def parameters(self):
        return (oed.Parameter("gain", 1.0, ""), oed.Parameter("turn", 0.5, ""))

    def twist(self, inputs, parameters):
        return ca.vertcat(parameters[0] * inputs[0], 0, parameters[1] * inputs[1])

"""


def own(folder: Path, more: str = "", **changes: str) -> oed.Study:
    """A study of the robot above with further lines of its class, and other words in it."""
    text = OWN + more
    for old, new in changes.items():
        text = text.replace(old, new)
    (folder / "own.py").write_text(text)
    return load(folder, "own:Robot", **{"gain: 0.9": "body_radius: 0.1"})


def refused(folder: Path, more: str = "", **changes: str) -> str:
    """What is said of it, in the one issue that it has, by the line of the robot."""
    with pytest.raises(StudyError) as caught:
        own(folder, more, **changes)
    (issue,) = caught.value.issues
    assert (issue.key, issue.line) == ("robot", 4)
    assert len(str(issue)) < 1000
    assert "prototypes" not in issue.message
    return issue.message


class TestNames:
    """What a robot calls its parts can be saved, and read again."""

    @pytest.mark.parametrize("name", ["soft ness", "../../x", "\\x1b[2J", 181 * "a", "a\\n"])
    @pytest.mark.parametrize(
        ("old", "new"), [('"gain"', '"{}"'), ('"v"', '"{}"'), ('"w", "wheel_speed"', '"w", "{}"')]
    )
    def test_no_such_name(self, folder: Path, old: str, new: str, name: str):
        said = refused(folder, **{old: new.format(name)})
        assert "expected a name of letters, digits, underscores and dots" in said

    def test_no_such_name_of_a_state(self, folder: Path):
        said = refused(folder, further_state("hitch angle", "rad"))
        assert "states: expected a name of letters" in said

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ('"turn"', '"gain"', "parameters: a second one named 'gain'"),
            ('"w", "wheel_speed"', '"v", "wheel_speed"', "inputs: a second one named 'v'"),
            ('"w", "wheel_speed"', '"x", "wheel_speed"', "inputs and states: a second one named 'x'"),
            ('"w", "wheel_speed"', '"t", "wheel_speed"', "inputs and states: a second one named 't'"),
            ('"w", "wheel_speed"', '"run", "wheel_speed"', "inputs and states: a second one named 'run'"),
            ('0.5, ""', '0.5, "\\x1b[2J"', "turn: expected a unit"),
            ('0.5, ""', "0.5, None", "turn: expected a unit"),
            ("0.5", "1e13", "turn: expected a finite nominal value of at most 1e+12"),
            ("0.5", "'fast'", "ValueError"),
            ('0.5, ""', '0.5, "", -1.0', "turn: expected a size of at least 0"),
            ('"wheel_speed", "rad/s"))', '"wheel_speed", "rad/s", float("nan")))', "w: expected `below`"),
        ],
    )
    def test_other_mistakes_of_its_tables(self, folder: Path, old: str, new: str, words: str):
        assert words in refused(folder, **{old: new})

    def test_far_too_many(self, folder: Path):
        said = refused(folder, **{'0.5, ""))': '0.5, "")) * 150_000'})
        assert "parameters: expected at most 200, got 300000" in said

    @pytest.mark.parametrize("states", ["('x', 'y')", "('a', 'b', 'c')", "'abc'"])
    def test_states_that_are_no_pose(self, folder: Path, states: str):
        assert "states: expected" in refused(folder, f"    states = {states}\n")


def further_state(name: str = "lag", unit: str = "rad") -> str:
    """Lines of a class with a state after the pose, which stays as it is."""
    return f"""
    states = ("x", "y", "heading", "{name}")
    state_units = ("m", "m", "rad", "{unit}")

    def internal_step(self, state, twist, parameters, period):
        return state[3]
"""


def member(name: str, body: str) -> str:
    """Lines of a class that say otherwise what a robot has or does."""
    lines = f"    def {name}(self, *given):\n        {body}\n"
    names = ("state_units", "states", "coefficient_names", "short_forms", "inputs", "parameters")
    return f"    @property\n{lines}" if name in names else lines


class TestEveryMember:
    """All that is ever asked of a robot is asked where it is named."""

    @pytest.mark.parametrize("name", ["state_units", "states", "coefficient_names", "short_forms", "inputs"])
    @pytest.mark.parametrize("body", ["return None", "return ((1, 2), (3,))"])
    def test_what_is_no_tuple_of_texts(self, folder: Path, name: str, body: str):
        assert f"{name}: expected" in refused(folder, member(name, body))

    @pytest.mark.parametrize("name", ["effective_inputs", "mean_twist", "internal_step", "coefficients"])
    @pytest.mark.parametrize("body", ["return None", "return ((1, 2), (3,))"])
    def test_what_is_no_expression(self, folder: Path, name: str, body: str):
        names = "    coefficient_names = (('a', 'b'), ('c', 'd'))\n"
        assert f"{name}: expected" in refused(folder, names + member(name, body))

    @pytest.mark.parametrize(
        "name", ["state_units", "effective_inputs", "mean_twist", "internal_step", "short_forms", "twist"]
    )
    def test_what_fails_is_told_with_its_line(self, folder: Path, name: str):
        said = refused(folder, member(name, "raise RuntimeError('two\\nlines')"))
        assert f"RuntimeError: two lines (own.py, line {self.line(folder)})" in said

    @pytest.mark.parametrize(
        ("body", "words"),
        [
            ("sys.exit(0)  # raise", "SystemExit: 0"),
            ("raise type('E', (Exception,), {'__str__': lambda self: 5})", "E:"),
            ("raise type('E', (Exception,), {'__str__': lambda self: 1 / 0})", "E:"),
            ("raise ValueError(10**6 * 'x')", "xxx..."),
        ],
    )
    @pytest.mark.parametrize("name", ["state_units", "twist"])
    def test_whatever_fails_is_told_with_its_line(self, folder: Path, name: str, body: str, words: str):
        said = refused(folder, member(name, body))
        assert f"{words} (own.py, line {self.line(folder)})" in said

    def line(self, folder: Path) -> int:
        """The line of the robot's file that fails."""
        lines = (folder / "own.py").read_text().splitlines()
        return next(number for number, line in enumerate(lines, 1) if "raise" in line)

    @pytest.mark.parametrize(
        ("more", "words"),
        [
            ("    state_units = ('m', 'm')\n", "state_units: expected 3, one of each state, got 2"),
            (further_state(unit="\\x1b"), "lag: expected a unit"),
            ("    coefficient_names = (('a', 'b'),)\n", "coefficient_names: expected 2 or 3 rows"),
            ("    coefficient_names = (('a', 'b'), ('c',))\n", "coefficient_names: expected 2 or 3 rows"),
            (
                "    coefficient_names = (('a', 'b'), ('c', 'a'))\n",
                "coefficient_names: a second one named 'a'",
            ),
            ("    coefficient_names = (('a', 'b'), ('c', '.'))\n", "coefficient_names: expected a name of"),
            ("    coefficient_names = (('a', 'b'), ('c', 'd'))\n", "not linear in coefficients"),
            (member("mean_twist", "return given[1][:2]"), "mean_twist: expected (3, 1), got (2, 1)"),
            (member("internal_step", "return given[1]"), "internal_step: expected (0, 1), got (3, 1)"),
        ],
    )
    def test_parts_that_do_not_fit_each_other(self, folder: Path, more: str, words: str):
        assert words in refused(folder, more)

    def test_one_that_has_everything_is_taken(self, folder: Path):
        more = further_state() + "    coefficient_names = (('a', 'b'), ('c', 'd'))\n"
        more += member("coefficients", "return ca.diag(given[0])") + member("short_forms", "return ('both',)")
        model = own(folder, more).problem.model
        assert model.states[3:] == ("lag",)
        assert model.short_forms == ("both",)

    def test_what_fails_later_is_named_too(self, folder: Path, monkeypatch: pytest.MonkeyPatch):
        model = own(folder).problem.model
        monkeypatch.setattr(type(model).__mro__[1], "twist", lambda *_: sys.exit(3))
        with pytest.raises(UserMistake, match="own:Robot: twist: SystemExit: 3"):
            model.twist(ca.DM([1, 1]), ca.DM([1, 1]))


class TestStreams:
    """What a module does to the program's streams stays within it."""

    @pytest.mark.parametrize(
        "line",
        ["sys.stdout.close()", "sys.stdout = sys.stderr = None", "sys.stderr.close()", "print('hello')"],
    )
    @pytest.mark.slow
    def test_the_answer_is_told_all_the_same(self, folder: Path, line: str, capsys):
        own(folder)
        (folder / "own.py").write_text(OWN.replace("import sys", f"import sys; {line}"))
        assert main(["check", str(folder / "study.yaml"), "--json"]) == 0
        out, err = capsys.readouterr()
        assert out.startswith("{")
        assert out.endswith("}\n")
        assert err == ("hello\n" if "hello" in line else "")
