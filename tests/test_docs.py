"""The documentation builds without a warning, its studies are valid, and what it shows is what comes out."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from own_parts import OWN_PARTS
from pages import DOCS, PAGES, blocks
from places import PROBLEMS, ROOT

import oed
from oed.cli import main
from oed.logs import CsvForm
from oed.report.estimate.parameters import estimate_rows
from oed.robots.limits import LIMITS
from oed.robots.models import MODELS
from oed.robots.presets import preset_names
from oed.uncertainty.uncertainty import spread_of
from oed.workflow.estimate_logs import estimate
from oed.workflow.studies import load_study, parse_study

GALLERY = ("choi_paper_table",)
"""Studies of the gallery of the build that is tested."""
ELSEWHERE = "heated_tank"
"""A study that is not of a robot, and has no drive to show."""


WHOLE = yaml.safe_load(blocks("reference/study", "yaml")[0])


def study_with(page: str, number: int, **keys: object) -> str:
    """The study that is explained, with the keys of a block of a page instead of its own."""
    return yaml.safe_dump({**WHOLE, **yaml.safe_load(blocks(page, "yaml")[number]), **keys})


TWO_WHEELS = {
    "format": 1,
    "name": "Two wheels",
    "robot": {"kind": "differential_drive", "wheel_radius": 0.05, "track": 0.2},
    "measurement": {"kind": "poses", "noise": {"position": 0.01, "heading": 0.02}},
}
"""A study that only estimates."""


SMALLER = {
    "notebooks/design.md": (
        ('"15 s", samples=60', '"5 s", samples=20'),
        ("arange(60)", "arange(20)"),
        ("15 - times", "5 - times"),
        ("times / 15", "times / 5"),
        ("duration=15", "duration=5"),
        ("replicates=200", "replicates=50"),
        ("draws=1000", "draws=200"),
    )
}
"""A drive of a third of the time, in periods of the same length: what bounds it is found in a sixth."""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages as HTML, from a copy of their sources: executed in full, with a gallery of one study."""
    place = tmp_path_factory.mktemp("docs")
    shutil.copytree(DOCS, place / "docs", ignore=shutil.ignore_patterns("_build", "generated", "__pycache__"))
    for name, changes in SMALLER.items():
        text = (DOCS / name).read_text(encoding="utf-8")
        for long, short in changes:
            assert long in text
            text = text.replace(long, short)
        (place / "docs" / name).write_text(text, encoding="utf-8")
    for name in ("oed", "problems", "reports", "CONTRIBUTING.md", "CHANGELOG.md"):
        (place / name).symlink_to(ROOT / name)
    quick = {"OED_DOCS_QUICK": "1", "OED_DOCS_GALLERY": " ".join([*GALLERY, ELSEWHERE])}
    search = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "docs", "html"],
        cwd=place,
        env={**os.environ, **quick, "PYTHONPATH": search},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return place / "html"


def page(built: Path, name: str) -> str:
    return (built / f"{name}.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_every_page_is_built(built: Path):
    assert [name for name in PAGES if not (built / f"{name}.html").exists()] == []


@pytest.mark.slow
def test_every_public_name_is_in_the_reference(built: Path):
    reference = "".join(
        one.read_text(encoding="utf-8") for one in (built / "generated" / "api").glob("*.html")
    )
    assert [name for name in dir(oed) if f'id="oed.{name}"' not in reference] == []


@pytest.mark.slow
def test_the_gallery_shows_each_study_with_its_drive_and_standard_errors(built: Path):
    listed = page(built, "generated/gallery/index")
    assert ELSEWHERE not in listed
    for stem in GALLERY:
        assert f"{stem}.svg" in listed
        shown = page(built, f"generated/gallery/{stem}")
        assert f"{stem}.svg" in shown
        assert "standard error, designed" in shown
        assert "best baseline" in shown


@pytest.mark.slow
def test_the_tutorial_ends_with_parameters_near_the_truth(built: Path):
    text = re.sub(r"<[^>]+>", "", page(built, "tutorial"))
    found = {
        name: (float(estimate), float(error))
        for name, estimate, error in re.findall(
            r"^(wheel radius \w+|track) +mm +[\d.]+ +([\d.]+) +([\d.]+)", text, flags=re.MULTILINE
        )
    }
    truth = {"wheel radius right": 32.72, "wheel radius left": 33.18, "track": 163.1}
    assert set(found) == set(truth)
    for name, (value, error) in found.items():
        assert abs(value - truth[name]) < 4 * error
        assert error < 0.01 * truth[name]


@pytest.mark.slow
def test_the_tutorial_through_slip_ends_with_intervals_beside_what_was_true(built: Path):
    pytest.importorskip("mujoco")
    text = re.sub(r"<[^>]+>", "", page(built, "tutorial_slip"))
    found = re.findall(
        r"^(first|both|slip) +(\w+) +([\d.]+) to +([\d.]+) mm, true ([\d.]+)(?: to ([\d.]+))? mm: contains",
        text,
        flags=re.MULTILINE,
    )
    assert len(found) == 9
    for _, name, low, high, least, most in found:
        size = float(least)
        assert (size, name) in {(49.6, "wheel_radius_right"), (48.7, "wheel_radius_left")} or name == "track"
        assert float(low) < float(high)
        assert 0.95 * size < float(low) < float(high) < 1.05 * float(most or least)


@pytest.mark.slow
def test_the_notebooks_show_what_was_computed(built: Path):
    assert "local optimum that satisfies every limit" in page(built, "notebooks/design")
    assert "clock_offset" in page(built, "notebooks/estimate")


def test_the_study_explained_is_the_shipped_one():
    shipped = load_study(PROBLEMS / "choi_skid_steer.yaml")
    assert parse_study(blocks("reference/study", "yaml")[0]).echo() == shipped.echo()


@pytest.mark.parametrize("number", range(len(blocks("howto/sensors", "yaml"))))
def test_the_keys_for_sensors_are_accepted(number: int):
    study = parse_study(study_with("howto/sensors", number, bound=False))
    assert study.problem.measurement is not None


def test_sensors_add_up():
    study = parse_study(study_with("howto/sensors", -1))
    kinds = [sensor.kind for sensor in study.problem.measurement.sensors]
    assert kinds == ["poses", "relative_poses", "ranges", "yaw_rate"]
    study.require_identifiable()


def test_the_keys_for_robots_and_limits_are_accepted():
    sensors = yaml.safe_load(blocks("howto/sensors", "yaml")[-1])
    measured = {key: sensors[key] for key in ("measurement", "estimate")}
    measured |= yaml.safe_load(blocks("howto/limits", "yaml")[0])
    problem = parse_study(
        yaml.safe_dump({**WHOLE, **measured, "criterion": {"kind": "E"}, "validation": None})
    ).problem
    assert {limit.name for limit in problem.limits} == set(LIMITS) - {
        "steering_angle",
        "steering_rate",
        "trailer_angle",
        "end_heading",
        "commanded_speed",
        "commanded_acceleration",
        "commanded_yaw_rate",
        "commanded_yaw_acceleration",
        "throttle",
        "throttle_rate",
    }


EXPERIMENTS = [yaml.safe_load(code) for code in blocks("howto/experiments", "yaml")]
TANK = EXPERIMENTS[0]


@pytest.mark.parametrize("keys", EXPERIMENTS, ids=lambda keys: ", ".join(keys))
def test_the_keys_for_experiments_are_accepted(keys: dict[str, Any]):
    if keys.get("system", {}).get("kind") == "python":
        assert set(keys["system"]) == {"kind", "object", "volume", "start"}
        return
    base = {key: TANK[key] for key in ("format", "name")} if "system" in keys else TANK
    if "candidates" in keys.get("experiment", {}):
        line = {"kind": "equations", "inputs": {"x": ""}, "parameters": {"a": 1}, "outputs": {"y": "a * x"}}
        base = {**TANK, "system": line, "measurement": {"kind": "responses", "noise": {"y": 1}}}
        base["estimate"] = ["a"]
    study = parse_study(yaml.safe_dump({**base, **keys}))
    study.require_identifiable()
    assert set(keys) <= set(study.echo())


@pytest.mark.parametrize("number", range(len(blocks("howto/criteria", "yaml"))))
def test_the_keys_for_criteria_are_accepted(number: int):
    measured = {"measurement": {"kind": "poses", "noise": {"position": 0.01, "heading": 0.02}}}
    given = yaml.safe_load(blocks("howto/criteria", "yaml")[number])
    study = parse_study(
        yaml.safe_dump({**WHOLE, "criterion": {"kind": "E"}, "bound": False, **measured, **given})
    )
    for key, value in given.items():
        if key == "criterion":
            assert study.problem.criterion.kind == value["kind"]


def test_the_robust_study_is_one():
    problem = parse_study(study_with("howto/robust", 0)).problem
    assert problem.robust is not None
    spread = spread_of(problem.uncertain_system)
    assert spread.names == ("wheel_radius_right", "wheel_radius_left", "track", "heading")


@pytest.mark.parametrize("number", range(len(blocks("howto/logs", "yaml"))))
def test_the_keys_for_logs_are_accepted(number: int):
    study = parse_study(study_with("howto/logs", number))
    assert study.log.kind == yaml.safe_load(blocks("howto/logs", "yaml")[number])["log"].get("kind", "csv")
    assert study.log.issues(study.problem.model) == []


def rows(page: str, table: int) -> list[list[str]]:
    """What stands as code in the last column of each row of a table; alternatives apart."""
    tables = re.findall(r"^\|[-|]+\|\n((?:\|.*\n)+)", PAGES[page], flags=re.MULTILINE)
    return [
        re.findall(r"`([^`]+)`", part)
        for line in tables[table].splitlines()
        for part in re.split(r"; |, or ", line.split("|")[2])
    ]


def keys_of(codes: list[str]) -> dict[str, object]:
    return {key: value for code in codes for key, value in yaml.safe_load(code).items()}


LOOKS = [keys_of(codes) for codes in rows("howto/logs", 0) if codes]
ROBOTS = [keys_of(codes) for codes in rows("howto/logs", 1)]


@pytest.mark.parametrize("keys", LOOKS, ids=str)
def test_each_look_of_a_log_has_valid_keys(keys: dict[str, object]):
    beside = {"measurement": keys.pop("measurement")} if "measurement" in keys else {}
    study = parse_study(yaml.safe_dump(TWO_WHEELS | beside | {"log": keys}))
    assert study.log.issues(study.problem.model) == []
    assert set(keys) <= study.log.model_fields_set | {"kind"}


@pytest.mark.parametrize("keys", ROBOTS, ids=str)
def test_each_robot_has_valid_keys(keys: dict[str, object]):
    study = parse_study(yaml.safe_dump(TWO_WHEELS | keys))
    assert study.log.issues(study.problem.model) == []


def test_every_key_of_a_log_is_in_the_table():
    named = {key for keys in LOOKS for key in keys}
    assert set(CsvForm.model_fields) - named == {"delimiter"}


def test_the_keys_for_estimates_are_accepted():
    study = parse_study(study_with("howto/estimate", 0))
    assert study.log.kind == "csv"
    assert study.calibration.method == "joint"


def test_the_keys_for_parts_of_ones_own_are_accepted(tmp_path: Path):
    (tmp_path / "own_parts.py").write_text(OWN_PARTS)
    (tmp_path / "study.yaml").write_text(study_with("howto/own_parts", 0, bound=False))
    study = load_study(tmp_path / "study.yaml")
    problem = study.problem
    assert [getattr(one, "label", one) for one in study.file.baselines] == ["square", "zigzag"]
    kinds = [one.kind for one in (*problem.measurement.sensors, problem.criterion)]
    assert kinds == ["poses", "compass", "log_smallest"]
    assert [limit.name for limit in problem.limits] == ["wheel_speed", "strip"]


def test_the_changes_begin_with_this_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (first, *_) = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), flags=re.MULTILINE)
    assert first == project["version"]


def test_every_robot_is_listed():
    for model in MODELS:
        assert f"`{model.model_fields['kind'].default}`" in PAGES["howto/limits"]
    for name in preset_names():
        assert f"`{name}`" in PAGES["howto/limits"]


def test_every_command_is_listed(capsys: pytest.CaptureFixture[str]):
    assert main([]) == 2
    commands = re.findall(r"^    (\w+) {2,}\S", capsys.readouterr().out, flags=re.MULTILINE)
    assert len(commands) >= 14
    assert [one for one in commands if f"| `oed {one} " not in PAGES["reference/command_line"]] == ["schema"]


@pytest.mark.slow
def test_the_estimate_shown_is_that_of_the_shipped_log():
    (text,) = [block for block in blocks("howto/estimate", "text") if block.startswith("parameter")]
    study = load_study(PROBLEMS / "room_robot.yaml")
    found = estimate(study, [PROBLEMS / "logs" / "room_robot.csv"])
    for row in estimate_rows(found):
        assert any(line.split() == " ".join(row).split() for line in text.splitlines())


QUICKER = {
    "equations": (
        ("Ipopt(starts=4)", "Ipopt(starts=1, perturbations=0)"),
        ("Ipopt(starts=4,", "Ipopt(starts=1,"),
        ('integrator="radau",', 'integrator="radau", substeps=1,'),
        ("perturbations=0), seed=0).t", "perturbations=0, max_iterations=4), seed=0).t"),
    )
}
"""Searches and steps that find the same, digit by digit, from fewer starts, steps and iterations."""


@pytest.mark.slow
@pytest.mark.parametrize("page", ["own_parts", "equations"])
def test_python_runs_and_prints_what_is_said(
    page: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(ROOT)
    text = "\n".join(blocks(f"howto/{page}", "python"))
    for long, short in QUICKER.get(page, ()):
        assert long in text
        text = text.replace(long, short)
    exec(compile(text, f"{page}.md", "exec"), {})
    printed = capsys.readouterr().out
    said = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("# ")]
    assert said == printed.splitlines()


COMMANDS = [
    shlex.split(line, comments=True)
    for text in blocks("reference/command_line", "sh") + blocks("howto/estimate", "sh")
    for line in text.splitlines()
    if line.startswith("oed")
]


SHORTER = {
    "solve problems/choi_paper_table.yaml": ("starts: 12", "starts: 1, perturbations: 0, max_iterations: 10"),
    "evaluate problems/room_robot.yaml": ("20 s\n  samples: 100", "5 s\n  samples: 25"),
}
"""What is less in studies of commands that take long."""


@pytest.mark.slow
@pytest.mark.usefixtures("blank_figures")
@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_commands_run(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(ROOT)
    # One start and few samples: that a whole search is a good one, and a bound tight, is shown elsewhere.
    if " ".join(words[1:3]) in SHORTER:
        long, short = SHORTER[" ".join(words[1:3])]
        text = Path(words[2]).read_text()
        assert long in text
        words = [*words[:2], str(tmp_path / Path(words[2]).name), *words[3:]]
        Path(words[2]).write_text(text.replace(long, short))
    out = ["--out", str(tmp_path / "out")] if words[1] == "estimate" else []
    assert main([*words[1:], *out]) == 0
    assert capsys.readouterr().out


def test_the_film_is_small():
    assert (DOCS / "_static" / "drive.gif").stat().st_size < 500_000
