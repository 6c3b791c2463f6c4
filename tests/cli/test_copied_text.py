"""What is there to be copied, and names of files that mean something to a shell, a page or the system."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import pytest
from studies import SMALL

from oed.cli import main
from oed.foundation.work.folders import kept_in
from oed.report.page import code_span


@pytest.mark.parametrize("name", ["my out", "a;b", "$(x)", "it's"])
def test_the_command_for_an_interrupted_run_names_one_folder(name: str):
    command = kept_in(Path(name)).split("`")[1]
    assert shlex.split(command) == ["oed", "report", name]


def test_a_backtick_does_not_end_a_code_span():
    assert code_span("oed run") == "`oed run`"
    assert code_span("a`<img>") == "`` a`<img> ``"


@pytest.mark.slow
def test_estimate_refuses_a_log_that_is_a_link_to_itself(tmp_path: Path, capsys):
    study, log = tmp_path / "study.yaml", tmp_path / "loop.csv"
    study.write_text(SMALL)
    log.symlink_to(log.name)
    assert main(["estimate", str(study), str(log), "--quiet"]) == 2
    assert os.strerror(40) in capsys.readouterr().err
