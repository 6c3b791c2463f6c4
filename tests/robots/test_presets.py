"""Robots that can be bought: every preset makes a study, every value has a source and can be overridden."""

from __future__ import annotations

import re
from importlib import resources

import pytest

import oed
from oed.foundation.errors import StudyError
from oed.foundation.quantities import parse_quantity
from oed.robots.presets import preset, preset_names

PUBLISHED = {
    "create_3",
    "husky",
    "jackal",
    "khepera_4",
    "pioneer_3dx",
    "turtlebot3_burger",
    "turtlebot3_waffle",
}
presets = pytest.mark.parametrize("name", preset_names())

STUDY = """
format: 1
name: A robot that can be bought
robot: {robot}
trajectory: {{duration: 20 s, samples: 40, spline: {{coefficients: 8}}}}
measurement: {{kind: poses, noise: {{position: 1 cm, heading: 1 deg}}}}
estimate: [wheel_radius_right, wheel_radius_left, track]
limits: {limits}
"""
ROOM = "{workspace: {kind: rectangle, x: [-2 m, 2 m], y: [-2 m, 2 m]}}"


def study(robot: str, limits: str = ROOM) -> oed.Study:
    return oed.parse_study(STUDY.format(robot=robot, limits=limits))


def limit(problem: oed.Problem, name: str) -> oed.Limit:
    return next(one for one in problem.limits if one.name == name)


def test_the_published_ones_are_there():
    assert set(preset_names()) == PUBLISHED


@presets
@pytest.mark.slow
def test_it_makes_a_study_that_can_be_told(name: str):
    found = study(f"{{preset: {name}}}")
    found.require_identifiable()
    assert found.problem.model.body_radius > max(found.problem.model.nominal[:2])
    assert {"wheel_speed", "body_speed", "workspace"} <= {one.name for one in found.problem.limits}


@presets
def test_its_limits_fit_each_other(name: str):
    problem = study(f"{{preset: {name}}}").problem
    radius = problem.model.nominal[0]
    fastest = limit(problem, "wheel_speed").bounds[1] * radius
    assert fastest == pytest.approx(limit(problem, "body_speed").bounds[1], rel=0.1)


@presets
def test_every_value_has_a_source(name: str):
    text = resources.files("oed.robots.presets").joinpath(f"{name}.yaml").read_text(encoding="utf-8")
    entries = re.split(r"\n(?=  \w+:)", text)
    values = [entry for entry in entries if re.match(r"  (?!kind)\w+: \S", entry)]
    keys = [key for part in preset(name).values() for key in part if key != "kind"]
    assert len(values) == len(keys)
    for entry in values:
        assert "#" in entry, entry


@presets
def test_its_quantities_have_units(name: str):
    data = preset(name)
    units = {
        "wheel_speed": "rad/s",
        "wheel_acceleration": "rad/s^2",
        "body_speed": "m/s",
        "yaw_rate": "rad/s",
    }
    for key, value in data["limits"].items():
        assert isinstance(value, str)
        assert parse_quantity(value, units[key]) > 0
    for key, value in data["robot"].items():
        assert key == "kind" or (isinstance(value, str) and parse_quantity(value, "m") > 0)


class TestOverriding:
    def test_any_key(self):
        limits = ROOM[:-1] + ", body_speed: 0.1 m/s}"
        found = study("{preset: turtlebot3_burger, track: 17 cm}", limits).problem
        assert found.model.nominal == pytest.approx([0.033, 0.033, 0.17])
        assert limit(found, "body_speed").bounds == pytest.approx((-0.1, 0.1))

    def test_unequal_radii(self):
        robot = "{preset: turtlebot3_burger, wheel_radius_right: 3.31 cm, wheel_radius_left: 3.29 cm}"
        assert study(robot).problem.model.nominal[:2] == pytest.approx([0.0331, 0.0329])

    def test_null_leaves_a_key_out(self):
        found = study(
            "{preset: turtlebot3_burger, body_radius: null}", ROOM[:-1] + ", yaw_rate: null}"
        ).problem
        assert found.model.body_radius == 0
        assert "yaw_rate" not in {one.name for one in found.limits}

    def test_the_kind(self):
        found = study("{preset: husky, kind: differential_drive}").problem
        assert found.model.kind == "differential_drive"

    def test_the_echo_stands_on_its_own(self):
        echo = study("{preset: create_3}").echo()
        assert "preset" not in echo["robot"]
        assert echo["robot"]["wheel_radius"] == pytest.approx(0.03575)
        assert echo["limits"]["body_speed"]["bounds"] == pytest.approx([-0.306, 0.306])


class TestMistakes:
    def test_an_unknown_preset_is_named_with_its_line(self):
        with pytest.raises(StudyError) as caught:
            study("{preset: turtlebot4}")
        (issue,) = caught.value.issues
        assert (issue.line, issue.key) == (4, "robot.preset")
        assert "turtlebot3_burger" in issue.message

    def test_an_unknown_key_beside_a_preset(self):
        with pytest.raises(StudyError) as caught:
            study("{preset: husky, trak: 55 cm}")
        (issue,) = caught.value.issues
        assert (issue.line, issue.key) == (4, "robot.trak")
        assert "did you mean track?" in issue.message

    def test_limits_that_are_no_mapping(self):
        with pytest.raises(StudyError, match="limits: expected keys and values"):
            study("{preset: husky}", "3")


def test_the_schema_knows_them():
    from oed.study.study import json_schema

    forms = json_schema()["else"]["properties"]["robot"]["anyOf"]
    assert any(
        set(form.get("properties", {}).get("preset", {}).get("enum", [])) == PUBLISHED for form in forms
    )
