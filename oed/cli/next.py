"""`oed next`: the drive that adds most information to that of logs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from oed.cli.terminal.arguments import add_trust, add_working, duration, pair, share, workers_of
from oed.cli.terminal.command import DONE, FAILED, Command, cut_short, noted, place, reported, saved, verdict

if TYPE_CHECKING:
    from oed.workflow.next_drive import NextDrive


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_working(parser)
    parser.add_argument("folder", metavar="DIR", help="the record of the design that was driven")
    parser.add_argument("logs", metavar="LOG", nargs="+", help="of the drives since, all together")
    parser.add_argument(
        "--target",
        metavar="PARAMETER=SIZE",
        type=pair,
        action="append",
        default=[],
        help="standard error wanted, e.g. 'track=0.2 mm' or 'track=0.1 %%'; may be given again",
    )
    parser.add_argument(
        "--least-gain",
        type=share,
        help="share of the worst standard error that another drive has to take away (default: 0.05)",
    )
    parser.add_argument(
        "--duration", type=duration, help="of the next drive, e.g. '20 s' (default: that of the last)"
    )
    parser.add_argument("--out", metavar="DIR", help="where to write (default: DIR/next/)")
    add_trust(parser)


def _run(options: argparse.Namespace) -> int:
    from oed.cli.terminal.console import print_next, progress
    from oed.cli.terminal.messages import print_json, say, tell
    from oed.foundation.files import inside
    from oed.records.record import load_record
    from oed.report.film.animation import folder_of
    from oed.workflow.next_drive import LEAST_GAIN, next_drive

    out = Path(options.out) if options.out else inside(folder_of(options.folder), "next")
    workers = workers_of(options)
    more = {
        "targets": dict(options.target),
        "duration": options.duration,
        "least_gain": LEAST_GAIN if options.least_gain is None else options.least_gain,
        "out": out,
        "seed": options.seed,
        "workers": workers,
        "trust": options.trust,
    }
    with progress(options.quiet) as listener:
        before = load_record(options.folder)
        found, trouble = saved(lambda: next_drive(before, options.logs, progress=listener, **more))
    interrupted = found.record is not None and found.record.interrupted
    page, unwritten = None, None
    if found.folder is not None and not interrupted:
        page, unwritten = reported(lambda: _pages(found, out), out)
    if options.json:
        print_json({**found.data, **place(found.folder, trouble or unwritten)})
    else:
        print_next(found)
        if page is not None:
            tell(f"report: {page}")
    noted((), trouble or unwritten)
    if interrupted and trouble is None:
        say(cut_short(found.folder, out))
    if trouble or unwritten:
        return FAILED
    return DONE if found.record is None else verdict(found.record)


def _pages(found: NextDrive, out: Path) -> Path:
    from oed.report import write_estimate, write_report

    estimated = write_estimate(found.estimate, out)
    return estimated if found.record is None else write_report(found.record, out)


NEXT = Command(
    "next", "estimate from logs of a saved design, and design the drive that adds most", _run, _arguments
)
