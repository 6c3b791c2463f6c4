"""Study files: shipped ones, what is read from them, and every rule broken one at a time."""

from __future__ import annotations

import json
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from places import PROBLEMS
from studies import SMALL, saved_study, small
from valid import VALID, assert_echo_is_equal, assert_echo_of, issues_of, line_of, replaced

from oed.foundation.errors import FileIssue, StudyError
from oed.optimize import Genetic, Ipopt
from oed.optimize.ipopt_options import BUDGET
from oed.robots.models import DifferentialDrive
from oed.study.study import PathFile, json_schema
from oed.workflow.studies import load_study, own_paths, parse_study

STUDIES = sorted(PROBLEMS.glob("*.yaml"))


class TestShipped:
    @pytest.mark.parametrize("file", STUDIES, ids=lambda file: file.stem)
    @pytest.mark.slow
    def test_every_shipped_study_loads_and_its_echo_is_the_same(self, file: Path):
        study = load_study(file)
        assert study.source == str(file)
        assert study.text == file.read_text(encoding="utf-8")
        assert study.folder == file.parent
        assert study.solvers
        assert study.problem.name == study.name
        assert_echo_of(study)
        # As a process that it is given to has it.
        assert pickle.loads(pickle.dumps(study)).echo() == study.echo()

    def test_there_are_some(self):
        assert {"choi_skid_steer", "choi_paper_table"} <= {file.stem for file in STUDIES}


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
        small(solvers="{kind: genetic, population: 40, time_limit: 1 min}, {kind: ipopt, starts: 3}"),
        SMALL.replace("coefficients: 8", "coefficients: auto"),
    ],
    ids=[
        "full",
        "small",
        "extras",
        "free",
        "both",
        "scales",
        "slip",
        "radii",
        "no workspace",
        "relatives",
        "auto",
    ],
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
        assert study.solvers == (Ipopt(iterations=BUDGET),)
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
        [("ipopt", Ipopt(iterations=BUDGET)), ("genetic", Genetic())],
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
        "kind: hovercraft",
        "robot.kind",
        "'tricycle', 'unicycle', got 'hovercraft'",
    ),
    "wrong kind of solver": (
        "kind: genetic",
        "kind: oracle",
        "- kind: oracle",
        "solvers.0.kind",
        "got 'oracle'",
    ),
    "wrong kind of measurement": ("displacements", "guesses", "kind: guesses", "measurement.kind", "guesses"),
    "kind that is nearly one": (
        "displacements",
        "displacement",
        "kind: displacement",
        "measurement.kind",
        "got 'displacement'; did you mean displacements?",
    ),
    "word that is nearly one": (
        "  integration: arc",
        "  integration: arch",
        "integration",
        "trajectory.integration",
        "expected 'arc' or 'midpoint', got 'arch'; did you mean arc?",
    ),
    "a unit forgotten": (
        "18 cm",
        "18",
        "track",
        "robot.track",
        "18 is taken as 18 m, more than its room of 2 m; did you mean '18 cm'?",
    ),
    "a drive of years": (
        "10 s\n",
        "1e9 s\n",
        "duration",
        "trajectory.duration",
        "1e+09 is taken as 1e+09 s, more than a day; is its unit right?",
    ),
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
    "a number of coefficients in words": (
        "coefficients: 8",
        "coefficients: automatic",
        "spline",
        "trajectory.spline.coefficients",
        "expected 'auto', got 'automatic'",
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
    issues = issues_of(text)
    assert [(issue.line, issue.key) for issue in issues] == [(line_of(text, line), key)]
    assert message in issues[0].message
    assert str(issues[0]).startswith(f"some.yaml:{issues[0].line}: {key}: ")


def test_relative_scaling_needs_the_noise():
    text = SMALL.replace("scaling: none", "scaling: relative").replace("position: 1 cm, ", "")
    (issue,) = issues_of(text)
    assert (issue.line, issue.key) == (line_of(text, "measurement"), "measurement.noise")
    assert "the position noise is needed" in issue.message


def test_every_input_needs_a_limit():
    text = replaced("  wheel_speed: 10 rad/s\n", "")
    issues = issues_of(text)
    assert {(issue.line, issue.key) for issue in issues} == {(line_of(text, "limits"), "limits")}
    for issue, name in zip(issues, ("wheel_speed_right", "wheel_speed_left"), strict=True):
        assert f"nothing bounds {name}; add wheel_speed" in issue.message


@pytest.mark.parametrize(
    "sizes", ["c21: 1 mm, c22: 2 %", "c21: 0.1 cm, c22: 0.00049", "c21: 1e-3, c22: 0.49 mm"]
)
def test_a_scale_may_have_its_unit_or_be_a_share(sizes: str):
    problem = parse_study(SMALL.replace("scaling: none", f"scaling: {{{sizes}}}"), "some.yaml").problem
    assert [one.scales.tolist() for one in problem.any_estimations] == [pytest.approx([1e-3, 0.49e-3])]


def test_an_issue_of_a_key_that_is_not_there_says_its_name():
    text = SMALL.replace("differential_drive", "skid_steer").replace(
        "criterion: {kind: E, scaling: none}\n", ""
    )
    text = re.sub(
        "measurement: .*", "measurement: {kind: poses, noise: {position: 1 cm, heading: 1 deg}}", text
    )
    (issue,) = issues_of(text)
    assert (issue.key, issue.line) == ("criterion.scaling", 1)
    assert "slip_outer, slip_inner is nominally 0" in issue.message


@pytest.mark.parametrize("value", [".nan", ".inf", "0", "-1", "1 kg", "wide", "true"])
def test_a_scale_has_to_be_positive_and_finite(value: str):
    text = SMALL.replace("scaling: none", f"scaling: {{c21: {value}, c22: 1}}")
    (issue,) = issues_of(text)
    assert (issue.line, issue.key) == (line_of(text, "criterion"), "criterion.scaling.c21")


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
    issues_of(text)


class TestNoStudy:
    """What is no study at all."""

    @pytest.mark.parametrize("text", ["", "# only a remark\n", "- a\n- b\n", "hello\n", "3\n"])
    def test_not_a_mapping(self, text: str):
        (issue,) = issues_of(text)
        assert issue.line >= 1
        assert "expected a study" in issue.message

    def test_a_key_given_twice(self):
        text = replaced("seed: 3", "seed: 3\nname: Again")
        (issue,) = issues_of(text)
        assert (issue.line, issue.key) == (line_of(text, "name: Again"), "name")
        assert "given twice (first in line 2)" in issue.message

    def test_a_key_given_twice_inside(self):
        text = replaced("    population: 20", "    population: 20\n    population: 30")
        (issue,) = issues_of(text)
        assert (issue.line, issue.key) == (line_of(text, "population: 30"), "solvers.0.population")

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
        (issue,) = issues_of(text)
        assert "not valid YAML" in issue.message
        assert issue.line == (line_of(text, line) if line else len(text.splitlines()) + 1)

    def test_an_empty_file(self, tmp_path: Path):
        file = tmp_path / "empty.yaml"
        file.write_text("")
        with pytest.raises(StudyError, match="expected a study") as caught:
            load_study(file)
        assert caught.value.issues[0].file == str(file)

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
        found = [(issue.line, issue.key) for issue in issues_of(text)]
        assert found == [(line_of(text, line), key) for line, key in expected]

    def test_parts_that_do_not_fit_together_are_reported_at_once(self):
        text = replaced("segments: 4", "segments: 41").replace("coefficients: 8", "coefficients: 2")
        assert [issue.key for issue in issues_of(text)] == [
            "trajectory.spline.coefficients",
            "measurement.segments",
        ]

    def test_and_with_those_of_the_searches(self):
        text = replaced("segments: 4", "segments: 41").replace("start_from: genetic", "start_from: nobody")
        assert [issue.key for issue in issues_of(text)] == ["measurement.segments", "solvers.1.start_from"]

    def test_searches_and_validation(self):
        text = replaced("    heading: 1 deg\n", "").replace("start_from: genetic", "start_from: nobody")
        assert {issue.key for issue in issues_of(text)} == {"measurement.noise", "solvers.1.start_from"}

    def test_keys_given_twice(self):
        text = replaced("seed: 3", "seed: 3\nseed: 4\nname: Again")
        assert [issue.key for issue in issues_of(text)] == ["seed", "name"]


class TestSchema:
    def test_it_is_json(self):
        assert json.loads(json.dumps(json_schema(), allow_nan=False)) == json_schema()

    def test_it_names_the_keys(self):
        schema = json_schema()["else"]
        assert set(schema["properties"]) == set(yaml.safe_load(VALID)) | {
            "bound",
            "calibration",
            "estimate",
            "log",
            "physics",
            "prior",
            "robust",
            "same_length",
            "uncertainty",
            "weights",
        }
        assert schema["additionalProperties"] is False
        assert {"format", "name", "robot", "measurement"} == set(schema["required"])
        assert "json-schema.org" in json_schema()["$schema"]

    def test_it_knows_studies_of_systems(self):
        schema = json_schema()["then"]
        assert {"format", "name", "system", "experiment", "measurement"} == set(schema["required"])
        assert {"limits", "weights", "prior", "validation"} < set(schema["properties"])

    def test_it_names_what_is_inside(self):
        text = json.dumps(json_schema())
        for name in ("skid_steer", "slip_outer", "wheel_acceleration", "start_from", "straight_and_spin"):
            assert f'"{name}"' in text


@pytest.mark.slow
def test_mistakes_without_number_are_counted():
    issues = issues_of(SMALL + "solvers:\n" + "- {kind: ipopt, perturbations: -1}\n" * 300)
    assert len(issues) == 201
    assert issues[-1].key == "solvers.200.perturbations"
    assert issues[-1].message == "and 100 more mistakes"
    assert issues[-1].line == SMALL.count("\n") + 202


class TestOwnPaths:
    @staticmethod
    def issues(folder: Path, *files: str) -> tuple[FileIssue, ...]:
        study = saved_study(folder, SMALL + "baselines:\n" + "".join(f"- file: {file}\n" for file in files))
        with pytest.raises(StudyError) as caught:
            own_paths(study)
        return caught.value.issues

    def test_every_mistake_is_named_by_the_study_and_by_the_path(self, tmp_path: Path):
        header = "t,wheel_speed_right,wheel_speed_left\n"
        (tmp_path / "wrong.csv").write_text(header + "0,1,2\n1,two,2\n2,1,nan\n")
        (tmp_path / "good.csv").write_text(header + "0,1,2\n1,1,2\n2,1,2\n")
        issues = self.issues(tmp_path, "good.csv", "nowhere.csv", "wrong.csv")
        assert [(issue.file, issue.line, issue.key) for issue in issues] == [
            (str(tmp_path / "study.yaml"), 13, "baselines.1.file"),
            (str(tmp_path / "study.yaml"), 14, "baselines.2.file"),
            (str(tmp_path / "study.yaml"), 14, "baselines.2.file"),
        ]
        assert [issue.message.removeprefix(f"{tmp_path}/") for issue in issues] == [
            "nowhere.csv: no such file",
            "wrong.csv:3: wheel_speed_right: expected a finite number, got 'two'",
            "wrong.csv:4: wheel_speed_left: expected a finite number, got 'nan'",
        ]

    def test_what_is_no_path_is_not_repeated(self, tmp_path: Path):
        (tmp_path / "passwd").write_text("secretive:x:0:secret\nother:y:1:secret\nlast:z:2:secret\n")
        (issue,) = self.issues(tmp_path, "passwd")
        assert "the header lacks t, wheel_speed_right, wheel_speed_left; expected a path" in issue.message
        assert "secret" not in issue.message


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
    issues = issues_of("\n".join([*kept, keys]))
    (issue,) = [issue for issue in issues if issue.key == key]
    assert issue.line == len(kept) + 1
    assert "expected at most" in issue.message


@pytest.mark.parametrize(
    ("track", "line"),
    [
        ("track: 18 kg", 6),
        ("track:\n    18 kg", 7),
        ("track: &size  # between the wheels\n    '18 kg'", 7),
        ("track: 'eighteen\n    centimetres'", 6),
        ("trakc:\n    18 cm", 6),
    ],
)
def test_a_wrong_value_is_named_by_its_own_line_a_wrong_key_by_its(track: str, line: int):
    assert ("robot", line) in [
        (one.key.partition(".")[0], one.line) for one in issues_of(replaced("track: 18 cm", track))
    ]


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "message"),
    [
        ("18 cm", "0,18 m", 6, "robot.track", "whose unit ',18 m' is not known; decimals need a point"),
        ("18 cm", "", 6, "robot.track", "expected a length [m], got nothing"),
        (
            "seed: 3",
            "log:\n  inputs:\n    wheel_speed_right:\n      column: 1\n      form: tick",
            0,
            "log.inputs.wheel_speed_right.form",
            "got 'tick'; did you mean ticks?",
        ),
        (
            "seed: 3",
            "log:\n  inputs:\n    wheel_speed_right:\n      column: 1\n      unit: m",
            0,
            "log.inputs.wheel_speed_right.unit",
            "expected an angular speed [rad/s], got 'm', whose unit is of another kind",
        ),
    ],
)
def test_a_wrong_value_says_where_and_what_to_do(old: str, new: str, line: int, key: str, message: str):
    text = replaced(old, new)
    (issue,) = issues_of(text)
    # Else the last line is the wrong one.
    assert (issue.line, issue.key) == (line or len(text.rstrip().splitlines()), key)
    assert issue.message.endswith(message)


def test_a_baseline_is_called_by_its_name():
    (issue,) = issues_of(replaced("  - circle\n", "  - {kind: circle}\n"))
    assert issue.key == "baselines.0"
    assert issue.message.startswith("expected 'straight', 'circle', ")
    assert issue.message.endswith("got {'kind': 'circle'}")


def test_a_prior_of_a_mistyped_parameter_says_what_was_meant():
    text = small().replace("scaling: none", "scaling: relative")
    (issue,) = issues_of(f"{text}prior: {{standard_deviations: {{c211: 1 %}}}}\n")
    assert issue.message.endswith("the parameters are c21, c22; did you mean c21?")


def test_a_range_has_two_ends():
    (issue,) = issues_of(replaced("seed: 3", "log: {keep: {x: [5, 1, 3]}}"))
    assert issue.message.endswith("or expected at most 2 of them, got [5, 1, 3]")


def test_an_empty_file_is_no_study():
    (issue,) = issues_of("# to be written\n")
    assert issue.message == "expected a study (keys and values), got nothing; `oed init` makes a first one"


def test_many_unknown_keys_are_counted():
    more = "".join(f"key{number:02}: 1\n" for number in range(20))
    with pytest.raises(StudyError) as caught:
        parse_study(SMALL + more + "seed: none\n")
    issues = {issue.key: issue.message for issue in caught.value.issues}
    assert list(issues) == [*(f"key0{number}" for number in range(5)), "seed"]
    assert issues["key03"].startswith("unknown key; known here: ")
    assert issues["key04"] == "unknown key, as are 15 more beside it"


@pytest.mark.parametrize(
    ("keys", "instead"),
    [
        ("solvers: [{kind: cmaes}]", "solvers.0.kind: .* use `kind: genetic`"),
        ("solvers: [{kind: differential_evolution}]", "solvers.0.kind: .* use `kind: genetic`"),
        ("solvers: [{kind: genetic, crossover: sbx}]", "solvers.0.crossover: .*leave this out"),
        ("solvers: [{kind: genetic, mutation: gaussian}]", "solvers.0.mutation: .*leave this out"),
        ("robust: {kind: tube}", "robust.kind: .* use `kind: chance`"),
        ("calibration: {noise: stated}", "calibration.noise: use `specified`"),
    ],
)
def test_removed_keys_and_kinds_name_what_to_write_instead(keys: str, instead: str):
    name = keys.partition(":")[0]
    lines = [line for line in SMALL.splitlines() if not line.startswith(f"{name}:")]
    with pytest.raises(StudyError, match=instead):
        parse_study("\n".join([*lines, keys]))


@pytest.mark.parametrize("name", ["a/b", "-x", ""])
def test_names_of_results_are_asked_for_in_words(name: str):
    with pytest.raises(
        StudyError, match=r"solvers\.0\.name: expected a name of letters, digits, spaces, _ and"
    ):
        parse_study(small(solvers=f"{{kind: ipopt, name: '{name}'}}"))
