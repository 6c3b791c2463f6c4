"""The command that designs, waits for logs and estimates until it is enough: `oed loop`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from oed.cli.terminal.arguments import add_working, aim, duration, positive, share, workers_of
from oed.cli.terminal.command import DONE, FAILED, Command, CommandResult
from oed.cli.terminal.messages import say, tell
from oed.foundation.shown import shown

if TYPE_CHECKING:
    from oed.workflow.loop import Loop

GOES_ON = "; the same command goes on where this one stopped"
"""What is to be known of an interrupted loop."""
NOT_BEGUN = "interrupted: the first drive had not been designed by then; the same command begins anew"
"""The same of one that has nothing to go on with, and nothing to report."""


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_working(parser)
    parser.add_argument("study", metavar="STUDY", help="of the first drive, and of how logs are read")
    parser.add_argument(
        "--target",
        metavar="'PARAMETER SIZE'",
        type=aim,
        action="append",
        default=[],
        help="standard error wanted, e.g. 'track 0.2 mm' or 'track 0.1 %%'; may be given again",
    )
    parser.add_argument("--logs", metavar="DIR", required=True, help="folder that logs come into")
    parser.add_argument(
        "--export",
        metavar="FORMAT",
        default="csv",
        help="of the drive: csv (default), json, rosbag2 or ros2_node",
    )
    parser.add_argument(
        "--command",
        dest="drive_command",
        metavar="COMMAND",
        help="what drives, and leaves a log; {drive} and {logs} in it are the file and the folder",
    )
    parser.add_argument("--pattern", help="of the logs' names, e.g. '*.csv' (default: all that may be logs)")
    parser.add_argument("--most", type=positive, help="drives at most (default: 10)")
    parser.add_argument(
        "--least-gain",
        type=share,
        help="share of the worst standard error that another drive has to take away (default: 0.05)",
    )
    parser.add_argument(
        "--duration", type=duration, help="of the drives after the first, e.g. '20 s' (default: the same)"
    )
    parser.add_argument("--poll", type=duration, help="time between looks for a log (default: '1 s')")
    parser.add_argument(
        "--settle", type=duration, help="for which a log may not change to be complete (default: '10 s')"
    )
    parser.add_argument("--out", metavar="DIR", help="where to write (default: reports/<file stem>-loop/)")


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import progress
    from oed.records.record import LOOP_FILE
    from oed.report import write_loop
    from oed.workflow.loop import loop
    from oed.workflow.studies import load_study

    out = Path(options.out) if options.out else Path("reports") / f"{Path(options.study).stem}-loop"
    names = ("most", "least_gain", "duration", "pattern", "poll", "settle")
    given = {name: value for name in names if (value := getattr(options, name)) is not None}
    study, workers = load_study(options.study), workers_of(options)
    with progress(options.quiet) as listener:
        done = loop(
            study,
            options.logs,
            out,
            targets=dict(options.target),
            to=options.export,
            command=options.drive_command,
            seed=options.seed,
            workers=workers,
            progress=listener,
            # What to drive is said where no progress is shown, too.
            tell=getattr(listener, "say", say),
            written=_pages,
            **given,
        )
    folder = done.folder if (done.folder / LOOP_FILE).is_file() else None
    outcome = CommandResult(folder, out, None, done.interrupted and folder is not None, GOES_ON)
    outcome.report(lambda: write_loop(done.found, out))
    outcome.show(options, {**done.data, **outcome.place}, lambda: _print(done))
    if folder is None:
        say(NOT_BEGUN)
    # Where nothing is wanted, it ends when another drive gains little.
    enough = done.reached or (done.found.finished and not options.target)
    return DONE if enough and not (done.interrupted or outcome.trouble) else FAILED


def _pages(folder: Path) -> None:
    # The whole loop's, with its estimate; of a round that of its design.
    from oed.records.record import FILE, LOOP_FILE, load_estimate, load_loop, load_record
    from oed.report import write_estimate, write_loop, write_report

    if (folder / LOOP_FILE).is_file():
        write_estimate(load_estimate(folder), folder)
        write_loop(load_loop(folder), folder)
    elif (folder / FILE).is_file():
        write_report(load_record(folder), folder)


def _print(done: Loop) -> None:
    from oed.cli.terminal.console import print_precision

    if done.found.driven:
        print_precision(done.found.driven[-1].known)
    if done.found.reason:
        tell(shown(done.found.reason))


LOOP = Command(
    "loop", "design, wait for the log, estimate, and again, until parameters are known", _run, _arguments
)
