"""Physics robots as they are configured, made from models, and varied."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

import oed
from oed.foundation.component import OneOf
from oed.foundation.errors import PartError, UserMistake
from oed.robots.models import DifferentialDrive, OffsetDrive, SkidSteer, SkidSteerSlip, Tricycle
from oed.robots.presets import preset_names
from oed.simulation.physics import (
    PHYSICS_ROBOTS,
    FourWheels,
    PhysicsRobot,
    TwoWheelsAndCaster,
    Variation,
    drive,
    physics_robot,
)

ANY = TypeAdapter(Annotated[PhysicsRobot, OneOf(PHYSICS_ROBOTS)])
STUDY = """
format: 1
name: A robot that can be bought
robot: {{preset: {name}}}
trajectory: {{duration: 20 s, samples: 40, spline: {{coefficients: 8}}}}
measurement: {{kind: poses, noise: {{position: 1 cm, heading: 1 deg}}}}
estimate: [wheel_radius_right, wheel_radius_left, track]
limits: {{workspace: {{kind: rectangle, x: [-2 m, 2 m], y: [-2 m, 2 m]}}}}
"""


class TestConfiguration:
    def test_is_of_the_papers_size_by_default(self):
        robot = FourWheels()
        assert (robot.radii, robot.track, robot.wheelbase, robot.mass) == ((0.049, 0.049), 0.18, 0.16, 3)

    def test_takes_units_and_a_kind(self):
        robot = ANY.validate_python({"kind": "four_wheels", "wheel_radius": "5 cm", "mass": "2500 g"})
        assert isinstance(robot, FourWheels)
        assert (robot.radii, robot.mass) == ((0.05, 0.05), 2.5)
        assert ANY.validate_python(ANY.dump_python(robot)) == robot

    @pytest.mark.parametrize(
        ("given", "message"),
        [
            ({"wheel_radius_right": 0.05}, "wheel_radius_right and wheel_radius_left"),
            ({"centre_of_mass": (0.1, 0)}, r"between the wheels, got \(0.1, 0.0\).* on rear_right"),
            ({"centre_of_mass": (0, "-10 cm")}, r"nothing would stand on .*_left"),
            ({"grips": (1, 1)}, "as many grips as driven wheels .front_right, .* got 2"),
            ({"step": "2 ms"}, "less than or equal to 0.001"),
            ({"suspension": {"stiffness": 1e5}}, "a step of at most 0.00017 s"),
            ({"motor": {"inertia": 1e-5}}, "a step of at most 2e-05 s"),
            ({"friction": 0}, "greater than 0"),
            ({"tyres": 4}, "tyres"),
        ],
    )
    def test_mistakes_are_refused(self, given: dict[str, object], message: str):
        with pytest.raises(ValidationError, match=message):
            FourWheels.model_validate(given)

    @pytest.mark.parametrize("caster", [0.0, 0.1])
    def test_a_caster_carries_something(self, caster: float):
        with pytest.raises(PartError, match="between the wheels"):
            TwoWheelsAndCaster(caster=caster)

    @pytest.mark.parametrize(
        "robot",
        [FourWheels(centre_of_mass=(0.03, -0.02)), TwoWheelsAndCaster(centre_of_mass=(-0.03, 0.01))],
        ids=lambda robot: robot.kind,
    )
    def test_loads_balance(self, robot: PhysicsRobot):
        weight = robot.mass * 9.81
        assert robot.loads.sum() == pytest.approx(weight)
        places = np.array([[support.ahead, support.left] for support in robot.supports])
        assert robot.loads @ places == pytest.approx(weight * np.array(robot.centre_of_mass))


class TestFromAModel:
    def test_the_papers_robot_is_itself(self):
        robot = physics_robot(SkidSteer(wheel_radius=0.049, track=0.18), wheel_width=0.03)
        same = robot.changed(mass=3.0, motor={}, suspension={}, wheelbase=0.16)
        assert same == FourWheels(wheel_radius_right=0.049, wheel_radius_left=0.049)
        assert isinstance(robot, FourWheels)
        assert (robot.mass, robot.wheelbase) == pytest.approx((3, 0.16))
        assert list(robot.motor.model_dump().values()) == pytest.approx([1, 10, 1, 0.001])
        assert list(robot.suspension.model_dump().values()) == pytest.approx([1000, 40])

    def test_robots_that_skid_have_four_wheels(self):
        slipping = SkidSteerSlip(wheel_radius=0.049, track=0.18, yaw_lag=0.01)
        assert isinstance(physics_robot(slipping), FourWheels)
        assert isinstance(
            physics_robot(DifferentialDrive(wheel_radius=0.049, track=0.18)), TwoWheelsAndCaster
        )

    @pytest.mark.parametrize("name", preset_names())
    def test_every_preset_drives_with_its_geometry(self, name: str):
        model = oed.parse_study(STUDY.format(name=name)).problem.model
        robot = physics_robot(model)
        assert [*robot.radii, robot.track] == pytest.approx(model.nominal[:3])
        assert isinstance(robot, FourWheels if model.kind == "skid_steer" else TwoWheelsAndCaster)
        motion = drive(robot, [(2, 1)] * 3, 0.1)
        assert 0 < motion.poses[-1, 2] < 0.3 * robot.radii[0] / robot.track

    def test_what_is_given_is_taken(self):
        model = SkidSteer(wheel_radius=0.1, track=0.4)
        robot = physics_robot(model, wheelbase=0.3, mass=20, friction=0.5)
        assert isinstance(robot, FourWheels)
        assert (robot.wheelbase, robot.mass, robot.friction) == (0.3, 20, 0.5)

    def test_an_offset_drive_has_two_wheels(self):
        model = OffsetDrive(wheel_radius_right=0.05, wheel_radius_left=0.051, track=0.2)
        assert physics_robot(model).radii == (0.05, 0.051)

    def test_models_without_sides_are_refused(self):
        model = Tricycle(wheel_radius=0.1, wheelbase=1)
        with pytest.raises(UserMistake, match=r"wheel radii and a track.* got tricycle"):
            physics_robot(model)

    def test_two_wheels_have_no_wheelbase(self):
        with pytest.raises(UserMistake, match="no wheelbase of a differential_drive"):
            physics_robot(DifferentialDrive(wheel_radius=0.05, track=0.2), wheelbase=0.2)


class TestVariation:
    SPREAD = Variation(friction=0.1, grip=0.05, gain=0.2, centre_of_mass=0.003)

    @pytest.mark.slow
    def test_scatters_as_it_says(self):
        rng, nominal = np.random.default_rng(0), FourWheels()
        drawn = [self.SPREAD.draw(nominal, rng) for _ in range(400)]
        assert np.std(np.log([one.friction / 0.8 for one in drawn])) == pytest.approx(0.1, rel=0.15)
        assert np.std(np.log([one.grips for one in drawn])) == pytest.approx(0.05, rel=0.15)
        assert np.std(np.log([one.motor.gain for one in drawn])) == pytest.approx(0.2, rel=0.15)
        assert np.std([one.centre_of_mass for one in drawn]) == pytest.approx(0.003, rel=0.15)
        assert {one.track for one in drawn} == {0.18}

    @pytest.mark.parametrize("robot", [FourWheels(), TwoWheelsAndCaster()], ids=lambda robot: robot.kind)
    def test_is_drawn_from_the_generator_alone(self, robot: PhysicsRobot):
        one, other = (self.SPREAD.draw(robot, np.random.default_rng(3)) for _ in range(2))
        assert one == other != robot
        assert type(one) is type(robot)

    def test_of_nothing_is_the_robot(self):
        still = Variation(friction=0, grip=0).draw(FourWheels(), np.random.default_rng(0))
        assert still == FourWheels(grips=(1, 1, 1, 1))

    def test_what_one_varies_does_not_change_the_others(self):
        wide = Variation(friction=0.1, grip=0.05).draw(FourWheels(), np.random.default_rng(5))
        also = self.SPREAD.draw(FourWheels(), np.random.default_rng(5))
        assert (wide.friction, wide.grips) == (also.friction, also.grips)
