"""Lists and names where they mean something, and words for what is something else than it is to be."""

from __future__ import annotations

import inspect
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
import pint
import pytest
from builders import problem_of, random_drive

import oed
from oed.foundation.arguments import WrongKind, require_count
from oed.foundation.errors import PartError
from oed.kernel.solution import unscored
from oed.robots import limits

POSES = oed.Poses(noise={"position": 0.01, "heading": 0.01})
GYRO = oed.YawRate(noise=0.01)


class Voltage(oed.Model):
    """A robot whose input no limit of the package bounds."""

    kind: Literal["voltage"] = "voltage"
    inputs: ClassVar = (oed.Input("u", "motor_voltage", "V"),)
    parameters: ClassVar = (oed.Parameter("gain", 1.0, ""),)

    def twist(self, inputs, parameters):
        """Straight on."""
        return ca.vertcat(parameters[0] * inputs[0], 0, 0)


class TwoRows(Voltage):
    """A robot that forgets its yaw rate."""

    def twist(self, inputs, parameters):
        """One row too few."""
        return ca.vertcat(parameters[0] * inputs[0], 0)


class Misspelt(oed.Sensor):
    """A sensor with a typing error in its reading."""

    kind: Literal["misspelt"] = "misspelt"

    def reading(self, moment):
        """`pose` is meant."""
        return moment.pos[2]

    def whitening(self, moment):
        """Noise of 1."""
        return ca.SX(1)


def test_problem_shows_the_attribute_error_of_an_own_sensor():
    with pytest.raises(AttributeError, match="Moment has no attribute 'pos'") as caught:
        problem_of(measurement=[POSES, Misspelt()])
    assert "reading" in [frame.name for frame in caught.traceback]
    assert Path(__file__).name in [frame.path.name for frame in caught.traceback[1:]]


def test_drive_shows_the_attribute_error_of_its_properties(monkeypatch: pytest.MonkeyPatch):
    """Attributes of a drive that are not there are signals else."""
    drive = problem_of()._any_drive
    monkeypatch.setattr(type(drive), "runs", property(lambda self: self.system.nonsense))
    with pytest.raises(AttributeError, match="'DifferentialDrive' object has no attribute 'nonsense'"):
        drive.runs  # noqa: B018


def test_a_list_of_sensors_is_the_sensors_together():
    problem = problem_of(measurement=[POSES, GYRO])
    assert problem.sensors == (POSES, GYRO)
    assert problem_of(measurement=oed.Several(sensors=(POSES, GYRO))).sensors == (POSES, GYRO)
    assert problem_of(measurement=(GYRO,)).sensors == problem_of(measurement=GYRO).sensors == (GYRO,)


@pytest.mark.parametrize("kind", [oed.E, oed.D, oed.A])
def test_a_criterion_that_needs_no_options_may_be_named(kind):
    criterion = kind()
    assert problem_of(measurement=POSES, criterion=criterion.kind).criterion == criterion


def test_one_limit_and_one_parameter_need_no_list():
    (limit,) = replace(problem_of(), limits=oed.WheelSpeed(bounds=3)).limits
    assert limit == oed.WheelSpeed(bounds=3)
    assert problem_of(measurement=POSES, estimate="track").estimate == ("track",)


@pytest.mark.parametrize(
    ("parts", "reason"),
    [
        ({"criterion": "EE"}, "criterion: expected one of E, D, A, .*, got 'EE'"),
        ({"criterion": "G"}, "criterion: G needs test_drive as well"),
        ({"criterion": 3}, "criterion: expected a Criterion, got 3"),
        (
            {"measurement": "poses"},
            "measurement: expected a Measurement, got 'poses'; make one with its noise",
        ),
        ({"measurement": []}, "measurement: expected at least one sensor"),
        ({"criterion": "e"}, r"criterion: expected one of .*, got 'e'; did you mean E\?"),
        (
            {"limits": ["wheel_speed"]},
            "limits.0: expected a Limit, got 'wheel_speed'; make one",
        ),
        ({"measurement": [POSES, 3]}, "measurement.1: expected a Sensor, got 3"),
        ({"model": "robot"}, "model: expected a System, got 'robot'"),
        ({"design": {"duration": 3}}, "design: expected a Space, got a dict"),
        ({"limits": {"wheel_speed": 3}}, r"limits: expected a list of limits, got \{'wheel_speed': 3\}"),
        ({"limits": [oed.WheelSpeed(bounds=3), "box"]}, "limits.1: expected a Limit, got 'box'"),
        ({"prior": "little"}, "prior: expected a Prior, got 'little'"),
        (
            {"measurement": POSES, "model": TwoRows()},
            r"robot: expected a twist \(3, 1\).* \(2, 1\)",
        ),
        (
            {"measurement": POSES, "model": Voltage(), "limits": ()},
            r"no limit but your own \(input_bounds\) bounds a motor_voltage \[V\]: make it a wheel_speed",
        ),
    ],
)
def test_a_part_that_is_something_else_is_refused_in_words(parts, reason):
    with pytest.raises(oed.ProblemError, match=reason):
        replace(problem_of(), **parts)


def test_all_wrong_parts_are_named_at_once():
    with pytest.raises(oed.ProblemError) as caught:
        replace(problem_of(), model=1, criterion="none", limits=None)
    assert [issue.key[0] for issue in caught.value.issues] == ["model", "criterion", "limits"]


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        (
            lambda problem, drive: oed.evaluate(problem, drive.inputs),
            "make one of a table with",
        ),
        (
            lambda problem, drive: oed.evaluate(problem, None),
            "trajectory: expected a Trajectory, got None; a solution without a design has none",
        ),
        (lambda problem, drive: oed.evaluate(drive, drive), "problem: expected a Problem, got a Trajectory"),
        (lambda problem, drive: oed.solve(problem, "ipop"), "solver: expected one of ipopt, .*, got 'ipop'"),
        (
            lambda problem, drive: oed.solve(problem, drive),
            "solver: expected a Solver or text, got a",
        ),
        (
            lambda problem, drive: oed.solve(problem, oed.Ipopt),
            r"^solver: expected a Solver or text, got the class Ipopt; write Ipopt\(\)$",
        ),
        (
            lambda problem, drive: oed.solve(oed.Problem),
            r"^problem: expected a Problem, got the class Problem; write Problem\(\.\.\.\)$",
        ),
        (
            lambda problem, drive: oed.solve(problem, oed.Poses),
            "^solver: expected a Solver or text, got the class Poses$",
        ),
        (
            lambda problem, drive: oed.solve(problem, seed=-1),
            "seed: expected a whole .* at least 0, got -1",
        ),
        (
            lambda problem, drive: oed.solve(problem, seed=10**100),
            "seed: expected a whole number of at most 100 digits, got 1000",
        ),
        (
            lambda problem, drive: oed.validate(problem, drive, seed=10**5000),
            "seed: expected a whole number of at most 100 digits, got a number of thousands",
        ),
        (
            lambda problem, drive: oed.solve(problem, workers=0),
            "workers: expected a whole number of at least 1, got 0",
        ),
        (
            lambda problem, drive: oed.validate(problem, drive, workers=-2),
            "workers: expected a whole number of at least 1, got -2",
        ),
        (
            lambda problem, drive: oed.bound(problem, nodes=-1),
            "nodes: expected a whole number of at least 1, got -1",
        ),
        (lambda problem, drive: oed.bound("study.yaml"), "problem: expected a Problem, got 'study.yaml'"),
        (
            lambda problem, drive: oed.run(problem),
            "study: expected a Study, got a Problem; make one",
        ),
        (
            lambda problem, drive: oed.validate(problem, drive, replicates="9"),
            "expected a whole number",
        ),
        (lambda problem, drive: oed.estimate("a.yaml", ["a.csv"]), "study: .* got 'a.yaml'; read one with"),
    ],
)
def test_an_argument_that_is_something_else_is_refused_in_words(flagship, call, reason):
    with pytest.raises(WrongKind, match=reason):
        call(flagship, random_drive(flagship, 0))


def test_such_an_error_is_the_users_mistake_and_pythons_type_error():
    assert issubclass(WrongKind, oed.UserMistake)
    assert issubclass(WrongKind, TypeError)
    with pytest.raises(WrongKind):
        require_count("seed", True)


def test_one_replicate_is_refused():
    problem = problem_of(measurement=POSES)
    reason = "replicates: expected at least 4, one more than there are parameters, got 1"
    with pytest.raises(oed.ProblemError, match=reason):
        oed.validate(problem, random_drive(problem, 0), replicates=1)


@pytest.mark.slow
def test_a_solver_may_be_named(three_segments, monkeypatch):
    asked = []

    def search(options, problem, context):
        asked.append(options)
        return unscored(options.label, options.kind, "nothing")

    monkeypatch.setattr("oed.optimize.search_with_assurance", search)
    monkeypatch.setattr("oed.optimize.require_identifiable", lambda problem: None)
    for named in ("genetic", None, "ipopt"):
        oed.solve(three_segments, named)
    assert asked == [oed.Genetic(), oed.Ipopt(), oed.Ipopt()]


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (
            lambda: oed.DesignSpace(duration=-1, samples=10),
            r"DesignSpace\.duration: expected more than 0, got -1",
        ),
        (lambda: oed.Ipopt(starts="many"), r"Ipopt\.starts: expected a whole number, got 'many'"),
        (lambda: oed.DifferentialDrive(wheel_radius="5 kg", track=1), "wheel_radius: expected a length"),
        (
            lambda: oed.Poses(noise={"postion": "1 cm"}),
            r"Poses\.noise\.postion: unknown key; did you mean position\?",
        ),
        (
            lambda: oed.E(scaling="foo"),
            r"^E\.scaling: expected 'relative' or 'none', got 'foo'; or expected keys",
        ),
        (
            lambda: oed.Ipopt(seed=10**100),
            r"^Ipopt\.seed: expected a whole number of at most 100 digits, got 1",
        ),
        (
            lambda: oed.Ipopt(name="a/b"),
            "^Ipopt.name: expected a name of letters, digits, spaces, _ and -, which begins with a letter, a "
            "digit or _, got 'a/b'$",
        ),
        (
            lambda: oed.Ipopt(**{f"key{number:02}": 1 for number in range(40)}),
            r"^Ipopt\.key00: unknown key; known here: .*\n(Ipopt\.key0[123]: .*\n){3}"
            r"Ipopt\.key04: unknown key, as are 35 more beside it$",
        ),
        (lambda: oed.Ranges(), r"^Ranges\.beacons: missing\nRanges\.noise: missing$"),
        (lambda: oed.Ipopt(startz=3), r"Ipopt\.startz: unknown key; did you mean starts\? known here: "),
    ],
)
def test_parts_made_in_python_are_refused_in_words_without_addresses(make, reason):
    with pytest.raises(PartError, match=reason) as caught:
        make()
    assert "http" not in str(caught.value)


def study() -> oed.Study:
    return oed.load_study("problems/room_robot.yaml")


@pytest.mark.parametrize("name", oed.__all__)
def test_every_public_function_refuses_in_words_what_it_cannot_take(name: str):
    function = getattr(oed, name)
    parameters = inspect.signature(function).parameters.values()
    needed = {one.name: object() for one in parameters if one.default is one.empty}
    first = next(iter(needed))
    with pytest.raises(WrongKind, match=f"^{name}: missing a required argument: '{first}'; it takes {first}"):
        function()
    with pytest.raises(WrongKind, match=f"^{name}: got an unexpected keyword argument 'nonsense'"):
        function(**needed, nonsense=1)
    with pytest.raises(WrongKind, match=f"^{first}: expected .*, got an object$"):
        function(**needed)


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        (lambda: oed.load_study(5), "file: expected a path, got 5"),
        (lambda: oed.animate(5), "source: expected a Record or a path, got 5"),
        (lambda: oed.read_logs("log.csv", oed.CsvForm(), None), "files: expected a list, got 'log.csv'"),
        (lambda: oed.read_logs(["a.csv", 3], oed.CsvForm(), None), "files: entry 1: expected a path, got 3"),
        (lambda: oed.estimate(study(), [3]), "logs: entry 0: expected a path, got 3"),
        (
            lambda: oed.estimate(study(), "a.csv", seed=-1),
            "seed: expected a whole number of at least 0, got -1",
        ),
        (lambda: oed.export("here", "csv", rate="fast"), "rate: expected a number, got 'fast'"),
        (lambda: oed.export("here", "csv", rat=3), r"unexpected keyword argument 'rat'; did you mean rate\?"),
        (
            lambda: oed.Problem(1, 2, 3, 4),
            "Problem: missing a required argument: 'criterion'; it takes model, ",
        ),
    ],
)
def test_calls_that_cannot_be_are_refused_in_words(call, reason):
    with pytest.raises(WrongKind, match=reason):
        call()


def test_no_logs_are_said_without_a_place():
    with pytest.raises(oed.LogError, match=r"^no logs were given$"):
        oed.estimate(study(), [])


@pytest.mark.parametrize(("name", "reason"), [("a\0b", "null byte"), ("a" * 5000, "File name too long")])
def test_names_that_no_file_has_are_refused_in_words(name: str, reason: str):
    with pytest.raises(oed.LogError, match=f"cannot be read: .*{reason}"):
        oed.estimate(study(), name)


def test_arguments_go_by_name():
    with pytest.raises(WrongKind, match=r"WheelSpeed: expected arguments by name \(bounds, each\), got 10"):
        oed.WheelSpeed(10)


def test_limits_and_sensors_of_the_same_quantity_have_names_of_their_own():
    assert issubclass(oed.YawRateLimit, oed.Limit)
    assert issubclass(oed.YawRate, oed.Sensor)
    assert issubclass(oed.TrailerAngleLimit, oed.PathLimit)
    assert issubclass(oed.TrailerAngle, oed.Sensor)
    assert limits.YawRate is oed.YawRateLimit
    assert oed.YawRateLimit.name == "yaw_rate"


def test_a_study_takes_names_as_well():
    study = oed.load_study("problems/laser_tracker.yaml").changed(criterion="D", solvers=["genetic"])
    assert study.problem.criterion == oed.D()
    assert study.solvers == (oed.Genetic(),)
    assert np.isfinite(study.problem.input_bounds).all()


class OneBound(oed.BareLimit):
    """A limit with one bound for all of its rows."""

    name, looks_at = "mine", "state"

    def rows(self, drive):
        """Within a centimetre."""
        return oed.Rows(drive.path[:, 0], np.array([-0.01]), np.array([0.01]), 1.0, "m")


class Number(OneBound):
    """A limit whose rows are a number."""

    def rows(self, drive):
        """None."""
        return 5


class TooWide(Misspelt):
    """A sensor whose whitening is of another size."""

    kind: Literal["too_wide"] = "too_wide"

    def reading(self, moment):
        """One entry."""
        return moment.pose[0]

    def whitening(self, moment):
        """Of two entries."""
        return ca.SX.eye(2)


def test_limit_with_one_bound_for_many_rows_is_refused():
    problem = problem_of(also=(OneBound(),))
    with pytest.raises(ValueError, match=r"rows: expected \d+ of lower, as of its expression, got \(1,\)"):
        oed.evaluate(problem, random_drive(problem, 0))


def test_limit_whose_rows_are_a_number_is_refused():
    problem = problem_of(also=(Number(),))
    with pytest.raises(WrongKind, match=r"limits.mine: rows: expected a Rows, got 5"):
        oed.evaluate(problem, random_drive(problem, 0))


def test_whitening_of_another_size_than_the_reading_is_refused():
    with pytest.raises(oed.UserMistake, match=r"whitening of too_wide: expected \(1, 1\).*got \(2, 2\)"):
        problem_of(measurement=TooWide())


@pytest.mark.parametrize(
    ("inputs", "reason"),
    [
        (np.ones((4, 2)) + 1j, "complex"),
        (np.ma.masked_greater(np.ones((4, 2)), 0), "masked"),
        ([[1.0, 2.0], [3.0]], "array of numbers"),
        ([["fast", "slow"]], "array of numbers"),
    ],
)
def test_inputs_that_are_no_real_numbers_are_refused(inputs: object, reason: str):
    with pytest.raises(WrongKind, match=f"inputs: expected .*{reason}"):
        oed.Trajectory.from_samples(inputs, 4.0, [0, 0, 0])
    with pytest.raises(WrongKind, match="start: expected real numbers"):
        oed.Trajectory.from_samples(np.ones((4, 2)), 4.0, np.zeros(3) + 1j)


def test_inputs_with_a_unit_are_refused():
    quantities = np.ones((4, 2)) * pint.UnitRegistry()("deg/s")
    with pytest.raises(WrongKind, match=r"inputs: .* with a unit"):
        oed.Trajectory.from_samples(quantities, 4.0, [0, 0, 0])


def test_lengths_are_taken_as_text_and_as_numbers_of_numpy():
    assert oed.Trajectory.from_samples(np.ones((4, 2)), "4 s", [0, 0, 0]).duration == 4
    robot = oed.DifferentialDrive(wheel_radius=np.float32(0.5), track=np.int64(2))
    assert robot == oed.DifferentialDrive(wheel_radius=0.5, track=2.0)


def test_estimate_that_is_no_name_is_refused():
    with pytest.raises(oed.ProblemError, match=r"estimate: expected names of parameters, got \[1\]"):
        problem_of(estimate=[1])


def test_arrays_of_an_evaluation_are_read_only():
    problem = problem_of()
    evaluation = oed.evaluate(problem, random_drive(problem, 0))
    for array in (evaluation.states, evaluation.path, evaluation.singular_values):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 7.0
