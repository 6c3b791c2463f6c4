"""A small campaign: some 70 cases of those that `make campaign` runs by the thousand."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest
import yaml

from .damage.material import make_material
from .runner import Task, run_case

SEED = 1
PROBLEMS = (19, 20, 22, 24, 25, 26, 33, 46, 51, 57, 60, 73, 89, 101, 104, 107, 113, 127, 138, 147)
"""Of the first 150 a few cheap ones that together have every key and kind of a study, and every verdict, that
the first sixty and 140 have; among them a search from a given start.
"""
EXPERIMENTS = (9, 14, 21, 22, 32, 38, 43, 48, 69, 107)
"""Of the first 120 a few cheap ones that have every kind of key and verdict that the first sixty have."""
CHUNK, FILES = 8, 42


def expect_none(sort: str, indices: Iterable[int], material: Path) -> None:
    """No case fails; else one line for everything that does not hold, with the command that repeats it."""
    tasks = [Task(sort, index, SEED, material, quick=True) for index in indices]
    found = [f"{task.command}: {one.asked}: {one.wrong}" for task in tasks for one in run_case(task).failures]
    assert not found, "\n".join(found)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, len(PROBLEMS), CHUNK))
def test_random_problems(first: int, tmp_path: Path) -> None:
    expect_none("problem", PROBLEMS[first : first + CHUNK], tmp_path)


@pytest.mark.slow
def test_random_experiments(tmp_path: Path) -> None:
    expect_none("experiment", EXPERIMENTS, tmp_path)


@pytest.fixture(scope="module")
def material(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("material")
    make_material(folder, SEED)
    # Without its room, whose bound takes a second: `make campaign` has it.
    logged = folder / "logged.yaml"
    study = yaml.safe_load(logged.read_text(encoding="utf-8"))
    del study["limits"]["workspace"]
    logged.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    return folder


@pytest.mark.slow
def test_damaged_files(material: Path) -> None:
    expect_none("file", range(FILES), material)


@pytest.mark.slow
def test_a_full_disk_and_a_signal(material: Path) -> None:
    expect_none("signal", range(2), material)
