"""Nothing that a run has found is lost: not what an earlier run found, not what cannot be saved."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from studies import GENETIC, saved_study, small, write_study

from oed.cli import main
from oed.foundation import files
from oed.foundation.errors import Failure, UserMistake
from oed.foundation.work.folders import interrupted_runs, updated
from oed.records.record import load_record
from oed.records.stored.study_record import Provenance
from oed.study.study import Study
from oed.workflow.runner import run

TEXT = small(solvers=GENETIC, baselines="[random]")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return saved_study(tmp_path_factory.mktemp("study"), TEXT)


@pytest.fixture(scope="module")
def made(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished run, with a report and something of the user's own."""
    out = tmp_path_factory.mktemp("made") / "out"
    run(study, out, workers=1, seed=1)
    (out / "figures").mkdir()
    for name in ("report.html", "report.md", "figures/paths.svg", "figures/estimate_paths.svg", "notes.txt"):
        (out / name).write_text("old")
    return out


@pytest.fixture
def finished(made: Path, tmp_path: Path) -> Path:
    """Such a folder that may be written into."""
    return shutil.copytree(made, tmp_path / "out")


class Striking:
    """A listener that raises as a stage begins."""

    def __init__(self, stage: str, error: BaseException) -> None:
        self.stage, self.error = stage, error

    def begin(self, description: str, total: int) -> None:
        if description.startswith(self.stage):
            raise self.error

    def advance(self, note: str = "") -> None:
        pass


class TestAgain:
    @pytest.mark.slow
    def test_a_complete_run_takes_the_place_of_the_old_one(self, finished: Path, tmp_path: Path):
        other = saved_study(tmp_path, TEXT.replace("kind: genetic,", "kind: genetic, name: another,"))
        record = run(other, finished, workers=1)
        assert record.folder == finished
        # Neither the old run's drives nor its report; what is not the run's stays.
        assert set(contents(finished)) == {
            "record.json",
            "another.csv",
            "random.csv",
            "notes.txt",
            "figures/estimate_paths.svg",
        }
        assert load_record(finished).data == json.loads(record.to_json())

    @pytest.mark.parametrize("stage", ["genetic", "score baselines"])
    @pytest.mark.slow
    def test_an_interrupted_one_leaves_it_bit_for_bit(self, study: Study, finished: Path, stage: str):
        before = contents(finished)
        record = run(study, finished, workers=1, progress=Striking(stage, KeyboardInterrupt()))
        assert contents(finished) == before
        if stage == "genetic":
            assert record.folder is None
            assert [path.name for path in finished.parent.iterdir()] == ["out"]
            return
        assert record.folder == finished.with_name("out.interrupted")
        kept = load_record(record.folder)
        assert kept.data["interrupted"]
        assert [entry.name for entry in kept.results] == ["genetic"]
        assert (record.folder / "genetic.csv").is_file()
        # Nor does one that is cut short take the place of another such.
        again = run(study, finished, workers=1, progress=Striking(stage, KeyboardInterrupt()))
        assert again.folder == finished.with_name("out.interrupted-2")

    @pytest.mark.slow
    def test_a_search_that_fails_leaves_it_bit_for_bit(self, study: Study, finished: Path):
        before = contents(finished)
        with pytest.raises(Failure, match="no memory"):
            run(study, finished, workers=1, progress=Striking("genetic", Failure("no memory")))
        assert contents(finished) == before
        assert [path.name for path in finished.parent.iterdir()] == ["out"]

    @pytest.mark.slow
    def test_a_step_that_fails_after_the_search_is_noted_in_the_record(self, study: Study, finished: Path):
        record = run(study, finished, workers=1, progress=Striking("score", Failure("no memory")))
        (sentence,) = load_record(finished).failures
        assert "no memory" in sentence
        assert record.best.name == "genetic"

    @pytest.mark.slow
    @pytest.mark.usefixtures("blank_figures")
    def test_what_is_kept_has_a_report(self, study: Study, finished: Path, capsys):
        record = run(study, finished, workers=1, progress=Striking("score", KeyboardInterrupt()))
        assert main(["report", str(record.folder)]) == 0
        assert "The run was interrupted" in (record.folder / "report.md").read_text()
        assert not (finished.parent / ".out.oed").exists()

    @pytest.mark.slow
    def test_only_one_at_a_time(self, study: Study, tmp_path: Path):
        class Second(Striking):
            def begin(self, description: str, total: int) -> None:
                with pytest.raises(UserMistake, match=rf"out: process {os.getpid()} .* is writing there"):
                    run(study, tmp_path / "out", workers=1)

        run(study, tmp_path / "out", workers=1, progress=Second("", KeyboardInterrupt()))
        assert load_record(tmp_path / "out").best is not None


@pytest.fixture
def full(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Path]]:
    """The places that still have room, once there is one in this list."""
    real, room = files.new_file, list[Path]()

    def new_file(folder: Path) -> tuple[int, Path]:
        if room and not any(folder.is_relative_to(place) for place in room):
            raise OSError(28, "No space left on device")
        return real(folder)

    monkeypatch.setattr(files, "new_file", new_file)
    return room


class TestNoRoom:
    @pytest.mark.slow
    def test_printed_all_the_same(self, finished: Path, tmp_path: Path, full, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        write_study(tmp_path, TEXT)
        before = contents(finished)
        spare = tmp_path / "spare"
        spare.mkdir()
        monkeypatch.setattr(tempfile, "tempdir", str(spare))
        full.append(spare)
        assert main(["run", "study.yaml", "--out", "out", "--quiet", "--workers", "1"]) == 1
        out, err = capsys.readouterr()
        assert "genetic" in out
        assert contents(finished) == before
        (line,) = err.splitlines()
        assert line.startswith(
            "out: cannot write there: No space left on device; what was in out is as it was"
        )
        (place,) = re.findall(r"The results are in (\S+) instead", line)
        assert load_record(place).best.name == "genetic"
        assert (Path(place) / "genetic.csv").is_file()

    @pytest.mark.slow
    def test_nowhere_at_all(self, finished: Path, tmp_path: Path, full, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        write_study(tmp_path, TEXT)
        full.append(tmp_path / "nowhere")
        assert main(["solve", "study.yaml", "--out", "out", "--quiet", "--workers", "1", "--json"]) == 1
        out, err = capsys.readouterr()
        data = json.loads(out)
        assert data["results"][0]["feasible"]
        assert data["directory"] is None
        assert data["error"] == err.strip()
        assert "nowhere else either" in err
        assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []

    @pytest.mark.slow
    def test_no_room_for_the_report_alone(self, tmp_path: Path, full, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        write_study(tmp_path, TEXT)

        def report(*_: object) -> None:
            raise Failure("there/report.html: cannot be written: No space left on device")

        monkeypatch.setattr("oed.report.write_report", report)
        assert main(["run", "study.yaml", "--out", "there", "--quiet", "--workers", "1"]) == 1
        out, err = capsys.readouterr()
        assert "genetic" in out
        assert err == (
            "there/report.html: cannot be written: No space left on device; "
            "the record is saved: `oed report there` makes the report\n"
        )
        assert load_record("there").best is not None

    def test_drafts_are_told_by_the_folder_they_are_of(self, tmp_path: Path, full, monkeypatch):
        monkeypatch.chdir(tmp_path)
        with updated("there") as draft:
            full.append(tmp_path / "nowhere")
            with pytest.raises(Failure, match=r"^there/figures: cannot write there: No space left"):
                draft.write({"figures/a.svg": "a"})


class TestUnreadable:
    """A record that could not be read again is not saved as if it were one; what was found is not lost."""

    @pytest.fixture
    def damaged(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        made = Provenance.of(packages={}, python=math.nan, platform="any", finished="now")
        monkeypatch.setattr("oed.workflow.runner.provenance", lambda study: made)
        (tmp_path / "spare").mkdir()
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "spare"))
        monkeypatch.chdir(tmp_path)
        write_study(tmp_path, TEXT)

    @pytest.mark.slow
    @pytest.mark.parametrize("as_json", [False, True])
    def test_printed_all_the_same(self, finished: Path, damaged, as_json: bool, capsys):
        before = contents(finished)
        more = ["--json"] if as_json else []
        assert main(["run", "study.yaml", "--out", "out", "--quiet", "--workers", "1", *more]) == 1
        out, err = capsys.readouterr()
        assert contents(finished) == before
        assert "genetic" in out
        if as_json:
            assert json.loads(out)["error"] == err.strip()
        (line,) = err.splitlines()
        assert line.startswith(
            "not saved, for it could not be read again: out/record.json: provenance.python: expected text, "
            "got nothing; what was in out is as it was. The results are in "
        )
        (place,) = re.findall(r"The results are in (\S+) instead", line)
        assert (Path(place) / "genetic.csv").is_file()

    @pytest.mark.slow
    def test_the_largest_numbers_of_a_study_are_none(self, tmp_path: Path):
        text = TEXT.replace("10 rad/s", "1e10 rad/s").replace("20 rad/s^2", "1e11 rad/s^2")
        study = saved_study(tmp_path, text.replace("[-1 m, 1 m]", "[-4e5 m, 4e5 m]"))
        record = run(study, tmp_path / "out", workers=1)
        speeds = [entry.drive.coefficients for entry in record.results]
        assert max(abs(value) for drive in speeds for row in drive for value in row) > 1e9
        assert load_record(tmp_path / "out").data == json.loads(record.to_json())

    @pytest.mark.slow
    def test_a_point_of_a_sweep_says_so(self, damaged, capsys):
        again = ["--over", "robot.track=17 cm", "--workers", "1", "--quiet", "--out", "swept"]
        assert main(["sweep", "study.yaml", *again]) == 1
        told = "".join(capsys.readouterr())
        assert "could not be read again" in told
        assert "defect" not in told


def started(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    """`oed` as a process, whose Ctrl-C is answered even where the tests' is not."""
    program = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from oed.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    return subprocess.Popen(
        [sys.executable, "-B", "-c", program, *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="limits and signals are POSIX's")
class TestProcess:
    @pytest.mark.parametrize("most", [21, 4096])
    def test_files_that_may_not_grow(self, finished: Path, most: int, monkeypatch, capsys):
        import resource

        write_study(finished.parent, TEXT)
        before = contents(finished)
        monkeypatch.chdir(finished.parent)
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
        try:
            code = main(["solve", "study.yaml", "--out", "out", "--workers", "1", "--quiet"])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        out, err = capsys.readouterr()
        assert code == 1
        assert re.search(r"genetic .*yes", out)
        assert "File too large; what was in out is as it was" in err
        assert "Traceback" not in err
        assert contents(finished) == before

    @pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
    def test_stopped_in_the_middle(self, finished: Path, number: int):
        slow = "{kind: genetic, population: 20, generations: 100000}"
        write_study(finished.parent, small(solvers=f"{GENETIC}, {slow[:-1]}, name: slow}}"))
        before = contents(finished)
        process = started(finished.parent, "solve", "study.yaml", "--out", "out", "--workers", "1", "--quiet")
        kept = finished.parent / ".out.oed" / "draft" / "out" / "record.json"
        give_up = time.monotonic() + 60
        while not kept.exists() and time.monotonic() < give_up:
            time.sleep(0.02)
        began = time.monotonic()
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
        assert time.monotonic() - began < 10
        assert contents(finished) == before
        beside = finished.with_name("out.interrupted")
        if number == signal.SIGTERM:
            assert process.returncode == 1
            assert re.search(r"genetic .*yes", out)
            assert err == (
                "interrupted: what had been done by then is kept in out.interrupted: `oed report "
                "out.interrupted` makes its report; out is as it was\n"
            )
        else:
            # Whoever looks there next puts it in order.
            assert interrupted_runs(finished) == [beside]
        assert load_record(beside).results[0].name == "genetic"
        assert not list(finished.parent.glob(".*"))
