"""A sweep from end to end: records, the table, what is kept, and the page."""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import pytest
from recorded import record_from
from studies import INFEASIBLE, small, without_seconds, write_study

from oed.cli import main
from oed.cli.terminal.console import print_sweep
from oed.foundation.errors import Failure, RecordError
from oed.foundation.work.folders import Draft
from oed.records.record import load_record, save_record
from oed.records.stored.sweep import StoredSweep, SweptKey, SweptPoint
from oed.workflow.runner import run as real_run
from oed.workflow.saving import NotSaved
from oed.workflow.studies import load_study
from oed.workflow.sweep import Axis, load_sweep, parse_axis, sweep
from oed.workflow.sweep import run as running

pytestmark = pytest.mark.usefixtures("drawn_once")

TINY = "{kind: genetic, population: 20, generations: 3}"
OVER = "limits.wheel_speed=5,10 rad/s"
MARKUP = ("[bold]speed[/]\\x1b[2J", "[red]", "[/nope]", "[link=x]", "[5]")
"""What the library that draws tables would take for its own."""


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The folder of a study of two points, in `out`, and the table."""
    folder = tmp_path_factory.mktemp("sweep")
    file = write_study(folder, small(solvers=TINY))
    return folder, sweep(file, [parse_axis(OVER)], folder / "out", workers=1).data


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the studies that are run."""
    names: list[str] = []

    def counting(study: Any, *arguments: Any, **options: Any) -> Any:
        names.append(study.name)
        return real_run(study, *arguments, **options)

    monkeypatch.setattr(running, "run", counting)
    return names


def axes(*over: str) -> list[Axis]:
    return [parse_axis(one) for one in over]


@pytest.mark.slow
def test_the_table_says_what_the_records_say(swept):
    folder, data = swept
    assert (
        json.loads((folder / "out" / "sweep.json").read_text()) == data == load_sweep(folder / "out").plain()
    )
    assert [row["numbers"] for row in data["points"]] == [
        {"limits.wheel_speed": 5},
        {"limits.wheel_speed": 10},
    ]
    for row in data["points"]:
        record = load_record(folder / "out" / row["record"])
        assert row["objective"] == record.best.objective
        assert row["standard_deviations"] == record.best.standard_deviations
        assert (folder / "out" / row["folder"] / record.best.trajectory).is_file()
    best = max(data["points"], key=lambda row: row["objective"])
    assert data["best"] == best["folder"]


def test_names_are_no_markup(swept, capsys: pytest.CaptureFixture[str]):
    data = json.loads(json.dumps(swept[1]))
    data["keys"][0]["name"] = "[bold]speed[/]\x1b[2J"
    data["points"][0].update(status="[red]", design="[/nope]", message="[link=x]", objective=None)
    data["points"][0]["values"] = {"limits.wheel_speed": "[5]"}
    keys = [SweptKey.model_construct(**one) for one in data["keys"]]
    points = [SweptPoint.model_construct(**one) for one in data["points"]]
    print_sweep(StoredSweep.model_construct(**{**data, "keys": keys, "points": points}))
    out = capsys.readouterr().out
    assert {text for text in MARKUP if text in out} == set(MARKUP)


def test_a_point_is_what_a_run_of_its_study_is(swept, tmp_path: Path):
    folder, data = swept
    file = write_study(tmp_path, small(solvers=TINY).replace("wheel_speed: 10", "wheel_speed: 5"))
    alone = real_run(load_study(file), workers=1)
    point = load_record(folder / "out" / data["points"][0]["record"])
    assert point.best.objective == alone.best.objective
    assert point.best.drive == alone.best.drive


@pytest.mark.slow
def test_what_is_there_is_kept_and_what_is_not_is_run(swept, tmp_path: Path, runs: list[str]):
    folder, data = swept
    shutil.copytree(folder / "out", tmp_path / "out")
    file, over = folder / "study.yaml", "limits.wheel_speed=5,7,10 rad/s"
    again = sweep(file, axes(over), tmp_path / "out", workers=1).data
    assert runs == ["Small study (wheel_speed 7 rad/s)"]
    assert again["kept"] == 2
    assert [again["points"][index] for index in (0, 2)] == data["points"]
    # Another seed is another study.
    sweep(file, axes("limits.wheel_speed=5 rad/s"), tmp_path / "out", workers=1, seed=9)
    assert runs[1:] == ["Small study (wheel_speed 5 rad/s)"]


@pytest.mark.slow
def test_an_interrupt_keeps_what_is_done(swept, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder, data = swept

    def second_interrupted(study: Any, *arguments: Any, **options: Any) -> Any:
        if "10 rad/s" in study.name:
            raise KeyboardInterrupt
        return real_run(study, *arguments, **options)

    monkeypatch.setattr(running, "run", second_interrupted)
    cut = sweep(folder / "study.yaml", axes(OVER), tmp_path, workers=1).data
    assert cut["interrupted"]
    assert [row["status"] for row in cut["points"]] == ["searched", "not run"]
    monkeypatch.setattr(running, "run", real_run)
    whole = sweep(folder / "study.yaml", axes(OVER), tmp_path, workers=1).data
    assert whole["kept"] == 1
    assert without_seconds({**whole, "kept": 0}) == without_seconds(data)


def all_files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_a_finished_sweep_stays_until_another_is_finished(
    swept, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder, _ = swept
    out = tmp_path / "out"
    shutil.copytree(folder / "out", out)
    before = all_files(out)

    def second_interrupted(study: Any, *arguments: Any, **options: Any) -> Any:
        if "10 rad/s" in study.name:
            raise KeyboardInterrupt
        return real_run(study, *arguments, **options)

    monkeypatch.setattr(running, "run", second_interrupted)
    cut = running.sweep(folder / "study.yaml", axes(OVER), out, workers=1, seed=9)
    assert all_files(out) == before
    assert cut.folder == tmp_path / "out.interrupted"
    assert load_sweep(cut.folder) == cut.found
    # The same command goes on where it stopped.
    monkeypatch.setattr(running, "run", real_run)
    whole = running.sweep(folder / "study.yaml", axes(OVER), out, workers=1, seed=9)
    assert whole.folder == out
    assert (whole.data["kept"], whole.data["interrupted"]) == (1, False)
    assert all_files(out).keys() == before.keys()
    assert {load_record(out / row["record"]).data["seed"] for row in whole.data["points"]} == {9}


@pytest.mark.slow
def test_what_a_killed_sweep_had_done_is_kept(swept, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    class Killed(BaseException):
        pass

    def second_killed(study: Any, *arguments: Any, **options: Any) -> Any:
        if "10 rad/s" in study.name:
            raise Killed
        return real_run(study, *arguments, **options)

    monkeypatch.setattr(running, "run", second_killed)
    with monkeypatch.context() as patch:
        # Nothing is tidied up by a process that is killed.
        patch.setattr("oed.foundation.work.folders.Draft.put_in_order", lambda _: None)
        with pytest.raises(Killed):
            sweep(swept[0] / "study.yaml", axes(OVER), tmp_path / "out", workers=1)
    monkeypatch.setattr(running, "run", real_run)
    whole = sweep(swept[0] / "study.yaml", axes(OVER), tmp_path / "out", workers=1).data
    assert whole["kept"] == 1
    assert load_sweep(tmp_path / "out.interrupted").interrupted


@pytest.mark.slow
def test_without_room_for_a_point_all_that_are_done_are_readable_elsewhere(
    swept, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder, data = swept
    real = Draft.write

    def full(draft: Draft, files: dict[str, str]) -> None:
        if any(name.startswith("wheel_speed_10") for name in files):
            # As on a disk that fills up: what is small still fits.
            real(draft, {name: text for name, text in files.items() if name.endswith(".csv")})
            raise Failure(f"{draft.target}/record.json: cannot be written: No space left on device")
        real(draft, files)

    monkeypatch.setattr(Draft, "write", full)
    (tmp_path / "spare").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "spare"))
    with pytest.raises(NotSaved, match=r"out/record.json: .* No space left") as caught:
        sweep(folder / "study.yaml", axes(OVER), tmp_path / "out", workers=1)
    (place,) = (tmp_path / "spare").iterdir()
    assert f"The results are in {place} instead" in str(caught.value)
    table = load_sweep(place)
    assert table == caught.value.found.found
    for row, point in zip(data["points"], table.points, strict=True):
        assert load_record(place / point.record).best.objective == row["objective"]
    assert main(["report", str(place), "--json"]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["spare"]


@pytest.mark.slow
def test_no_room_for_any_record_promises_no_report(swept, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder, _ = swept
    real = Draft.write

    def full(draft: Draft, files: dict[str, str]) -> None:
        real(draft, {name: text for name, text in files.items() if name.endswith(".csv")})
        raise Failure(f"{draft.path}/record.json: cannot be written: No space left on device")

    monkeypatch.setattr(Draft, "write", full)
    monkeypatch.setattr("oed.workflow.saving._written_elsewhere", lambda *_: None)
    with pytest.raises(NotSaved, match="nowhere else either") as caught:
        sweep(folder / "study.yaml", axes(OVER), tmp_path / "out", workers=1)
    assert "oed report" not in str(caught.value)


@pytest.mark.slow
def test_a_point_cut_short_is_shown_and_run_again(swept, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder, _ = swept

    def cut_short(study: Any, out: Path, **options: Any) -> Any:
        record = real_run(study, out, **options)
        save_record(record_from({**record.data, "interrupted": True}), out)

    monkeypatch.setattr(running, "run", cut_short)
    cut = sweep(folder / "study.yaml", axes(OVER), tmp_path, workers=1).data
    assert cut["interrupted"]
    assert [row["objective"] is None for row in cut["points"]] == [False, True]
    monkeypatch.setattr(running, "run", real_run)
    assert sweep(folder / "study.yaml", axes(OVER), tmp_path, workers=1).data["kept"] == 0


@pytest.mark.slow
def test_a_point_that_fails_is_told_and_the_others_are_run(
    swept, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def failing(study: Any, *arguments: Any, **options: Any) -> Any:
        if "(wheel_speed 5 rad/s)" in study.name:
            raise Failure("no memory")
        return real_run(study, *arguments, **options)

    monkeypatch.setattr(running, "run", failing)
    data = sweep(swept[0] / "study.yaml", axes(OVER), tmp_path, workers=1).data
    first, second = data["points"]
    assert (first["status"], first["message"], first["record"]) == ("failed", "no memory", None)
    assert data["best"] == second["folder"]


@pytest.mark.slow
def test_objectives_of_other_criteria_are_not_ranked(tmp_path: Path):
    file = write_study(tmp_path, small(solvers=TINY))
    data = sweep(file, axes("criterion.kind=E,D"), tmp_path / "out", workers=1).data
    assert data["best"] is None
    assert not data["comparable"]


def test_no_sweep_there(tmp_path: Path):
    with pytest.raises(RecordError, match="no sweep there; make one with `oed sweep`"):
        load_sweep(tmp_path)


class TestCommand:
    @pytest.mark.slow
    def test_json_page_and_the_page_again(self, swept, tmp_path: Path, monkeypatch, capsys):
        folder, data = swept
        monkeypatch.chdir(tmp_path)
        shutil.copytree(folder / "out", tmp_path / "reports" / "study-sweep")
        study = str(folder / "study.yaml")
        monkeypatch.setattr("oed.report.write_report", lambda record, out: (out / "report.html").touch())
        over = ("--over", OVER, "--quiet", "--json", "--workers", "1", "--reports")
        assert main(["sweep", study, *over]) == 0
        captured = capsys.readouterr()
        out = Path("reports") / "study-sweep"
        printed = json.loads(captured.out)
        assert printed == {**data, "kept": 2, "directory": str(out)}
        assert "note: 2 of 2 points kept" in captured.err
        page = (out / "report.html").read_text()
        assert "wheel speed [rad/s]" in page
        assert f"{data['points'][1]['objective']:.4g}" in page
        for row in data["points"]:
            assert f'href="{row["folder"]}/report.html"' in page
        (out / "report.html").unlink()
        assert main(["report", str(out)]) == 0
        assert (out / "report.html").read_text() == page
        # A process was killed between the old folder's leaving and the new one's coming.
        (out.parent / f".{out.name}.oed").mkdir()
        out.rename(out.parent / f".{out.name}.oed" / "old")
        assert main(["report", str(out)]) == 0
        assert (out / "report.html").read_text() == page

    def test_nothing_is_written_where_a_combination_is_wrong(self, tmp_path: Path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        write_study(tmp_path, small(solvers=TINY))
        assert main(["sweep", "study.yaml", "--over", "limits.wheel_speed=5,10 m"]) == 2
        assert capsys.readouterr().err.startswith("study.yaml:7: limits.wheel_speed: with wheel_speed 5 m: ")
        assert not (tmp_path / "reports").exists()

    @pytest.mark.slow
    def test_no_feasible_drive_anywhere(self, tmp_path: Path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        write_study(tmp_path, INFEASIBLE.replace("{kind: ipopt, starts: 1, perturbations: 0}", TINY))
        assert main(["sweep", "study.yaml", "--over", "seed=1", "--quiet", "--workers", "1"]) == 1
        assert "no feasible drive" in capsys.readouterr().out
        assert (tmp_path / "reports" / "study-sweep" / "report.html").is_file()

    @pytest.mark.parametrize("arguments", [[], ["--over", "a=1", "--workers", "2", "--cluster", "tcp://a:1"]])
    def test_wrong_arguments(self, arguments: list[str], capsys):
        with pytest.raises(SystemExit) as leaving:
            main(["sweep", "study.yaml", *arguments])
        assert leaving.value.code == 2

    def test_a_malformed_address(self, tmp_path: Path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        write_study(tmp_path, small(solvers=TINY))
        assert main(["sweep", "study.yaml", "--over", OVER, "--cluster", "host"]) == 2
        assert "tcp://HOST:PORT" in capsys.readouterr().err
