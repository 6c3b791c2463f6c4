"""A robust study from end to end: its record, its next drive, and the logs of drives judged by it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from driven_robot import QUICKLY, ROOM_STUDY, write_log
from places import PROBLEMS
from recorded import record_from
from studies import GENETIC, saved_study, small

from oed.bounds import Certificate
from oed.foundation.errors import StudyError
from oed.kernel.evaluation import evaluate
from oed.kernel.solution import Solution, Status
from oed.optimize import Silent
from oed.optimize.assurance import ROUNDS
from oed.records.record import Record, load_record
from oed.study.study import Study
from oed.uncertainty.departures import interval_of, violation_probability
from oed.uncertainty.uncertainty import spread_of
from oed.workflow.driven import score_logs
from oed.workflow.next_drive import next_drive
from oed.workflow.robustness import safe
from oed.workflow.runner import run
from oed.workflow.studies import parse_study

WITHIN = "{wheel_radius_right: 5 %, wheel_radius_left: 5 %, track: 5 %, x: 1 cm}"
ROBUST = "{confidence: 0.98, draws: 400}"
FAST = "{kind: ipopt, starts: 1, perturbations: 0, second_stage: logdet}"
WHOLE = small(solvers=FAST, uncertainty=WITHIN, robust=ROBUST, baselines="[random]", seed=5)
TEXT = WHOLE.replace("samples: 40", "samples: 20").replace("coefficients: 8", "coefficients: 7")
TEXT = TEXT.replace("-1 m, 1 m", "-40 cm, 40 cm")
TINY = "{kind: rectangle, x: [-2 cm, 2 cm], y: [-2 cm, 2 cm]}"
KNOWN = {"name", "probability", "interval", "draws", "seed", "by_limit", "farthest"} | {
    "objective",
    "reserve",
    "kept",
    "checked_at_points",
}


class Hearing(Silent):
    """Hears sentences."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def say(self, sentence: str) -> None:
        self.said.append(sentence)


@pytest.fixture(scope="module")
def heard() -> Hearing:
    """What is said of the run."""
    return Hearing()


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory, heard: Hearing) -> tuple[Study, Record, Path]:
    folder = tmp_path_factory.mktemp("robust")
    study = saved_study(folder, TEXT)
    return study, run(study, folder / "out", workers=1, progress=heard), folder / "out"


def entry(record: Record, name: str) -> dict[str, Any]:
    (found,) = [one for one in record.data["robustness"]["results"] if one["name"] == name]
    return found


@pytest.mark.slow
@pytest.mark.usefixtures("ran")
def test_of_the_first_feasible_drive_is_told_once(heard):
    # The search without back-off, for comparison, finds feasible drives too.
    assert len(heard.said) == 1
    assert heard.said[0].startswith("first drive, untried with other robots, after")


@pytest.mark.slow
class TestRecord:
    def test_every_drive_is_simulated(self, ran):
        _, record, _ = ran
        names = [one["name"] for one in record.data["robustness"]["results"]]
        assert names == [one.name for one in record.results]
        assert names[:2] == ["ipopt", "nominal"]
        assert all(set(one) == KNOWN for one in record.data["robustness"]["results"])

    def test_numbers_are_those_that_leaving_gives(self, ran):
        study, record, _ = ran
        for result in record.results:
            found = entry(record, result.name)
            own = violation_probability(
                study.problem, result.drive.trajectory, draws=found["draws"], seed=found["seed"]
            )
            assert found["probability"] == own.probability
            # Searches verify several drives by the same draws.
            drives = 1 if found["reserve"] is None else ROUNDS + 1
            count = round(found["probability"] * found["draws"])
            assert found["interval"] == list(interval_of(count, found["draws"], drives))
            assert found["by_limit"] == own.by_limit
            assert found["objective"] == result.objective

    def test_what_is_uncertain_is_said(self, ran):
        study, record, _ = ran
        told = record.data["robustness"]["uncertain"]
        assert [one["name"] for one in told] == list(spread_of(study.problem.uncertain_system).names)
        assert told[2] == {
            "name": "track",
            "unit": "m",
            "nominal": 0.18,
            "low": pytest.approx(0.171),
            "high": pytest.approx(0.189),
            "uniform": True,
        }

    def test_only_the_search_keeps_something_in_reserve(self, ran):
        _, record, _ = ran
        kept = {one["name"]: one["reserve"] for one in record.data["robustness"]["results"]}
        assert kept.pop("ipopt") >= 2.3
        assert set(kept.values()) == {None}

    def test_the_search_without_reserve_is_told_as_infeasible(self, ran):
        study, record, _ = ran
        nominal = record.result("nominal")
        assert "workspace" in nominal.violations
        assert not nominal.feasible
        assert record.data["best"] == "ipopt"
        assert entry(record, "nominal")["probability"] > 0.02 > entry(record, "ipopt")["interval"][1]
        assert nominal.objective == pytest.approx(evaluate(study.problem, nominal.drive.trajectory).objective)

    def test_it_is_the_same_after_being_saved(self, ran):
        _, record, folder = ran
        saved = load_record(folder)
        assert saved.data["robustness"] == record.data["robustness"]
        text = json.dumps(record.data["robustness"], allow_nan=False)
        assert json.loads(text) == record.data["robustness"]
        assert (folder / "nominal.csv").is_file()

    def test_bundles_are_of_the_searches_drives(self, ran):
        study, record, _ = ran
        bundles = record.data["robustness"]["bundles"]
        assert [one["name"] for one in bundles] == ["ipopt", "nominal"]
        for bundle in bundles:
            assert np.shape(bundle["paths"])[1:] == (1, study.problem.design.samples + 1, 2)
            assert len(bundle["paths"]) == len(bundle["leaves"])
        assert sum(bundles[0]["leaves"]) < sum(bundles[1]["leaves"])

    def test_its_echo_is_the_same_study(self, ran):
        study, record, _ = ran
        again = parse_study(yaml.safe_dump(record.data["study"]))
        assert again.problem.uncertainty == study.problem.uncertainty
        assert again.problem.robust == study.problem.robust


@pytest.mark.slow
class TestWhatIsAsked:
    def test_a_study_that_is_not_robust_has_none(self, tmp_path):
        study = saved_study(tmp_path, small(solvers="", baselines="[straight]"))
        assert run(study, workers=1).data["robustness"] is None

    def test_uncertainty_of_a_system_that_nothing_has_to_survive_is_refused(self):
        text = (PROBLEMS / "heated_tank.yaml").read_text() + "\nuncertainty: {loss: 5 %}\n"
        with pytest.raises(StudyError, match="uncertainty: is what a robust drive has to survive"):
            parse_study(text)

    def test_uncertainty_of_a_robot_is_what_robots_are_drawn_from(self, tmp_path):
        study = saved_study(tmp_path, small(solvers="", baselines="[straight]", uncertainty=WITHIN))
        departures = run(study, workers=1).departures
        assert (departures.usual, departures.robust) == (False, False)
        assert [quantity.name for quantity in departures.uncertain][-1] == "x"

    def test_the_search_without_reserve_is_never_the_best(self, ran):
        study, _, _ = ran
        alike = [
            Solution(name, "ipopt", None, None, Status.CONVERGED) for name in ("ipopt", "nominal", "random")
        ]
        assert [one.name for one in safe(study, alike)] == ["ipopt", "random"]

    @pytest.mark.slow
    def test_the_search_without_reserve_may_be_left_out(self, driven):
        study, record, *_ = driven
        assert not study.problem.robust.compare
        assert [one.name for one in record.results][:2] == ["ipopt", "random"]
        assert [one["name"] for one in record.data["robustness"]["bundles"]] == ["ipopt"]

    def test_paths_alone_are_simulated_as_well(self, tmp_path):
        text = small(solvers="", baselines="[straight]", uncertainty=WITHIN, robust=ROBUST)
        record = run(saved_study(tmp_path, text), workers=1)
        (found,) = record.data["robustness"]["results"]
        assert found["name"] == "straight"
        # A straight drive tells too little: no number, not infinity.
        json.dumps(record.data, allow_nan=False)

    @pytest.mark.slow
    def test_without_any_drive_nothing_is_simulated(self, tmp_path):
        text = TEXT.replace(WITHIN, "{x: 5 cm}").replace("draws: 400", "draws: 400, compare: false")
        # Whatever searches: a genetic one takes no time.
        text = (
            text.replace(FAST, GENETIC)
            .replace("baselines: [random]\n", "")
            .replace("{kind: rectangle, x: [-40 cm, 40 cm], y: [-40 cm, 40 cm]}", TINY)
        )
        record = run(saved_study(tmp_path, text), workers=1)
        assert record.best is None
        assert record.data["robustness"]["results"] == []
        assert record.data["robustness"]["bundles"] == []
        assert "stays well inside would narrow it" in record.results[0].message

    def test_a_result_named_nominal_is_refused(self, tmp_path):
        text = small(solvers="{kind: ipopt, name: nominal}", uncertainty=WITHIN, robust=ROBUST)
        with pytest.raises(Exception, match="a second result named nominal"):
            saved_study(tmp_path, text)


SHORT = ROOM_STUDY.replace("samples: 40", "samples: 16").replace("coefficients: 10", "coefficients: 7")
PILOT = (
    f"{SHORT}{QUICKLY}solvers: [{{kind: ipopt, starts: 1, perturbations: 0, second_stage: none}}]\n"
    "uncertainty: {track: 3 %, y: 1 cm}\n"
    "robust: {kind: scenarios, confidence: 0.95, draws: 300, compare: false}\nbaselines: [random]\nlog: {}\n"
)
TRUTH = {"wheel_radius_right": 0.0325, "wheel_radius_left": 0.0334, "track": 0.1635}


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Study, Record, Path, Path]:
    """A pilot's study, its record and folder, and the log of a robot that is not the nominal one."""
    folder = tmp_path_factory.mktemp("pilot")
    study = saved_study(folder, PILOT)
    record = run(study, folder / "out", workers=1)
    drive, rng = record.best.drive.trajectory, np.random.default_rng(3)
    return study, record, folder / "out", write_log(folder / "log.csv", study.problem, drive, TRUTH, rng)


def next_study(record: Record, log: Path) -> Study:
    """The study of the next drive, without searching for it."""
    found = next_drive(record_from({**record.data, "study": {**record.data["study"], "solvers": []}}), [log])
    assert found.study is not None
    return found.study


@pytest.mark.slow
class TestDriven:
    def test_the_next_drive_is_sure_of_what_was_estimated(self, driven):
        _, record, _, log = driven
        following = next_study(record, log).problem
        # The start pose is uncertain as before; of the robot the prior speaks now.
        assert list(following.uncertainty.within) == ["y"]
        assert set(following.prior.names) == set(TRUTH)
        assert following.robust.kind == "chance"
        spread = spread_of(following.uncertain_system)
        assert spread.names == (*TRUTH, "y")
        assert spread.uniform.tolist() == [False, False, False, True]
        assert np.all(np.sqrt(np.diag(spread.covariance))[:3] < 0.01 * spread.nominal[:3])
        np.testing.assert_allclose(spread.nominal[:3], list(TRUTH.values()), rtol=0.01)

    def test_an_uncertainty_of_nothing_else_is_gone(self, driven):
        _, record, _, log = driven
        data = record.data
        del data["study"]["uncertainty"]["within"]["y"]
        following = next_study(record_from(data), log)
        assert following.problem.uncertainty is None
        assert "uncertainty" not in following.echo()
        assert spread_of(following.problem.uncertain_system).names == tuple(TRUTH)

    def test_what_was_driven_needs_nothing_in_reserve(self, driven, tmp_path, monkeypatch):
        study, record, folder, _ = driven
        # Of the bound it is compared with nothing is asked here.
        monkeypatch.setattr("oed.workflow.driven.bound", lambda _: Certificate(np.inf, "none", ()))
        drive = record.result("random").drive.trajectory
        log = write_log(tmp_path / "random.csv", study.problem, drive, {})
        scored = score_logs(study, [log], folder).first.result
        margins = {one.limit: one.margin for one in scored.margins}
        tight = {one.limit: one.margin for one in record.result("random").margins}
        assert margins["workspace"] > tight["workspace"] + 0.01
