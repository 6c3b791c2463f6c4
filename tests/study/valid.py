"""A valid study to be varied, and what is said of its mistakes."""

from __future__ import annotations

import json

import pytest
import yaml

from oed.foundation.errors import FileIssue, StudyError
from oed.study.study import Study
from oed.workflow.studies import parse_study

VALID = """\
format: 1
name: Every key
robot:
  kind: differential_drive
  wheel_radius: 4.9 cm
  track: 18 cm
trajectory:
  duration: 10 s
  samples: 40
  spline: {degree: 3, coefficients: 8}
  start:
    x: 10 cm
    heading: 30 deg
  rest_to_rest: true
  integration: arc
measurement:
  kind: displacements
  segments: 4
  regressor: position
  noise:
    position: 1 cm
    heading: 1 deg
limits:
  wheel_speed: 10 rad/s
  wheel_acceleration: [-20 rad/s^2, 15 rad/s^2]
  workspace:
    kind: rectangle
    x: [-1 m, 1 m]
    y: [-1 m, 1 m]
criterion:
  kind: E
  scaling: none
solvers:
  - kind: genetic
    population: 20
  - kind: ipopt
    starts: 1
    start_from: genetic
baselines:
  - circle
  - file: mine.csv
validation:
  replicates: 500
  heading: measured
seed: 3
"""


def issues_of(text: str) -> tuple[FileIssue, ...]:
    with pytest.raises(StudyError) as caught:
        parse_study(text, "some.yaml")
    assert all(issue.file == "some.yaml" for issue in caught.value.issues)
    assert str(caught.value) == "\n".join(str(issue) for issue in caught.value.issues)
    return caught.value.issues


def line_of(text: str, start: str) -> int:
    """Number of the only line that begins so, after its indentation."""
    hits = [number for number, line in enumerate(text.splitlines(), 1) if line.strip().startswith(start)]
    assert len(hits) == 1, f"{start!r} begins lines {hits}"
    return hits[0]


def replaced(old: str, new: str) -> str:
    assert VALID.count(old) == 1, f"{old!r} stands {VALID.count(old)} times in the study"
    return VALID.replace(old, new)


def assert_echo_is_equal(text: str) -> None:
    assert_echo_of(parse_study(text))


def assert_echo_of(study: Study) -> None:
    echo = json.loads(json.dumps(study.echo(), allow_nan=False))
    again = parse_study(yaml.safe_dump(echo, sort_keys=False))
    assert again.file == study.file
    assert again.echo() == study.echo()
    parts = ("model", "design", "measurement", "limits", "criterion", "name")
    assert all(getattr(again.problem, part) == getattr(study.problem, part) for part in parts)
