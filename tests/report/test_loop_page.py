"""The page of a loop."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from oed.records.stored.loop import KnownParameter, LoopRound, StoredLoop
from oed.report import write_loop

pytestmark = pytest.mark.usefixtures("blank_figures")


def rounds_of(count: int, wanted: float | None, **changes: Any) -> StoredLoop:
    known = {"name": "track", "unit": "m", "value": 0.16, "size": 0.16, "wanted": wanted}
    rounds = [
        LoopRound(
            folder=f"round{n}",
            logs=[f"{n}.csv"],
            known=[KnownParameter(**known, now=1e-3 / n, next=1e-3 / (n + 1))],
        )
        for n in range(1, count + 1)
    ]
    state = {"seen": [], "reached": False, "finished": False, "reason": "drive it"} | changes
    return StoredLoop(format=1, oed_version="0", name="Mine", study="0", asked={}, rounds=rounds, **state)


@pytest.mark.slow
class TestPage:
    """Of a single parameter: its own unit."""

    @pytest.mark.parametrize(
        ("loop", "title"),
        [
            (rounds_of(2, 1e-4), "## After 2 drives; the next one is to be driven"),
            (rounds_of(1, 1e-4, finished=True), "## Ended after 1 drive, short of what is wanted"),
            (rounds_of(2, None, finished=True), "## Ended after 2 drives"),
            (rounds_of(2, 1e-2, finished=True, reached=True), "## Enough after 2 drives"),
            (rounds_of(0, None), "## The first drive is to be driven"),
        ],
    )
    def test_says_how_it_stands(self, tmp_path: Path, loop: StoredLoop, title: str):
        write_loop(loop, tmp_path)
        page = (tmp_path / "report.md").read_text()
        assert title in page.splitlines()
        wanted = any(one.wanted for each in loop.rounds for one in each.known)
        assert ("| wanted |" in page) == wanted
        assert (tmp_path / "figures" / "precision.svg").exists() == (len(loop.rounds) > 1)
