"""`oed animate`: a film beside the record, the report made again with it, and mistakes in one line."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from places import REPORTS
from recorded import keep_results

from oed.cli import main
from oed.report.film.writing import Frame

RECORD = REPORTS / "choi_skid_steer" / "record.json"
QUICK = ("--speed", "40", "--fps", "5", "--quiet")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(RECORD, tmp_path)
    return tmp_path


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.mark.slow
def test_one_object_and_a_film(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["animate", str(folder), "--json", *QUICK]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["file"] == str(folder / "drive.gif")
    assert told["bytes"] == (folder / "drive.gif").stat().st_size
    assert told["frames"] == round(told["seconds"] * 5)
    assert (told["results"], told["speed"], told["report"]) == (["ipopt"], 40.0, None)
    # No report is made where there was none.
    assert names(folder) == {"record.json", "drive.gif"}


@pytest.mark.slow
@pytest.mark.usefixtures("blank_figures")
def test_the_report_shows_it(folder: Path, capsys: pytest.CaptureFixture[str]):
    data = json.loads((folder / "record.json").read_text())
    keep_results(data, "ipopt", "circle")
    # Without simulated experiments the report is soon made.
    (folder / "record.json").write_text(json.dumps({**data, "validation": None}))
    assert main(["report", str(folder)]) == 0
    assert "](drive.gif)" not in (folder / "report.md").read_text()
    assert main(["animate", str(folder), "--result", "ipopt", "circle", *QUICK]) == 0
    printed = capsys.readouterr().out
    assert f"film: {folder / 'drive.gif'} (" in printed
    assert f"Page:  {folder / 'report.html'}" in printed
    assert "![Film of Designed drive and Circle in the room](drive.gif)" in (folder / "report.md").read_text()


@pytest.mark.slow
def test_elsewhere(folder: Path, capsys: pytest.CaptureFixture[str]):
    (folder / "report.html").write_text("old")
    assert (
        main(["animate", str(folder / "record.json"), "--out", str(folder / "there" / "x.gif"), *QUICK]) == 0
    )
    assert names(folder / "there") == {"x.gif"}
    assert (folder / "report.html").read_text() == "old"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ["--result", "nonsense"],
            "record.json: no drive of the name 'nonsense'; the record has ipopt, genetic",
        ),
        (
            ["--to", "mp4"],
            "an MP4 needs the program ffmpeg, which is not on the PATH: install it (`apt install",
        ),
        (["--out", "film.avi"], "film.avi: expected a name that ends in .gif or .mp4"),
        (["--out", "film.mp4", "--to", "gif"], "film.mp4: expected a name that ends in .gif, as --to says"),
        (["--fps", "200"], "fps: a GIF shows at most 50 frames a second, got 200"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_mistakes(
    folder: Path,
    options: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setenv("PATH", str(folder))
    assert main(["animate", str(folder), *options]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err
    assert len(err.splitlines()) == 1
    assert names(folder) == {"record.json"}


def test_no_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["animate", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith(f"{tmp_path / 'record.json'}: no record there")


@pytest.mark.slow
def test_interrupted(folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    from oed.report.film.stage import Stage

    drawn = Stage.frame

    def strike(self: Stage, time: float) -> Frame:
        if 0.1 < time < 0.4:
            raise KeyboardInterrupt
        return drawn(self, time)

    monkeypatch.setattr(Stage, "frame", strike)
    assert main(["animate", str(folder), *QUICK]) == 1
    assert capsys.readouterr().err == "interrupted\n"
    assert names(folder) == {"record.json"}


@pytest.mark.slow
def test_physics(folder: Path):
    # Of a quarter of the drive's time, which is soon simulated.
    data = json.loads((folder / "record.json").read_text())
    (drive,) = (entry["drive"] for entry in data["results"] if entry["name"] == data["best"])
    drive["knots"] = [time / 4 for time in drive["knots"]]
    (folder / "record.json").write_text(json.dumps(data))
    # The graphics library is chosen when the engine is first imported: a process of its own.
    command = [sys.executable, "-m", "oed", "animate", str(folder), "--physics", "--speed", "25", "--json"]
    run = subprocess.run(command, capture_output=True, text=True)
    if "no way to draw" in run.stderr:
        assert run.returncode == 1
        pytest.skip("nothing to draw with here")
    told = json.loads(run.stdout)
    assert told["file"] == str(folder / "physics.gif")
    assert told["frames"] == 3
    assert names(folder) == {"record.json", "physics.gif"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--result", "ipopt", "circle"], "--physics films one drive"),
        (["--result", "nobody"], "no drive of the name .nobody."),
        (["--speed", "-1"], "expected more than 0"),
        (["--speed", "1e-5"], "frames, expected at most 2000; take a higher speed"),
        (["--out", "drive.avi"], r"\.gif or \.mp4"),
    ],
)
def test_mistakes_with_physics(
    folder: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str]
):
    assert main(["animate", str(folder), "--physics", "--quiet", *options]) == 2
    assert re.search(message, capsys.readouterr().err)
    assert names(folder) == {"record.json"}
