"""Study files: shipped ones, what is read from them, and every rule broken one at a time."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from places import PROBLEMS
from studies import SMALL, saved_study, small

from oed.foundation.errors import FileFlaw, StudyError
from oed.optimize import CmaEs, DifferentialEvolution, Genetic, Ipopt
from oed.robots.models import DifferentialDrive
from oed.robots.sensors import PosePrior, Poses, Ranges, Several, YawRate
from oed.study.study import PathFile, Study, json_schema
from oed.workflow.studies import load_study, own_paths, parse_study

STUDIES = sorted(PROBLEMS.glob("*.yaml"))

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


def flaws_of(text: str) -> tuple[FileFlaw, ...]:
    with pytest.raises(StudyError) as caught:
        parse_study(text, "some.yaml")
    assert all(flaw.file == "some.yaml" for flaw in caught.value.flaws)
    assert str(caught.value) == "\n".join(str(flaw) for flaw in caught.value.flaws)
    return caught.value.flaws


def line_of(text: str, start: str) -> int:
    """Number of the only line that begins so, after its indentation."""
    hits = [number for number, line in enumerate(text.splitlines(), 1) if line.strip().startswith(start)]
    assert len(hits) == 1, f"{start!r} begins lines {hits}"
    return hits[0]


def replaced(old: str, new: str) -> str:
    assert VALID.count(old) == 1, f"{old!r} stands {VALID.count(old)} times in the study"
    return VALID.replace(old, new)


class TestShipped:
    @pytest.mark.parametrize("file", STUDIES, ids=lambda file: file.stem)
    def test_every_shipped_study_loads_and_its_echo_is_the_same(self, file: Path):
        study = load_study(file)
        assert study.source == str(file)
        assert study.text == file.read_text(encoding="utf-8")
        assert study.folder == file.parent
        assert study.solvers
        assert study.problem.name == study.name
        assert_echo_of(study)

    def test_there_are_some(self):
        assert {"choi_skid_steer", "choi_paper_table"} <= {file.stem for file in STUDIES}


def assert_echo_is_equal(text: str) -> None:
    assert_echo_of(parse_study(text))


def assert_echo_of(study: Study) -> None:
    echo = json.loads(json.dumps(study.echo(), allow_nan=False))
    again = parse_study(yaml.safe_dump(echo))
    assert again.file == study.file
    assert again.echo() == study.echo()
    parts = ("model", "design", "measurement", "limits", "criterion", "name")
    assert all(getattr(again.problem, part) == getattr(study.problem, part) for part in parts)


@pytest.mark.parametrize(
    "text",
    [
        VALID,
        SMALL,
        small(bound="true", baselines="[random, {file: a.csv, name: my drive}]"),
        SMALL.replace("coefficients: 8}}", "coefficients: 8}, start: free}"),
        SMALL.replace("segments: 4", "segments: samples, regressor: both"),
        SMALL.replace("scaling: none", "scaling: {c21: 0.01, c22: 0.02}"),
        SMALL.replace("differential_drive", "skid_steer, slip_outer: 5 %, slip_inner: -0.01"),
        SMALL.replace("wheel_radius: 4.9 cm", "wheel_radius_right: 5 cm, wheel_radius_left: 48 mm"),
        "\n".join(line for line in SMALL.splitlines() if "workspace" not in line and "accel" not in line),
        small(solvers="{kind: cmaes, sigma: 0.1}, {kind: differential_evolution, time_limit: 1 min}"),
    ],
    ids=["full", "small", "extras", "free", "both", "scales", "slip", "radii", "no workspace", "relatives"],
)
def test_an_echo_is_the_same_study(text: str):
    assert_echo_is_equal(text)


class TestReading:
    def test_everything_given_is_read(self):
        study = parse_study(VALID)
        problem = study.problem
        assert (study.name, study.seed, study.source) == ("Every key", 3, "study")
        assert problem.model == DifferentialDrive(wheel_radius=0.049, track=0.18)
        assert (problem.design.duration, problem.design.samples) == (10.0, 40)
        assert problem.fixed_starts[0] == pytest.approx((0.1, 0.0, np.pi / 6))
        np.testing.assert_array_equal(problem.input_bounds, [[-10, 10], [-10, 10]])
        assert [limit.name for limit in problem.limits] == ["wheel_speed", "wheel_acceleration", "workspace"]
        assert problem.limits[1].bounds == (-20.0, 15.0)
        assert problem.measurement.noise.heading == pytest.approx(np.pi / 180)
        assert [type(solver) for solver in study.solvers] == [Genetic, Ipopt]
        assert study.file.baselines == ("circle", PathFile(file="mine.csv"))
        assert study.file.baselines[1].label == "mine"
        assert (study.file.validation.replicates, study.file.validation.heading) == (500, "measured")

    def test_defaults(self):
        study = parse_study(SMALL)
        assert study.solvers == (Ipopt(),)
        assert (study.seed, study.file.baselines, study.file.validation) == (0, (), None)
        assert study.problem.fixed_starts.tolist() == [[0.0, 0.0, 0.0]]

    def test_bare_numbers_are_si(self):
        plain = VALID
        for quantity, number in {"4.9 cm": "0.049", "18 cm": "0.18", "10 rad/s": "10", "10 s": "10"}.items():
            plain = plain.replace(f": {quantity}\n", f": {number}\n")
        assert plain != VALID
        assert parse_study(plain).file == parse_study(VALID).file

    @pytest.mark.parametrize(
        ("kind", "expected"),
        [("cmaes", CmaEs()), ("differential_evolution", DifferentialEvolution()), ("genetic", Genetic())],
    )
    def test_solvers_by_kind(self, kind: str, expected):
        assert parse_study(small(solvers=f"{{kind: {kind}}}")).solvers == (expected,)

    def test_a_file_is_read_as_text_is(self, tmp_path: Path):
        file = tmp_path / "a study.yaml"
        file.write_text(VALID.replace("Every key", "Größe"), encoding="utf-8")
        study = load_study(str(file))
        assert study.name == "Größe"
        assert study.folder == tmp_path


BROKEN = {
    "unknown key": ("seed: 3", "sede: 3", "sede", "sede", "did you mean seed?"),
    "unknown key of the robot": (
        "  track:",
        "  traek: 1\n  track:",
        "traek",
        "robot.traek",
        "did you mean track?",
    ),
    "unknown key of a limit": (
        "    y: [-1",
        "    z: 1\n    y: [-1",
        "z:",
        "limits.workspace.z",
        "known here: kind, x, y",
    ),
    "unknown limit": (
        "  wheel_acceleration:",
        "  wheel_accelerations: 5\n  wheel_acceleration:",
        "wheel_accelerations",
        "limits.wheel_accelerations",
        "did you mean wheel_acceleration?",
    ),
    "unknown key of a solver": (
        "    population:",
        "    populations:",
        "populations",
        "solvers.0.populations",
        "did you mean population?",
    ),
    "another solver's key": (
        "    starts: 1",
        "    starts: 1\n    generations: 5",
        "generations",
        "solvers.1.generations",
        "unknown key",
    ),
    "wrong unit": ("18 cm", "5 kg", "track", "robot.track", "expected a length [m], got '5 kg'"),
    "unknown unit": ("18 cm", "5 smoots", "track", "robot.track", "'smoots' is not known"),
    "Hz is no angular speed": ("10 rad/s\n", "10 Hz\n", "wheel_speed:", "limits.wheel_speed", "rad/s"),
    "no number": ("18 cm", "wide", "track", "robot.track", "does not begin with a number"),
    "NaN": ("18 cm", ".nan", "track", "robot.track", "finite"),
    "infinite": ("10 s\n", ".inf\n", "duration", "trajectory.duration", "finite"),
    "too large to be finite": ("18 cm", "1e999 m", "track", "robot.track", "finite"),
    "negative length": ("18 cm", "-18 cm", "track", "robot.track", "expected more than 0"),
    "truth as quantity": ("18 cm", "true", "track", "robot.track", "got True"),
    "no duration": ("  duration: 10 s\n", "", "trajectory", "trajectory.duration", "missing"),
    "no track": ("  track: 18 cm\n", "", "robot", "robot.track", "missing"),
    "no name": ("name: Every key\n", "", "format", "name", "missing"),
    "name of no text": ("name: Every key", "name: 12", "name", "name", "expected text, got 12"),
    "no kind of robot": ("  kind: differential_drive\n", "", "robot", "robot", "kind is missing"),
    "wrong kind of robot": (
        "differential_drive",
        "hovercraft",
        "robot",
        "robot",
        "'tractor_trailer', 'tricycle', got 'hovercraft'",
    ),
    "wrong kind of solver": (
        "kind: genetic",
        "kind: oracle",
        "- kind: oracle",
        "solvers.0",
        "got 'oracle'",
    ),
    "wrong kind of measurement": ("displacements", "guesses", "measurement:", "measurement", "guesses"),
    "both radius forms": (
        "  track:",
        "  wheel_radius_left: 5 cm\n  track:",
        "robot",
        "robot",
        "either wheel_radius, or both wheel_radius_right and wheel_radius_left",
    ),
    "one side's radius": ("wheel_radius:", "wheel_radius_left:", "robot", "robot", "wheel_radius_right"),
    "min above max": (
        "[-20 rad/s^2, 15 rad/s^2]",
        "[15 rad/s^2, -20 rad/s^2]",
        "wheel_acceleration",
        "limits.wheel_acceleration",
        "min below max",
    ),
    "room with min above max": ("x: [-1 m", "x: [2 m", "x: [2", "limits.workspace.x", "min below max"),
    "three bounds": (
        "[-20 rad/s^2, 15",
        "[-20, 0, 15",
        "wheel_acceleration",
        "limits.wheel_acceleration",
        "got 3 values",
    ),
    "negative limit": (
        ": 10 rad/s\n",
        ": -10 rad/s\n",
        "wheel_speed",
        "limits.wheel_speed",
        "positive limit",
    ),
    "start outside": (
        "x: [-1 m",
        "x: [0.5 m",
        "workspace",
        "limits.workspace",
        "the start (0.1 m, 0 m) lies outside",
    ),
    "too many segments": (
        "segments: 4",
        "segments: 41",
        "segments",
        "measurement.segments",
        "at most as many segments as there are samples (40), got 41",
    ),
    "heading with one segment": (
        "segments: 4\n  regressor: position",
        "segments: 1\n  regressor: heading",
        "segments",
        "measurement.segments",
        "at least 2 segments, got 1",
    ),
    "fraction of a segment": ("segments: 4", "segments: 4.5", "segments", "measurement.segments", "4.5"),
    "rest excluded": (
        ": 10 rad/s\n",
        ": [1 rad/s, 10 rad/s]\n",
        "wheel_speed",
        "limits.wheel_speed",
        "rest_to_rest",
    ),
    "too few coefficients": (
        "coefficients: 8",
        "coefficients: 5",
        "spline",
        "trajectory.spline.coefficients",
        "needs at least 6 coefficients, got 5",
    ),
    "search of the same name": (
        "    starts: 1",
        "    starts: 1\n    name: genetic",
        "name: genetic",
        "solvers.1.name",
        "a second result named genetic",
    ),
    "unknown search to start from": (
        "start_from: genetic",
        "start_from: genetics",
        "start_from",
        "solvers.1.start_from",
        "listed before (genetic), got 'genetics'",
    ),
    "bad name": (
        "    starts: 1",
        "    starts: 1\n    name: ../up",
        "name: ../up",
        "solvers.1.name",
        "../up",
    ),
    "long name": (
        "    starts: 1",
        f"    starts: 1\n    name: {'ä' * 130}",
        "name: ä",
        "solvers.1.name",
        "expected a name of at most 180 bytes, got 260",
    ),
    "scale of no parameter": (
        "scaling: none",
        "scaling: {c21: 1, c22: 1, c99: 1}",
        "scaling",
        "criterion.scaling.c99",
        "the parameters are c21, c22",
    ),
    "scale missing": ("scaling: none", "scaling: {c21: 1}", "scaling", "criterion.scaling", "c22 is missing"),
    "heading noise missing": (
        "    heading: 1 deg\n",
        "",
        "noise",
        "measurement.noise",
        "simulating measured headings needs the noise of heading",
    ),
    "too few replicates": (
        "replicates: 500",
        "replicates: 5",
        "replicates",
        "validation.replicates",
        "at least 100, got 5",
    ),
    "unknown baseline": ("  - circle", "  - circel", "- circel", "baselines.0", "'circle'"),
    "baseline without a file": (
        "  - file: mine.csv",
        "  - name: mine",
        "- name: mine",
        "baselines.1.file",
        "missing",
    ),
    "negative seed": ("seed: 3", "seed: -3", "seed", "seed", "expected at least 0, got -3"),
    "wrong format": ("format: 1", "format: 2", "format", "format", "expected 1, got 2"),
    "no mapping where one belongs": (
        "spline: {degree: 3, coefficients: 8}",
        "spline: 3",
        "spline",
        "trajectory.spline",
        "expected keys and values, got 3",
    ),
    "no list where one belongs": (
        "x: [-1 m, 1 m]",
        "x: 1 m",
        "x: 1 m",
        "limits.workspace.x",
        "expected a list",
    ),
    "truth expected": (
        "rest_to_rest: true",
        "rest_to_rest: perhaps",
        "rest_to_rest",
        "trajectory.rest_to_rest",
        "true or false",
    ),
    "unknown rule": (
        "integration: arc",
        "integration: euler",
        "integration",
        "trajectory.integration",
        "arc",
    ),
}


@pytest.mark.parametrize(("old", "new", "line", "key", "message"), BROKEN.values(), ids=BROKEN.keys())
def test_one_mistake_is_named_by_its_line_and_key(old: str, new: str, line: str, key: str, message: str):
    text = replaced(old, new)
    flaws = flaws_of(text)
    assert [(flaw.line, flaw.key) for flaw in flaws] == [(line_of(text, line), key)]
    assert message in flaws[0].message
    assert str(flaws[0]).startswith(f"some.yaml:{flaws[0].line}: {key}: ")


def test_relative_scaling_needs_the_noise():
    text = SMALL.replace("scaling: none", "scaling: relative").replace("position: 1 cm, ", "")
    (flaw,) = flaws_of(text)
    assert (flaw.line, flaw.key) == (line_of(text, "measurement"), "measurement.noise")
    assert "the position noise is needed" in flaw.message


def test_every_input_needs_a_limit():
    text = replaced("  wheel_speed: 10 rad/s\n", "")
    flaws = flaws_of(text)
    assert {(flaw.line, flaw.key) for flaw in flaws} == {(line_of(text, "limits"), "limits")}
    for flaw, name in zip(flaws, ("wheel_speed_right", "wheel_speed_left"), strict=True):
        assert f"nothing bounds {name}; add wheel_speed" in flaw.message


@pytest.mark.parametrize("value", [".nan", ".inf", "0", "-1"])
def test_a_scale_has_to_be_positive_and_finite(value: str):
    text = SMALL.replace("scaling: none", f"scaling: {{c21: {value}, c22: 1}}")
    (flaw,) = flaws_of(text)
    assert (flaw.line, flaw.key) == (line_of(text, "criterion"), "criterion.scaling.c21")


@pytest.mark.parametrize(
    "text",
    [
        small(solvers="{kind: ipopt, name: circle}", baselines="[circle]"),
        small(baselines="[circle, circle]"),
        small(baselines="[{file: ipopt.csv}]"),
        small(baselines="[{file: a/mine.csv}, {file: b/mine.csv}]"),
        small(solvers="{kind: ipopt, name: a b}, {kind: ipopt, name: a_b}"),
    ],
    ids=["search and path", "path twice", "search and file", "two files", "one file for two names"],
)
def test_results_that_could_not_be_told_apart_are_refused(text: str):
    flaws_of(text)


class TestNoStudy:
    """What is no study at all."""

    @pytest.mark.parametrize("text", ["", "# only a remark\n", "- a\n- b\n", "hello\n", "3\n"])
    def test_not_a_mapping(self, text: str):
        (flaw,) = flaws_of(text)
        assert flaw.line >= 1
        assert "expected a study" in flaw.message

    def test_a_key_given_twice(self):
        text = replaced("seed: 3", "seed: 3\nname: Again")
        (flaw,) = flaws_of(text)
        assert (flaw.line, flaw.key) == (line_of(text, "name: Again"), "name")
        assert "given twice (first in line 2)" in flaw.message

    def test_a_key_given_twice_inside(self):
        text = replaced("    population: 20", "    population: 20\n    population: 30")
        (flaw,) = flaws_of(text)
        assert (flaw.line, flaw.key) == (line_of(text, "population: 30"), "solvers.0.population")

    @pytest.mark.parametrize(
        ("old", "new", "line"),
        [
            ("  track: 18 cm", "\ttrack: 18 cm", "track"),
            ("y: [-1 m, 1 m]", "y: [-1 m, 1 m", "criterion"),
            ("seed: 3", 'seed: "3', None),
        ],
        ids=["tab", "open bracket", "open quote"],
    )
    def test_not_yaml(self, old: str, new: str, line: str | None):
        text = replaced(old, new)
        (flaw,) = flaws_of(text)
        assert "not valid YAML" in flaw.message
        assert flaw.line == (line_of(text, line) if line else len(text.splitlines()) + 1)

    def test_an_empty_file(self, tmp_path: Path):
        file = tmp_path / "empty.yaml"
        file.write_text("")
        with pytest.raises(StudyError, match="expected a study") as caught:
            load_study(file)
        assert caught.value.flaws[0].file == str(file)

    def test_no_file(self, tmp_path: Path):
        file = tmp_path / "nowhere.yaml"
        with pytest.raises(StudyError, match="no such file") as caught:
            load_study(file)
        assert str(caught.value) == f"{file}: no such file"


class TestSeveralMistakes:
    def test_all_are_reported_at_once_in_the_order_of_the_lines(self):
        text = VALID
        for old, new in {
            "track: 18 cm": "track: 5 kg",
            "samples: 40": "samples: 0",
            "  regressor: position": "  regresor: position",
            "    starts: 1": "    starts: none",
            "seed: 3": "seed: -1\ncolour: red",
        }.items():
            text = text.replace(old, new)
        expected = [
            ("track", "robot.track"),
            ("samples", "trajectory.samples"),
            ("regresor", "measurement.regresor"),
            ("starts", "solvers.1.starts"),
            ("seed", "seed"),
            ("colour", "colour"),
        ]
        found = [(flaw.line, flaw.key) for flaw in flaws_of(text)]
        assert found == [(line_of(text, line), key) for line, key in expected]

    def test_parts_that_do_not_fit_together_are_reported_at_once(self):
        text = replaced("segments: 4", "segments: 41").replace("coefficients: 8", "coefficients: 2")
        assert [flaw.key for flaw in flaws_of(text)] == [
            "trajectory.spline.coefficients",
            "measurement.segments",
        ]

    def test_and_with_those_of_the_searches(self):
        text = replaced("segments: 4", "segments: 41").replace("start_from: genetic", "start_from: nobody")
        assert [flaw.key for flaw in flaws_of(text)] == ["measurement.segments", "solvers.1.start_from"]

    def test_searches_and_validation(self):
        text = replaced("    heading: 1 deg\n", "").replace("start_from: genetic", "start_from: nobody")
        assert {flaw.key for flaw in flaws_of(text)} == {"measurement.noise", "solvers.1.start_from"}

    def test_keys_given_twice(self):
        text = replaced("seed: 3", "seed: 3\nseed: 4\nname: Again")
        assert [flaw.key for flaw in flaws_of(text)] == ["seed", "name"]


class TestSchema:
    def test_it_is_json(self):
        assert json.loads(json.dumps(json_schema(), allow_nan=False)) == json_schema()

    def test_it_names_the_keys(self):
        schema = json_schema()
        assert set(schema["properties"]) == set(yaml.safe_load(VALID)) | {
            "bound",
            "calibration",
            "estimate",
            "log",
            "physics",
            "prior",
            "robust",
            "uncertainty",
        }
        assert schema["additionalProperties"] is False
        assert {"format", "name", "robot", "trajectory", "measurement", "limits"} == set(schema["required"])
        assert "json-schema.org" in schema["$schema"]

    def test_it_names_what_is_inside(self):
        text = json.dumps(json_schema())
        for name in ("skid_steer", "slip_outer", "wheel_acceleration", "start_from", "straight_and_spin"):
            assert f'"{name}"' in text


SENSORS = """\
format: 1
name: Several sensors
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}
trajectory: {duration: 10 s, samples: 40, spline: {degree: 3, coefficients: 8}}
measurement:
  - kind: poses
    quantities: [x, y]
    every: 2
    noise:
      position: 1 mm
      position_per_speed: 2 ms
    initial_pose: {position: 1 cm, heading: 2 deg}
    lever_arm: {x: 10 cm, known: false, deviation: 5 mm}
  - kind: yaw_rate
    bias: 0.2 deg/s
    noise: 0.1 deg/s
  - kind: ranges
    beacons: [[3 m, 3 m], [-3 m, 250 cm]]
    noise: 10 cm
    initial_pose: {position: 10 mm, heading: 2 deg}
    lever_arm: {y: -2 cm}
estimate: [wheel_radius_right, track]
prior:
  standard_deviations:
    track: 5 mm
    wheel_radius_right: 2 %
limits:
  wheel_speed: 10 rad/s
  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}
criterion: {kind: E, subset: [track]}
"""
"""A list of sensors, with every key that sensors have."""


def without(text: str, line: str) -> str:
    """The text without the only line that begins so."""
    lines = text.splitlines(keepends=True)
    del lines[line_of(text, line) - 1]
    return "".join(lines)


def changed(old: str, new: str) -> str:
    assert SENSORS.count(old) == 1, f"{old!r} stands {SENSORS.count(old)} times in the study"
    return SENSORS.replace(old, new)


BROKEN_SENSORS = {
    "unknown key of a sensor": (
        "    every: 2",
        "    evry: 2",
        "evry",
        "measurement.0.evry",
        "did you mean every?",
    ),
    "another sensor's key": (
        "    bias: 0.2 deg/s",
        "    beacons: [[1, 2]]",
        "beacons: [[1, 2",
        "measurement.1.beacons",
        "known here: bias, every, kind, noise",
    ),
    "unknown key inside": (
        "      position: 1 mm",
        "      positon: 1 mm",
        "positon",
        "measurement.0.noise.positon",
        "did you mean position?",
    ),
    "unknown key of a lever arm": (
        "{y: -2 cm}",
        "{z: -2 cm}",
        "lever_arm: {z",
        "measurement.2.lever_arm.z",
        "known here: deviation, known, x, y",
    ),
    "wrong kind of sensor": (
        "kind: yaw_rate",
        "kind: gyroscope",
        "- kind: gyroscope",
        "measurement.1",
        "expected 'poses', 'ranges', 'yaw_rate', 'trailer_angle', 'python', got 'gyroscope'",
    ),
    "no sensor": (
        "kind: yaw_rate",
        "kind: displacements",
        "- kind: displacements",
        "measurement.1",
        "got 'displacements'",
    ),
    "no kind": (
        "  - kind: yaw_rate\n    bias: 0.2 deg/s",
        "  - bias: 0.2 deg/s",
        "- bias",
        "measurement.1",
        "the key kind is missing",
    ),
    "wrong unit": (
        "noise: 10 cm",
        "noise: 10 deg",
        "noise: 10 deg",
        "measurement.2.noise",
        "expected a length [m], got '10 deg'",
    ),
    "wrong unit inside": (
        "position_per_speed: 2 ms",
        "position_per_speed: 2 m",
        "position_per_speed",
        "measurement.0.noise.position_per_speed",
        "expected a time [s], got '2 m'",
    ),
    "no noise": (
        "    noise: 0.1 deg/s\n",
        "",
        "- kind: yaw_rate",
        "measurement.1.noise",
        "missing",
    ),
    "noise of too few quantities": (
        "[x, y]",
        "[x, heading]",
        "noise:",
        "measurement.0.noise",
        "the noise of heading is needed to weight the readings",
    ),
    "negative noise": (
        "noise: 10 cm",
        "noise: -10 cm",
        "noise: -10 cm",
        "measurement.2.noise",
        "expected more than 0",
    ),
    "no such quantity": (
        "[x, y]",
        "[x, z]",
        "quantities",
        "measurement.0.quantities.1",
        "expected 'x', 'y' or 'heading', got 'z'",
    ),
    "quantity twice": ("[x, y]", "[x, x]", "quantities", "measurement.0.quantities", "listed twice"),
    "never": ("every: 2", "every: 0", "every", "measurement.0.every", "expected at least 1, got 0"),
    "wrong bias": ("bias: 0.2 deg/s", "bias: some", "bias", "measurement.1.bias", "got 'some'"),
    "beacon without y": (
        "[-3 m, 250 cm]",
        "[-3 m]",
        "beacons",
        "measurement.2.beacons.1.1",
        "missing",
    ),
    "deviation of a known arm": (
        "{y: -2 cm}",
        "{y: -2 cm, deviation: 1 mm}",
        "lever_arm: {y",
        "measurement.2.lever_arm",
        "add known: false",
    ),
    "another initial pose": (
        "{position: 10 mm, heading: 2 deg}",
        "{position: 2 cm, heading: 2 deg}",
        "initial_pose: {position: 2 cm",
        "measurement.2.initial_pose",
        "differs from that of the sensors before",
    ),
    "an initial pose left out": (
        "    initial_pose: {position: 10 mm, heading: 2 deg}\n",
        "",
        "- kind: ranges",
        "measurement.2",
        "there is one initial pose",
    ),
    "half an initial pose": (
        "{position: 10 mm, heading: 2 deg}",
        "{position: 10 mm}",
        "initial_pose: {position: 10 mm",
        "measurement.2.initial_pose.heading",
        "missing",
    ),
    "unknown parameter": (
        "[wheel_radius_right, track]",
        "[wheel_radius, track]",
        "estimate",
        "estimate",
        "left, track) or coefficients (c11, c12, c21, c22), got wheel_radius, track",
    ),
    "parameters of both kinds": (
        "[wheel_radius_right, track]",
        "[c11, track]",
        "estimate",
        "estimate",
        "got c11, track",
    ),
    "parameter twice": (
        "[wheel_radius_right, track]",
        "[track, track]",
        "estimate",
        "estimate",
        "listed twice",
    ),
    "no parameters": (
        "[wheel_radius_right, track]",
        "[]",
        "estimate",
        "estimate",
        "at least one parameter",
    ),
    "parameters that are no list": (
        "[wheel_radius_right, track]",
        "track",
        "estimate",
        "estimate",
        "expected a list, got 'track'",
    ),
    "prior of what is not estimated": (
        "    track: 5 mm",
        "    wheel_radius_left: 5 mm",
        "wheel_radius_left",
        "prior.standard_deviations.wheel_radius_left",
        "the parameters are wheel_radius_right, track",
    ),
    "prior of a wrong unit": (
        "track: 5 mm",
        "track: 5 kg",
        "track: 5 kg",
        "prior.standard_deviations.track",
        "expected a length [m], got '5 kg'",
    ),
    "negative prior": (
        "track: 5 mm",
        "track: -5 %",
        "track: -5 %",
        "prior.standard_deviations.track",
        "expected a positive standard deviation, got '-5 %'",
    ),
    "unknown key of a prior": (
        "  standard_deviations:",
        "  standard_deviation:",
        "standard_deviation",
        "prior.standard_deviation",
        "did you mean standard_deviations?",
    ),
    "empty prior": (
        "  standard_deviations:\n    track: 5 mm\n    wheel_radius_right: 2 %",
        "  {}",
        "prior",
        "prior",
        "either standard_deviations, or parameters and their covariance",
    ),
    "both priors": (
        "  standard_deviations:",
        "  parameters: [track]\n  covariance: [[1]]\n  standard_deviations:",
        "prior",
        "prior",
        "either standard_deviations, or parameters and their covariance",
    ),
    "prior covariance of another size": (
        "  standard_deviations:\n    track: 5 mm\n    wheel_radius_right: 2 %",
        "  parameters: [track]\n  covariance: [[1, 0], [0, 1]]",
        "prior",
        "prior",
        "expected a 1 x 1 covariance for 1 parameters",
    ),
    "prior covariance of what is not estimated": (
        "  standard_deviations:\n    track: 5 mm\n    wheel_radius_right: 2 %",
        "  covariance: [[1]]\n  parameters: [wheel_radius_left]",
        "parameters",
        "prior.parameters",
        "wheel_radius_left is not estimated here",
    ),
    "judged but not estimated": (
        "subset: [track]",
        "subset: [wheel_radius_left]",
        "criterion",
        "criterion.subset",
        "expected some of the estimated wheel_radius_right, track, got wheel_radius_left",
    ),
}


class TestSensors:
    """Lists of sensors, and what is estimated from them."""

    def test_everything_given_is_read(self):
        problem = parse_study(SENSORS).problem
        poses, rates, ranges = problem.measurement.sensors
        start = PosePrior(position=0.01, heading=np.deg2rad(2))
        assert isinstance(problem.measurement, Several)
        assert poses == Poses(
            quantities=("x", "y"),
            every=2,
            noise={"position": 1e-3, "position_per_speed": 2e-3},
            initial_pose=start,
            lever_arm={"x": 0.1, "known": False, "deviation": 5e-3},
        )
        assert isinstance(rates, YawRate)
        assert (rates.noise, rates.bias) == pytest.approx((np.deg2rad(0.1), np.deg2rad(0.2)))
        assert ranges == Ranges(
            beacons=((3, 3), (-3, 2.5)), noise=0.1, initial_pose=start, lever_arm={"y": -0.02}
        )
        assert problem.estimate == ("wheel_radius_right", "track")
        assert problem.prior.standard_deviations == {"track": "5 mm", "wheel_radius_right": "2 %"}

    @pytest.mark.parametrize(
        "text",
        [
            SENSORS,
            without(SENSORS, "estimate:"),
            changed("estimate: [wheel_radius_right, track]", "estimate: [track, wheel_radius_right]"),
            changed("bias: 0.2 deg/s", "bias: known"),
            changed("    bias: 0.2 deg/s\n", ""),
            changed("[x, y]", "[heading]").replace("position: 1 mm", "heading: 1 deg"),
            SENSORS.replace("{position: 1 cm, heading: 2 deg}", "known").replace(
                "{position: 10 mm, heading: 2 deg}", "known"
            ),
            changed("position: 1 mm", "covariance: [[1e-6, 1e-7], [1e-7, 2e-6]]").replace(
                "      position_per_speed: 2 ms\n", ""
            ),
            SMALL.replace(
                "{kind: displacements, segments: 4, noise: {position: 1 cm, heading: 1 deg}}",
                "[{kind: yaw_rate, noise: 0.1}]",
            ),
            SMALL.replace("{kind: displacements, segments: 4,", "{kind: poses,"),
            SMALL.replace("segments: 4,", "segments: 4, noise_model: absolute, estimator: ols,"),
            small(estimate="[c21]"),
        ],
        ids=[
            "full",
            "all parameters",
            "in another order",
            "known bias",
            "unknown bias",
            "headings",
            "known start",
            "covariance",
            "list of one",
            "no list",
            "absolute displacements",
            "some coefficients",
        ],
    )
    @pytest.mark.slow
    def test_an_echo_is_the_same_study(self, text: str):
        assert_echo_is_equal(text)
        study, again = parse_study(text), parse_study(yaml.safe_dump(parse_study(text).echo()))
        assert (again.problem.estimate, again.problem.prior) == (study.problem.estimate, study.problem.prior)

    def test_a_prior_covariance_is_echoed_too(self):
        prior = "prior: {parameters: [track, wheel_radius_right], covariance: [[1e-6, 1e-7], [1e-7, 4e-8]]}\n"
        text = SENSORS[: SENSORS.index("prior:")] + prior + SENSORS[SENSORS.index("limits:") :]
        assert_echo_is_equal(text)
        again = parse_study(yaml.safe_dump(parse_study(text).echo())).problem.prior
        assert again == parse_study(text).problem.prior
        assert again.covariance == ((1e-6, 1e-7), (1e-7, 4e-8))

    def test_a_list_is_short_for_several(self):
        listed = parse_study(SENSORS)
        assert listed.echo()["measurement"]["kind"] == "several"
        assert [sensor["kind"] for sensor in listed.echo()["measurement"]["sensors"]] == [
            "poses",
            "yaw_rate",
            "ranges",
        ]

    @pytest.mark.parametrize(
        ("old", "new", "line", "key", "message"), BROKEN_SENSORS.values(), ids=BROKEN_SENSORS.keys()
    )
    def test_one_mistake_is_named_by_its_line_and_key(
        self, old: str, new: str, line: str, key: str, message: str
    ):
        text = changed(old, new)
        flaws = flaws_of(text)
        place = [number for number, each in enumerate(text.splitlines(), 1) if each.strip().startswith(line)]
        assert [(flaw.line, flaw.key) for flaw in flaws] == [(place[0], key)]
        assert message in flaws[0].message

    def test_mistakes_in_several_sensors_are_reported_at_once(self):
        text = changed("every: 2", "every: 0").replace("bias: 0.2 deg/s", "bias: -1")
        text = text.replace("beacons: [[3 m,", "beacons: [[3 kg,").replace("track: 5 mm", "track: [1]")
        expected = [
            ("every", "measurement.0.every"),
            ("bias", "measurement.1.bias"),
            ("beacons", "measurement.2.beacons.0.0"),
            ("track: [1]", "prior.standard_deviations.track"),
        ]
        found = [(flaw.line, flaw.key) for flaw in flaws_of(text)]
        assert found == [(line_of(text, line), key) for line, key in expected]

    def test_a_prior_without_noise_has_nothing_to_be_weighed_against(self):
        text = small(prior="{standard_deviations: {c21: 1 mm}}")
        (flaw,) = flaws_of(text)
        assert (flaw.line, flaw.key) == (line_of(text, "prior"), "prior")
        assert "scaling: relative" in flaw.message

    def test_what_displacements_do_not_tell(self):
        text = small(estimate="[track]")
        (flaw,) = flaws_of(text)
        assert (flaw.line, flaw.key) == (line_of(text, "estimate"), "estimate")
        assert "track cannot be estimated from displacements, which tell c21, c22" in flaw.message

    @pytest.mark.parametrize("value", ["[]", "[3]", "[[]]"])
    def test_lists_of_no_sensors(self, value: str):
        begin, end = SENSORS.index("measurement:"), SENSORS.index("estimate:")
        text = f"{SENSORS[:begin]}measurement: {value}\n{SENSORS[end:]}"
        (flaw,) = flaws_of(text)
        assert flaw.line == line_of(text, "measurement")
        assert flaw.key in ("measurement", "measurement.0")


def test_mistakes_without_number_are_counted():
    flaws = flaws_of(SMALL + "".join(f"k{number}: 1\n" for number in range(3000)))
    assert len(flaws) == 201
    assert flaws[-1].key == "k200"
    assert flaws[-1].message == "and 2800 more mistakes"
    assert flaws[-1].line == SMALL.count("\n") + 201


class TestOwnPaths:
    @staticmethod
    def flaws(folder: Path, *files: str) -> tuple[FileFlaw, ...]:
        study = saved_study(folder, SMALL + "baselines:\n" + "".join(f"- file: {file}\n" for file in files))
        with pytest.raises(StudyError) as caught:
            own_paths(study)
        return caught.value.flaws

    def test_every_mistake_is_named_by_the_study_and_by_the_path(self, tmp_path: Path):
        header = "t,wheel_speed_right,wheel_speed_left\n"
        (tmp_path / "wrong.csv").write_text(header + "0,1,2\n1,two,2\n2,1,nan\n")
        (tmp_path / "good.csv").write_text(header + "0,1,2\n1,1,2\n2,1,2\n")
        flaws = self.flaws(tmp_path, "good.csv", "nowhere.csv", "wrong.csv")
        assert [(flaw.file, flaw.line, flaw.key) for flaw in flaws] == [
            (str(tmp_path / "study.yaml"), 13, "baselines.1.file"),
            (str(tmp_path / "study.yaml"), 14, "baselines.2.file"),
            (str(tmp_path / "study.yaml"), 14, "baselines.2.file"),
        ]
        assert [flaw.message.removeprefix(f"{tmp_path}/") for flaw in flaws] == [
            "nowhere.csv: no such file",
            "wrong.csv:3: wheel_speed_right: expected a finite number, got 'two'",
            "wrong.csv:4: wheel_speed_left: expected a finite number, got 'nan'",
        ]

    def test_what_is_no_path_is_not_repeated(self, tmp_path: Path):
        (tmp_path / "passwd").write_text("secretive:x:0:secret\nother:y:1:secret\nlast:z:2:secret\n")
        (flaw,) = self.flaws(tmp_path, "passwd")
        assert "the header lacks t, wheel_speed_right, wheel_speed_left; expected a path" in flaw.message
        assert "secret" not in flaw.message


HUGE = 10**40
"""More than fits into any memory, or any array's index."""


@pytest.mark.parametrize(
    ("keys", "key"),
    [
        (f"trajectory: {{duration: 10 s, samples: {HUGE}}}", "trajectory.samples"),
        (
            f"trajectory: {{duration: 10 s, samples: 40, spline: {{coefficients: {HUGE}}}}}",
            "trajectory.spline.coefficients",
        ),
        (f"trajectory: {{duration: 10 s, runs: {HUGE}}}", "trajectory.runs"),
        (f"solvers: [{{kind: ipopt, starts: {HUGE}}}]", "solvers.0.starts"),
        (f"solvers: [{{kind: genetic, population: {HUGE}}}]", "solvers.0.population"),
        (f"validation: {{replicates: {HUGE}}}", "validation.replicates"),
        (f"robust: {{kind: chance, draws: {HUGE}}}", "robust.draws"),
        (f"calibration: {{replicates: {HUGE}}}", "calibration.replicates"),
    ],
)
def test_counts_that_no_machine_can_hold_are_refused(keys: str, key: str):
    kept = [line for line in SMALL.splitlines() if not keys.startswith(line.partition(":")[0] + ":")]
    flaws = flaws_of("\n".join([*kept, keys]))
    (flaw,) = [flaw for flaw in flaws if flaw.key == key]
    assert flaw.line == len(kept) + 1
    assert "expected at most" in flaw.message


@pytest.mark.parametrize("name", ["load_study", "parse_study"])
def test_readers_of_files_say_where_they_are_now(name: str):
    with pytest.raises(ImportError, match=rf"oed\.study\.{name} is now oed\.{name}"):
        exec(f"from oed.study import {name}")
