"""What the command line prints: lines that fit and hold what belongs together, one for repeated steps."""

from __future__ import annotations

import io
from itertools import count

from rich.console import Console
from rich.progress import Progress as RichProgress

from oed.cli.terminal.console import _Bars, _print_line


def printed(line: str, width: int) -> list[str]:
    """A line as a terminal of that width shows it."""
    console = Console(file=io.StringIO(), width=width)
    _print_line(console, line)
    return console.file.getvalue().splitlines()


def test_a_number_stays_with_its_unit_and_a_room_with_its_sides() -> None:
    title = "Laser tracker: a drive of 20 s in a room of 2 m x 2 m"
    for width in range(12, 60):
        lines = printed(title, width)
        assert " ".join(lines) == title
        assert max(map(len, lines)) <= width
        assert sum("20 s" in line for line in lines) == 1
        assert sum("2 m x 2 m" in line for line in lines) == 1


def test_stages_of_one_step_take_each_others_place() -> None:
    bars = RichProgress(console=Console(file=io.StringIO()))
    listener = _Bars(bars)
    for stage, total in (("read", 1), ("fit", 1), ("starts", 4), ("second stage", 1), ("bound", 1)):
        listener.begin(stage, total)
        listener.advance()
    listener.end()
    assert [task.description for task in bars.tasks] == ["starts", "bound"]


def test_the_clock_of_a_stage_that_ends_early_stops_with_it() -> None:
    clock = count()
    bars = RichProgress(console=Console(file=io.StringIO()), get_time=lambda: float(next(clock)))
    listener = _Bars(bars)
    listener.begin("explore", 100)
    listener.advance()
    listener.begin("starts", 4)
    explored, _ = bars.tasks
    assert (explored.completed, explored.total) == (1, 1)
    took = explored.elapsed
    listener.advance()
    assert explored.elapsed == took
    # The thread that draws the bars ends.
    listener.end()
