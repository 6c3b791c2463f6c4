"""The parameter file of ros2_control's diff_drive_controller."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
import yaml
from export_records import MECANUM, saved, study_of

from oed.exporters import diff_drive_parameters, export
from oed.foundation.errors import RecordError, UserMistake
from oed.robots.limits import BodySpeed, WheelAcceleration, WheelSpeed, YawRate
from oed.robots.models import (
    DifferentialDrive,
    Model,
    OffsetDrive,
    PythonRobot,
    SkidSteer,
    SkidSteerIcr,
    TractorTrailer,
    Tricycle,
)

DIFFERENTIAL = DifferentialDrive(wheel_radius_right=0.051, wheel_radius_left=0.049, track=0.2)
SKID = SkidSteer(wheel_radius=0.165, track=0.55, slip_outer=0.2, slip_inner=-0.1)
ICR = SkidSteerIcr(
    wheel_radius=0.1, y_icr_left=0.4, y_icr_right=-0.3, x_icr=0.02, alpha_right=0.9, alpha_left=0.8
)
ESTIMATED = {"wheel_radius_right": 0.0419, "wheel_radius_left": 0.0431, "track": 0.1873}


def parsed(text: str) -> dict[str, Any]:
    data = yaml.safe_load(text)
    assert list(data) == ["diff_drive_controller"]
    assert list(data["diff_drive_controller"]) == ["ros__parameters"]
    return dict(data["diff_drive_controller"]["ros__parameters"])


def parameters(model: Model, *arguments: Any, **options: Any) -> dict[str, Any]:
    return parsed(diff_drive_parameters(model, *arguments, **options))


def comment(text: str) -> str:
    return " ".join(line.removeprefix("# ") for line in text.splitlines() if line.startswith("#"))


def controller(found: dict[str, Any], speeds: np.ndarray) -> tuple[float, float]:
    """Forward speed and yaw rate that the controller takes wheel speeds (right, left) for."""
    right = found["right_wheel_radius_multiplier"] * found["wheel_radius"] * speeds[0]
    left = found["left_wheel_radius_multiplier"] * found["wheel_radius"] * speeds[1]
    separation = found["wheel_separation_multiplier"] * found["wheel_separation"]
    return (right + left) / 2, (right - left) / separation


def effective(found: dict[str, Any]) -> tuple[float, float, float]:
    """Right and left radius and separation that the controller works with."""
    radius = found["wheel_radius"]
    return (
        radius * found["right_wheel_radius_multiplier"],
        radius * found["left_wheel_radius_multiplier"],
        found["wheel_separation"] * found["wheel_separation_multiplier"],
    )


class TestGeometry:
    def test_nominal(self):
        found = parameters(DIFFERENTIAL)
        assert found == {
            "type": "diff_drive_controller/DiffDriveController",
            "left_wheel_names": ["wheel_left_joint"],
            "right_wheel_names": ["wheel_right_joint"],
            "wheels_per_side": 1,
            "wheel_separation": 0.2,
            "wheel_radius": pytest.approx(0.05),
            "wheel_separation_multiplier": 1.0,
            "left_wheel_radius_multiplier": pytest.approx(0.98),
            "right_wheel_radius_multiplier": pytest.approx(1.02),
        }

    def test_estimates_are_in_the_multipliers(self):
        found = parameters(DIFFERENTIAL, ESTIMATED)
        assert (found["wheel_radius"], found["wheel_separation"]) == pytest.approx((0.05, 0.2))
        assert effective(found) == pytest.approx((0.0419, 0.0431, 0.1873), rel=1e-12)

    def test_what_is_not_given_is_nominal(self):
        assert effective(parameters(DIFFERENTIAL, {"track": 0.21})) == pytest.approx((0.051, 0.049, 0.21))

    @pytest.mark.parametrize("speeds", [(3.0, 5.0), (-2.0, 4.0), (1.0, 0.0)])
    def test_the_controller_then_moves_as_the_robot(self, speeds: tuple[float, float]):
        expected = oracle.differential_twist(np.array(speeds), *ESTIMATED.values())
        forward, yaw_rate = controller(parameters(DIFFERENTIAL, ESTIMATED), np.array(speeds))
        assert (forward, 0.0, yaw_rate) == pytest.approx(tuple(expected))

    @pytest.mark.parametrize(
        "model",
        [
            TractorTrailer(wheel_radius=0.05, track=0.2, trailer_length=0.4),
            OffsetDrive(wheel_radius=0.05, track=0.2, sensor_offset=0.01),
            PythonRobot(
                object="oed.robots.models.differential_drive:DifferentialDrive", wheel_radius=0.05, track=0.2
            ).made(Model),
        ],
        ids=lambda model: model.kind,
    )
    def test_other_robots_with_two_wheels(self, model: Model):
        assert effective(parameters(model)) == pytest.approx((0.05, 0.05, 0.2))

    @pytest.mark.parametrize("speeds", [(4.0, -4.0), (-2.0, 2.0), (3.0, 3.0), (-3.0, -3.0)])
    def test_slip_on_the_spot_and_straight_ahead(self, speeds: tuple[float, float]):
        found = parameters(SKID)
        assert (found["wheel_radius"], found["wheel_separation"]) == pytest.approx((0.165, 0.55))
        # On the spot and straight ahead each side has the mean of both slips: 0.05.
        acting = 0.95 * np.array(speeds)
        expected = oracle.differential_twist(acting, 0.165, 0.165, 0.55)
        assert controller(found, np.array(speeds)) == pytest.approx((expected[0], expected[2]), abs=1e-12)
        twist = np.array(SKID.twist(np.array(speeds), np.array(SKID.nominal))).ravel()
        assert controller(found, np.array(speeds)) == pytest.approx((twist[0], twist[2]), abs=1e-12)

    def test_centres_of_rotation(self):
        found = parameters(ICR, {"y_icr_left": 0.42, "y_icr_right": -0.32})
        assert (found["wheel_radius"], found["wheel_separation"]) == pytest.approx((0.1, 0.7))
        assert effective(found) == pytest.approx((0.09, 0.08, 0.74))
        # Treads at the centres of rotation: 0.09 * 2 and 0.08 * -1, 0.74 m apart.
        _, yaw_rate = controller(found, np.array([2.0, -1.0]))
        assert yaw_rate == pytest.approx((0.18 + 0.08) / 0.74)

    def test_numbers_that_the_controller_reads_as_numbers(self):
        found = parameters(DifferentialDrive(wheel_radius=1.0, track=2.0), limits=[WheelSpeed(bounds=10)])
        # A whole number would be taken for another type, and refused.
        numbers = [value for key, value in found.items() if key.startswith(("wheel_r", "wheel_sep"))]
        numbers += [found["linear"]["x"]["max_velocity"], found["right_wheel_radius_multiplier"]]
        assert {type(value) for value in numbers} == {float}


class TestLimits:
    def test_none(self):
        assert {"linear", "angular"}.isdisjoint(parameters(DIFFERENTIAL))

    def test_those_of_the_wheels(self):
        model = DifferentialDrive(wheel_radius=0.05, track=0.2)
        limits = [WheelSpeed(bounds=(-4, 10)), WheelAcceleration(bounds=20)]
        found = parameters(model, limits=limits)
        assert found["linear"]["x"] == {
            "has_velocity_limits": True,
            "max_velocity": pytest.approx(0.5),
            "min_velocity": pytest.approx(-0.2),
            "has_acceleration_limits": True,
            "max_acceleration": pytest.approx(1.0),
        }
        # On the spot one wheel goes ahead by 10, the other one back by 4.
        assert found["angular"]["z"]["max_velocity"] == pytest.approx(0.05 * 14 / 0.2)
        assert found["angular"]["z"]["min_velocity"] == pytest.approx(-0.05 * 14 / 0.2)
        assert found["angular"]["z"]["max_acceleration"] == pytest.approx(0.05 * 40 / 0.2)

    def test_those_of_the_body_where_they_are_tighter(self):
        limits = [WheelSpeed(bounds=10), BodySpeed(bounds=(-0.1, 0.3)), YawRate(bounds=99.0)]
        found = parameters(DifferentialDrive(wheel_radius=0.05, track=0.2), limits=limits)
        assert (found["linear"]["x"]["min_velocity"], found["linear"]["x"]["max_velocity"]) == (-0.1, 0.3)
        assert found["angular"]["z"]["max_velocity"] == pytest.approx(5.0)
        assert "max_acceleration" not in found["linear"]["x"]

    def test_each_wheel_by_its_own(self):
        each = {"wheel_speed_right": (-10, 10), "wheel_speed_left": (-6, 6)}
        found = parameters(DifferentialDrive(wheel_radius=0.05, track=0.2), limits=[WheelSpeed(each=each)])
        assert found["linear"]["x"]["max_velocity"] == pytest.approx(0.05 * 8)

    def test_the_robot_may_always_stop(self):
        found = parameters(DIFFERENTIAL, limits=[WheelSpeed(bounds=(3, 10))])
        assert found["linear"]["x"]["min_velocity"] == 0.0


class TestMistakes:
    def test_robots_without_two_sides(self, tmp_path: Path):
        known = "differential_drive, tractor_trailer, offset_drive, skid_steer, skid_steer_icr"
        with pytest.raises(UserMistake, match=f"two sides: {known}; not tricycle"):
            diff_drive_parameters(Tricycle(wheel_radius=0.1, wheelbase=0.4))
        folder = saved(tmp_path, study_of(MECANUM))
        with pytest.raises(UserMistake, match=f"two sides: {known}; not mecanum"):
            export(folder, "ros2_yaml")

    def test_values_of_other_parameters(self):
        with pytest.raises(UserMistake, match="has no c21, wheelbase; its parameters are wheel_radius_right"):
            diff_drive_parameters(DIFFERENTIAL, {"c21": 0.02, "wheelbase": 1.0, "track": 0.2})

    @pytest.mark.parametrize("value", [0.0, -0.1, float("nan"), float("inf")])
    def test_values_that_leave_no_robot(self, value: float):
        with pytest.raises(UserMistake, match="positive radii and track"):
            diff_drive_parameters(DIFFERENTIAL, {"track": value})


class TestExport:
    def test_nominal(self, tmp_path: Path):
        file = export(saved(tmp_path, study_of(limits="wheel_acceleration: 20 rad/s^2")), "ros2_yaml")
        assert file == tmp_path / "diff_drive_controller.yaml"
        found = parsed(file.read_text())
        assert effective(found) == pytest.approx((0.051, 0.049, 0.2))
        assert found["linear"]["x"]["max_acceleration"] == pytest.approx(1.0)
        text = comment(file.read_text())
        assert "Study: Out to the robot." in text
        assert "Values: nominal, from the study." in text
        assert "track 0.2 m (nominal)" in text

    def test_no_drive_is_needed(self, tmp_path: Path):
        file = export(saved(tmp_path, study_of(), []), "ros2_yaml", out=tmp_path / "mine.yaml")
        assert file == tmp_path / "mine.yaml"
        assert file.is_file()

    def test_estimated(self, tmp_path: Path):
        folder = saved(tmp_path, study_of())
        entries = [{"name": name, "value": value} for name, value in {**ESTIMATED, "mount_x": 0.1}.items()]
        (folder / "estimate.json").write_text(json.dumps({"parameters": entries}))
        text = export(folder, "ros2_yaml").read_text()
        assert effective(parsed(text)) == pytest.approx(tuple(ESTIMATED.values()))
        said = "Values: estimated, from estimate.json: wheel_radius_right, wheel_radius_left, track."
        assert said in comment(text)
        assert "track 0.1873 m (nominal 0.2 m)" in comment(text)

    def test_estimated_by_a_study_of_no_drive(self, tmp_path: Path):
        echo = {key: value for key, value in study_of().echo().items() if key not in ("trajectory", "limits")}
        entries = [{"name": name, "value": value} for name, value in ESTIMATED.items()]
        kept = {"format": 1, "oed_version": "1", "study": echo, "parameters": entries}
        (tmp_path / "estimate.json").write_text(json.dumps(kept))
        text = export(tmp_path, "ros2_yaml").read_text()
        assert effective(parsed(text)) == pytest.approx(tuple(ESTIMATED.values()))

    @pytest.mark.parametrize(
        "text", ["{", "[]", "{}", '{"parameters": [{"name": "track"}]}', '{"parameters": [1]}']
    )
    def test_an_estimate_that_cannot_be_read(self, tmp_path: Path, text: str):
        folder = saved(tmp_path, study_of())
        (folder / "estimate.json").write_text(text)
        with pytest.raises(RecordError, match=r"estimate\.json: parameters: expected an estimate"):
            export(folder, "ros2_yaml")

    def test_an_estimate_of_something_else(self, tmp_path: Path):
        folder = saved(tmp_path, study_of())
        (folder / "estimate.json").write_text('{"parameters": [{"name": "c21", "value": 0.02}]}')
        with pytest.raises(RecordError, match=r"some of the robot's wheel_radius_right.*; got c21"):
            export(folder, "ros2_yaml")

    def test_what_slips_is_said(self):
        assert "effective track of turning in place" in comment(diff_drive_parameters(SKID))
        assert "effective track of turning in place" in comment(diff_drive_parameters(ICR))

    def test_no_text_breaks_out_of_the_comment(self):
        text = diff_drive_parameters(DIFFERENTIAL, about=["Study: two\nlines: [\n"])
        assert "Study: two lines: [" in comment(text)
        assert effective(parsed(text)) == pytest.approx((0.051, 0.049, 0.2))
