"""Encoders of steered wheels, with a range and a zero of their own; wheels logged by their rims."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logged import INPUTS, ROBOT, cells, drive, form, found, issue_of, read_one, write

from oed.kernel.dynamics.system import Input
from oed.robots.models import Ackermann, DifferentialDrive, Mecanum, Model, Tricycle, Unicycle
from oed.robots.models.model import CoefficientRobot

TABLE = drive(120)
TRICYCLE = Tricycle(wheel_radius=0.3, wheelbase=1.6)
STEERED = ("t", "wheel_speed", "steering_angle", "x", "y", "heading")
ANGLES = 0.9 * np.sin(0.8 * TABLE[:, 0])
MEANS = (ANGLES[1:] + ANGLES[:-1]) / 2
"""Of a steering angle that runs in straight lines from row to row [rad]."""


def steering_file(tmp_path: Path, logged: np.ndarray) -> Path:
    table = TABLE.copy()
    table[:, 2] = logged
    return write(tmp_path / "a.csv", cells(table), STEERED)


def steered(**keys) -> dict:
    """The keys of a log whose steering column is of some form."""
    return {"model": TRICYCLE, "inputs": {"steering_angle": {"column": "steering_angle", **keys}}}


def means_read(tmp_path: Path, logged: np.ndarray, **keys) -> np.ndarray:
    """Mean steering angles between rows, of a column as logged."""
    log = read_one(steering_file(tmp_path, logged), **steered(**keys))
    return log.inputs_between(log.input_times)[:, 1]


class TestSteeringEncoders:
    @pytest.mark.parametrize("sign", [1, -1])
    @pytest.mark.parametrize("zero", [3, 2048, 4090])
    def test_ticks_that_wrap_about_any_zero(self, tmp_path: Path, zero: int, sign: int):
        ticks = np.mod(np.round(sign * ANGLES / (2 * np.pi) * 4096) + zero, 4096)
        keys = {"form": "ticks", "ticks_per_turn": 4096, "cumulative": True, "wrap": 4096, "zero": zero}
        means = means_read(tmp_path, ticks, **keys, sign=sign)
        np.testing.assert_allclose(means, MEANS, atol=np.pi / 4096)

    def test_geared_ticks_without_a_range(self, tmp_path: Path):
        ticks = np.round(ANGLES / (2 * np.pi) * 500 * 12) + 70_000
        keys = {"form": "ticks", "ticks_per_turn": 500, "gear": 12, "cumulative": True, "zero": 70_000}
        np.testing.assert_allclose(means_read(tmp_path, ticks, **keys), MEANS, atol=np.pi / 6000)

    def test_ticks_since_the_row_before_begin_straight_ahead(self, tmp_path: Path):
        counts = np.diff(np.round(ANGLES / (2 * np.pi) * 4096), prepend=0.0)
        means = means_read(tmp_path, counts, form="ticks", ticks_per_turn=4096)
        np.testing.assert_allclose(means, MEANS, atol=np.pi / 4096)

    @pytest.mark.parametrize(("unit", "turn"), [("deg", 360.0), ("turn", 1.0), ("rad", 2 * np.pi)])
    def test_an_angle_that_wraps_in_any_unit(self, tmp_path: Path, unit: str, turn: float):
        logged = np.mod(ANGLES / (2 * np.pi) * turn + 0.05 * turn, turn)
        means = means_read(tmp_path, logged, form="angle", unit=unit, wrap=turn, zero=0.05 * turn)
        np.testing.assert_allclose(means, MEANS, atol=1e-7)

    def test_that_it_begins_anew_is_noted(self, tmp_path: Path):
        degrees = np.mod(np.degrees(ANGLES), 360)
        around = np.count_nonzero(np.abs(np.diff(degrees)) > 180)
        keys = steered(form="angle", unit="deg", wrap=360)
        log = read_one(steering_file(tmp_path, degrees), **keys)
        assert found(log) == {"counter_wrapped": f"counters began anew {around} times; unwrapped"}

    def test_a_value_that_wraps_is_refused(self, tmp_path: Path):
        degrees = np.mod(np.degrees(ANGLES[:90]), 360)
        table = TABLE[:90].copy()
        table[:, 2] = degrees
        file = write(tmp_path / "a.csv", cells(table), STEERED)
        issue = issue_of(file, **steered(unit="deg"))
        steps = np.abs(np.diff(degrees))
        row = int(np.argmax(steps))
        assert (issue.line, issue.key) == (row + 3, "steering_angle")
        advice = "if it begins anew, say `form: angle` and `wrap:` its range"
        assert issue.message == f"the steering angle jumps by {steps[row]:.4g} deg; {advice}"

    def test_a_wrong_range_and_none_are_refused(self, tmp_path: Path):
        file = steering_file(tmp_path, np.mod(np.round(ANGLES / (2 * np.pi) * 4096), 4096))
        ticks = {"form": "ticks", "ticks_per_turn": 4096, "cumulative": True}
        assert "more than `wrap: 1024` allows" in issue_of(file, **steered(**ticks, wrap=1024)).message
        assert "say `wrap: 4096`" in issue_of(file, **steered(**ticks)).message


def rims_file(tmp_path: Path, factor: float) -> Path:
    table = TABLE.copy()
    table[:, 1:3] *= factor
    return write(tmp_path / "a.csv", cells(table))


def wheels(**keys) -> dict:
    return {"inputs": {name: {"column": name, **keys} for name in INPUTS}}


class TestRims:
    """A wheel logged in m/s is turned into rad/s by the nominal radius of its own, or by another."""

    def test_speeds_by_the_nominal_radius(self, tmp_path: Path):
        log = read_one(rims_file(tmp_path, 0.05), **wheels(unit="m/s"))
        np.testing.assert_allclose(log.inputs_between(log.input_times), TABLE[:-1, 1:3], rtol=1e-9)
        assert found(log) == {
            "rim_speeds": "the wheels are logged by their rims, turned into angles by the nominal radii: "
            "wheel_speed_right by 50 mm and wheel_speed_left by 50 mm"
        }

    def test_each_wheel_by_its_own_radius(self, tmp_path: Path):
        robot = DifferentialDrive(wheel_radius_right=0.05, wheel_radius_left=0.1, track=0.2)
        log = read_one(rims_file(tmp_path, 0.05), robot, **wheels(unit="m/s"))
        np.testing.assert_allclose(log.inputs_between(log.input_times), TABLE[:-1, 1:3] / [1, 2], rtol=1e-9)

    def test_a_radius_that_is_given_needs_no_word(self, tmp_path: Path):
        log = read_one(rims_file(tmp_path, 100.0), **wheels(unit="mm/s", radius="10 cm"))
        np.testing.assert_allclose(log.inputs_between(log.input_times), TABLE[:-1, 1:3], rtol=1e-9)
        assert found(log) == {}

    def test_the_way_of_a_rim(self, tmp_path: Path):
        table = TABLE.copy()
        turned = np.cumsum(TABLE[:-1, 1:3] * np.diff(TABLE[:, 0])[:, None], axis=0)
        table[1:, 1:3], table[0, 1:3] = 50 * turned, 0
        log = read_one(write(tmp_path / "a.csv", cells(table)), **wheels(form="angle", unit="mm"))
        np.testing.assert_allclose(log.inputs_between(log.input_times), TABLE[:-1, 1:3], rtol=1e-7)

    def test_every_wheel_knows_its_radius(self):
        radii = {f"wheel_radius_{place}": 0.05 + 0.01 * at for at, place in enumerate(Mecanum.places)}
        unequal = Mecanum(half_wheelbase_plus_half_track=0.3, **radii)
        for robot, expected in (
            (ROBOT, [0.05, 0.05]),
            (TRICYCLE, [0.3, 0.0]),
            (Ackermann(wheel_radius=0.2, wheelbase=1), [0.2, 0.0]),
            (Unicycle(), [0.0, 0.0]),
            (unequal, list(radii.values())),
            (CoefficientRobot(base=ROBOT), [0.05, 0.05]),
        ):
            assert [robot.lever(entry) for entry in robot.inputs] == expected

    def test_a_robot_that_says_of_no_radius(self):
        class Bare(DifferentialDrive):
            def lever(self, entry: Input) -> float:
                return 0.0

        robot: Model = Bare(wheel_radius=0.05, track=0.2)
        (issue,) = form(inputs={INPUTS[0]: {"column": 1, "unit": "m/s"}}).issues(robot)
        assert issue.key == ("log", "inputs", INPUTS[0], "unit")
        assert issue.message == "m/s is the speed of a rim; say of which `radius` the wheel is"
        assert not form(inputs={INPUTS[0]: {"column": 1, "unit": "m/s", "radius": "5 cm"}}).issues(robot)

    def test_a_yaw_rate_has_no_rim(self):
        (issue,) = form(inputs={"omega": {"column": 1, "unit": "m/s", "radius": "5 cm"}}).issues(Unicycle())
        assert "whose unit is of another kind" in issue.message
        (issue,) = form(inputs={"v": {"column": 1, "unit": "m/s", "radius": "5 cm"}}).issues(Unicycle())
        assert issue.key == ("log", "inputs", "v", "radius")
        assert issue.message == "is that of a wheel's rim, and v has none; leave it out"


def test_a_column_is_one_quantity():
    same = {INPUTS[0]: "w", INPUTS[1]: "w"}
    (issue,) = form(inputs=same).issues(ROBOT)
    assert issue.key == ("log", "inputs", INPUTS[1])
    assert issue.message == f"column w is read as inputs.{INPUTS[0]} already; name another"
    (issue,) = form(time="x").issues(ROBOT)
    assert (issue.key, issue.message.partition(" already")[0]) == (
        ("log", "poses", "x"),
        "column x is read as time",
    )
    (issue,) = form(poses={"heading": "y"}).issues(ROBOT)
    assert issue.key == ("log", "poses", "heading")
    # Columns of another file are others.
    assert not form(time="x", poses={"file": "{stem}_poses.csv"}).issues(ROBOT)
