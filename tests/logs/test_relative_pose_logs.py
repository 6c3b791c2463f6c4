"""Logs of how a sensor moved: read from tables and tuples, and every fault named by its place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from logged import form, found, issues_of, read_one
from pydantic import ValidationError

from oed.foundation.errors import LogError, ProblemError
from oed.logs import read_logs
from oed.robots.models import DifferentialDrive, Mecanum

ROBOT = DifferentialDrive(wheel_radius=0.02, track=0.09)
WHEELS = "t,wheel_speed_right,wheel_speed_left"
MATCHES = "t0,t1,x,y,heading,vx,vy,vh,c"
BESIDE: dict[str, Any] = {"file": "{stem}_matches.csv", "t0": "t0", "t1": "t1"}
COVARIANCE = {"xx": "vx", "yy": "vy", "hh": "vh", "xy": "c"}


def row(first: float, last: float, *values: float) -> str:
    motion = values or (0.01, 0.002, 0.1)
    return ",".join(f"{one:.9g}" for one in (first, last, *motion, 1e-6, 1e-6, 4e-6, 5e-7))


def written(folder: Path, matches: list[str] | None = None, header: str = MATCHES) -> Path:
    wheels = [f"{0.1 * index:.9g},1,0.5" for index in range(101)]
    file = folder / "drive.csv"
    file.write_text("\n".join([WHEELS, *wheels]) + "\n", encoding="utf-8")
    rows = [row(0.8 * index, 0.8 * (index + 1)) for index in range(12)] if matches is None else matches
    (folder / "drive_matches.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return file


def log_of(file: Path, **keys: Any) -> Any:
    return read_one(file, ROBOT, relative_poses={**BESIDE, **keys})


def test_pairs_of_times_in_a_file_of_their_own(tmp_path: Path):
    log = log_of(written(tmp_path))
    assert log.motions is not None
    np.testing.assert_allclose(log.motions.times[:, 0], 0.8 * np.arange(12))
    np.testing.assert_allclose(log.motions.values, np.tile([0.01, 0.002, 0.1], (12, 1)))
    assert log.motions.covariances is None
    # One after the other they are an arc.
    np.testing.assert_allclose(log.pose_times, 0.8 * np.arange(13), atol=1e-9)
    np.testing.assert_allclose(log.poses[:, 2], 0.1 * np.arange(13))
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(log.poses[:, :2], axis=0), axis=1), np.hypot(0.01, 0.002)
    )


def test_covariances_are_in_the_units_of_the_columns(tmp_path: Path):
    keys = {
        "covariance": COVARIANCE,
        "x": {"column": "x", "unit": "mm"},
        "heading": {"column": "heading", "unit": "deg"},
    }
    log = log_of(written(tmp_path), **keys)
    found = log.motions.covariances[0]
    assert found[0, 0] == pytest.approx(1e-12)
    assert found[0, 1] == pytest.approx(5e-10)
    assert found[2, 2] == pytest.approx(4e-6 * np.radians(1) ** 2)
    assert log.motions.values[0, 0] == pytest.approx(1e-5)


def test_rows_that_follow_each_other(tmp_path: Path):
    log = log_of(written(tmp_path), t0=None, t1=None, time="t1")
    assert len(log.motions) == 11
    np.testing.assert_allclose(log.motions.times[:, 0], 0.8 * np.arange(1, 12))


def test_rows_of_the_log_itself(tmp_path: Path):
    file = tmp_path / "drive.csv"
    cells = ["0.01,0,0.1" if index % 5 == 0 else ",," for index in range(101)]
    rows = [f"{0.1 * index:.9g},1,0.5,{cell}" for index, cell in enumerate(cells)]
    file.write_text("\n".join([f"{WHEELS},x,y,heading", *rows]) + "\n", encoding="utf-8")
    log = read_one(file, ROBOT, relative_poses={})
    np.testing.assert_allclose(
        log.motions.times, 0.5 * np.column_stack([np.arange(20), np.arange(1, 21)]), atol=1e-9
    )


def test_the_path_begins_anew_after_a_hole(tmp_path: Path):
    rows = [row(0.8 * index, 0.8 * (index + 1)) for index in range(12) if index not in (5, 6)]
    log = log_of(written(tmp_path, rows))
    np.testing.assert_allclose(log.motions.begins, [0.0, 5.6])


GOOD = [row(0.8 * index, 0.8 * (index + 1)) for index in range(12)]


def changed(place: int, text: str) -> list[str]:
    return [text if index == place else one for index, one in enumerate(GOOD)]


@pytest.mark.parametrize(
    ("rows", "keys", "line", "key", "words"),
    [
        (changed(3, row(3.2, 2.4)), {}, 5, "t0", "begins at 3.2 s, not before its end at 2.4 s"),
        ([row(1 + 0.8 * k, 0.8 * k) for k in range(9)], {}, 2, "t0", "are t0 and t1 exchanged"),
        (GOOD, {"t1": "end"}, 1, "", "the header lacks 'end'"),
        (
            changed(4, row(3.2, 4.0).replace("1e-06", "-1e-06")),
            {"covariance": COVARIANCE},
            6,
            "covariance",
            "not positive definite",
        ),
        (
            changed(4, row(3.2, 4.0).replace("5e-07", "5e-06")),
            {"covariance": COVARIANCE},
            6,
            "covariance",
            "not positive definite",
        ),
        *(
            (
                changed(4, row(3.2, 4.0).replace("1e-06,1e-06,4e-06,5e-07", entries)),
                {"covariance": COVARIANCE},
                6,
                "covariance",
                words,
            )
            for entries, words in (
                ("1e-06,1e-06,4e-06,9.99999999999999e-07", "singular but for rounding"),
                ("1e-306,1e-306,4e-306,0", "known to 1e-153 (m or rad)"),
                ("1e-16,1e-16,4e-16,5e-17", "known 1e+05 times as surely as is usual"),
                ("1e-06,1e-06,1e-14,0", "times as surely as is usual"),
            )
        ),
        (changed(2, "1.6,2.4,0.01,,0.1,1,1,1,0"), {}, 4, "y", ""),
        (changed(2, "1.6,2.4,0.01,lost,0.1,1,1,1,0"), {}, 4, "y", "lost"),
        ([row(90 + 0.8 * k, 90.8 + 0.8 * k) for k in range(9)], {}, 2, "t1", "clocks do not overlap"),
        (GOOD[:1], {}, 2, "", "has 2 row(s) of poses; at least 3"),
        (changed(5, row(3.2, 3.2)), {"t0": None, "t1": None, "time": "t1"}, 7, "t1", "time goes back"),
        (changed(3, row(2.4, 3.2, 1e25, 0, 0)), {}, 5, "x", ""),
    ],
    ids=[
        "ends before it begins",
        "times exchanged",
        "missing column",
        "negative variance",
        "correlation above one",
        "correlation of one",
        "next to no error",
        "far surer than others",
        "a heading far surer",
        "empty cell",
        "text",
        "outside of the wheels' log",
        "too few",
        "times that go back",
        "too large",
    ],
)
def test_faults_are_named_by_file_and_line(
    tmp_path: Path, rows: list[str], keys: dict[str, Any], line: int, key: str, words: str
):
    file = written(tmp_path, rows)
    found = issues_of(file, model=ROBOT, relative_poses={**BESIDE, **keys})
    assert found[0].file.endswith("drive_matches.csv")
    assert found[0].line == line
    assert key in found[0].key
    assert words in found[0].message


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"relative_poses": {"t0": "t0"}}, "t0 and t1 belong together"),
        ({"relative_poses": {**BESIDE, "time": "t"}}, "not both"),
        ({"relative_poses": {**BESIDE, "inverse": True, "covariance": COVARIANCE}}, "motion forwards"),
        ({"relative_poses": {**BESIDE, "covariance": {"xx": "vx"}}}, "yy"),
        ({"relative_poses": {**BESIDE, "heading": "none", "dy": 3}}, "dy"),
    ],
)
def test_keys_that_do_not_go_together(keys: dict[str, Any], words: str):
    with pytest.raises(ValidationError, match=words):
        form(**keys)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"relative_poses": BESIDE, "poses": {"x": "x"}}, "poses or relative_poses"),
        ({"relative_poses": {**BESIDE, "x": {"column": "x", "unit": "deg"}}}, "deg"),
    ],
)
def test_forms_that_do_not_fit(tmp_path: Path, keys: dict[str, Any], words: str):
    with pytest.raises(ProblemError, match=words):
        read_logs([written(tmp_path)], form(**keys), ROBOT)


def test_a_file_of_motions_that_is_not_there(tmp_path: Path):
    file = written(tmp_path)
    (tmp_path / "drive_matches.csv").unlink()
    with pytest.raises(LogError, match=r"drive_matches\.csv: file: no such file"):
        log_of(file)


class TestTuples:
    def tuples(self, folder: Path, *lines: str) -> Path:
        usual = {"T": 0.8, "phi_l": 0.5, "phi_r": -0.25, "sm": [0.001, -0.0005, -0.03]}
        file = folder / "l90.tuple"
        file.write_text("\n".join([json.dumps(usual)] * 6 + list(lines)) + "\n", encoding="utf-8")
        return file

    def test_wheels_and_motions(self, tmp_path: Path):
        log = read_one(self.tuples(tmp_path), ROBOT, kind="tuples")
        np.testing.assert_allclose(log.input_times, 0.8 * np.arange(7), atol=1e-12)
        np.testing.assert_allclose(log.integrals[-1], [-1.2, 2.4])
        np.testing.assert_allclose(log.motions.times[:, 1], 0.8 * np.arange(1, 7))
        np.testing.assert_allclose(log.motions.values[3], [0.001, -0.0005, -0.03])

    @pytest.mark.parametrize(
        ("line", "key", "words"),
        [
            ('{"T": 0.8, "phi_l": 1, "sm": [0, 0, 0]}', "phi_r", "is missing"),
            ('{"T": 0, "phi_l": 1, "phi_r": 1, "sm": [0, 0, 0]}', "T", "above 0 s"),
            ('{"T": 1, "phi_l": 1, "phi_r": 1, "sm": [0, 0]}', "sm", "x, y and heading"),
            ('{"T": 1, "phi_l": NaN, "phi_r": 1, "sm": [0, 0, 0]}', "phi_l", "finite"),
            ('{"T": 1, "phi_l": "fast", "phi_r": 1, "sm": [0, 0, 0]}', "phi_l", "finite"),
            ('{"T": -0.8, "phi_l": 1, "phi_r": 1, "sm": [0, 0, 0]}', "T", "above 0 s"),
            ('{"T": 1, "phi_l": 1, "phi_r": null, "sm": [0, 0, 0]}', "phi_r", "finite"),
            ('{"T": 1, "phi_l": 1, "phi_r": 1, "sm": [0, 0, "far"]}', "sm", "finite"),
            ('{"T": 1, "phi_l": 1, "phi_r": 1}', "sm", "is missing"),
            (f'{{"T": 1{"0" * 400}, "phi_l": 1, "phi_r": 1, "sm": [0, 0, 0]}}', "T", "finite"),
            (f'{{"T": {"1" * 5000}, "phi_l": 1, "phi_r": 1, "sm": [0, 0, 0]}}', "T", "finite"),
            ("[" * 100_000, "", "nested too deep"),
            ("[1, 2, 3]", "", "expected a tuple like"),
            ("0.8 0.5 0.5 0 0 0", "", "as JSON"),
        ],
    )
    def test_faults(self, tmp_path: Path, line: str, key: str, words: str):
        (issue,) = issues_of(self.tuples(tmp_path, line), model=ROBOT, kind="tuples")
        assert (issue.line, issue.key) == (7, key)
        assert words in issue.message
        log = read_one(self.tuples(tmp_path, line), ROBOT, kind="tuples", skip_invalid_rows=True)
        assert len(log.motions) == 6
        assert any("1 line(s)" in one.message for one in log.findings)

    @pytest.mark.parametrize("left", [1, 20, 60])
    def test_a_file_that_breaks_off_in_its_last_line(self, tmp_path: Path, left: int):
        file = self.tuples(tmp_path)
        whole = file.read_text(encoding="utf-8")
        file.write_text(whole + whole.splitlines()[0][:left], encoding="utf-8")
        log = read_one(file, ROBOT, kind="tuples")
        assert len(log.motions) == 6
        assert "breaks off within its last line" in found(log)["cut_off"]

    def test_one_in_so_many_is_used_on_request(self, tmp_path: Path):
        log = read_one(self.tuples(tmp_path), ROBOT, kind="tuples", thin=2)
        np.testing.assert_allclose(log.motions.times[:, 1], [0.8, 2.4, 4.0])
        assert "of 6 motions one in 2 is used, as the study asks" in [one.message for one in log.findings]

    def test_too_few_that_are_left(self, tmp_path: Path):
        (issue,) = issues_of(self.tuples(tmp_path), model=ROBOT, kind="tuples", thin=4)
        assert issue.message == "l90: one in 4 of 6 motions leaves 2; at least 3 are needed"

    def test_other_robots(self, tmp_path: Path):
        robot = Mecanum(wheel_radius=0.05, half_wheelbase_plus_half_track=0.35)
        with pytest.raises(ProblemError, match="wheel_speed_right and wheel_speed_left"):
            read_logs([self.tuples(tmp_path)], form(kind="tuples"), robot)


def test_two_motions_are_three_poses(tmp_path: Path):
    log = log_of(written(tmp_path, GOOD[:2]))
    assert len(log.poses) == 3
    assert "short_runs" not in [one.name for one in log.findings]
