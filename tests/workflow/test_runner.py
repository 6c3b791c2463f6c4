"""A study run from end to end: what is in the record, what is written, and what an interrupt leaves."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from listeners import interrupt
from studies import GENETIC, saved_study, small

from oed.foundation.errors import StudyError
from oed.kernel.criteria import E
from oed.kernel.evaluation import evaluate
from oed.records.path_file import read_trajectory
from oed.records.record import Record, load_record
from oed.study.study import Study
from oed.workflow.runner import best_of, run, search
from oed.workflow.studies import Work

MINE = "t,wheel_speed_right,wheel_speed_left\n" + "".join(f"{0.5 * k},0.5,0.25\n" for k in range(20))
SETTLED = "{kind: ipopt, starts: 2, perturbations: 0, second_stage: logdet}"
TEXT = small(
    solvers=f"{SETTLED}, {GENETIC}",
    baselines="[straight, random, {file: mine.csv, name: my drive}]",
    validation="{replicates: 100}",
    seed=5,
).replace("samples: 40", "samples: 12")
ONE = "{kind: ipopt, starts: 1, perturbations: 0, second_stage: none}"
NAMES = ["ipopt", "genetic", "straight", "straight_same_length", "random", "my drive"]


def make_study(folder: Path, text: str = TEXT) -> Study:
    (folder / "mine.csv").write_text(MINE)
    return saved_study(folder, text)


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[Study, Record, Path]:
    folder = tmp_path_factory.mktemp("run")
    study = make_study(folder)
    return study, run(study, folder / "out", workers=1), folder / "out"


def result(record: Record, name: str) -> dict[str, Any]:
    (found,) = [entry.plain() for entry in record.results if entry.name == name]
    return found


@pytest.mark.slow
class TestRecord:
    def test_every_search_and_path_is_there(self, ran):
        _, record, _ = ran
        assert [entry.name for entry in record.results] == NAMES
        kinds = {entry.name: entry.kind for entry in record.results}
        assert kinds == {
            **dict.fromkeys(NAMES, "baseline"),
            "ipopt": "ipopt",
            "genetic": "genetic",
            "my drive": "path",
        }

    def test_statuses(self, ran):
        _, record, _ = ran
        statuses = [entry.status for entry in record.results]
        assert statuses == ["converged", "searched", *["scored"] * 4]

    def test_numbers_are_those_that_evaluate_gives(self, ran):
        study, record, _ = ran
        for entry in record.results:
            evaluation = evaluate(study.problem, entry.drive.trajectory)
            assert entry.objective == pytest.approx(evaluation.objective, rel=1e-12, abs=1e-12)
            assert entry.feasible == evaluation.feasible
            assert entry.violations == evaluation.violations

    def test_the_best_is_named(self, ran):
        _, record, _ = ran
        assert record.data["best"] == record.best.name == "ipopt"

    def test_what_made_it(self, ran):
        study, record, _ = ran
        assert record.data["seed"] == 5
        assert record.data["study"] == study.echo()
        assert record.data["study_text"] == TEXT
        assert set(record.data["provenance"]) == {"packages", "python", "platform", "finished", "study"}
        assert record.data["provenance"]["study"] == "study.yaml"
        assert {"casadi", "numpy", "scipy", "pymoo"} <= set(record.data["provenance"]["packages"])

    def test_informative_feasible_drives_are_validated(self, ran):
        _, record, _ = ran
        validation = record.data["validation"]
        assert (validation["replicates"], validation["heading"]) == (100, "known")
        assert validation["seed"] == 5
        names = [entry["name"] for entry in validation["results"]]
        assert {"ipopt", "genetic"} <= set(names)
        left_open = {one.name for one in record.results if one.singular or not one.feasible}
        assert left_open
        assert not left_open & set(names)
        assert all(entry["passed"] for entry in validation["results"])

    def test_same_length_means_the_best_drives(self, ran):
        _, record, _ = ran
        same = result(record, "straight_same_length")
        assert same["path_length"] == pytest.approx(record.best.path_length, rel=1e-3)

    @pytest.mark.slow
    def test_nothing_is_left_unsaid(self, ran, tmp_path: Path):
        _, record, _ = ran
        assert record.data["notes"] == []
        text = small(solvers=ONE, bound="true").replace("samples: 40", "samples: 12")
        bounded = run(make_study(tmp_path, text), workers=1).data
        assert bounded["notes"] == []
        assert bounded["certificate"]["gap"] >= 0
        text = text.replace("criterion: {kind: E, scaling: none}", "criterion: {kind: modified_E}")
        other = make_study(tmp_path, text.replace(ONE, GENETIC))
        assert other.problem.criterion.kind == "modified_E"
        unbounded = run(other, workers=1).data
        assert unbounded["certificate"] is None
        assert "no bound is known" in unbounded["notes"][0]


class TestFiles:
    @pytest.mark.slow
    def test_what_is_written(self, ran):
        _, record, out = ran
        drives = {entry.trajectory for entry in record.results}
        assert drives == {f"{name.replace(' ', '_')}.csv" for name in NAMES}
        assert {path.name for path in out.iterdir()} == {*drives, "record.json"}

    @pytest.mark.slow
    def test_the_record_is_the_file(self, ran):
        _, record, out = ran
        assert load_record(out).data == json.loads(record.to_json())

    def test_every_drive_can_be_scored_again(self, ran):
        study, record, out = ran
        for entry in record.results:
            drive = read_trajectory(out / entry.trajectory, study.problem)
            objective = evaluate(study.problem, drive).objective
            assert objective == pytest.approx(entry.objective, rel=1e-9, abs=1e-9)

    @pytest.mark.slow
    def test_nothing_without_a_folder(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
        study = make_study(tmp_path, small(solvers=GENETIC, baselines="[random]"))
        monkeypatch.chdir(tmp_path)
        before = sorted(tmp_path.iterdir())
        record = run(study, workers=1)
        assert sorted(tmp_path.iterdir()) == before
        assert {entry.trajectory for entry in record.results} == {None}
        assert all(entry.drive is not None for entry in record.results)


TIMES = ("wall_seconds", "seconds", "finished")


def timeless(value: Any, *more: str) -> Any:
    """The same data without what tells the time, and without keys named `more`."""
    if isinstance(value, dict):
        return {key: timeless(entry, *more) for key, entry in value.items() if key not in (*TIMES, *more)}
    return [timeless(entry, *more) for entry in value] if isinstance(value, list) else value


def assert_alike(first: Any, second: Any, place: str = "record") -> None:
    """Equal but for rounding."""
    if isinstance(first, dict):
        assert first.keys() == second.keys(), place
        for key in first:
            assert_alike(first[key], second[key], f"{place}.{key}")
    elif isinstance(first, list):
        assert len(first) == len(second), place
        for index, pair in enumerate(zip(first, second, strict=True)):
            assert_alike(*pair, f"{place}.{index}")
    elif isinstance(first, float):
        assert second == pytest.approx(first, rel=1e-5, abs=1e-5), place
    else:
        assert first == second, place


class TestSeed:
    @pytest.mark.slow
    def test_the_same_seed_gives_the_same_record(self, ran, tmp_path: Path):
        study, record, _ = ran
        again = run(study, tmp_path / "again", workers=1)
        assert timeless(again.data) == timeless(record.data)

    @pytest.mark.slow
    def test_whatever_the_workers(self, ran, tmp_path: Path):
        study, record, _ = ran
        double = run(study, tmp_path / "double", workers=2)
        # Which start ends first is the workers' affair; where it leads is not. A singular drive's condition
        # number is rounding.
        varying = ("history", "condition_number")
        assert_alike(timeless(record.data, *varying), timeless(double.data, *varying))

    @pytest.mark.slow
    def test_another_seed_can_be_given(self, ran):
        study, record, _ = ran
        solutions, _ = search(Work(study, 6, workers=1))
        assert [solution.seed for solution in solutions] == [6, 6]
        first, other = record.result("ipopt").drive.trajectory, solutions[0].trajectory
        assert np.abs(first.coefficients - other.coefficients).max() > 0.01


class Listener:
    """Calls `action` at the step `after` of the stage whose description begins so (0: as it begins)."""

    def __init__(self, stage: str, after: int, action: Callable[[], None]) -> None:
        self.stage, self.after, self.action = stage, after, action
        self.stages: list[str] = []
        self.said: list[tuple[str, str]] = []
        self.steps = 0

    def say(self, sentence: str) -> None:
        self.said.append((self.stages[-1], sentence))

    def begin(self, description: str, total: int) -> None:
        self.stages.append(description)
        self.steps = -1
        self.advance()

    def advance(self, note: str = "") -> None:
        self.steps += 1
        if self.stages[-1].startswith(self.stage) and self.steps == self.after:
            self.action()


@pytest.mark.slow
class TestInterrupted:
    """An interrupted run keeps what has been found, and says that it was interrupted."""

    @pytest.fixture
    def study(self, ran) -> Study:
        """The one that has run, whose expressions are built."""
        return ran[0]

    def test_in_the_first_search(self, study: Study, tmp_path: Path):
        listener = Listener("starts", 1, interrupt)
        record = run(study, tmp_path / "out", workers=1, progress=listener)
        (entry,) = record.results
        assert (entry.name, entry.status) == ("ipopt", "interrupted")
        assert entry.message.startswith("Interrupted")
        assert entry.feasible
        assert record.best.name == "ipopt"
        assert record.data["validation"] is None
        assert load_record(tmp_path / "out").data == json.loads(record.to_json())
        drive = read_trajectory(tmp_path / "out" / entry.trajectory, study.problem)
        assert evaluate(study.problem, drive).objective == pytest.approx(entry.objective, rel=1e-9)

    def test_in_the_second_search(self, study: Study, tmp_path: Path):
        listener = Listener("genetic", 2, interrupt)
        record = run(study, tmp_path / "out", workers=1, progress=listener)
        assert [entry.name for entry in record.results] == ["ipopt", "genetic"]
        assert [entry.status for entry in record.results] == ["converged", "interrupted"]
        assert record.best.name == "ipopt"
        assert (tmp_path / "out" / "ipopt.csv").exists()
        # The first feasible drive is told of at once, and only the first.
        ((stage, sentence),) = listener.said
        assert stage == "starts"
        assert re.fullmatch(
            r"first feasible drive after \S+ s: standard errors c21 \S+ mm and c22 \S+ mm; .* goes on: "
            r"to make the standard error of the least certain combination of parameters as small as possible",
            sentence,
        )

    def test_before_anything_was_found_nothing_more_is_searched(self, study: Study, tmp_path: Path):
        listener = Listener("starts", 0, interrupt)
        record = run(study, tmp_path / "out", workers=1, progress=listener)
        assert "genetic" not in listener.stages
        assert [entry.name for entry in record.results] == ["ipopt"]
        assert record.best is None

    @pytest.mark.parametrize("stage", ["score baselines", "simulate experiments"])
    def test_after_the_searches(self, study: Study, tmp_path: Path, stage: str):
        listener = Listener(stage, 0, interrupt)
        with contextlib.suppress(KeyboardInterrupt):
            run(study, tmp_path / "out", workers=1, progress=listener)
        saved = load_record(tmp_path / "out")
        assert [entry.name for entry in saved.results][:2] == ["ipopt", "genetic"]
        assert saved.best.name == "ipopt"


def test_a_path_that_is_not_there_is_named_before_anything_is_searched(tmp_path: Path):
    listener = Listener("", -1, interrupt)
    study = saved_study(tmp_path, small(solvers=GENETIC, baselines="[{file: nowhere.csv}]"))
    with pytest.raises(StudyError, match=r"study\.yaml:12: baselines\.0\.file: .*nowhere\.csv: no such file"):
        run(study, tmp_path / "out", workers=1, progress=listener)
    assert listener.stages == []


class TestBestOf:
    @pytest.mark.slow
    def test_among_practically_equal_ones_the_most_informative(self, ran, tmp_path: Path):
        text = small(
            solvers="{kind: ipopt, name: plain, starts: 1, perturbations: 0, second_stage: none}, "
            "{kind: ipopt, name: settled, starts: 1, perturbations: 0, second_stage: logdet}"
        ).replace("samples: 40", "samples: 12")
        (plain, settled), _ = search(Work(make_study(tmp_path, text), 5, workers=1))
        assert settled.evaluation.log_determinant > plain.evaluation.log_determinant
        assert best_of([plain, settled], E()) is best_of([settled, plain], E()) is settled

    def test_nothing_feasible(self):
        assert best_of([], E()) is None


@pytest.mark.slow
def test_baselines_as_long_as_the_design_break_limits_only_where_that_is_asked_for(tmp_path: Path):
    one = "{kind: ipopt, starts: 1, perturbations: 0, second_stage: logdet}"
    asked = {"solvers": one, "baselines": "[straight, random]", "seed": 5}
    found, wanted = (
        run(
            make_study(tmp_path, small(**asked, **more).replace("samples: 40", "samples: 12")), workers=1
        ).results
        for more in ({}, {"same_length": "true"})
    )
    left_out = {one.name for one in wanted if one.name.endswith("_same_length") and not one.feasible}
    assert left_out
    assert {one.name for one in wanted} - {one.name for one in found} == left_out
