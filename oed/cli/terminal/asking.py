"""Questions at a terminal, each answer checked when it is given: what `oed init` is to write a study for."""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from oed.cli.terminal.messages import ask, say
from oed.foundation.text import words

if TYPE_CHECKING:
    from oed.study.starter import Choice

YES, NO = "yes", "no"
DESIGN = "design"
PURPOSES = {DESIGN: "the best drive to estimate from", "estimate": "only estimates, from logs that there are"}
"""What a study is for."""
WIDTH = 80
"""Columns of a list of choices."""
Check = Callable[[str], object]
"""Raises a `UserMistake` for an answer that will not do."""


def choice_of(options: argparse.Namespace) -> tuple[Choice, Path]:
    """What `oed init` is to write a study for, and the file: from its options, and asked for at a terminal
    where missing. Whether a file may be written over comes first.

    Raises:
        UserMistake: no robot given and nobody there to ask, a file that is there, options that will not do.
    """
    from oed.foundation.errors import UserMistake
    from oed.study.starter import Choice, require_readable, robots, sizes_needed

    asking = _Asking(sys.stdin.isatty() and not options.json)
    if options.file:
        _require_free(Path(options.file), options.force, asking)
    robot = options.robot or asking.answer("Which robot", None, sizes_needed, dict.fromkeys(robots(), ""))
    if robot is None:
        raise UserMistake(f"give --robot, one of {', '.join(robots())}")
    file = Path(options.file or f"{robot}.yaml")
    sizes_needed(robot)
    if not options.file:
        _require_free(file, options.force, asking)
    choice = Choice(
        robot, sizes=dict(options.size), runs=options.runs or 1, designs=_designs(options, asking)
    )
    if options.room or options.size:
        # What was given is wrong before anything is asked for.
        require_readable(_in_room(choice, options.room))
    return _completed(choice, options, asking), file


def _designs(options: argparse.Namespace, asking: _Asking) -> bool:
    # What is given of a drive says that there is to be one.
    from oed.foundation.errors import UserMistake

    of_drives = {"--room": options.room, "--duration": options.duration, "--runs": options.runs}
    given = [name for name, value in of_drives.items() if value]
    if options.only_estimate and given:
        raise UserMistake(f"--only-estimate designs no drive; leave {' and '.join(given)} out")
    if options.only_estimate or given:
        return not options.only_estimate
    return asking.answer("What for", DESIGN, _anything, PURPOSES) == DESIGN


def _anything(text: str) -> None:
    # Whether it is listed is looked at before.
    return


def _completed(choice: Choice, options: argparse.Namespace, asking: _Asking) -> Choice:
    from oed.study.offered import OFFERS, sensor_meant
    from oed.study.starter import noise_needed, require_readable, sizes_needed, skids, usual_duration

    choice = _each(choice, "sizes", sizes_needed(choice.robot), "Its {}", asking)
    if choice.designs:
        room = options.room or asking.answer(
            "Which room ('4 m x 3 m' or 'circle 2 m')", choice.room, _tried(choice, "room")
        )
        choice = _in_room(choice, room)
    sensors = {name: one.text for name, one in OFFERS.items()}
    sensor = options.sensor or asking.answer(
        "Which sensor", "poses", _tried(choice, "sensor"), sensors, sensor_meant
    )
    choice = replace(choice, sensor=sensor or "poses", noise=dict(options.noise))
    usual = noise_needed(choice.robot, choice.sensor)
    choice = _each(choice, "noise", usual, "Standard deviation of its noise: {}", asking)
    if not choice.designs:
        require_readable(choice)
        return choice
    duration = options.duration or asking.answer(
        "How long may a drive take", usual_duration(choice.robot), _tried(choice, "duration")
    )
    choice = replace(choice, duration=duration)
    if not options.runs and not skids(choice.robot):
        # What is a pilot drive is one.
        runs = asking.answer("How many drives of that length, designed together", "1", _whole)
        choice = replace(choice, runs=int(runs or 1))
    require_readable(choice)
    return choice


def _whole(text: str) -> None:
    from oed.cli.terminal.arguments import positive
    from oed.foundation.errors import UserMistake

    try:
        positive(text)
    except argparse.ArgumentTypeError as error:
        raise UserMistake(str(error)) from None


def _tried(choice: Choice, name: str, key: str | None = None) -> Check:
    # Whether a study can be made of an answer, beside those that were given before.
    from oed.study.starter import require_readable

    def check(text: str) -> None:
        value = text if key is None else {**getattr(choice, name), key: text}
        require_readable(replace(choice, **{name: value}))  # type: ignore[arg-type]

    return check


def _each(choice: Choice, name: str, usual: Mapping[str, str], question: str, asking: _Asking) -> Choice:
    # Entries of a table of the choice that are not given; where nobody is there, they are the usual ones.
    for key, typical in usual.items() if asking.possible else ():
        given = getattr(choice, name)
        if key not in given:
            text = asking.answer(question.format(words(key)), typical, _tried(choice, name, key))
            choice = replace(choice, **{name: {**given, key: text or typical}})  # type: ignore[arg-type]
    return choice


def _in_room(choice: Choice, room: str | None) -> Choice:
    return replace(choice, room=room) if room else choice


def _require_free(file: Path, force: bool, asking: _Asking) -> None:
    # Nobody is asked ten questions for a file that is not to be written.
    from oed.foundation.errors import UserMistake
    from oed.records.record import require_no_results

    require_no_results(file)
    if not file.exists() or force:
        return
    if not asking.agreed(f"{file} exists; write over it"):
        raise UserMistake(f"{file} exists; give another name, or --force to write over it")


class _Asking:
    """Who answers, if anybody is there."""

    def __init__(self, possible: bool) -> None:
        self.possible = possible

    def answer(
        self,
        question: str,
        default: str | None,
        check: Check,
        choices: Mapping[str, str] | None = None,
        meant: Callable[[str], str] | None = None,
    ) -> str | None:
        """An answer that will do; the default where nobody is there.

        Args:
            question: without its question mark.
            default: that an empty line stands for.
            check: of an answer.
            choices: that there are, each with what it is; they are listed once. None for any answer.
            meant: what is said of an answer that is no choice; by default what is spelt alike.
        """
        if self.possible and choices:
            say("\n".join(_listed(choices)))
        shown = f" [{default}]" if default else ""
        while self.possible:
            given = ask(f"{question}{shown}")
            if given is None:
                break
            text = given or default
            if text and (wrong := _reason_against(text, check, choices or {}, meant)):
                say(f"  {wrong}")
            elif text:
                return text
        return default

    def agreed(self, question: str) -> bool:
        """Whether somebody is there and says yes, or y."""
        while self.possible:
            given = ask(f"{question} (yes, no) [{NO}]")
            text = (given or NO).lower()
            if text in (YES, NO, YES[0], NO[0]):
                return text[0] == YES[0]
            say(f"  expected {YES} or {NO}, got {given!r}")
        return False


def _listed(choices: Mapping[str, str]) -> list[str]:
    # Names side by side in columns; those with an explanation each on lines of their own.
    wide = max(map(len, choices)) + 2
    if any(choices.values()):
        gap = " " * (wide + 2)
        return [
            textwrap.fill(text, WIDTH, initial_indent=f"  {name:<{wide}}", subsequent_indent=gap)
            for name, text in choices.items()
        ]
    names, columns = list(choices), (WIDTH - 2) // wide
    rows = -(-len(names) // columns)
    return ["  " + "".join(f"{name:<{wide}}" for name in names[row::rows]).rstrip() for row in range(rows)]


def _reason_against(
    text: str, check: Check, choices: Mapping[str, str], meant: Callable[[str], str] | None
) -> str:
    from oed.foundation.errors import UserMistake
    from oed.foundation.text import did_you_mean

    if choices and text not in choices:
        hint = did_you_mean(text, choices) if meant is None else meant(text)
        return f"{text!r}: not listed{hint}"
    try:
        check(text)
    except UserMistake as error:
        return str(error)
    return ""
