"""The study of a record, as a study again; and what a record says before the next study."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded import record_from
from studies import SMALL, saved_study

from oed.foundation.errors import FileIssue, RecordError, StudyError
from oed.kernel.solution import scored
from oed.records.record import Record, load_record, save_record
from oed.records.recorded_study import recorded_study
from oed.study import yaml_source
from oed.study.study import Study, read_study
from oed.workflow.runner import record
from oed.workflow.studies import parse_study

POSES = SMALL.replace("kind: displacements, segments: 4", "kind: poses")


def made(text: str) -> Record:
    """The record of a winding drive, and of a straight one."""
    study = parse_study(text)
    wave = np.array([0.0, 0.6, 0.8, 0.9, -0.7, 0.2, 0.3, 0.0])
    wheels = {"winding": (wave, wave[::-1]), "straight": (wave, wave)}
    drives = {
        name: study.problem.design.trajectory(np.column_stack(speeds), np.zeros(3))
        for name, speeds in wheels.items()
    }
    return record(study, [scored(study.problem, drive, name) for name, drive in drives.items()], 0)


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Record:
    folder = tmp_path_factory.mktemp("record")
    save_record(made(POSES), folder)
    return load_record(folder)


class TestItsStudy:
    def test_is_made_of_data_without_yaml(self, saved: Record, monkeypatch: pytest.MonkeyPatch):
        def refuse(*_: object) -> None:
            raise AssertionError("a YAML text is parsed")

        monkeypatch.setattr(yaml_source, "_parsed", refuse)
        assert recorded_study(saved).problem.name == "Small study"

    def test_is_the_one_that_the_record_was_made_of(self, saved: Record):
        again, before = recorded_study(saved), parse_study(POSES)
        assert again.echo() == before.echo()
        assert again.text == POSES

    def test_mistakes_are_told_by_the_records_keys(self, saved: Record):
        study = saved.data["study"]
        limits = {**study["limits"], "path_length": -1.0}
        changed = record_from({**saved.data, "study": {**study, "limits": limits, "estimate": ["colour"]}})
        with pytest.raises(RecordError) as caught:
            recorded_study(changed)
        (issue,) = caught.value.issues
        assert (issue.file, issue.line, issue.key) == ("record", 0, "study.limits.path_length")

    def test_characters_that_steer_terminals_are_refused_as_in_a_file(self, saved: Record):
        changed = record_from({**saved.data, "study": {**saved.data["study"], "name": "a\x1b[2J"}})
        with pytest.raises(RecordError, match=r"study\.name: the character '\\x1b' cannot stand in a study"):
            recorded_study(changed)


class TestPriorOfARecord:
    @pytest.fixture
    def folder(self, tmp_path: Path) -> Path:
        save_record(made(POSES), tmp_path / "earlier")
        return tmp_path

    @staticmethod
    def study(folder: Path, prior: str, text: str = POSES) -> Study:
        return saved_study(folder, f"{text}prior: {prior}\n")

    def issue(self, folder: Path, prior: str) -> FileIssue:
        with pytest.raises(StudyError) as caught:
            self.study(folder, prior)
        (issue,) = caught.value.issues
        return issue

    def test_is_its_covariance_as_numbers(self, folder: Path):
        study = self.study(folder, "{record: earlier}")
        (told,) = load_record(folder / "earlier").results[0].covariances
        prior = study.problem.prior
        assert prior is not None
        assert prior.model_dump(mode="json", exclude_defaults=True) == told.plain()
        assert study.echo()["prior"] == prior.model_dump(mode="json", exclude_none=True)

    def test_of_no_record_is_named_by_file_line_and_key(self, folder: Path):
        issue = self.issue(folder, "{record: nowhere}")
        assert (issue.file, issue.line, issue.key) == (
            str(folder / "study.yaml"),
            POSES.count("\n") + 1,
            "prior.record",
        )
        assert "no record there; make one with `oed run`" in issue.message

    def test_of_no_result_names_those_there_are(self, folder: Path):
        issue = self.issue(folder, "{record: earlier, result: circle}")
        assert issue.key == "prior.result"
        assert issue.message == "expected one of winding, straight; found no circle"

    def test_of_a_drive_that_tells_too_little(self, folder: Path):
        issue = self.issue(folder, "{record: earlier, result: straight}")
        assert issue.key == "prior.record"
        assert issue.message == "the record's straight predicts no covariance of all parameters together"

    def test_is_refused_by_a_reader_that_opens_no_records(self, folder: Path):
        text = f"{POSES}prior: {{record: earlier}}\n"
        with pytest.raises(StudyError, match=r"prior\.record: expected a prior as numbers here"):
            read_study(yaml_source.parse_yaml(text, str(folder / "study.yaml")))
