"""What is wrong in the lines of a car-sized tricycle is named by file and line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from public_sets import CAR_HEAD, car

from oed.cli import main

FIRST = len(CAR_HEAD.splitlines()) + 1
"""Line of the first row."""
Broken = Callable[[list[str]], list[str]]


def cell(place: int, text: str) -> Broken:
    return lambda words: [*words[:place], text, *words[place + 1 :]]


@pytest.mark.parametrize(
    "broken",
    [
        cell(1, "yesterday"),
        cell(1, "1568091584.8"),
        cell(3, "9000"),
        cell(3, "nan"),
        cell(4, "-"),
        cell(4, "1e12"),
        cell(10, "lost"),
        cell(11, "inf"),
        lambda words: words[:-1],
        lambda words: [*words, "0.5"],
    ],
    ids=["text", "back", "beyond", "nan", "dash", "far beyond", "lost", "infinite", "short", "long"],
)
def test_a_line(broken: Broken, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = car(tmp_path, 0, seconds=3.0)
    lines = file.read_text(encoding="utf-8").splitlines()
    lines[FIRST + 19] = " ".join(broken(lines[FIRST + 19].split()))
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    out = tmp_path / "out"
    study = Path(__file__).parent / "tricycle.yaml"
    assert main(["estimate", str(study), str(file), "--out", str(out), "--quiet"]) == 2
    assert f"{file.name}:{FIRST + 20}" in "".join(capsys.readouterr().err.split())
    assert not out.exists()
