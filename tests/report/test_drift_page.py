"""The page of a study whose robot drifts says what that does, and what a search costs that leaves it out."""

from __future__ import annotations

import numpy as np
import pytest
from builders import random_drive
from sample_records import sensors
from shown_in import section

from oed import evaluate, load_record, load_study, run, write_report
from oed.kernel.solution import scored
from oed.records.outcomes import result_of
from oed.report.figures.draw import svg_text
from oed.report.page import sections_of
from oed.workflow.studies import parse_study

STUDY = """
format: 1
name: A robot that drifts
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}
trajectory: {duration: 4 s, samples: 8, spline: {degree: 3, coefficients: 7}}
measurement:
  kind: poses
  noise: {position: 1 cm, heading: 1 deg}
  drift: {ahead_per_metre: 5 mm, heading_per_metre: 1 deg, heading_per_radian: 1 deg}
limits:
  wheel_speed: 10 rad/s
  wheel_acceleration: 20 rad/s^2
  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}
criterion: A
solvers:
  - {kind: ipopt, name: aware, starts: 1, perturbations: 0, second_stage: none}
  - {kind: ipopt, name: blind, starts: 1, perturbations: 0, second_stage: none, without_drift: true}
baselines: [square]
"""


# All figures but that of drift are those of other drives' pages.
pytestmark = pytest.mark.usefixtures("blank_figures")


@pytest.fixture(scope="module")
def drifted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drift")
    (folder / "study.yaml").write_text(STUDY)
    run(load_study(folder / "study.yaml"), folder / "out")
    return folder / "out"


@pytest.mark.slow
def test_every_drive_has_its_standard_errors_without_drift(drifted):
    record = load_record(drifted)
    problem = load_study(drifted.parent / "study.yaml").problem
    for one in record.results:
        found = evaluate(problem.steady, one.drive.trajectory).standard_deviations
        np.testing.assert_allclose(list(one.steady_deviations.values()), list(found.values()), rtol=1e-9)
        assert all(one.standard_deviations[name] > size for name, size in one.steady_deviations.items())


@pytest.mark.slow
def test_precision_over_time_ends_with_that_of_the_drive(drifted):
    record = load_record(drifted)
    for one in record.results:
        assert one.over_time is not None
        assert one.over_time.t[-1] == pytest.approx(4.0)
        for course, whole in (
            (one.over_time.standard_deviations, one.standard_deviations),
            (one.over_time.steady_deviations, one.steady_deviations),
        ):
            for name, sizes in course.items():
                known = [size for size in sizes if size is not None]
                assert known[-1] == pytest.approx(whole[name])
                assert known == sorted(known, reverse=True)
    (picture,) = section(record, "What drift does").figures
    assert picture.name == "precision_over_time"
    assert "without drift" in svg_text(picture.figure)


def test_the_page_says_what_drift_does(drifted):
    text = (write_report(load_record(drifted), drifted).parent / "report.md").read_text()
    assert "## What drift does" in text
    assert "5 mm ahead and 1 deg in heading after 1 m, 1 deg in heading after 1 rad of turning" in text
    assert "is the best drive found for a robot without drift" in text
    assert "Standard errors with drift and without" in text
    # What starts of that search came to is of another problem.
    assert "A without drift" in text
    assert "Left out: starts of Design 2, which sought something else" in text


@pytest.mark.slow
def test_what_does_not_drift_has_no_such_section():
    lines = [line for line in STUDY.splitlines() if "drift:" not in line and "without_drift" not in line]
    problem = parse_study("\n".join(lines)).problem
    stored = result_of(scored(problem, random_drive(problem, 0), "random"), None)
    assert (stored.steady_deviations, stored.over_time) == ({}, None)
    record = sensors()
    assert "What drift does" not in [one.title for one in sections_of(record)]


def test_there_has_to_be_drift_to_leave_out(tmp_path):
    lines = [line for line in STUDY.splitlines() if "  drift:" not in line]
    (tmp_path / "study.yaml").write_text("\n".join(lines))
    with pytest.raises(Exception, match=r"without_drift.*there is no drift to leave out"):
        load_study(tmp_path / "study.yaml")
