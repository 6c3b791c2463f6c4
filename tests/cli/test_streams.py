"""Standard streams that are closed, full, or read by nobody: the work is done and its exit code stays."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TextIO

import pytest
from studies import GENETIC, small, write_study

from oed.cli import main
from oed.records.record import load_record

pytestmark = pytest.mark.usefixtures("blank_figures")


@pytest.fixture
def unread() -> Iterator[TextIO]:
    """A pipe that nobody reads any more."""
    reading, writing = os.pipe()
    os.close(reading)
    stream = os.fdopen(writing, "w")
    yield stream
    with suppress(OSError):
        stream.close()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_study(tmp_path, small(solvers=GENETIC))
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_run_whose_reader_leaves_is_done_all_the_same(
    folder: Path, unread: TextIO, monkeypatch: pytest.MonkeyPatch, stream: str
) -> None:
    monkeypatch.setattr(sys, stream, unread)
    assert main(["run", "study.yaml", "--out", "out"]) == 0
    assert load_record("out").results
    assert (folder / "out" / "report.html").exists()
    # Nor is there anything left that could fail when the program ends.
    unread.flush()
    assert getattr(sys, stream) is unread


@pytest.mark.parametrize("arguments", [["--help"], ["schema"], ["check", "study.yaml", "--json"]])
@pytest.mark.slow
def test_nobody_reads(
    folder: Path, unread: TextIO, monkeypatch: pytest.MonkeyPatch, capsys, arguments: list[str]
) -> None:
    monkeypatch.setattr(sys, "stdout", unread)
    try:
        code = main(arguments)
    except SystemExit as leaving:
        code = leaving.code
    unread.flush()
    assert (code, capsys.readouterr().err) == (0, "")


@pytest.mark.parametrize("stream", ["stdin", "stdout", "stderr"])
@pytest.mark.slow
def test_closed_streams(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], stream: str
) -> None:
    monkeypatch.setattr(sys, stream, None)
    assert main(["check", "study.yaml"]) == 0
    assert main(["check", "study.yaml", "--json"]) == 0
    assert main(["check", "nope.yaml"]) == 2
    assert main(["init"]) == 2
    assert "defect" not in capsys.readouterr().err


@pytest.mark.slow
def test_closed_streams_of_the_program(folder: Path) -> None:
    command = f"{sys.executable} -m oed check nope.yaml --json <&- >&- 2>&-"
    assert subprocess.run(["/bin/sh", "-c", command], check=False).returncode == 2


@pytest.mark.parametrize("arguments", [["--help"], ["check", "study.yaml"], ["schema", "--json"]])
@pytest.mark.slow
def test_full_output(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no device that is always full")
    with suppress(OSError), open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert main(arguments) == 1
    assert capsys.readouterr().err == "standard output cannot be written: No space left on device\n"


def test_who_closes_the_stream_closes_their_own(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def closing() -> dict[str, str]:
        sys.stdout.close()
        return {"a": "b"}

    monkeypatch.setattr("oed.study.study.json_schema", closing)
    assert main(["schema"]) == 0
    assert '"a": "b"' in capsys.readouterr().out


def test_warnings_take_a_line_and_do_not_steer(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def warning() -> dict[str, str]:
        warnings.warn("Glyph 27 (\x1b)\nmissing", stacklevel=1)
        return {}

    monkeypatch.setattr("oed.study.study.json_schema", warning)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert main(["schema"]) == 0
    said = capsys.readouterr().err
    assert said.endswith(": UserWarning: Glyph 27 (\\x1b)\\nmissing\n")
    assert said.count("\n") == 1


def test_what_is_written_is_passed_on(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    assert main(["check", "study.yaml"]) == 0
    assert out.getvalue().startswith("study.yaml: ok")
