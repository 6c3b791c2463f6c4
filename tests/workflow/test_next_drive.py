"""The loop on a simulated robot: drive, estimate, drive again, until the parameters are as sure as wanted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from driven_robot import QUICKLY, ROOM_STUDY, write_log
from recorded import record_from

from oed.cli import main
from oed.cli.terminal.console import print_next
from oed.foundation.errors import Failure, StudyError, UserMistake
from oed.records.record import Record, load_estimate, load_record, save_record
from oed.robots.baselines import baselines
from oed.study.study import Study
from oed.workflow.aims import aims_of
from oed.workflow.estimate_logs import estimate
from oed.workflow.next_drive import next_drive
from oed.workflow.runner import run
from oed.workflow.studies import load_study, parse_study

SEARCH = "solvers: [{kind: ipopt, starts: 1, perturbations: 0, second_stage: none}]"
STUDY = f"{ROOM_STUDY}{SEARCH}\n{QUICKLY}"
STUDY = STUDY.replace("samples: 40", "samples: 20").replace("coefficients: 10", "coefficients: 8")
TRUTH = {"wheel_radius_right": 0.0325, "wheel_radius_left": 0.0334, "track": 0.1635}
TARGETS = {"wheel_radius_right": "0.3 %", "wheel_radius_left": "0.3 %", "track": "0.45 %"}
SHARES = {name: float(size[:-1]) / 100 for name, size in TARGETS.items()}


@pytest.fixture(scope="module")
def study() -> Study:
    return parse_study(STUDY)


@pytest.fixture(scope="module")
def designed(study: Study) -> Record:
    return run(study, workers=1)


@pytest.fixture(scope="module")
def following(study: Study, designed: Record, tmp_path_factory: pytest.TempPathFactory):
    """The log of the design, what is to be driven after it, and the folder that this is in."""
    folder = tmp_path_factory.mktemp("following")
    first = drive(study, designed, folder / "first.csv", np.random.default_rng(3))
    found = next_drive(designed, [first], targets=TARGETS, least_gain=0.0, out=folder / "next", workers=1)
    return first, found, folder / "next"


def drive(study: Study, record: Record, path: Path, rng: np.random.Generator) -> Path:
    return write_log(path, study.problem, record.best.drive.trajectory, TRUTH, rng)


def errors(found) -> dict[str, float]:
    return {entry.name: entry.standard_error / entry.value for entry in found.parameters}


def all_files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
class TestInterrupted:
    """The next drive of before stays; what there is of this one is kept beside it."""

    @pytest.fixture
    def old(self, designed, tmp_path: Path) -> Path:
        out = tmp_path / "next"
        out.mkdir()
        for name in ("next.yaml", "next.json", "estimate.json", "best.csv"):
            (out / name).write_text("old")
        save_record(designed, out)
        return out

    @pytest.mark.slow
    @pytest.mark.parametrize(
        "error", [KeyboardInterrupt(), Failure("no memory")], ids=["interrupt", "failure"]
    )
    def test_the_one_before_stays(self, study, designed, old, tmp_path, monkeypatch, error):
        def strike(*_: object, **__: object) -> None:
            raise error

        log = drive(study, designed, tmp_path / "log.csv", np.random.default_rng(1))
        monkeypatch.setattr("oed.workflow.runner.solve", strike)
        before = all_files(old)
        if isinstance(error, Failure):
            with pytest.raises(Failure, match="no memory"):
                next_drive(designed, [log], out=old, workers=1)
        else:
            found = next_drive(designed, [log], out=old, workers=1)
            assert found.folder == tmp_path / "next.interrupted"
            assert "interrupted" in found.reason
        assert all_files(old) == before
        # The estimate, which took its time, too.
        assert load_estimate(tmp_path / "next.interrupted").values.keys() == TRUTH.keys()

    def test_another_takes_its_place(self, study, designed, old, tmp_path):
        log = drive(study, designed, tmp_path / "log.csv", np.random.default_rng(1))
        found = next_drive(designed, [log], targets=dict.fromkeys(TRUTH, "50 %"), out=old, workers=1)
        assert found.stop
        assert found.folder == old
        # No design from before passes for the next drive; what is not oed's stays.
        assert all_files(old).keys() == {"next.json", "estimate.json", "best.csv"}


@pytest.mark.slow
class TestPriorsLogs:
    """A log that made the prior must not count again."""

    def test_it_is_refused_by_its_content(self, study, designed, following, tmp_path, capsys):
        first, found, out = following
        second = drive(study, designed, tmp_path / "second.csv", np.random.default_rng(6))
        assert list(found.record.study.prior.logs.values()) == [str(first)]
        copy = tmp_path / "copy.csv"
        copy.write_bytes(first.read_bytes())
        assert main(["next", str(out), str(copy), "--quiet"]) == 2
        assert f"{copy}: is {first} to the byte, which made the study's prior" in capsys.readouterr().err
        assert main(["estimate", str(out / "next.yaml"), str(first), "--quiet"]) == 2
        unsearched = load_record(out).data
        unsearched["study"]["solvers"] = []
        again = next_drive(record_from(unsearched), [second], workers=1)
        assert list(again.study.problem.prior.logs.values()) == [str(first), str(second)]

    def test_a_prior_from_a_record_hands_them_on(self, following, tmp_path):
        _, found, out = following
        (tmp_path / "study.yaml").write_text(f"{STUDY}prior: {{record: {out}}}\n")
        assert load_study(tmp_path / "study.yaml").problem.prior.logs == found.study.problem.prior.logs


@pytest.mark.slow
class TestLoop:
    def test_reaches_the_precision_in_fewer_runs_than_repeating_squares(
        self, study, designed, following, tmp_path
    ):
        # The first log again, and what was designed after it.
        rng, found, logs = np.random.default_rng(3), following[1], []
        record = designed
        for runs in range(1, 6):
            logs.append(drive(study, record, tmp_path / f"drive_{runs}.csv", rng))
            if runs > 1:
                found = next_drive(designed, logs, targets=TARGETS, least_gain=0.0, workers=1)
            if found.stop:
                break
            record = found.record
        assert logs[0].read_bytes() == following[0].read_bytes()
        assert found.stop
        assert found.record is None
        assert "as precise as wanted" in found.reason
        for name, value in found.estimate.values.items():
            assert value == pytest.approx(TRUTH[name], rel=5 * SHARES[name])

        rng, (square,) = np.random.default_rng(3), baselines(study.problem, "square")
        files = [tmp_path / f"square_{number}.csv" for number in range(3 * runs)]
        squares = [write_log(file, study.problem, square.trajectory, TRUTH, rng) for file in files]
        repeated = errors(estimate(study, squares))
        assert any(repeated[name] > share for name, share in SHARES.items())

    def test_predicts_what_the_next_drive_brings(self, study, following, tmp_path, capsys):
        first, found, out = following
        assert not found.stop
        assert 0.05 < found.gain < 0.9
        assert found.basis.startswith(
            "standard errors after it: the next drive is thought to drift as the logs"
        )
        assert found.data["basis"] == found.basis
        print_next(found)
        assert "standard errors after it: the next drive is thought to drift" in capsys.readouterr().out
        for entry in found.precision:
            assert entry.next < entry.now
        second = drive(study, found.record, tmp_path / "second.csv", np.random.default_rng(6))
        after = errors(estimate(study, [first, second]))
        for entry in found.precision:
            # The log estimates the sensor's place and the clocks along, which the design takes as known.
            assert 0.6 < after[entry.name] * entry.value / entry.next < 2.0
        assert json.loads((out / "next.json").read_text())["stop"] is False
        again = load_study(out / "next.yaml")
        assert again.problem.model.nominal == pytest.approx(list(found.estimate.values.values()))
        assert again.problem.prior is not None

    def test_stops_where_another_drive_gains_little(self, study, designed, tmp_path):
        log = drive(study, designed, tmp_path / "drive.csv", np.random.default_rng(7))
        found = next_drive(designed, [log], least_gain=0.9, workers=1)
        assert found.stop
        assert "less than 90.0 %" in found.reason


class TestMistakes:
    @pytest.mark.slow
    def test_target_for_what_is_not_estimated(self, study, designed, tmp_path):
        log = drive(study, designed, tmp_path / "drive.csv", np.random.default_rng(7))
        with pytest.raises(UserMistake, match="--target wheelbase: expected one of wheel_radius_right"):
            next_drive(designed, [log], targets={"wheelbase": "1 mm"})

    @pytest.mark.parametrize("size", ["1 deg", "0 mm", "-1 %", "much"])
    def test_target_that_is_no_size(self, study, size):
        with pytest.raises(UserMistake, match="--target track: expected"):
            aims_of(study, {"track": size}, "--target")

    @pytest.mark.slow
    def test_an_impossible_duration_leaves_nothing_behind(self, study, designed, tmp_path):
        log = drive(study, designed, tmp_path / "drive.csv", np.random.default_rng(7))
        with pytest.raises(StudyError, match="needs at least 6 coefficients"):
            next_drive(designed, [log], duration=0.2, out=tmp_path / "next")
        assert not list(tmp_path.glob("next/*"))

    def test_coefficients_have_no_nominal_values(self, designed, tmp_path):
        data = {**designed.data, "study": {**designed.data["study"], "estimate": ["c11", "c12"]}}
        with pytest.raises(UserMistake, match="estimates c11, c12"):
            next_drive(record_from(data), [tmp_path / "drive.csv"])
