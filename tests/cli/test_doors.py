"""Whatever stands where a file is to be read, it is said at once: nothing waits or fills memory."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from studies import SMALL

from oed.cli import main

pytestmark = pytest.mark.skipif(os.name != "posix", reason="there are no pipes with names elsewhere")

COMMANDS = {
    "check": ["check", "odd"],
    "run": ["run", "odd", "--quiet"],
    "sweep": ["sweep", "odd", "--over", "trajectory.duration=10 s,20 s", "--quiet"],
    "estimate": ["estimate", "study.yaml", "odd", "--quiet"],
    "evaluate": ["evaluate", "study.yaml", "odd"],
    "report": ["report", "odd"],
    "report of a record": ["report", "of"],
    "export": ["export", "of", "--to", "csv"],
    "validate": ["validate", "of", "--quiet"],
    "animate": ["animate", "of", "--quiet"],
    "next": ["next", "of", "log.csv", "--quiet"],
    "a path": ["run", "path.yaml", "--quiet"],
    "a prior": ["check", "prior.yaml"],
    "a code": ["check", "code.yaml"],
}
"""By what reads the odd file."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.yaml").write_text(SMALL)
    (tmp_path / "path.yaml").write_text(SMALL + "baselines: [{file: odd}]\n")
    (tmp_path / "prior.yaml").write_text(SMALL + "prior: {record: odd}\n")
    robot = "{kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}"
    (tmp_path / "code.yaml").write_text(SMALL.replace(robot, "{kind: python, object: 'odd_code:Robot'}"))
    (tmp_path / "log.csv").write_text("")
    (tmp_path / "of").mkdir()
    (tmp_path / "of" / "record.json").symlink_to(tmp_path / "odd")
    (tmp_path / "odd_code.py").symlink_to("odd")

    def late(*_: object) -> None:
        raise TimeoutError

    # A defect here is one that waits for ever.
    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(30)
    yield tmp_path
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_what_is_no_file_is_refused(folder: Path, capsys: pytest.CaptureFixture[str], kind: str):
    if kind == "pipe":
        os.mkfifo("odd")
    else:
        # It ends at once: a defect is seen, and fills no memory.
        Path("odd").symlink_to("/dev/null")
    for command, arguments in COMMANDS.items():
        assert main(arguments) == 2, command
        said = capsys.readouterr().err
        expected = "no module" if command == "a code" else f"expected a file, got a {kind}"
        assert expected in said, (command, said)
