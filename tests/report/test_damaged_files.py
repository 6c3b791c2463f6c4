"""Damaged files end in a sentence that names the file and the key, never in a traceback."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import sample_estimates
from damage import DAMAGES, EVIL, damaged, keys_of, some
from places import REPORTS
from recorded import keep_results
from sample_records import swept
from studies import SMALL

from oed.cli import main
from oed.exporters import EXPORTERS, export
from oed.foundation.errors import LogError, OedError, RecordError, UserMistake
from oed.records.record import load_estimate, load_record
from oed.report.estimate import estimate_sections
from oed.report.estimate.parameters import estimate_lines, estimate_rows
from oed.report.figures.draw import svg_text
from oed.report.film.animation import animate
from oed.report.page import sections_of, write_report
from oed.report.sections.drives import paths
from oed.workflow.experiments import validated, validation_options
from oed.workflow.next_drive import next_drive
from oed.workflow.studies import parse_study
from oed.workflow.sweep import load_sweep

FLAGSHIP = REPORTS / "choi_skid_steer"
SHIPPED = ("choi_skid_steer", "obstacle_course", "physics_skid_steer", "robust_laser_tracker")
KEPT = ("ipopt", "nominal", "square", "circle_same_length")
"""Results that damaged records have."""


@cache
def shipped(name: str) -> dict[str, Any]:
    """A shipped record with some of its results."""
    data = json.loads((REPORTS / name / "record.json").read_text(encoding="utf-8"))
    keep_results(data, *KEPT)
    for part in ("validation", "robustness"):
        if data.get(part):
            data[part]["results"] = data[part]["results"][:2]
    return data


def saved(folder: Path, data: Any, file: str = "record.json") -> Path:
    path = folder / file
    # File systems wait for the disk where a file that is there is written anew.
    path.unlink(missing_ok=True)
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


TOLD = set[str]()
"""Records, as read, whose reports are whole: what is damaged is often null already, or may be missing."""


def report(folder: Path) -> None:
    """All of a report but its drawings, of alike records once."""
    record = load_record(folder)
    known = json.dumps(record.data)
    if known in TOLD:
        return
    for section in sections_of(record):
        for table in section.tables:
            assert table.cells is not None
    TOLD.add(known)


def report_estimate(folder: Path) -> None:
    record = load_estimate(folder)
    for section in estimate_sections(record):
        for table in section.tables:
            assert table.cells is not None
    assert estimate_lines(record)
    assert estimate_rows(record) is not None


def complained(read: Callable[[Path], None], path: Path) -> str:
    """What is said of a damaged file; "" where it can be used all the same."""
    said = ""
    try:
        read(path.parent)
    except UserMistake as error:
        said = str(error)
    assert str(path) in said or not said
    assert all(line.isprintable() for line in said.split("\n"))
    return said


def estimate() -> dict[str, Any]:
    """An estimate with everything there is, of a whole study."""
    return {**sample_estimates.estimate(), "study": parse_study(SMALL).echo()}


@pytest.mark.slow
class TestAtRandom:
    @pytest.mark.parametrize(("name", "count"), [("obstacle_course", 40), ("physics_skid_steer", 10)])
    def test_records(self, tmp_path: Path, name: str, count: int):
        said = [
            complained(report, saved(tmp_path, damaged(shipped(name), *one)))
            for one in some(shipped(name), count, seed=count)
        ]
        assert sum(map(bool, said)) > count / 2

    def test_estimates(self, tmp_path: Path):
        whole = estimate()
        said = [
            complained(report_estimate, saved(tmp_path, damaged(whole, *one), "estimate.json"))
            for one in some(whole, 40, seed=1)
        ]
        assert any(said)

    def test_sweeps(self, tmp_path: Path):
        def read(folder: Path) -> None:
            load_sweep(folder)

        said = [
            complained(read, saved(tmp_path, damaged(swept(), *one), "sweep.json"))
            for one in some(swept(), 100, seed=2)
        ]
        assert any(said)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "how"),
    [("obstacle_course", how) for how in ("deleted", "null", "shorter", "longer", "huge")],
)
def test_every_key_of_a_record(tmp_path: Path, name: str, how: str):
    # Of a design and a path: further results have the same keys.
    data, known = {**shipped(name), "results": shipped(name)["results"][:2]}, set[Any]()
    for key in keys_of(data):
        # Places of a list are alike.
        alike = tuple(0 if isinstance(part, int) else part for part in key)
        if alike not in known:
            known.add(alike)
            complained(report, saved(tmp_path, damaged(data, key, how)))


@pytest.mark.slow
def test_every_command_on_damaged_records(tmp_path: Path):
    data = shipped("obstacle_course")
    place = tmp_path / "record.json"

    def simulate(folder: Path) -> None:
        record = load_record(folder)
        validated(record, validation_options(record, replicates=100), workers=1)

    def following(folder: Path) -> None:
        with pytest.raises(LogError):
            next_drive(load_record(folder), [tmp_path / "no.csv"])

    commands: list[Callable[[Path], Any]] = [
        lambda folder: write_report(load_record(folder), tmp_path / "out"),
        lambda folder: animate(folder, tmp_path / "film.gif", speed=100.0, fps=10.0),
        lambda folder: export(folder, "csv"),
        lambda folder: export(folder, "json"),
        simulate,
        following,
    ]
    for number, one in enumerate(some(data, 60, seed=3)):
        saved(tmp_path, damaged(data, *one))
        with suppress(OedError):
            commands[number % len(commands)](tmp_path)
    assert place.is_file()


class TestWhatIsSaid:
    def said(self, tmp_path: Path, key: tuple[str | int, ...], how: str) -> str:
        saved(tmp_path, damaged(shipped("obstacle_course"), key, how))
        with pytest.raises(RecordError) as caught:
            load_record(tmp_path)
        return str(caught.value).replace(str(tmp_path), "there")

    @pytest.mark.parametrize(
        ("key", "how", "expected"),
        [
            (("seed",), "deleted", "seed: missing"),
            (("results", 1, "drive", "samples"), "text", "results.1.drive.samples: expected a whole number"),
            (("results", 0, "objective"), "huge", "results.0.objective: expected at most 1e+100, got 1e+300"),
            (("results", 0, "drive", "poses"), "shorter", "results.0.drive: poses: expected 81 rows, got 80"),
            (
                ("results", 0, "name"),
                "evil",
                "results.0.name: expected a name that files can have",
            ),
            (("study", "limits"), "deleted", "study.limits: missing"),
            (("study", "trajectory"), "deleted", "study.trajectory: missing"),
            (("study", "trajectory", "duration"), "zero", "study.trajectory.duration: expected more than 0"),
            (("inputs", 0, "quantity"), "evil", "inputs.0.quantity: "),
        ],
    )
    def test_the_file_and_the_key(self, tmp_path: Path, key: Any, how: str, expected: str):
        assert self.said(tmp_path, key, how).startswith(f"there/record.json: {expected}")

    def test_issues_are_not_told_without_end(self, tmp_path: Path):
        data = copy.deepcopy(shipped("obstacle_course"))
        data["results"][0]["drive"]["knots"] = ["x"] * 1000
        saved(tmp_path, data)
        with pytest.raises(RecordError, match=r"and 98\d more like that") as caught:
            load_record(tmp_path)
        assert len(caught.value.issues) < 20

    @pytest.mark.parametrize(
        ("content", "expected"),
        [
            (b'{"format": 1, "resu', "cannot be read: not JSON"),
            (b'{"format": NaN}', "cannot be read: NaN is no number of JSON"),
            (b"\xff\xfe{", "cannot be read: not UTF-8 text"),
            (b"[" * 200_000, "cannot be read: nested too deeply"),
            (b'{"format": 1' + b"1" * 6000 + b"}", "cannot be read: a whole number of 6001 digits"),
            (b"", "cannot be read: not JSON"),
            (b"[]", "expected a record of format 1"),
        ],
    )
    def test_what_is_no_json(self, tmp_path: Path, content: bytes, expected: str):
        (tmp_path / "record.json").write_bytes(content)
        with pytest.raises(RecordError) as caught:
            load_record(tmp_path)
        assert caught.value.issues[0].message.startswith(expected)

    @pytest.mark.parametrize("file", ["record.json", "estimate.json", "sweep.json"])
    def test_a_folder_instead_of_the_file(self, tmp_path: Path, file: str):
        (tmp_path / file).mkdir()
        read = {"record.json": load_record, "estimate.json": load_estimate, "sweep.json": load_sweep}[file]
        with pytest.raises(RecordError, match="expected a file, got a folder"):
            read(tmp_path)

    @pytest.mark.parametrize(
        "command",
        [["report"], ["validate", "--quiet"], ["export", "--to", "csv"], ["animate", "--quiet"], ["next"]],
    )
    def test_every_command_says_it_and_ends_with_2(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: list[str]
    ):
        saved(tmp_path, damaged(shipped("obstacle_course"), ("results", 0, "feasible"), "deleted"))
        logs = ["log.csv", "--quiet"] if command == ["next"] else []
        assert main([command[0], str(tmp_path), *logs, *command[1:]]) == 2
        assert capsys.readouterr().err == f"{tmp_path / 'record.json'}: results.0.feasible: missing\n"


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_records_are_read_as_they_are(name: str):
    data = json.loads((REPORTS / name / "record.json").read_text(encoding="utf-8"))
    read = load_record(REPORTS / name).data
    assert {key: read[key] for key in data if key != "study"} == {
        key: value if key != "results" else [{**one, **_added(one)} for one in value]
        for key, value in data.items()
        if key != "study"
    } | {
        "provenance": {"study": "", **data["provenance"]},
        "robustness": data["robustness"] and {**data["robustness"], "courses": None},
        "physics": data["physics"]
        and {
            **data["physics"],
            "floors": [*map(_tried, data["physics"]["floors"])],
            # What drives are designed for, before there were several aims.
            "planned": [{"aim": None, "discrepancy": None, **one} for one in data["physics"]["planned"]],
        },
    }
    assert data["study"].keys() <= read["study"].keys()


def _added(one: dict[str, Any]) -> dict[str, Any]:
    # What drives of one run left out before there were several, and margins before they were of all times
    # and said what looser limits gain; whether a drive tells all parameters apart, before results did;
    # which readings are taken, before they were chosen; what would be without drift, before it counted;
    # and what would be with usual drift; what a search spent, before it had a budget; levels of splines,
    # before these were refined; how precise a drive is over time.
    drive, margins = one["drive"], [{"certain": None, "gain": None, **margin} for margin in one["margins"]]
    said = {key: one.get(key) for key in ("identifiable", "singular")}
    known = None if drive is None else {"runs": 1, "weights": None, **drive}
    later = {"selection": None, "steady_deviations": {}, "explored": None, "levels": [], "over_time": None}
    later |= {"usual_drift_deviations": {}}
    said |= {key: one.get(key, value) for key, value in later.items()}
    return {"drive": known, "margins": margins, **said}


def _tried(floor: dict[str, Any]) -> dict[str, Any]:
    # What trials left out before they said what is left at best.
    errors = [{"excess": None, "excess_each": None, **one} for one in floor["errors"]]
    return {"attainable": [], **floor, "errors": errors}


@pytest.mark.slow
def test_an_older_record_is_read(tmp_path: Path):
    data = copy.deepcopy(shipped("choi_skid_steer"))
    for key in ("inputs", "nuisances", "interrupted", "best", "robustness", "physics", "departures"):
        data.pop(key, None)
    for one in data["results"]:
        for key in ("covariances", "criteria", "criterion"):
            one.pop(key)
        one["drive"].pop("runs")
    for one in data["parameters"]:
        one.pop("judged")
    saved(tmp_path, data)
    report(tmp_path)
    assert load_record(tmp_path).results[0].drive.runs == 1


@pytest.mark.slow
def test_names_are_no_formulas(tmp_path: Path):
    data = copy.deepcopy(shipped("obstacle_course"))
    data["results"] = data["results"][:1]
    (departing,) = data["departures"]["results"]
    for named, key in (
        (data["results"][0], "name"),
        (data, "best"),
        (departing, "name"),
        (data["departures"]["bundle"], "name"),
    ):
        named[key] = "a $x^$ drive"
    saved(tmp_path, data)
    (picture,) = paths(load_record(tmp_path)).figures
    assert "<svg" in svg_text(picture.figure)


def test_damages_damage():
    data = shipped("obstacle_course")
    key = ("results", 0, "drive", "knots")
    for name in DAMAGES:
        assert damaged(data, key, name) != data
    assert EVIL in damaged(data, key, "evil")["results"][0]["drive"]["knots"]
    assert set(EXPORTERS) == {"csv", "json", "rosbag2", "ros2_node", "ros2_yaml"}
