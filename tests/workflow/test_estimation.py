"""`estimate`: a study and its robot's logs in files, to a record."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from studies import saved_study

from oed.foundation import files
from oed.foundation.errors import LogError, UserMistake
from oed.records.record import EstimateRecord, load_estimate
from oed.report import write_estimate
from oed.report.estimate.logs import findings
from oed.report.estimate.parameters import estimate_lines
from oed.study.study import Study
from oed.workflow.arrivals import fingerprint_of
from oed.workflow.driven import score_logs
from oed.workflow.estimate_logs import estimate
from oed.workflow.saving import NotSaved
from oed.workflow.studies import parse_study

pytestmark = pytest.mark.usefixtures("blank_figures")

STUDY = """\
format: 1
name: Logged
robot: {kind: differential_drive, wheel_radius: 5 cm, track: 20 cm}
trajectory: {duration: 10 s, samples: 40, spline: {degree: 3, coefficients: 8}}
measurement: {kind: poses, noise: {position: 2 mm, heading: 5 mrad}}
limits: {wheel_speed: 10 rad/s}
criterion: {kind: E}
seed: 3
"""
CALIBRATION = "calibration: {segment: 2 s, noise: specified, clock_offset: false}\n"
QUICK = STUDY + CALIBRATION
TRUTH = {"wheel_radius_right": 0.0515, "wheel_radius_left": 0.0492, "track": 0.213}


def write_drive(file: Path, seed: int, rows: int = 100, period: float = 0.1) -> Path:
    """The table of a drive: times, wheel speeds held to the next row, noisy poses."""
    rng, times = np.random.default_rng(seed), period * np.arange(rows)
    right = 3 + 4 * np.sin(0.7 * times + seed) + 2 * np.cos(1.7 * times)
    left = 3 - 4 * np.cos(0.5 * times + seed) + 2 * np.sin(1.3 * times)
    poses = [np.zeros(3)]
    for one, other in zip(
        TRUTH["wheel_radius_right"] * right, TRUTH["wheel_radius_left"] * left, strict=True
    ):
        x, y, heading = poses[-1]
        turn, forward = (one - other) / TRUTH["track"] * period, (one + other) / 2 * period
        mean = forward * np.exp(1j * heading) * (np.exp(1j * turn) - 1) / (1j * turn)
        poses.append(np.array([x + mean.real, y + mean.imag, heading + turn]))
    noisy = np.array(poses[:-1]) + rng.normal(size=(rows, 3)) * [0.002, 0.002, 0.005]
    table = np.column_stack([times, right, left, noisy])
    header = "t,wheel_speed_right,wheel_speed_left,x,y,heading"
    np.savetxt(file, table, delimiter=",", header=header, comments="")
    return file


def plain(record: EstimateRecord) -> dict:
    """What it holds but for when it was made."""
    return {key: value for key, value in record.data.items() if key != "provenance"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("logged")
    for seed in range(3):
        write_drive(place / f"drive_{seed}.csv", seed)
    return place


@pytest.fixture(scope="module")
def study(folder: Path) -> Study:
    return saved_study(folder, STUDY)


@pytest.fixture(scope="module")
def quick(folder: Path) -> Study:
    """Of which estimates are made in a third of the time: what is told of them is the same."""
    return saved_study(folder, QUICK)


@pytest.fixture(scope="module")
def record(folder: Path, quick: Study) -> EstimateRecord:
    drives = [folder / "drive_0.csv", folder / "drive_1.csv"]
    return estimate(quick, drives, apart=[folder / "drive_2.csv"], out=folder / "out")


class TestEstimate:
    @pytest.mark.slow
    def test_intervals_hold_the_truth(self, record: EstimateRecord):
        for entry in record.parameters:
            low, high = entry.interval
            assert low < TRUTH[entry.name] < high
            assert high - low < 0.01 * entry.value

    @pytest.mark.slow
    def test_is_written_and_read(self, record: EstimateRecord, folder: Path):
        assert load_estimate(folder / "out").data == record.data
        assert load_estimate(folder / "out" / "estimate.json").values == record.values

    @pytest.mark.slow
    def test_what_cannot_be_saved_is_found_all_the_same(
        self, quick: Study, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ):
        out, spare = tmp_path / "out", tmp_path / "spare"
        for place in (out, spare):
            place.mkdir()
        (out / "estimate.json").write_text("old")
        real = files.new_file

        def full(folder: Path) -> tuple[int, Path]:
            if not folder.is_relative_to(spare):
                raise OSError(28, "No space left on device")
            return real(folder)

        monkeypatch.setattr(files, "new_file", full)
        monkeypatch.setattr(tempfile, "tempdir", str(spare))
        with pytest.raises(
            NotSaved, match=r"No space left on device; what was in .*out is as it was"
        ) as caught:
            estimate(quick, [folder / "drive_0.csv"], out=out)
        (saved,) = spare.iterdir()
        assert str(saved) in str(caught.value)
        assert load_estimate(saved).values == caught.value.found.values
        assert (out / "estimate.json").read_text() == "old"

    @pytest.mark.slow
    def test_same_seed_same_result(self, folder: Path):
        keys = "calibration: {segment: 1 s, covariance: bootstrap, block: 1 s, replicates: 100}\n"
        study, drive = saved_study(folder, STUDY + keys), folder / "drive_0.csv"
        one, same, other = (estimate(study, [drive], seed=seed) for seed in (None, 3, 4))
        assert plain(one) == plain(same)
        assert one.data["covariance_kind"] == "bootstrap"
        assert one.values == other.values
        assert one.data["covariance"] != other.data["covariance"]

    @pytest.mark.slow
    def test_the_last_part_of_logs_is_only_reckoned(self, quick: Study, folder: Path):
        files = [folder / "drive_0.csv", folder / "drive_1.csv"]
        found = estimate(quick, files, apart=[folder / "drive_2.csv"], hold_out=0.25)
        names = found.data["held_out"]["logs"]
        assert names == ["drive_2", "drive_0 (last 25 %)", "drive_1 (last 25 %)"]
        assert "the last 25 % of each drive is test data" in str(found.data["logs"][0]["findings"])

    @pytest.mark.parametrize("share", [-0.1, 1.0, float("nan")])
    def test_a_share_to_hold_out_that_is_none(self, study: Study, folder: Path, share: float):
        with pytest.raises(UserMistake, match="hold_out: expected a share of each log"):
            estimate(study, [folder / "drive_0.csv"], hold_out=share)

    @pytest.mark.slow
    def test_logs_apart_are_only_reckoned(self, record: EstimateRecord, quick: Study, folder: Path):
        held = record.data["held_out"]
        assert held["logs"] == ["drive_2"]
        assert held["mean"]["after"]["rmse_position"] < 0.3 * held["mean"]["before"]["rmse_position"]
        without = estimate(quick, [folder / "drive_0.csv", folder / "drive_1.csv"])
        assert without.values == record.values
        assert without.data["held_out"] is None

    @pytest.mark.slow
    def test_stages_are_told(self, folder: Path, quick: Study):
        class Listener:
            def __init__(self):
                self.told: list[str] = []

            def begin(self, stage, total):
                self.told.append(f"begin {stage}")

            def advance(self, *_):
                self.told.append("done")

        listener = Listener()
        estimate(quick, [folder / "drive_0.csv"], progress=listener)
        assert listener.told[0] == "begin reading logs"
        assert listener.told[1::2] == ["done"] * (len(listener.told) // 2)

    def test_no_logs(self, study: Study):
        with pytest.raises(LogError, match="no logs were given"):
            estimate(study, [])

    @pytest.mark.slow
    def test_nothing_is_written_unless_asked(self, quick: Study, folder: Path):
        before = set(folder.iterdir())
        estimate(quick, [folder / "drive_0.csv"])
        assert set(folder.iterdir()) == before


class TestTwice:
    def test_a_log_counts_once(self, tmp_path: Path):
        file = write_drive(tmp_path / "run.csv", 0)
        study = saved_study(tmp_path, STUDY)
        with pytest.raises(LogError, match=r"run\.csv: given twice"):
            estimate(study, [file, tmp_path / "." / "run.csv"])
        with pytest.raises(LogError, match=r"run\.csv: given twice"):
            estimate(study, [file], apart=[file])
        copy = tmp_path / "copy.csv"
        copy.write_bytes(file.read_bytes())
        with pytest.raises(LogError, match=r"copy\.csv: is the same as .*run\.csv to the byte"):
            estimate(study, [file, copy])

    @pytest.mark.slow
    def test_a_log_that_made_the_prior_is_in_it_already(self, tmp_path: Path):
        file, other = write_drive(tmp_path / "run.csv", 0), write_drive(tmp_path / "other.csv", 1)
        study = saved_study(tmp_path, QUICK)
        made = estimate(study, [file])
        prior = {"parameters": list(made.values), "covariance": made.covariance}
        logs = {fingerprint_of(file, study.log): "drives/first.csv"}
        copy = tmp_path / "copy.csv"
        copy.write_bytes(file.read_bytes())
        # Priors of earlier versions do not say from which logs they are.
        unnamed, named = study.changed(prior=prior), study.changed(prior={**prior, "logs": logs})
        assert "logs" not in unnamed.echo()["prior"]
        assert named.echo()["prior"]["logs"] == logs
        estimate(unnamed, [file])
        estimate(named, [other], apart=[file])
        for given in (file, copy):
            said = rf"{given.name}: is drives/first\.csv to the byte, which made the study's prior"
            with pytest.raises(LogError, match=said):
                estimate(named, [other, given])
        with pytest.raises(LogError, match=r"cannot be read|no such file"):
            estimate(named, [tmp_path / "none.csv"])


def test_a_fault_of_the_log_is_all_that_is_told(tmp_path: Path):
    file = write_drive(tmp_path / "run.csv", 0)
    lines = file.read_text().splitlines()
    lines[5] = ",".join(["?", *lines[5].split(",")[1:]])
    file.write_text("\n".join(lines))
    study = saved_study(tmp_path, STUDY)
    for name in ("run.csv", "missing.csv"):
        with pytest.raises(LogError) as caught:
            estimate(study, [tmp_path / name])
        assert [Path(issue.file).name for issue in caught.value.issues] == [name]


def test_a_foreign_table_asks_for_the_key_that_explains_it(tmp_path: Path):
    (tmp_path / "run.csv").write_text("time,left,right\n0,1,1\n1,1,1\n2,1,1\n")
    with pytest.raises(LogError) as caught:
        estimate(saved_study(tmp_path, STUDY), [tmp_path / "run.csv"])
    # The cause comes first, and what the log lacks is one line.
    cause, lacking = map(str, caught.value.issues)
    assert "study.yaml: log: the study has no key `log`" in cause
    assert lacking.endswith(
        "run.csv:1: nothing says where time, wheel_speed_right, wheel_speed_left, x, y and heading are; "
        "it has time, left, right"
    )


@pytest.mark.parametrize("rows", [slice(None, None, -1), [0, 1, 2, 2, 3, 4]])
def test_times_that_do_not_rise_come_with_the_keys_that_may_mend_them(tmp_path: Path, rows):
    file = write_drive(tmp_path / "drive.csv", 0)
    header, *lines = file.read_text().splitlines()
    # Other readings at the same time: a row that is merely given twice is left out.
    marked = [f"{line.rpartition(',')[0]},{number}" for number, line in enumerate(np.array(lines)[rows])]
    file.write_text("\n".join([header, *marked]) + "\n")
    with pytest.raises(LogError) as caught:
        estimate(saved_study(tmp_path, STUDY), [file])
    *issues, hint = caught.value.issues
    assert {issue.key for issue in issues} == {"t"}
    assert hint.key == "log"
    assert "sort the rows, or say with `runs`" in hint.message


@pytest.mark.parametrize(
    ("log", "said"),
    [
        (
            "log:\n  inputs:\n    wheel_speed_right:\n      column: wheel_right\n",
            "wheel_speed_right: the header lacks 'wheel_right'; did you mean wheel_speed_right? it has t, "
            "wheel_speed_right, wheel_speed_left, x, y, heading "
            "(named in {study}:12: log.inputs.wheel_speed_right.column)",
        ),
        ("log:\n  poses: {y: y,\n    x: east}\n", "(named in {study}:11: log.poses.x)"),
        (
            "log:\n  time: {column: 9}\n",
            "time: there is no column 9; the last one is 5, from 0 (named in {study}:10: log.time.column)",
        ),
        (
            "log:\n  poses:\n    file: drive.tum\n",
            "file: no such file; did you mean drive.txt? (named in {study}:11: log.poses.file)",
        ),
        ("log:\n  keep: {steady: 1}\n", "(named in {study}:10: log.keep.steady)"),
        ("log:\n  keep: {x: [7, 9]}\n", "keep: no row has x from 7 to 9 (named in {study}:10: log.keep)"),
        ("log:\n  runs:\n    x\n", "does another column tell them apart? (named in {study}:11: log.runs)"),
        (
            "log: {poses: {file: '{stme}.csv'}}\n",
            "no such file; `{{stem}}` stands for the log's own (named in {study}:9: log.poses.file)",
        ),
        ("log:\n  poses: {x: x, heading:\n    yaw}\n", "(named in {study}:11: log.poses.heading)"),
        ("log: {skip_stationary: true}\n", "(name it in {study}:9: log.poses.y.column)"),
    ],
)
def test_what_a_log_has_not_is_named_with_the_line_of_the_study(tmp_path: Path, log: str, said: str):
    file = write_drive(tmp_path / "drive.csv", 0)
    (tmp_path / "drive.txt").write_text("")
    if "skip_stationary" in log:
        file.write_text(file.read_text().replace(",y,", ",north,"))
    study = saved_study(tmp_path, f"{STUDY}{log}")
    with pytest.raises(LogError) as caught:
        estimate(study, [file])
    (issue,) = caught.value.issues
    assert str(issue).endswith(said.format(study=study.source))


@pytest.mark.slow
def test_rows_without_numbers_are_refused_with_a_hint_or_skipped_and_counted(tmp_path: Path):
    file = write_drive(tmp_path / "drive.csv", 0)
    lines = file.read_text().splitlines()
    lines[20] = ",".join([*lines[20].split(",")[:3], "nan", "nan", "nan"])
    file.write_text("\n".join(lines) + "\n")
    with pytest.raises(LogError) as caught:
        estimate(saved_study(tmp_path, STUDY), [file])
    assert caught.value.issues[-1].key == "log"
    assert "`skip_invalid_rows: true`" in caught.value.issues[-1].message
    found = estimate(saved_study(tmp_path, f"{QUICK}log: {{skip_invalid_rows: true}}\n"), [file])
    said = [one.message for group in findings(found).values() for _, one in group]
    assert any(text.startswith("the poses of 1 of 100 rows of drive.csv are skipped") for text in said)
    assert any(
        "the poses of 1 of 100 rows of drive.csv are skipped" in line for line in estimate_lines(found)
    )


class TestWithoutTrajectory:
    ONLY = "".join(
        line for line in STUDY.splitlines(keepends=True) if not line.startswith(("trajectory", "limits"))
    )

    @pytest.mark.slow
    def test_estimates_are_the_same(self, folder: Path, record: EstimateRecord):
        drives = [folder / "drive_0.csv", folder / "drive_1.csv"]
        out = folder / "only"
        found = estimate(parse_study(self.ONLY + CALIBRATION), drives, out=out)
        assert found.values == record.values
        assert load_estimate(out).values == record.values
        assert write_estimate(load_estimate(out), out).exists()

    def test_a_log_is_scored_whole(self, folder: Path):
        found = score_logs(parse_study(self.ONLY), [folder / "drive_0.csv", folder / "drive_1.csv"])
        assert [one.name for one in found.paths] == ["drive_0", "drive_1"]
        assert (found.best, found.bound, found.design) == (None, None, None)
        assert [one.seconds for one in found.paths] == pytest.approx([9.9, 9.9], abs=0.2)
        assert all(one.efficiency is None and one.share_of_bound is None for one in found.paths)

    @pytest.mark.slow
    def test_its_standard_errors_are_those_of_the_estimate(self, folder: Path):
        study = parse_study(self.ONLY)
        (path,) = score_logs(study, [folder / "drive_0.csv"]).paths
        record = estimate(study, [folder / "drive_0.csv"])
        errors = [*path.result.standard_deviations.values()]
        own = [one.error("information") for one in record.parameters]
        assert errors == pytest.approx(own, rel=0.5)
