"""README: every code block runs, and the output it shows is that of the committed report."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
from pathlib import Path

import pytest
import yaml
from own_parts import OWN_PARTS
from places import GALLERY, PROBLEMS, ROOT

from oed.cli import main
from oed.report.estimate.parameters import estimate_rows
from oed.robots.limits import LIMITS
from oed.robots.models import MODELS
from oed.robots.presets import preset_names
from oed.uncertainty.uncertainty import spread_of
from oed.workflow.estimate_logs import estimate
from oed.workflow.studies import load_study, parse_study

README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", README, flags=re.DOTALL)
RECORD = json.loads((GALLERY / "choi_skid_steer" / "record.json").read_text(encoding="utf-8"))


def blocks(language: str) -> list[str]:
    return [text for kind, text in BLOCKS if kind == language]


def commands() -> list[list[str]]:
    lines = [line for text in blocks("sh") for line in text.splitlines() if line.strip()]
    return [shlex.split(line, comments=True) for line in lines]


def test_every_block_is_of_a_kind_that_is_checked():
    assert {kind for kind, _ in BLOCKS} <= {"sh", "yaml", "python", "text"}


@pytest.mark.parametrize("target", [words[1] for words in commands() if words[0] == "make"])
def test_make_targets_exist(target: str):
    subprocess.run(["make", "-n", target], cwd=ROOT, check=True, capture_output=True)


def test_init_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    (words,) = [words for words in commands() if words[:2] == ["oed", "init"]]
    assert main(words[1:]) == 0
    load_study(tmp_path / words[2]).require_identifiable()


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", [words for words in commands() if words[0] == "oed" and words[1] != "init"], ids=" ".join
)
def test_commands_run(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(ROOT)
    if words[1] == "solve":
        # One start alone: that the whole search is a good one is shown elsewhere.
        text = Path(words[2]).read_text()
        assert "starts: 12" in text
        (tmp_path / words[2]).parent.mkdir()
        (tmp_path / words[2]).write_text(text.replace("starts: 12", "starts: 1, perturbations: 0"))
        monkeypatch.chdir(tmp_path)
    assert main(words[1:]) == 0
    assert capsys.readouterr().out


def test_the_study_explained_is_the_shipped_one():
    text = blocks("yaml")[0]
    shipped = load_study(PROBLEMS / "choi_skid_steer.yaml")
    assert parse_study(text).echo() == shipped.echo()


def test_the_keys_for_sensors_are_accepted():
    # They stand in the place of the first study's keys of the same names.
    whole, part, *_ = (yaml.safe_load(text) for text in blocks("yaml"))
    study = parse_study(yaml.safe_dump({**whole, **part}))
    assert [sensor.kind for sensor in study.problem.measurement.sensors] == ["poses", "ranges", "yaw_rate"]
    study.require_identifiable()


def test_the_keys_for_robots_and_limits_are_accepted():
    whole, sensors, part, *_ = (yaml.safe_load(text) for text in blocks("yaml"))
    measured = {**whole, "measurement": sensors["measurement"], "estimate": sensors["estimate"], **part}
    problem = parse_study(
        yaml.safe_dump({**measured, "criterion": {"kind": "E"}, "validation": None})
    ).problem
    assert {limit.name for limit in problem.limits} == set(LIMITS) - {
        "steering_angle",
        "steering_rate",
        "trailer_angle",
        "end_heading",
    }


def test_the_robust_study_is_one():
    whole, _, _, part, *_ = (yaml.safe_load(text) for text in blocks("yaml"))
    problem = parse_study(yaml.safe_dump({**whole, **part})).problem
    assert problem.robust is not None
    spread = spread_of(problem.uncertain_system)
    assert spread.names == ("wheel_radius_right", "wheel_radius_left", "track", "heading")


def test_the_keys_for_logs_are_accepted():
    whole, *_, part, _ = (yaml.safe_load(text) for text in blocks("yaml"))
    study = parse_study(yaml.safe_dump({**whole, **part}))
    assert study.log.kind == "csv"
    assert study.calibration.method == "joint"


def test_the_keys_for_parts_of_ones_own_are_accepted(tmp_path: Path):
    (tmp_path / "own_parts.py").write_text(OWN_PARTS)
    whole, *_, part = (yaml.safe_load(text) for text in blocks("yaml"))
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({**whole, **part, "bound": False}))
    problem = load_study(tmp_path / "study.yaml").problem
    assert [one.kind for one in (*problem.measurement.sensors, problem.criterion)] == [
        "poses",
        "compass",
        "log_smallest",
    ]
    assert [limit.name for limit in problem.limits] == ["wheel_speed", "strip"]


@pytest.mark.slow
def test_the_estimate_shown_is_that_of_the_shipped_log():
    (text,) = [block for block in blocks("text") if block.startswith("parameter")]
    study = load_study(PROBLEMS / "room_robot.yaml")
    found = estimate(study, [PROBLEMS / "logs" / "room_robot.csv"])
    for row in estimate_rows(found):
        assert any(line.split() == " ".join(row).split() for line in text.splitlines())


def test_every_robot_is_listed():
    for model in MODELS:
        assert f"`{model.model_fields['kind'].default}`" in README
    for name in preset_names():
        assert f"`{name}`" in README


@pytest.mark.slow
def test_python_runs_and_prints_what_is_said(capsys: pytest.CaptureFixture[str]):
    (text,) = blocks("python")
    exec(compile(text, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    said = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("# ")]
    assert said == printed.splitlines()


def test_the_output_shown_is_the_committed_report():
    shown = {line.split()[0]: line.split() for line in blocks("text")[0].splitlines() if line.strip()}
    for entry in RECORD["results"]:
        assert shown[entry["name"]][1] == f"{entry['objective']:.6g}"
        assert shown[entry["name"]][5] == f"{entry['path_length']:.6g}"


def test_links_and_figures_exist():
    targets = re.findall(r"\]\(([^)#:]+)\)", README)
    assert targets
    assert [target for target in targets if not (ROOT / target).exists()] == []
