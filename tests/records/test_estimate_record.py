"""Estimates saved, and read again."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from oed.foundation.errors import RecordError
from oed.records.record import EstimateRecord, load_estimate
from oed.workflow.saving import save_estimate

DATA = {"format": 1, "parameters": [{"name": "track", "value": 0.2}], "notes": []}
RECORD = EstimateRecord.model_validate(DATA)


class TestSaving:
    def test_is_read_again(self, tmp_path: Path):
        path = save_estimate(RECORD, tmp_path / "new")
        assert path == tmp_path / "new" / "estimate.json"
        assert load_estimate(path).data == load_estimate(path.parent).data == RECORD.data
        assert load_estimate(path).values == {"track": 0.2}

    def test_a_comparison_by_one_measure_alone_agrees_with_nothing(self, tmp_path: Path):
        # Few readings leave the other measures without a value.
        score = {"value": 1.0, "difference": 0.0, "interval": None, "equal": True}
        own = {"name": "a", "kind": "skid_steer", "own": True, "comparable": True, "reason": "", "doubt": ""}
        numbers = {"parameters": [], "unknowns": 1.0, "starts": 0.0, "log_likelihood": 2.0}
        model = {**own, **numbers, "scores": {"bic": score}}
        found = {"readings": 6.0, "inflation": 1.0, "inflation_by": "blocks", "best": {"bic": "a"}}
        comparison = {**found, "models": [model], "agree": None, "favourites": ["a"]}
        made = EstimateRecord.model_validate({**DATA, "comparison": comparison})
        path = save_estimate(made, tmp_path / "new")
        (read,) = load_estimate(path).models
        assert (read.name, read.scores["bic"].value) == ("a", 1.0)

    def test_what_json_cannot_hold_is_not_written(self, tmp_path: Path):
        with pytest.raises(ValueError, match="not JSON compliant"):
            save_estimate(EstimateRecord.model_validate({**DATA, "x": math.nan}), tmp_path)
        assert list(tmp_path.iterdir()) == []


class TestLoading:
    def issue(self, place: Path) -> str:
        with pytest.raises(RecordError) as caught:
            load_estimate(place)
        (issue,) = caught.value.issues
        return issue.message

    def test_nothing_there(self, tmp_path: Path):
        assert self.issue(tmp_path) == "no estimate there; make one with `oed estimate`"
        assert self.issue(tmp_path / "no.json") == "no estimate there; make one with `oed estimate`"

    @pytest.mark.parametrize("text", ["{", "", "\x00", '{"format": 1'])
    def test_not_json(self, tmp_path: Path, text: str):
        (tmp_path / "estimate.json").write_text(text)
        assert self.issue(tmp_path).startswith("cannot be read: ")

    def test_not_text(self, tmp_path: Path):
        (tmp_path / "estimate.json").write_bytes(b"\xff\xfe\xff")
        assert self.issue(tmp_path).startswith("cannot be read: ")

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("[]", "expected an estimate of format 1, got a list"),
            ("3", "expected an estimate of format 1, got 3"),
            ("{}", "expected an estimate of format 1, got keys and values without `format`"),
            ('{"format": 2, "parameters": []}', "an estimate of format 2, which a newer oed has written"),
            ('{"format": 1}', "an estimate of format 1 without the key `parameters`: the file is damaged"),
        ],
    )
    def test_not_an_estimate(self, tmp_path: Path, text: str, message: str):
        (tmp_path / "estimate.json").write_text(text)
        assert self.issue(tmp_path).startswith(message)
