"""README: every code block runs, and what it shows is what comes out; the pages: tests/test_docs.py."""

from __future__ import annotations

import re
import shlex
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from places import PROBLEMS, REPORTS, ROOT

from oed.cli import main
from oed.kernel.solution import scored
from oed.records.record import load_record
from oed.report.answer import answer_of
from oed.report.estimate.parameters import estimate_rows
from oed.workflow.compared import compared
from oed.workflow.estimate_logs import estimate
from oed.workflow.runner import record
from oed.workflow.studies import Work, load_study

README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", README, flags=re.DOTALL)
MOST = 2_000
"""Words of a page that is read to the end."""


def blocks(language: str) -> list[str]:
    return [text for kind, text in BLOCKS if kind == language]


def commands() -> list[list[str]]:
    lines = [line for text in blocks("sh") for line in text.splitlines() if line.strip()]
    return [shlex.split(line, comments=True) for line in lines]


def test_it_is_short_and_opens_with_the_two_commands():
    assert len(README.split()) <= MOST
    assert [words[:2] for words in commands()[:2]] == [["make", "demo"], ["make", "test"]]
    assert README.index("make demo") < README.index("make test") < 250


def test_every_block_is_of_a_kind_that_is_checked():
    assert {kind for kind, _ in BLOCKS} <= {"sh", "python", "text"}


@pytest.mark.parametrize("target", [words[1] for words in commands() if words[0] == "make"])
def test_make_targets_exist(target: str):
    subprocess.run(["make", "-n", target], cwd=ROOT, check=True, capture_output=True)


@pytest.mark.slow
def test_init_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    (words,) = [words for words in commands() if words[:2] == ["oed", "init"]]
    assert main(words[1:]) == 0
    load_study(tmp_path / words[2]).require_identifiable()


def test_commands_are_of_the_command_line(capsys: pytest.CaptureFixture[str]):
    for words in commands():
        if words[0] == "oed":
            with pytest.raises(SystemExit) as left:
                main([words[1], "--help"])
            assert left.value.code == 0
            known = capsys.readouterr().out
            assert [word for word in words if word.startswith("--") and word not in known] == []


@pytest.mark.slow
def test_the_estimate_shown_is_that_of_the_shipped_log():
    (text,) = [block for block in blocks("text") if block.startswith("parameter")]
    study = load_study(PROBLEMS / "room_robot.yaml")
    found = estimate(study, [PROBLEMS / "logs" / "room_robot.csv"])
    shown = [line.split() for line in text.splitlines()[1:]]
    assert shown == [" ".join(row).split() for row in estimate_rows(found)]


@pytest.mark.slow
def test_python_runs_and_prints_a_standard_error_of_each_parameter(capsys: pytest.CaptureFixture[str]):
    (text,) = blocks("python")
    # A search of a tenth of the size.
    for long, short in (("samples=100", "samples=20"), ("starts=2", "starts=1")):
        assert long in text
        text = text.replace(long, short)
    exec(compile(text, "README.md", "exec"), {})
    printed = capsys.readouterr().out.splitlines()
    errors = {line.split(":")[0]: float(line.split()[-2]) for line in printed}
    assert set(errors) == {"wheel_radius_right", "wheel_radius_left", "track"}
    assert all(0 < error < 1 for error in errors.values())


def shown_rows() -> dict[str, list[str]]:
    """Of the demo's table: name, then value, standard error and that of the best baseline, without units."""
    lines = [line.split() for line in blocks("text")[0].splitlines() if line.startswith("c2")]
    return {words[0]: words[1::2] for words in lines}


def test_the_drive_shown_is_that_of_the_committed_report():
    answer = answer_of(load_record(REPORTS / "choi_skid_steer"))
    assert answer is not None
    lines = blocks("text")[0].splitlines()
    title = lines.index(answer.title)
    assert " ".join(lines[:title]) == answer.warning
    expected = {row.name: [row.value.split()[0], row.designed.split()[0]] for row in answer.rows}
    assert {name: numbers[:2] for name, numbers in shown_rows().items()} == expected


@pytest.mark.slow
def test_the_baseline_shown_is_the_best_one():
    study = load_study(PROBLEMS / "choi_skid_steer.yaml")
    # Baselines of the design's length are among those compared: that of the committed report.
    design = load_record(REPORTS / "choi_skid_steer").result("ipopt").drive.trajectory
    found = replace(scored(study.problem, design, "ipopt"), kind="ipopt")
    answer = answer_of(record(study, [found, *compared(Work(study, study.seed), {}, found)], study.seed))
    assert answer is not None
    assert f"best baseline ({answer.baseline})" in blocks("text")[0]
    expected = {row.name: row.baseline.split()[0] for row in answer.rows}
    assert {name: numbers[-1] for name, numbers in shown_rows().items()} == expected


def test_links_and_figures_exist():
    targets = re.findall(r"\]\(([^)#:]+)\)", README)
    assert targets
    assert [target for target in targets if not (ROOT / target).exists()] == []
