"""`oed examples`: what comes with the package is listed, and copied whole or not at all."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
import yaml
from places import PROBLEMS, ROOT

from oed.cli import main
from oed.foundation import files
from oed.foundation.errors import Failure
from oed.study import examples
from oed.workflow.studies import load_study

STUDIES = sorted(one.relative_to(PROBLEMS).with_suffix("").as_posix() for one in PROBLEMS.rglob("*.yaml"))
PAIR = ("room_robot.yaml", "logs/room_robot.csv")


@pytest.fixture(scope="module", autouse=True)
def read_once() -> Iterator[None]:
    """Whatever is asked, each shipped study is read for its name: here once for all."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(examples, "read_yaml", cache(examples.read_yaml))
        yield


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder: Path) -> dict[str, bytes | None]:
    """Of all files below a folder, hidden ones too, by name; None of empty folders."""
    found = [one for one in folder.rglob("*") if one.is_file() or not any(one.iterdir())]
    return {one.relative_to(folder).as_posix(): one.read_bytes() if one.is_file() else None for one in found}


def shipped(*names: str) -> dict[str, bytes]:
    return {f"problems/{name}": (PROBLEMS / name).read_bytes() for name in names}


def data(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict]:
    capsys.readouterr()
    code = main(["examples", *arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.slow
def test_all_are_listed_with_their_names(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["examples"]) == 0
    said = capsys.readouterr()
    rows = dict(line.split(maxsplit=1) for line in said.out.splitlines())
    assert (sorted(rows), said.err) == (STUDIES, "")
    assert rows["laser_tracker_coefficients"] == "Laser tracker, coefficients"
    assert contents(folder) == {}


@pytest.mark.slow
def test_their_names_are_those_of_the_studies(capsys: pytest.CaptureFixture[str]):
    code, found = data(capsys)
    assert code == 0
    for one in found["examples"]:
        file = PROBLEMS / one["files"][0]
        # That those of the folder itself load, tests of studies show.
        own = yaml.safe_load(file.read_text())["name"] if file.parent == PROBLEMS else load_study(file).name
        assert own == one["title"]


def test_every_shipped_file_comes_with_a_study(capsys: pytest.CaptureFixture[str]):
    code, found = data(capsys)
    assert code == 0
    files = {file for one in found["examples"] for file in one["files"]}
    there = {one for one in PROBLEMS.rglob("*") if one.is_file() and one.parent.name != "__pycache__"}
    assert files == {one.relative_to(PROBLEMS).as_posix() for one in there}


def test_a_study_is_copied_with_what_it_needs(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["examples", "room_robot"]) == 0
    said = capsys.readouterr()
    study = Path("problems") / "room_robot.yaml"
    log = Path("problems") / "logs" / "room_robot.csv"
    assert (said.out, said.err) == ("", f"wrote {study} and {log}; then: oed run {study}\n")
    assert contents(folder) == shipped(*PAIR)


def test_a_study_of_ones_own_robot_is_copied_with_its_module(folder: Path):
    assert main(["examples", "own_robot.yaml", "--out", "mine"]) == 0
    assert sorted(contents(folder)) == ["mine/own_robot.py", "mine/own_robot.yaml"]
    assert load_study("mine/own_robot.yaml").name == "A robot of one's own"


def test_copies_are_told_as_json(folder: Path, capsys: pytest.CaptureFixture[str]):
    code, found = data(capsys, "box_lucas", "published/box_lucas", "room_robot", "--out", "here")
    assert (code, set(found)) == (2, {"error", "flaws"})
    code, found = data(capsys, "published/box_lucas", "room_robot", "room_robot.yaml", "--out", "here")
    assert code == 0
    studies = ["here/published/box_lucas.yaml", "here/room_robot.yaml"]
    assert found == {
        "directory": "here",
        "studies": studies,
        "files": [*studies, "here/logs/room_robot.csv"],
        "written": [*studies, "here/logs/room_robot.csv"],
    }


def test_all_are_copied(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["examples", "--all"]) == 0
    there = {one for one in PROBLEMS.rglob("*") if one.is_file() and one.parent.name != "__pycache__"}
    assert contents(folder) == shipped(*(one.relative_to(PROBLEMS).as_posix() for one in there))
    assert f"wrote {len(there)} files to problems" in capsys.readouterr().err


def test_an_unknown_name_is_refused_with_those_like_it(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["examples", "lazer_tracker", "laser_tracker", "box_lucas", "zzz"]) == 2
    first, second, third, last = capsys.readouterr().err.splitlines()
    assert first == "no example study 'lazer_tracker'; did you mean laser_tracker?"
    assert second == "no example study 'box_lucas'; did you mean published/box_lucas?"
    assert third == "no example study 'zzz'"
    assert "`oed examples`" in last
    assert contents(folder) == {}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--out", "x"], "which studies"),
        (["--force"], "which studies"),
        (["heading", "--all"], "not both"),
    ],
)
def test_what_makes_no_sense_is_refused(folder: Path, capsys, arguments: list[str], said: str):
    assert main(["examples", *arguments]) == 2
    assert said in capsys.readouterr().err
    assert contents(folder) == {}


def test_nothing_is_written_over_without_force(folder: Path, capsys: pytest.CaptureFixture[str]):
    own = folder / "problems" / "room_robot.yaml"
    own.parent.mkdir()
    own.write_text("mine\n")
    assert main(["examples", "heading", "room_robot"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"{Path('problems') / 'room_robot.yaml'} exists; ")
    assert "--force" in said
    assert contents(folder) == {"problems/room_robot.yaml": b"mine\n"}
    assert main(["examples", "heading", "room_robot", "--force"]) == 0
    assert contents(folder) == shipped("heading.yaml", *PAIR)


def test_a_copy_that_is_there_already_stays(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["examples", "room_robot"]) == 0
    (folder / "problems" / "notes.txt").write_text("mine")
    log = folder / "problems" / "logs" / "room_robot.csv"
    before = log.stat()
    (folder / "problems" / "room_robot.yaml").unlink()
    code, found = data(capsys, "room_robot")
    assert (code, found["written"], len(found["files"])) == (0, ["problems/room_robot.yaml"], 2)
    assert contents(folder) == {**shipped(*PAIR), "problems/notes.txt": b"mine"}
    assert main(["examples", "room_robot"]) == 0
    assert capsys.readouterr().err.startswith("nothing to write, all is in problems already; then: oed run ")
    assert (log.stat().st_ino, log.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)


@pytest.mark.parametrize("taken", ["problems", "problems/logs", "problems/logs/room_robot.csv/x"])
@pytest.mark.parametrize("force", [[], ["--force"]], ids=["", "force"])
def test_what_is_in_the_way_of_one_stops_all(folder: Path, capsys, taken: str, force: list[str]):
    # A file where a folder should be, or a folder where a file should be.
    (folder / taken).parent.mkdir(parents=True, exist_ok=True)
    (folder / taken).write_text("mine")
    assert main(["examples", "room_robot", "heading", *force]) == 2
    place = Path(taken.removesuffix("/x"))
    assert capsys.readouterr().err.startswith(f"{place} is in the way")
    assert contents(folder) == {taken: b"mine"}


def test_where_the_disk_is_full_nothing_is_written(folder: Path, capsys, monkeypatch: pytest.MonkeyPatch):
    write, names = files.write_bytes, []

    def write_two(path: Path, content: bytes) -> None:
        names.append(path.name)
        if len(names) > 2:
            raise Failure(f"{path}: cannot be written: no room")
        write(path, content)

    monkeypatch.setattr(files, "write_bytes", write_two)
    assert main(["examples", "room_robot", "heading"]) == 1
    assert f"{Path('problems') / 'heading.yaml'}: cannot be written: no room" in capsys.readouterr().err
    assert (len(names), contents(folder)) == (3, {})


@pytest.mark.slow
def test_installed_they_are_found_in_the_package(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    assert examples.examples_folder() == ROOT / "problems"
    # As in a wheel, with what Python has compiled there.
    package = folder / "site-packages" / "oed"
    for name in (*PAIR, "own_robot.yaml", "own_robot.py"):
        target = package / "problems" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(PROBLEMS / name, target)
    (package / "problems" / "__pycache__").mkdir()
    (package / "problems" / "__pycache__" / "own_robot.pyc").write_bytes(b"")
    monkeypatch.setattr(examples, "__file__", str(package / "study" / "examples.py"))
    assert examples.examples_folder() == package / "problems"
    assert sorted(examples.examples()) == ["own_robot", "room_robot"]
    shutil.rmtree(package / "problems")
    assert main(["examples"]) == 1
    assert "install oed again" in capsys.readouterr().err
