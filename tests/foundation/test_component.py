"""What all configurable parts have in common: true and false are no numbers, in none of their fields."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest
from pydantic import ValidationError

import oed.study.study
from oed.foundation.component import Component
from oed.foundation.errors import PartError, StudyError
from oed.robots.models.model import CoefficientRobot
from oed.workflow.studies import parse_study

STUDY = """
format: 1
name: A study
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}
trajectory: {duration: 20 s, samples: 40, spline: {coefficients: 8}, rest_to_rest: true}
measurement: {kind: poses, every: 1, noise: {position: 1 cm, heading: 1 deg}}
limits: {wheel_speed: "10 rad/s"}
solvers: [{kind: ipopt, starts: 3}]
seed: 0
"""


def all_parts(base: type[Component] = Component) -> list[type[Component]]:
    own = [one for one in base.__subclasses__() if one.__module__.startswith("oed.")]
    return [one for part in own for one in (part, *all_parts(part))]


def takes_truth(schema: dict[str, Any]) -> bool:
    inner = [*schema.get("anyOf", []), *([schema["items"]] if isinstance(schema.get("items"), dict) else [])]
    return schema.get("type") == "boolean" or any(map(takes_truth, inner))


def numeric(schema: dict[str, Any]) -> bool:
    return schema.get("type") in ("number", "integer") or any(map(numeric, schema.get("anyOf", [])))


@cache
def numbers() -> list[tuple[type[Component], str]]:
    """Every field of every part that is a number, or may be."""
    found = []
    # A robot seen through its coefficients is made of one, not read.
    for part in set(all_parts()) - {CoefficientRobot}:
        fields = part.model_json_schema().get("properties", {})
        found += [(part, name) for name, one in fields.items() if numeric(one) and not takes_truth(one)]
    return found


@pytest.mark.slow
def test_there_are_many_numbers():
    assert oed.study.study is not None
    assert len(numbers()) > 80


@pytest.mark.slow
@pytest.mark.parametrize("value", [True, False])
def test_no_field_takes_true_for_a_number(value: bool):
    for part, name in numbers():
        with pytest.raises((PartError, ValidationError)) as caught:
            part.model_validate({name: value})
        assert (name,) in [error["loc"][:1] for error in caught.value.errors()], (part, name)


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("format: 1", "format: true", "format"),
        ("starts: 3", "starts: true", "solvers.0.starts"),
        ("samples: 40", "samples: true", "trajectory.samples"),
        ("every: 1", "every: true", "measurement.every"),
        ("20 s", "true", "trajectory.duration"),
        ('"10 rad/s"', "[0, true]", "limits.wheel_speed.1"),
        ("seed: 0", "seed: false", "seed"),
    ],
)
def test_in_a_study_its_key_and_line_are_named(old: str, new: str, key: str):
    with pytest.raises(StudyError) as caught:
        parse_study(STUDY.replace(old, new))
    (issue,) = caught.value.issues
    assert issue.key.startswith(key)
    assert issue.line == STUDY[: STUDY.index(old)].count("\n") + 1


def test_true_is_true_where_it_means_something():
    assert parse_study(STUDY.replace("seed: 0", "bound: true")).file.bound
