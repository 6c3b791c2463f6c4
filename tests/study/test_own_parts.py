"""Sensors, criteria and limits of the user's own: from YAML and Python, saved, read again, reported again."""

from __future__ import annotations

import json
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from builders import random_drive
from own_parts import OWN_PARTS

import oed
from oed.cli import main
from oed.foundation.errors import RecordError, StudyError, UserMistake
from oed.foundation.own import code
from oed.kernel.criteria import PythonCriterion
from oed.kernel.solution import scored
from oed.records.record import load_record, save_record
from oed.records.recorded_study import recorded_study
from oed.report.page import sections_of
from oed.robots.sensors import PythonSensor
from oed.study.study import Study
from oed.workflow.experiments import validated, validation_options
from oed.workflow.runner import record, run
from oed.workflow.studies import load_study, parse_study

STUDY = """\
format: 1
name: All of it my own
robot: {kind: differential_drive, wheel_radius: 5 cm, track: 20 cm}
trajectory: {duration: 8 s, samples: 20, spline: {coefficients: 6}}
measurement:
  - {kind: poses, noise: {position: 1 cm, heading: 1 deg}}
  - {kind: python, object: own:Compass, noise: 0.02, every: 2}
limits:
  wheel_speed: 6 rad/s
  own:
    - {kind: python, object: own:Strip, half_width: 0.3}
criterion: {kind: python, object: own:LogSmallest}
solvers: [{kind: ipopt, starts: 1, perturbations: 0, second_stage: none}]
baselines: [straight]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    forget()


def forget() -> None:
    """Let modules be read anew, as another process would."""
    for name in [name for name in sys.modules if name.startswith(code.PREFIX)]:
        del sys.modules[name]
    code._packages.clear()


def load(folder: Path, text: str = STUDY, module: str = OWN_PARTS) -> Study:
    (folder / "own.py").write_text(module)
    (folder / "study.yaml").write_text(text)
    return load_study(folder / "study.yaml")


def driven(study: Study) -> oed.Record:
    """A record of a drive of a study, which is not searched for."""
    return record(study, [scored(study.problem, random_drive(study.problem, 1, amplitude=2.0), "some")], 0)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[oed.Record, Path]:
    """A run of such a study, and the folder that it is in, saved in `out`."""
    folder = tmp_path_factory.mktemp("own")
    return run(load(folder), folder / "out", workers=1), folder


@pytest.fixture
def home(done: tuple[oed.Record, Path], monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of that run, whose code has not been run since."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    (done[1] / "was_run").unlink(missing_ok=True)
    forget()
    yield done[1]
    forget()


@pytest.mark.slow
def test_a_study_of_ones_own_parts_is_solved_saved_and_read_again(
    done: tuple[oed.Record, Path], home: Path, folder: Path
) -> None:
    fresh, _ = done
    best = fresh.best
    assert best is not None
    by_e = load(folder, STUDY.replace("python, object: own:LogSmallest", "E")).problem
    assert best.objective == pytest.approx(np.log(oed.evaluate(by_e, best.drive.trajectory).objective))
    assert {margin.limit for margin in best.margins} >= {"wheel_speed", "strip"}
    assert np.abs(np.array(best.drive.poses)[:, 1]).max() <= 0.3 * 1.001

    again = load_record(home / "out")
    assert again.data == json.loads(fresh.to_json())
    study = recorded_study(again, trust=True)
    assert study.problem.measurement == load(home).problem.measurement
    assert oed.evaluate(study.problem, best.drive.trajectory).objective == pytest.approx(best.objective)


@pytest.mark.slow
def test_its_echo_is_the_same_study(folder: Path) -> None:
    study = load(folder)
    again = parse_study(json.dumps(study.echo()))
    for part in ("measurement", "limits", "criterion"):
        assert getattr(again.problem, part) == getattr(study.problem, part)
    assert again.echo() == study.echo()


@pytest.mark.slow
@pytest.mark.usefixtures("blank_figures")
def test_no_code_is_run_to_report_again(home: Path) -> None:
    place = home / "out"
    assert main(["report", str(place)]) == 0
    assert not (home / "was_run").exists()
    text = (place / "report.md").read_text()
    assert "the compass at every 2nd sample (11 times) with a standard deviation of 1.146 deg" in text
    assert "The criterion is log smallest, the logarithm of the smallest eigenvalue" in text


@pytest.mark.slow
def test_the_page_is_the_same_with_and_without_the_code(done: tuple[oed.Record, Path], home: Path) -> None:
    fresh, _ = done
    read = load_record(home / "out")
    for mine, other in zip(sections_of(fresh), sections_of(read), strict=True):
        assert (mine.title, mine.paragraphs) == (other.title, other.paragraphs)
        assert [table.rows for table in mine.tables] == [table.rows for table in other.tables]


@pytest.mark.slow
def test_code_is_run_for_who_trusts_it_only(home: Path) -> None:
    saved = load_record(home / "out")
    with pytest.raises(RecordError) as caught:
        validated(saved, validation_options(saved, replicates=100))
    keys = [issue.key for issue in caught.value.issues]
    assert sorted(keys) == ["study.criterion", "study.limits.own.0", "study.measurement.sensors.1"]
    assert all(
        "own.py, and would be run; read it, and if you trust it" in str(one) for one in caught.value.issues
    )
    assert not (home / "was_run").exists()
    assert validated(saved, validation_options(saved, replicates=100), trust=True, workers=1)
    assert (home / "was_run").exists()


@pytest.mark.slow
def test_what_needs_the_code_says_so(home: Path) -> None:
    (sensor,) = load_record(home / "out").study.measurement.sensors[1:]
    assert isinstance(sensor, PythonSensor)
    assert sensor.columns(20) == list(range(0, 21, 2))
    with pytest.raises(UserMistake, match=r"own:Compass is code, of .*own\.py, and was not run"):
        sensor.reading(None)


def test_parts_survive_pickling(folder: Path) -> None:
    problem = load(folder).problem
    again = pickle.loads(pickle.dumps(problem))
    assert (again.measurement, again.criterion) == (problem.measurement, problem.criterion)
    assert again.limits == problem.limits


@pytest.mark.slow
@pytest.mark.usefixtures("few_screened")
def test_the_number_of_workers_changes_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("oed.optimize.search.POOL_SECONDS", 0.0)
    study = load(folder)
    # Where all starts are after some steps: the first alone, the others in processes.
    solver = study.solvers[0].model_copy(update={"starts": 3, "max_iterations": 5})
    found = [oed.solve(study.problem, solver, seed=1, workers=workers) for workers in (1, 2)]
    one, two = ([start.objective for start in each.starts] for each in found)
    assert one == two
    assert None not in one


class TestFromPython:
    """Parts that a program makes are saved by where their classes stand."""

    def study(self, folder: Path) -> Study:
        sys.path.insert(0, str(folder))
        (folder / "my_parts.py").write_text(OWN_PARTS)
        sys.modules.pop("my_parts", None)
        import my_parts

        return load(folder, STUDY.replace("kind: python, object: own:Compass", "kind: yaw_rate")).changed(
            measurement=[oed.Poses(noise={"position": 0.01, "heading": 0.02}), my_parts.Compass(noise=0.03)],
            criterion=my_parts.LogSmallest(subset=("track",)),
            limits={"wheel_speed": 6, "own": [my_parts.Strip(half_width=0.3)]},
        )

    @pytest.mark.slow
    def test_they_are_saved_and_reported_again(self, folder: Path) -> None:
        fresh = driven(self.study(folder))
        save_record(fresh, folder / "out")
        echo = fresh.data["study"]
        sensor = echo["measurement"]["sensors"][1]
        assert (sensor["object"], sensor["folder"]) == ("my_parts:Compass", str(folder))
        assert yaml.safe_load(fresh.data["study_text"]) == echo
        assert echo["criterion"]["described"]["kind"] == "log_smallest"
        read = load_record(folder / "out")
        assert [part.paragraphs for part in sections_of(read)] == [
            part.paragraphs for part in sections_of(fresh)
        ]
        again = recorded_study(read, trust=True).problem
        assert again.measurement.sensors[1].noise == 0.03
        assert again.criterion.subset == ("track",)
        assert again.limits[1].half_width == 0.3

    @pytest.mark.slow
    def test_a_class_that_no_file_holds_is_saved_all_the_same(self, folder: Path) -> None:
        class Local(oed.E):
            kind: str = "local"

        study = load(folder, STUDY.replace("python, object: own:LogSmallest", "E")).changed(criterion=Local())
        save_record(driven(study), folder / "out")
        read = load_record(folder / "out")
        assert isinstance(read.study.criterion, PythonCriterion)
        assert sections_of(read)
        with pytest.raises(RecordError, match=r"study\.criterion: .*test_own_parts has no .*Local"):
            recorded_study(read, trust=True)


@pytest.mark.slow
def test_a_study_with_other_keys_is_checked_anew(folder: Path) -> None:
    study = load(folder)
    assert study.changed(name="Another").name == "Another"
    assert study.changed().echo() == study.echo()
    with pytest.raises(StudyError, match=r"criterion: expected .* got 7"):
        study.changed(criterion=7)
    with pytest.raises(StudyError, match="colour: unknown key"):
        study.changed(colour="red")
    with pytest.raises(StudyError, match="nothing bounds wheel_speed_right"):
        study.changed(limits={})


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ("own:Compass", "own:Strip", "measurement.1", "inherits from oed.Sensor"),
        (
            "own:Strip",
            "own:Compass",
            "limits.own.0",
            "own:Compass is no limit: expected a class",
        ),
        ("own:LogSmallest", "own:Nothing", "criterion", "own has no Nothing"),
        ("own:LogSmallest", "nowhere:E", "criterion", "no module nowhere in "),
        ("noise: 0.02", "nois: 0.02", "measurement.1", "nois: unknown key; did you mean noise? known here: "),
        ("half_width: 0.3", "half_width: wide", "limits.own.0", "half_width: expected a number, got 'wide'"),
        ("{kind: python, object: own:Strip", "{object: own:Strip", "limits.own.0.kind", "missing"),
    ],
)
def test_mistakes_are_named_with_their_key(folder: Path, old: str, new: str, key: str, words: str) -> None:
    with pytest.raises(StudyError) as caught:
        load(folder, STUDY.replace(old, new))
    (issue,) = caught.value.issues
    assert issue.key == key
    assert issue.line > 4
    assert words in issue.message


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ("moment.pose[2] +", "moment.pose[:2] +", "measurement", "whitening: expected (2, 2), got (1, 1)"),
        ("moment.pose[2] +", "None +", "measurement", "own:Compass: reading: TypeError"),
        ('moment.nuisances["north"]', 'moment.nuisances["x"]', "measurement", "KeyError: 'x' (own.py, line "),
        ("ca.SX(1 / self.noise)", "1 / 0", "measurement", "whitening: ZeroDivisionError"),
        (
            'ClassVar = ("rad",)',
            'ClassVar = ("rad", "m")',
            "measurement",
            "units: expected 1, one of each entry",
        ),
        (
            'kind: Literal["log_smallest"] = "log_smallest"',
            "",
            "criterion",
            "expected a name of its own, got 'E'",
        ),
        ("np.log(super()", "exit(super()", "criterion", "own:LogSmallest: judge: SystemExit"),
        (
            "np.log(super().judge(information))",
            "'much'",
            "criterion",
            "LogSmallest does not work: ValueError",
        ),
        ("np.log(super().judge(information))", "np.ones(3)", "criterion", "value: expected one number"),
        ("oed.Rows(y,", "oed.Rows(y[1:],", "limits", "expected 20 of lower, as of its expression, got (21,)"),
        ("return oed.Rows(", "return (", "limits", "rows: expected Rows, got "),
        ("drive.path[:, 1]", "drive.path[:, 7]", "limits", "own:Strip: rows: RuntimeError"),
    ],
)
def test_a_part_that_does_not_work_is_named_where_it_is(
    folder: Path, old: str, new: str, key: str, words: str
) -> None:
    assert old in OWN_PARTS
    with pytest.raises(StudyError) as caught:
        load(folder, module=OWN_PARTS.replace(old, new))
    (issue,) = caught.value.issues
    assert issue.key.startswith(key)
    assert issue.line > 4
    assert words in issue.message
    assert "\n" not in issue.message


def test_what_fails_later_is_named_too(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    criterion = load(folder).problem.criterion
    monkeypatch.setattr(type(criterion).__mro__[1], "judge", lambda *_: sys.exit(3))
    with pytest.raises(UserMistake, match="own:LogSmallest: judge: SystemExit: 3"):
        criterion.value([np.eye(2)])


def test_a_sensor_may_read_between_two_moments(folder: Path):
    own = (
        "import casadi as ca\nimport oed\n\n\nclass Odometer(oed.Sensor):\n"
        '    kind: str = "odometer"\n    when = "between samples"\n\n'
        "    def reading(self, moment):\n"
        "        return ca.norm_2(moment.state[:2] - moment.earlier.state[:2]) / moment.elapsed\n\n"
        "    def whitening(self, moment):\n        return ca.SX(1 / 0.01)\n"
    )
    (folder / "own.py").write_text(own, encoding="utf-8")
    keys = yaml.safe_load(STUDY)
    keys["measurement"][1] = {"kind": "python", "object": "own:Odometer", "every": 4}
    keys["limits"].pop("own")
    keys["criterion"] = "D"
    (folder / "study.yaml").write_text(yaml.safe_dump(keys), encoding="utf-8")
    sensor = load_study(folder / "study.yaml").problem.sensors[1]
    assert sensor.columns(20) == [4, 8, 12, 16, 20]
