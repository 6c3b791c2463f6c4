"""What is there to be copied, and names of files that mean something to a shell, a page or the system."""

from __future__ import annotations

import errno
import os
import re
import shlex
from pathlib import Path

import pytest
from studies import SMALL

from oed.cli import main
from oed.foundation.work.folders import kept_in
from oed.report.page import code_span

NAME = "my out; $(x)"
"""Name of a folder that a shell reads as several words and commands."""
CHOICE = ("--robot", "unicycle", "--sensor", "poses", "--room", "2 m x 2 m")


@pytest.mark.parametrize("name", ["my out", "a;b", "$(x)", "it's"])
def test_the_command_for_an_interrupted_run_names_one_folder(name: str):
    command = kept_in(Path(name)).split("`")[1]
    assert shlex.split(command) == ["oed", "report", name]


def test_a_backtick_does_not_end_a_code_span():
    assert code_span("oed run") == "`oed run`"
    assert code_span("a`<img>") == "`` a`<img> ``"


@pytest.mark.slow
def test_init_quotes_the_study_to_run(tmp_path: Path, capsys):
    file = tmp_path / NAME / "study.yaml"
    assert main(["init", str(file), *CHOICE]) == 0
    command = capsys.readouterr().err.split("then: ")[1]
    assert shlex.split(command) == ["oed", "run", str(file)]


@pytest.mark.slow
def test_examples_quotes_the_study_to_run(tmp_path: Path, capsys):
    folder = tmp_path / NAME
    assert main(["examples", "choi_skid_steer", "--out", str(folder)]) == 0
    command = capsys.readouterr().err.split("then: ")[1]
    assert shlex.split(command) == ["oed", "run", str(folder / "choi_skid_steer.yaml")]


def test_report_quotes_the_folder_that_has_no_results(tmp_path: Path, capsys):
    folder = tmp_path / NAME
    folder.mkdir()
    assert main(["report", str(folder)]) == 2
    (command,) = re.findall(r"`(oed run [^`]*)`", capsys.readouterr().err)
    assert shlex.split(command) == ["oed", "run", "STUDY", "--out", str(folder)]


@pytest.mark.slow
def test_estimate_refuses_a_log_that_is_a_link_to_itself(tmp_path: Path, capsys):
    study, log = tmp_path / "study.yaml", tmp_path / "loop.csv"
    study.write_text(SMALL)
    log.symlink_to(log.name)
    assert main(["estimate", str(study), str(log), "--quiet"]) == 2
    assert os.strerror(errno.ELOOP) in capsys.readouterr().err
