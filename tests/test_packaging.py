"""What is shipped: wheel and sdist hold all that is read from them, and nothing that is no part of them."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from places import PROBLEMS, ROOT

wheel = pytest.importorskip("hatchling.builders.wheel", reason="what builds the package is not installed")
sdist = pytest.importorskip("hatchling.builders.sdist")

pytestmark = pytest.mark.slow
ALWAYS = {"pyproject.toml", ".gitignore"}
"""What every sdist gets from hatchling."""
LIGHT = 2_000_000
"""Bytes of all data that a wheel may hold beside Python files, before it is compressed."""


def shipped(builder: Callable[[str], object]) -> dict[str, Path]:
    """The files that a builder packs, by the names that they get."""
    return {
        Path(one.distribution_path).as_posix(): Path(one.path)
        for one in builder(str(ROOT)).recurse_included_files()
    }


@pytest.fixture(scope="module")
def in_wheel() -> dict[str, Path]:
    return shipped(wheel.WheelBuilder)


@pytest.fixture(scope="module")
def in_sdist() -> dict[str, Path]:
    return shipped(sdist.SdistBuilder)


def below(folder: str) -> set[str]:
    """Names, relative to the root, of all files below a folder of it that Python has not made."""
    found = (one for one in (ROOT / folder).rglob("*") if one.is_file() and one.parent.name != "__pycache__")
    return {one.relative_to(ROOT).as_posix() for one in found}


def test_a_wheel_holds_the_package_and_the_examples(in_wheel: dict[str, Path]):
    assert set(in_wheel) == below("oed") | {f"oed/{name}" for name in below("problems")}
    # Each kind of file that is read when the package runs.
    kinds = {
        "oed/py.typed",
        "oed/__init__.pyi",
        "oed/study/__init__.pyi",
        "oed/study/templates/first_study.yaml.jinja",
        "oed/exporters/templates/ros2_node.py.jinja",
        "oed/report/templates/report.html.jinja",
        "oed/report/templates/player.js",
        "oed/report/templates/prose/answer.jinja",
        "oed/robots/presets/turtlebot3_burger.yaml",
        "oed/problems/choi_skid_steer.yaml",
        "oed/problems/own_robot.py",
        "oed/problems/logs/room_robot.csv",
        "oed/problems/published/box_lucas.yaml",
    }
    assert kinds <= set(in_wheel)


def test_a_wheel_is_light(in_wheel: dict[str, Path]):
    assert sum(one.stat().st_size for one in in_wheel.values() if one.suffix != ".py") < LIGHT
    assert sum(one.stat().st_size for one in PROBLEMS.rglob("*") if one.is_file()) < LIGHT / 4


def test_an_editable_install_copies_nothing():
    # Copies of the examples would stay as they were when the package was installed.
    builder = wheel.WheelBuilder(str(ROOT))
    assert builder.config.dev_mode_dirs == ["."]
    assert builder.config.get_force_include() == {}


def test_an_sdist_holds_what_its_tests_and_its_wheel_need(in_sdist: dict[str, Path]):
    needed = {"README.md", "CONTRIBUTING.md", "CHANGELOG.md", "LICENSE", "Makefile"}
    needed |= below("oed") | below("problems") | below("tests")
    assert needed <= set(in_sdist)


@pytest.mark.skipif(shutil.which("git") is None or not (ROOT / ".git").exists(), reason="no clone by git")
def test_nothing_is_shipped_but_what_is_kept_in_the_repository(
    in_wheel: dict[str, Path], in_sdist: dict[str, Path]
):
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    kept = set(
        subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\n")
    )
    for files in (in_wheel, in_sdist):
        assert {one.relative_to(ROOT).as_posix() for one in files.values()} <= kept
    # All of it is in an sdist, but for what runs the tests of the repository itself.
    there = {name for name in kept - {""} if (ROOT / name).exists()}
    assert there - set(in_sdist) - ALWAYS == {".ci/run"}
