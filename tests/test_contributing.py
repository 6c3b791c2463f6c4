"""CONTRIBUTING: every change that it shows is applied to a copy of the package, and what it adds is used."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from places import ROOT
from test_architecture import HOUSE, PACKAGE

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
PARTS = dict(re.findall(r"^### (.*?)\n.*?^```diff\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE))
MOST = 15
"""Lines that a new part takes, without blank ones."""

PROGRAM = '''
import json

import oed
from oed.kernel.measurement.measurement import sensors_of
from oed.report.page import sections_of

STUDY = """
format: 1
name: All of it new
robot: {kind: gained}
trajectory: {duration: 8 s, samples: 12, spline: {coefficients: 6}, start: {x: 0 m, y: 0 m, heading: 0 deg}}
measurement: [{kind: poses, noise: {position: 1 cm, heading: 1 deg}}, {kind: compass}]
limits: {body_speed: 0.5 m/s, yaw_rate: 1 rad/s, total_turning: 4}
criterion: {kind: first}
solvers: [{kind: twice}]
baselines: [triangle]
"""
study = oed.parse_study(STUDY)
record = oed.run(study, "out", workers=1)
again = oed.load_record("out")
best = again.result("twice")
headings = oed.Problem(
    model=oed.DifferentialDrive(wheel_radius=0.05, track=0.2),
    design=study.problem.design,
    measurement=oed.Poses(quantities=("heading",), noise={"heading": 0.01}, initial_pose="known"),
    limits=[oed.WheelSpeed(bounds=6)],
    criterion=oed.E(scaling="none"),
    estimate=("track",),
)
certificate = oed.bound(headings)
found = oed.solve(headings, oed.Ipopt(starts=1, perturbations=0), workers=1)
one = oed.evaluate(study.problem, best.drive.trajectory)
json.dump(
    {
        "file": oed.__file__,
        "results": {each.name: each.feasible for each in again.results},
        "objective": best.objective,
        "first": next(iter(one.information.values()))[0][0],
        "turning": next(each.margin for each in best.margins if each.limit == "total_turning"),
        "turned": {row[0]: row[1] for part in sections_of(again) if part.title == "Turns"
                   for row in part.tables[0].rows},
        "sensors": [each.kind for each in sensors_of(again.study.measurement)],
        "method": certificate.method,
        "bound": certificate.upper_bound,
        "found": found.evaluation.objective,
    },
    open("found.json", "w"),
)
'''


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package with all that the page adds."""
    place = tmp_path_factory.mktemp("contributed")
    # With what is compiled of it: unchanged files are not compiled again.
    shutil.copytree(PACKAGE, place / "oed")
    for title, diff in PARTS.items():
        (place / "part.diff").write_text(diff)
        # Out of any repository, or the paths would be those of that.
        apart = {**os.environ, "GIT_CEILING_DIRECTORIES": str(place.parent)}
        done = subprocess.run(
            ["git", "apply", "--verbose", "part.diff"], cwd=place, env=apart, capture_output=True, text=True
        )
        assert done.returncode == 0, f"{title}: {done.stderr}"
    return place


@pytest.fixture(scope="module")
def found(built: Path) -> dict[str, Any]:
    """What comes of a study and a program that use all of it."""
    (built / "program.py").write_text(PROGRAM)
    alone = {**os.environ, "PYTHONPATH": str(built)}
    done = subprocess.run(
        [sys.executable, "program.py"], cwd=built, env=alone, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    told: dict[str, Any] = json.loads((built / "found.json").read_text())
    assert told["file"] == str(built / "oed" / "__init__.py")
    return told


@pytest.mark.slow
def test_every_part_is_shown():
    titles = "robot, sensor, limit, criterion, solver, upper bound, baseline, section of the report"
    assert [title.partition(" ")[2] for title in PARTS] == titles.split(", ")


@pytest.mark.slow
@pytest.mark.parametrize("title", PARTS)
def test_a_part_is_a_file_and_a_name(title: str):
    files = re.findall(r"^\+\+\+ b/(.*)$", PARTS[title], flags=re.MULTILINE)
    made = re.findall(r"^--- /dev/null\n\+\+\+ b/(.*)$", PARTS[title], flags=re.MULTILINE)
    assert len(files) <= 2
    # A baseline is a function in the list's own file.
    assert len(made) == len(files) - 1
    added = [line for line in PARTS[title].splitlines() if re.match(r"\+(?!\+\+)\s*\S", line)]
    assert len(added) <= MOST
    assert max(map(len, added)) <= 111


@pytest.mark.slow
def test_the_robot_sensor_and_criterion_make_a_study(found: dict[str, Any]):
    assert found["sensors"] == ["poses", "compass"]
    assert found["objective"] == pytest.approx(found["first"])
    assert found["objective"] > 0


@pytest.mark.slow
def test_the_solver_and_the_baseline_have_results(found: dict[str, Any]):
    assert set(found["results"]) == {"twice", "triangle"}
    assert found["results"]["twice"]


@pytest.mark.slow
def test_the_limit_holds_and_the_section_tells_what_it_limits(found: dict[str, Any]):
    assert found["turned"]["twice"] == pytest.approx(4 - found["turning"], abs=1e-2)
    assert found["turning"] > -4e-3
    # It does bind: without it a drive turns more.
    assert found["turned"]["twice"] > 3.9
    assert found["turned"]["triangle"] > 4


@pytest.mark.slow
def test_the_bound_is_one(found: dict[str, Any]):
    assert found["method"] == "no turn is faster than the wheels allow"
    assert 0.5 * found["bound"] < found["found"] <= found["bound"]


@pytest.mark.slow
def test_the_house_drawn_is_the_house():
    rows = re.findall(r"^\| `(\w+)/` \| (.+) \| (.+) \|$", PAGE, flags=re.MULTILINE)
    assert [name for name, _, _ in rows] == list(reversed(HOUSE))
    for name, _, allowed in rows:
        assert ([] if allowed == "–" else allowed.split(", ")) == HOUSE[name].split()


@pytest.mark.slow
@pytest.mark.parametrize("target", re.findall(r"`make (\w+)`", PAGE))
def test_make_targets_exist(target: str):
    subprocess.run(["make", "-n", target], cwd=ROOT, check=True, capture_output=True)
