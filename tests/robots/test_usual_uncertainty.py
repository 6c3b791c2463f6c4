"""Usual ranges of a robot's parameters before it is calibrated."""

from __future__ import annotations

import pytest
from places import PROBLEMS

from oed.kernel.dynamics.system import Parameter
from oed.robots.models import DifferentialDrive, SkidSteer, Tricycle, Unicycle
from oed.robots.usual_uncertainty import usual_uncertainty
from oed.uncertainty.uncertainty import Uncertainty
from oed.workflow.studies import load_study

STUDIES = sorted(PROBLEMS.glob("*.yaml"))


def test_radii_are_known_to_2_and_tracks_to_4_per_cent():
    robot = DifferentialDrive(wheel_radius=0.05, track=0.3)
    expected = {"wheel_radius_right": "2 %", "wheel_radius_left": "2 %", "track": "4 %"}
    assert usual_uncertainty(robot) == expected


def test_angles_are_known_to_a_degree_even_where_they_are_0():
    robot = Tricycle(wheel_radius=0.1, wheelbase=1.0)
    assert usual_uncertainty(robot)["steering_offset"] == "1 deg"


def test_gains_are_known_to_2_and_lags_to_5_per_cent():
    ranges = usual_uncertainty(Unicycle(lag_v=0.1, lag_omega=0.2))
    assert ranges == {"gain_v": "2 %", "gain_omega": "2 %", "lag_v": "5 %", "lag_omega": "5 %"}


def test_track_of_a_skidding_robot_has_a_range_as_wide_as_skidding_makes_it():
    robot = SkidSteer(wheel_radius=0.1, track=0.9)
    assert usual_uncertainty(robot)["track"] == ("0.7 m", "1.2 m")


def test_parameter_that_is_0_takes_a_share_of_its_scale_or_none():
    class Offset(DifferentialDrive):
        parameters = property(lambda self: (Parameter("a", 0.0, "m", size=0.5), Parameter("b", 0.0, "m")))

    assert usual_uncertainty(Offset(wheel_radius=0.05, track=0.3)) == {"a": "0.02 m"}


@pytest.mark.slow
@pytest.mark.parametrize("file", STUDIES, ids=[file.stem for file in STUDIES])
def test_robots_within_the_usual_ranges_can_be(file):
    study = load_study(file)
    if study.file.domain != "robots":
        pytest.skip("no robot")
    uncertainty = Uncertainty(within=usual_uncertainty(study.problem.model))
    assert uncertainty.issues(study.problem.uncertain_system) == []
