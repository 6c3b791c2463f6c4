"""A small campaign: some 90 cases of those that `make campaign` runs by the thousand."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest
import yaml

from .damage.material import make_material
from .runner import Task, run_case

SEED = 1
PROBLEMS = (
    *(0, 2, 4, 6, 8, 9, 10, 11, 13, 16, 17, 18, 19, 20, 22, 23, 25, 26, 29, 31, 32, 33, 36, 41, 46, 48),
    *(49, 50, 51, 56, 57, 140),
)
"""Of the first sixty those that together go through every branch of the package, and have every key and kind
of a study, that all sixty do; 140 searches from a given start, which takes 39 ten times as long.
"""
EXPERIMENTS = (3, 21, 22, 26, 27, 32, 36, 38, 44, 48, 51, 58)
"""Of the first sixty those that together have every kind of key and verdict that all sixty have."""
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
