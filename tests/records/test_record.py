"""Records: JSON that any program can read, saved and loaded without loss."""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import random_drive
from hypothesis import given
from hypothesis import strategies as st
from recorded import record_from
from studies import SMALL

from oed.foundation.errors import RecordError
from oed.foundation.files import write_files
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.solution import HistoryPoint, Solution, Start, Status, scored
from oed.records.outcomes import result_of, validation_of
from oed.records.record import Record, known_record, load_record, save_record
from oed.records.stored.parts import plain
from oed.records.stored.result import Margin, Result
from oed.records.stored.simulation import StoredValidation
from oed.simulation import validate
from oed.study.study import ValidationOptions
from oed.workflow.runner import record, record_files
from oed.workflow.studies import parse_study

STUDY = parse_study(SMALL)
PROBLEM = STUDY.problem


def solutions() -> list[Solution]:
    """A winding drive as a search's, a straight one (singular), a fast one (infeasible), and none."""
    winding, fast = random_drive(PROBLEM, 3, 1.0), random_drive(PROBLEM, 3, 30.0)
    straight = Trajectory.from_samples(np.ones((40, 2)), 10.0, (0, 0, 0))
    found = scored(STUDY.problem, winding, "winding")
    searched = Solution(
        name="ipopt",
        kind="ipopt",
        trajectory=winding,
        evaluation=found.evaluation,
        status=Status.CONVERGED,
        starts=(Start(12.5, Status.CONVERGED, 0.25, 31), Start(None, Status.FAILED, 0.5, 500)),
        wall_seconds=1.5,
        seed=3,
        stages={"starts": 12.5, "second_stage": -math.inf},
        history=(HistoryPoint(2000, 0.5, 12.0), HistoryPoint(2100, 1.5, 12.5)),
        gains={"workspace": 1.5, "wheel_speed": 0.0},
    )
    nothing = Solution("genetic", "genetic", None, None, Status.INFEASIBLE, detail="wheel_speed is too low.")
    return [
        searched,
        scored(STUDY.problem, straight, "straight"),
        scored(STUDY.problem, fast, "fast"),
        nothing,
    ]


@pytest.fixture(scope="module")
def made() -> Record:
    result = validate(PROBLEM, random_drive(PROBLEM, 3, 1.0), replicates=200, seed=0)
    options = ValidationOptions(replicates=200).model_dump(mode="json")
    validation = StoredValidation.model_construct(**options, seed=0, results=[validation_of("ipopt", result)])
    return record(STUDY, solutions(), 3, validation=validation)


def refuse(constant: str) -> None:
    raise AssertionError(f"{constant} is not JSON")


def entry(made: Record, name: str) -> dict[str, Any]:
    (found,) = [result for result in made.results if result.name == name]
    return found.plain()


class TestJson:
    @pytest.mark.slow
    def test_there_is_no_nan_nor_infinity(self, made: Record):
        assert json.loads(made.to_json(), parse_constant=refuse) == made.data

    def test_it_ends_with_a_newline(self, made: Record):
        assert made.to_json().endswith("}\n")

    @pytest.mark.parametrize("text", ["x: [ -1,  1 ]", "x: [   3 ]", "[ e ]", "a\nb: [\n 1,\n 2 ]"])
    def test_no_text_is_changed(self, made: Record, text: str):
        data = {**made.data, "study_text": text}
        assert json.loads(record_from(data).to_json()) == data

    def test_what_is_not_finite_is_null(self, made: Record):
        straight = entry(made, "straight")
        assert straight["standard_deviations"] == {"c21": None, "c22": None}
        assert entry(made, "ipopt")["stages"]["second_stage"] is None
        assert entry(made, "genetic")["objective"] is None

    @given(st.floats())
    def test_what_json_has_of_a_number(self, value: float):
        expected = value if math.isfinite(value) else None
        assert plain(value) == plain(np.float64(value)) == expected
        assert plain({"a": [(value,), np.array([value, 2.0])]}) == {"a": [[expected], [expected, 2.0]]}

    def test_of_nothing_and_of_numpy(self):
        assert plain(None) is None
        assert type(plain(np.float64(2))) is float
        assert [type(one) for one in plain([np.int64(3), np.bool_(True)])] == [int, bool]

    def test_of_status_and_of_rounded_numbers(self):
        assert plain((Status.FAILED, 0.123456), 3) == ["failed", 0.123]
        assert plain(np.array([[0.123456, math.inf]]), 3) == [[0.123, None]]

    def test_numbers_that_json_lacks_are_refused(self):
        with pytest.raises(ValueError, match="JSON"):
            record_from({"results": [], "number": math.nan}).to_json()


class TestContract:
    """The keys that other programs rely on, with their types."""

    def test_record(self, made: Record):
        types = {
            "format": int,
            "oed_version": str,
            "study": dict,
            "seed": int,
            "results": list,
            "certificate": (dict, type(None)),
            "validation": (dict, type(None)),
        }
        assert types.keys() <= made.data.keys()
        for key, kind in types.items():
            assert isinstance(made.data[key], kind), key
        assert (made.data["format"], made.data["seed"]) == (1, 3)
        assert made.data["study"] == STUDY.echo()
        assert made.data["study_text"] == SMALL

    @pytest.mark.parametrize("name", ["ipopt", "straight", "fast", "genetic"])
    def test_results(self, made: Record, name: str):
        number = (float, type(None))
        types = {
            "name": str,
            "kind": str,
            "status": str,
            "message": str,
            "feasible": bool,
            "violations": dict,
            "objective": number,
            "lambda_min": number,
            "lambda_max": number,
            "condition_number": number,
            "smallest_singular_value": number,
            "norm_y": number,
            "path_length": number,
            "wall_seconds": float,
            "starts": list,
            "trajectory": (str, type(None)),
        }
        found = entry(made, name)
        assert types.keys() <= found.keys()
        for key, kind in types.items():
            assert isinstance(found[key], kind), key

    def test_every_result_has_the_same_keys(self, made: Record):
        assert len({frozenset(result) for result in made.data["results"]}) == 1

    def test_starts(self, made: Record):
        first, second = entry(made, "ipopt")["starts"]
        assert first == {"objective": 12.5, "status": "converged", "wall_seconds": 0.25, "iterations": 31}
        assert second == {"objective": None, "status": "failed", "wall_seconds": 0.5, "iterations": 500}
        assert entry(made, "straight")["starts"] == []

    def test_numbers_are_those_of_the_evaluation(self, made: Record):
        evaluation, found = solutions()[0].evaluation, entry(made, "ipopt")
        for key in ("objective", "lambda_min", "lambda_max", "norm_y", "path_length", "condition_number"):
            assert found[key] == getattr(evaluation, key)
        assert found["smallest_singular_value"] == evaluation.smallest_singular_value
        assert found["feasible"] is True
        assert found["violations"] == {}
        assert {margin["limit"] for margin in found["margins"]} >= {"wheel_speed", "workspace", "duration"}

    def test_what_looser_limits_gain_is_said_of_searches_that_know_it(self, made: Record):
        gains = {margin["limit"]: margin["gain"] for margin in entry(made, "ipopt")["margins"]}
        assert (gains["workspace"], gains["wheel_speed"], gains["duration"]) == (1.5, 0.0, None)
        assert {margin["gain"] for margin in entry(made, "fast")["margins"]} == {None}

    def test_violations_are_named(self, made: Record):
        fast = entry(made, "fast")
        assert fast["feasible"] is False
        assert fast["violations"]["wheel_speed"] > 0
        exceeded = {margin["limit"] for margin in fast["margins"] if not margin["kept"]}
        assert exceeded == set(fast["violations"])

    def test_history(self, made: Record):
        assert entry(made, "ipopt")["history"] == [
            {"evaluations": 2000, "seconds": 0.5, "objective": 12.0},
            {"evaluations": 2100, "seconds": 1.5, "objective": 12.5},
        ]

    def test_a_search_without_a_design(self, made: Record):
        found = entry(made, "genetic")
        assert (found["feasible"], found["drive"], found["trajectory"]) == (False, None, None)
        assert found["message"].endswith("wheel_speed is too low.")

    def test_parameters(self, made: Record):
        assert made.data["parameters"] == [
            {
                "name": name,
                "nominal": 0.0245,
                "unit": "m",
                "block": "position",
                "noise": 0.01,
                "judged": True,
            }
            for name in ("c21", "c22")
        ]

    def test_validation(self, made: Record):
        (found,) = made.data["validation"]["results"]
        assert found["name"] == "ipopt"
        assert found["parameters"] == ["c21", "c22"]
        assert len(found["checks"]) == 6
        assert np.shape(found["promised_covariance"]) == np.shape(found["sampled_covariance"]) == (2, 2)
        assert np.shape(found["estimates"]) == (200, 2)
        assert isinstance(found["passed"], bool)
        assert all(isinstance(check["passed"], bool) for check in found["checks"])


class TestBest:
    def test_the_best_feasible_result(self, made: Record):
        assert made.data["best"] == "ipopt"
        assert made.best.name == "ipopt"

    def test_the_one_named(self, made: Record):
        assert record_from({**made.data, "best": "straight"}).best.name == "straight"

    @pytest.mark.parametrize("named", [None, "fast"])
    def test_unless_it_cannot_be(self, made: Record, named: str | None):
        assert record_from({**made.data, "best": named}).best.name == "ipopt"

    def test_of_a_record_that_names_none(self, made: Record):
        data = {key: value for key, value in made.data.items() if key != "best"}
        assert record_from(data).best.name == "ipopt"

    def test_nothing_feasible(self, made: Record):
        data = {**made.data, "best": None, "validation": None}
        for results in ([entry(made, "fast"), entry(made, "genetic")], []):
            assert record_from({**data, "results": results}).best is None


class TestDrive:
    @pytest.mark.slow
    @given(seed=st.integers(0, 2**32 - 1), amplitude=st.floats(1e-3, 100))
    def test_a_drive_is_kept_exactly(self, seed: int, amplitude: float):
        drive = random_drive(PROBLEM, seed, amplitude)
        text = json.dumps(result_of(scored(STUDY.problem, drive, "drive"), "drive.csv").plain())
        again = Result.model_validate_json(text).drive.trajectory
        for name in ("knots", "coefficients", "start"):
            np.testing.assert_array_equal(getattr(again, name), getattr(drive, name))
        assert (again.degree, again.samples) == (drive.degree, drive.samples)

    def test_no_drive(self, made: Record):
        assert made.result("genetic").drive is None

    def test_poses_are_there_to_be_drawn(self, made: Record):
        poses = solutions()[0].evaluation.states
        np.testing.assert_allclose(entry(made, "ipopt")["drive"]["poses"], poses, atol=1e-9)


class TestParts:
    def test_are_the_data_with_names_and_types(self, made: Record):
        for one, data in zip(made.results, made.data["results"], strict=True):
            assert one.plain() == data
            assert all(hasattr(one, key) for key in data)
        found = made.results[0]
        assert found.drive is not None
        assert found.drive.trajectory.samples == 40
        assert [margin.limit for margin in found.margins] == [
            margin["limit"] for margin in made.data["results"][0]["margins"]
        ]
        assert made.validation is not None
        assert made.validation.plain() == made.data["validation"]
        assert [one.plain() for one in made.parameters] == made.data["parameters"]
        assert [one.name for one in made.inputs] == list(PROBLEM.model.input_names)
        assert [one.name for one in made.states] == list(PROBLEM.model.states)
        assert (made.certificate, made.robustness, made.interrupted, made.seed) == (None, None, False, 3)

    def test_are_made_and_read_alike(self, made: Record):
        found = result_of(solutions()[0], None)
        assert Result.model_validate(json.loads(json.dumps(found.plain()))) == found

    def test_need_a_value_of_every_field_and_of_no_other(self):
        room = solutions()[0].evaluation.margins[0]
        assert Margin.of(room, limit=room.name, satisfied=True).plain()["kept"] is True
        with pytest.raises(TypeError, match="Margin: expected limit"):
            Margin.of(room, satisfied=True)
        with pytest.raises(TypeError, match="Margin has no kind"):
            Margin.of(room, limit=room.name, satisfied=True, kind="x")

    def test_of_other_data_say_which_key_is_wrong(self, made: Record):
        data = {**made.data, "results": [{**made.data["results"][0], "objective": "large"}]}
        with pytest.raises(
            RecordError, match=r"record\.json: results\.0\.objective: expected a number, got 'large'"
        ):
            known_record(data, Path("record.json"))

    def test_of_one_parameter_may_have_eigenvalues_that_rounding_tells_apart(self, made: Record):
        plain = made.results[0].plain()
        most = plain["lambda_max"]
        assert Result.model_validate({**plain, "lambda_min": math.nextafter(most, math.inf)}).feasible
        with pytest.raises(ValueError, match="expected at most lambda_max"):
            Result.model_validate({**plain, "lambda_min": 1.001 * most})


class TestFiles:
    def test_a_copy_is_equal_and_knows_its_study(self, made: Record, tmp_path: Path):
        save_record(made, tmp_path)
        for one in (made, load_record(tmp_path)):
            copy = pickle.loads(pickle.dumps(one))
            assert copy == one != made.saved_in(tmp_path).at(tmp_path)
            assert copy.study == one.study
        assert made == made.saved_in(tmp_path) != load_record(tmp_path)

    def test_round_trip(self, made: Record, tmp_path: Path):
        file = save_record(made, tmp_path / "deep" / "folder")
        assert file == tmp_path / "deep" / "folder" / "record.json"
        for place in (file, file.parent, str(file.parent)):
            assert load_record(place).data == made.data

    def test_trajectories_are_written_beside_it(self, tmp_path: Path):
        made = record(STUDY, solutions(), 3, named=True)
        write_files(tmp_path, record_files(STUDY, solutions(), made))
        files = {result.trajectory for result in made.results} - {None}
        assert files == {"ipopt.csv", "straight.csv", "fast.csv"}
        assert {path.name for path in tmp_path.iterdir()} == {*files, "record.json"}
        assert load_record(tmp_path).data == made.data

    def test_no_record(self, tmp_path: Path):
        for place in (tmp_path, tmp_path / "nowhere"):
            with pytest.raises(RecordError, match="no record there; make one with `oed run`"):
                load_record(place)

    @pytest.mark.parametrize(
        ("text", "line", "message"),
        [
            ("", 1, "not JSON"),
            ('{\n"format": 1,\noops}', 3, "not JSON"),
            ("[]", 0, "expected a record of format 1, got a list; make it again with `oed run`$"),
            ('"no"', 0, "expected a record of format 1, got 'no'; make it again with `oed run`$"),
            ("{}", 0, "of format 1, got keys and values without `format`; make it again with `oed run`$"),
            ('{"format": 0, "results": []}', 0, "expected a record of format 1, got format 0; make it"),
            ('{"format": "x", "results": []}', 0, "expected a record of format 1, got format 'x'; make it"),
            (
                '{"format": 2, "results": []}',
                0,
                r"a record of format 2, which a newer oed has written; this one \(\d.*\) reads format 1: "
                "update oed$",
            ),
            (
                '{"format": 1}',
                0,
                "a record of format 1 without the key `results`: the file is damaged, or was changed by "
                "hand; restore it, or make it again with `oed run`$",
            ),
        ],
    )
    def test_no_such_record(self, tmp_path: Path, text: str, line: int, message: str):
        (tmp_path / "record.json").write_text(text)
        with pytest.raises(RecordError, match=message) as caught:
            load_record(tmp_path)
        assert caught.value.issues[0].line == line

    def test_no_text(self, tmp_path: Path):
        (tmp_path / "record.json").write_bytes(b"\xff\xfe")
        with pytest.raises(RecordError, match="cannot be read"):
            load_record(tmp_path)
