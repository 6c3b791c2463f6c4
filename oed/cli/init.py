"""`oed init`: a first study."""

from __future__ import annotations

import argparse
from pathlib import Path

from oed.cli.terminal.arguments import pair, positive
from oed.cli.terminal.command import DONE, Command


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="STUDY", nargs="?", help="what to write (default: ROBOT.yaml)")
    parser.add_argument("--robot", help="a preset or a kind of robot; asked for where not given")
    parser.add_argument("--room", help="like '4 m x 3 m' or 'circle 2 m'")
    parser.add_argument("--sensor", help="poses, positions, ranges or displacements")
    parser.add_argument(
        "--size",
        metavar="KEY=VALUE",
        type=pair,
        action="append",
        default=[],
        help="a constant of the robot, e.g. 'track=18 cm'; may be given again",
    )
    parser.add_argument("--duration", help="of one run, e.g. '20 s'")
    parser.add_argument("--runs", type=positive, default=1, help="separate drives designed together")
    parser.add_argument("--force", action="store_true", help="write over a file that exists")


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import choice_of
    from oed.cli.terminal.messages import print_json, say
    from oed.foundation.errors import UserMistake
    from oed.foundation.files import write_text
    from oed.records.record import require_no_results
    from oed.study.starter import starter

    choice = choice_of(options)
    file = Path(options.file or f"{choice.robot}.yaml")
    if file.exists() and not options.force:
        raise UserMistake(f"{file} exists; give another name, or --force to write over it")
    require_no_results(file)
    write_text(file, starter(choice))
    if options.json:
        print_json({"study": str(file)})
    else:
        say(f"wrote {file}; change what is yours, then: oed run {file}")
    return DONE


INIT = Command("init", "write a first study for a robot, a room and a sensor", _run, _arguments)
